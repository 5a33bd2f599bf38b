from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import bussim
from bussim.cli import main
from tests.live.recordings.generator import rtu
from tests.undrawn import undrawn

SCENARIO = """\
schema: 1
name: two presses
duration: 40 s
seed: 3
buses: [{name: link, nn: true}]
plcs:
  - {name: m, nn: {bus: link, port: COM4, station: 0, slaves: 2, mode: 1, retries: 2, timeout: 60 ms}}
  - name: a
    profile: {base: pw10, turnaround: {mean: 1.5 ms, jitter: 0.5 ms}}
    nn: {bus: link, port: COM4, station: 1}
  - name: b
    profile: {base: pw10, turnaround: {values: [1 ms, 2 ms, 7 ms], weights: [1, 1, 2]}}
    nn: {bus: link, port: COM4, station: 2}
noise:
  - {bus: link, station: a, reply_loss: 0.03}
  - {bus: link, ber: 1.0e-5}
faults:
  - {at: 20 s, for: 2 s, power_off: a}
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fit")
    file = folder / "s.yaml"
    file.write_text(SCENARIO, encoding="utf-8")
    with undrawn():
        bussim.run(file, out=folder / "run", trace=True)
    return folder / "run"


def fitted(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, Any]:
    assert main(["fit", *arguments, "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


@pytest.mark.slow
def test_estimates_make_a_scenario_that_behaves_like_the_recording(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "fitted.yaml"
    found = fitted(capsys, str(run), "-o", str(output))
    link = found["link"]
    assert link["settings"] == {"slaves": 2, "mode": 1, "retries": 2, "timeout_ms": 60}
    assert link["stations"]["1"]["turnaround_ms"]["value"] == pytest.approx(1.5, rel=0.02)
    assert link["stations"]["1"]["reply_loss"]["low"] < 0.03 < link["stations"]["1"]["reply_loss"]["high"]
    assert link["ber"]["low"] < 1e-5 < link["ber"]["high"]
    distribution = link["stations"]["2"]["law"]
    assert set(distribution["values_ms"]) == {1, 2, 7}  # not uniform: measured
    assert distribution["uniform_p"] < 0.01
    # The same distribution in two runs: a distance that happens once in a thousand times is refused.
    assert found["comparison"]["p"] > 0.001
    assert found["comparison"]["simulated_ms"]["mean"] == pytest.approx(
        found["comparison"]["measured_ms"]["mean"], rel=0.03
    )
    made = bussim.load(output)
    assert [plc.name for plc in made.plcs] == ["m", "a", "b"]
    assert made.duration == bussim.load(run / "scenario.yaml").duration
    assert made.plcs[1].profile.turnaround.mean == pytest.approx(1.5 * 72_000, rel=0.02)
    assert len(made.faults) == 1
    text = output.read_text(encoding="utf-8")
    assert text.startswith("# Made by bussim")
    assert main(["fit", str(run), "-o", str(output)]) == 2
    assert "--force" in capsys.readouterr().err


def test_estimates_are_put_into_a_given_scenario(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    base, output = tmp_path / "base.yaml", tmp_path / "out.yaml"
    text = SCENARIO.replace("mean: 1.5 ms, jitter: 0.5 ms", "mean: 9 ms, jitter: 1 ms")
    text = text.replace("reply_loss: 0.03", "reply_loss: 0.5").replace("name: two presses", "name: kept")
    base.write_text(text, encoding="utf-8")
    fitted(capsys, str(run), "--scenario", str(base), "-o", str(output), "--simulate", "0 s")
    made = bussim.load(output)
    assert made.name == "kept"
    assert made.plcs[1].profile.turnaround.mean == pytest.approx(1.5 * 72_000, rel=0.02)
    losses = [noise.kind.probability for noise in made.noise if hasattr(noise.kind, "probability")]
    assert max(losses) < 0.1
    assert len(made.faults) == 1


@pytest.mark.slow
def test_it_shows_both_histograms_and_draws_them(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fit", str(run), "--simulate", "10 s", "--plot", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    for words in (
        "turnaround of a",
        "lost replies of b",
        "bit error rate",
        "Kolmogorov",
        "simulated",
        "silent from 20",
    ):
        assert words in out
    assert (tmp_path / "fit_link.png").is_file()


BUS = """\
schema: 1
name: feeder
duration: 40 s
seed: 2
buses: [{name: feeder, baud: 19200, format: 8E1}]
plcs: [{name: idle}]
devices:
  - {name: one, model: v80, bus: feeder, station: 1, delay: 5 ms, jitter: 4 ms}
  - {name: two, model: v80, bus: feeder, station: 2, delay: 2 ms}
  - name: panel
    model: hmi
    bus: feeder
    timeout: 100 ms
    polls:
      - {station: 1, function: 3, address: 0, count: 10, every: 200 ms}
      - {station: 2, function: 1, address: 4, count: 20, every: 500 ms}
