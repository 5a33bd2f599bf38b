"""``bussim size`` of Modbus poll lists: what it prints, its JSON form, its exit code."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

import bussim
from bussim.cli import main
from bussim.commands.size.command import command as size
from bussim.units import TICKS_PER_MS

LINE = """\
schema: 1
name: meters
duration: 10 s
buses: [{name: b, baud: 19200, format: 8N1}]
plcs:
  - name: p
    scan: 10 ms
    ports: {COM3: {bus: b, protocol: modbus-rtu-master, timeout: 200 ms}}
    polls:
      - {name: m1, port: COM3, station: 1, function: 3, address: 0, count: 2, to: D400}
      - {name: m2, port: COM3, station: 2, function: 3, address: 0, count: 2, to: D410}
devices:
  - {name: s1, model: v80, bus: b, station: 1}
  - {name: s2, model: v80, bus: b, station: 2}
"""


@pytest.fixture
def line(tmp_path: Path) -> str:
    path = tmp_path / "meters.yaml"
    path.write_text(LINE, encoding="utf-8")
    return str(path)


def test_a_scenario_without_a_link_is_sized_and_verified(line: str) -> None:
    done = CliRunner().invoke(size, [line, "--verify", "--json"])
    assert done.exit_code == 0, done.output
    found = json.loads(done.output)
    assert found["links"] == {}
    port = found["ports"]["p.COM3"]
    assert port["recommended"]["timeout_ms"] == 10
    assert {"retries", "interval_ms"} < set(port["recommended"])
    with_noise, off = port["verify"]
    assert with_noise["agrees"] is off["agrees"] is True
    assert with_noise["failed_attempts"] > 20
    assert off["dead"] in {"s1", "s2"}
    shown = CliRunner().invoke(size, [line]).output
    assert "2 devices" not in shown
    assert "settings with an interval of 5 ms: times in ms" in shown
    assert f"recommended: timeout 10 ms, {port['recommended']['retries']} retries" in shown
    assert "MOV K1 D7929  ; timeout: 10 ms" in shown


def test_as_many_attempts_are_simulated_where_polls_have_a_period(line: str) -> None:
    seldom = ["--set", "plcs.p.polls.m1.every=1s", "--set", "plcs.p.polls.m2.every=1s"]
    done = CliRunner().invoke(size, [line, "--verify", "--json", *seldom])
    assert done.exit_code == 0, done.output
    with_noise, _ = json.loads(done.output)["ports"]["p.COM3"]["verify"]
    assert 2_500 < with_noise["attempts"] < 4_000


def test_no_timeout_is_shorter_than_a_response_of_a_run(
    line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    slow, late = str(tmp_path / "slow"), str(tmp_path / "late")
    run = ["run", line, "--duration", "2s", "--no-plots"]
    assert main([*run, "--set", "devices.s2.delay=43ms", "--out", slow]) == 0
    short = ["--set", "plcs.p.ports.COM3.timeout=40ms", "--set", "devices.s1.delay=38ms"]
    assert main([*run, *short, "--out", late]) == 0
    capsys.readouterr()
    longest = json.loads((tmp_path / "slow" / "summary.json").read_text("utf-8"))["ports"]["p.COM3"]
    assert 40 < longest["response_ms"]["max"] < 50
    assert main(["size", line, "--responses", slow, "--json"]) == 0
    out, err = capsys.readouterr()
    port = json.loads(out)["ports"]["p.COM3"]
    assert (port["timeout_floor_ms"], port["recommended"]["timeout_ms"], err) == (50, 50, "")
    (sizing,) = bussim.size(line, responses={"p.COM3": 91.2}).ports.values()
    assert sizing.least == 100 * TICKS_PER_MS
    assert main(["size", line, "--responses", late, "--json"]) == 0
    assert "came after the timeout" in capsys.readouterr().err
    assert main(["size", "feeder_off", "--responses", slow]) == 2
    said = capsys.readouterr().err
    assert "responses of p.COM3: no Modbus master of feeder off; did you mean press.COM5?" in said
    assert main(["size", "two_stations", "--responses", slow]) == 2
    assert "it has none" in capsys.readouterr().err
    assert main(["size", line, "--responses", line]) == 2
    assert "is a file, not the folder of a run" in capsys.readouterr().err


@pytest.mark.slow
def test_a_fitted_recording_has_no_response_that_outlasts_its_timeout(line: str, tmp_path: Path) -> None:
    run, fitted = tmp_path / "run", tmp_path / "fitted.yaml"
    slower = ["--set", "devices.s2.delay=33ms", "--set", "devices.s2.jitter=12ms"]
    assert main(["run", line, *slower, "--duration", "60s", "--trace", "--no-plots", "--out", str(run)]) == 0
    assert main(["fit", str(run), "--simulate", "0s", "-o", str(fitted)]) == 0
    longest = bussim.open_run(run).summary["ports"]["p.COM3"]["response_ms"]["max"]
    (sizing,) = bussim.size(fitted).ports.values()
    assert sizing.recommended is not None
    assert longest <= sizing.least / TICKS_PER_MS <= 1.05 * longest + 1
    assert sizing.recommended.timeout >= sizing.least


def test_goals_of_what_a_scenario_lacks_and_goals_that_cannot_be_met(
    line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["size", line, "--goal", "scan<=200ms@1e-6", "--goal", "ride>=100ms"]) == 2
    shown = capsys.readouterr().err
    assert "--goal scan is of N:N links, of which" in shown
    assert "--goal ride" in shown
    assert main(["size", line, "--goal", "cycle<=10ms"]) == 1
    shown = capsys.readouterr().out
    assert "not to be met: a cycle of at most 10 ms without errors: no setting does; the best is" in shown
    assert main(["size", "two_stations", "--goal", "cycle<=10ms"]) == 2
    assert "--goal cycle is of Modbus poll lists" in capsys.readouterr().err
