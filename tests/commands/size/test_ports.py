"""``bussim size`` of Modbus poll lists: what it prints, its JSON form, its exit code."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from bussim.cli import main
from bussim.commands.size.command import command as size

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
    assert f"recommended: timeout 10 ms, {port['recommended']['retries']} retries" in shown
    assert "MOV K1 D7929  ; timeout: 10 ms" in shown


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