noise:
  - {bus: feeder, station: one, reply_loss: 0.1}
"""


@pytest.mark.usefixtures("pictures_undrawn")
def test_a_modbus_bus(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, output = tmp_path / "s.yaml", tmp_path / "fitted.yaml"
    file.write_text(BUS, encoding="utf-8")
    bussim.run(file, out=tmp_path / "run", trace=True)
    whole = fitted(capsys, str(tmp_path / "run"), "-o", str(output))
    assert whole["comparison"]["verdict"] == "agrees"
    assert whole["comparison"]["tail_judged"]
    assert whole["warnings"] == []
    found = whole["modbus"]
    assert found["timeout_ms"] == 105  # and the pause of 5 ms that a panel keeps
    assert found["timeout_between_ms"] is None
    assert found["burst"]["seen"] in (False, None)
    assert found["master_receiver"]["repeats"] == 0
    assert found["ber"]["value"] == 0  # what is lost is not damaged
    assert found["protocol"] == "modbus-rtu"
    every = {poll["station"]: (poll["every_ms"], poll["periodic"]) for poll in found["polls"]}
    assert every[1] == (pytest.approx(200, rel=0.01), True)
    assert every[2] == (pytest.approx(500, rel=0.01), True)
    one = found["stations"]["1"]
    assert one["reply_loss"]["low"] < 0.1 < one["reply_loss"]["high"]
    assert one["delay_ms"]["value"] == pytest.approx(7, rel=0.1)  # and up to the silence that ends a request
    made = bussim.load(output)
    assert {device.name: device.model for device in made.devices} == {
        "master": "hmi",
        "station1": "map",
        "station2": "map",
    }
    bussim.run(made)


def test_mistakes(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    silence = tmp_path / "silence.txt"
    silence.write_text("0.0 00\n", encoding="utf-8")
    other = tmp_path / "other.yaml"
    other.write_text(SCENARIO.replace("link", "line"), encoding="utf-8")
    for arguments, said in (
        ([str(tmp_path / "none")], "is no file and no folder"),
        ([str(run), "--scenario", str(other)], "no PLCs on an N:N link 'link'"),
        ([str(run), "--bus", "x"], "no bus 'x'"),
        ([str(run), "--simulate", "5"], "without a unit"),
    ):
        assert main(["fit", *arguments]) == 2, arguments
        err = capsys.readouterr().err
        assert said in err
        assert "Traceback" not in err
    for arguments, said in (
        ([str(silence)], "no protocol is recognised"),
        ([str(silence), "--protocol", "modbus-rtu"], "no exchange was recognised in 1 character"),
    ):
        assert main(["fit", *arguments]) == 1
        assert said in capsys.readouterr().err


def test_more_polls_than_a_scenario_may_have(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Those that come most often stay, and the share of the others is told."""
    path, output, rows = tmp_path / "line.txt", tmp_path / "fitted.yaml", []
    for turn in range(2):
        for number in range(230 if turn else 200, -1, -1):
            head = bytes((1 + number % 7, 3))
            at = 0.05 * (len(rows) // 2)
            rows += [
                f"{at + 0.01:.6f} {rtu(head, 0, number, 0, 1).hex()}",
                f"{at + 0.02:.6f} {rtu(head, 2, 0, 7).hex()}",
            ]
    path.write_text("\n".join(rows), encoding="utf-8")
    found = fitted(capsys, str(path), "-b", "19200", "-P", "none", "--simulate", "0 s", "-o", str(output))
    (warning,) = (each["text"] for each in found["warnings"] if each["code"] == "left_out")
    assert "31 polls, 7.4% of turns" in warning  # 31 that came once and one that came twice
    assert len(bussim.load(output).source["devices"][0]["polls"]) == 200
