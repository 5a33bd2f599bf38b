"""``bussim sweep``, end to end."""

from __future__ import annotations

import csv
import io
import json
import re
import sys
from pathlib import Path

import pytest
import rich.progress

from bussim import api
from bussim.cli import main
from bussim.commands import sweep
from bussim.commands.common import progress
from bussim.results.store.safe_names import from_cell
from bussim.sweep import plots, run
from bussim.sweep.plan import Plan
from tests.sweep.samples import BER, RETRIES, TIMEOUT, HereExecutor, noisy


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with a scenario in it."""
    monkeypatch.chdir(tmp_path)
    noisy(tmp_path)
    return tmp_path


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """No other processes, no real runs, no pictures."""
    monkeypatch.setattr(run, "open_executor", lambda *_: HereExecutor(real=False))
    monkeypatch.setattr(plots, "draw", lambda *_: [])


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return [{from_cell(key): value for key, value in row.items()} for row in csv.DictReader(file)]


@pytest.mark.usefixtures("pictures_undrawn")
def test_a_sweep_from_the_command_line(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [
        "sweep", "noisy.yaml", "--vary", f"{RETRIES}=0:2:1", "--vary", f"{TIMEOUT}=50ms,100ms",
        "--repeat", "3", "--duration", "500ms", "--seed", "9", "--set", f"{BER}=2e-3", "--workers", "1",
    ]  # fmt: skip
    assert main(arguments) == 0
    said = capsys.readouterr()
    assert said.err == ""
    folder = here / "sweeps" / "noisy"
    assert names(folder) == {
        "sweep.json", "scenario.yaml", "runs.csv", "runs.parquet", "points.csv", "sweep_link.png",
        "sweep_link.svg",
    }  # fmt: skip
    assert said.out.startswith("noisy pair: 18 runs at 6 points\n")
    assert re.search(r"retries +timeout", said.out)
    assert re.search(r"\n +2 +100ms +(\d+\.\d+ ± \d|\d+\.\d\d–\d+\.\d\d\*)", said.out)
    assert re.search(r"station errors +onsets of", said.out)
    assert (
        "* least and greatest run: 3 repeats are too few for a mean within ±10 %; it takes at least "
        in said.out
    )
    assert said.out.endswith(
        f"\nresults: {Path('sweeps/noisy')}\npicture: {Path('sweeps/noisy/sweep_link.png')}\n"
    )
    runs, points = rows(folder / "runs.csv"), rows(folder / "points.csv")
    assert (len(runs), len(points)) == (18, 6)
    assert [(row[RETRIES], row[f"{TIMEOUT}_ms"]) for row in points] == [
        (str(retries), str(timeout)) for retries in range(3) for timeout in (50, 100)
    ]
    # Any row can be run again by itself.
    row = runs[7]
    again = api.load(
        "noisy.yaml",
        [
            f"{RETRIES}={row[RETRIES]}",
            f"{TIMEOUT}={row[f'{TIMEOUT}_ms']} ms",
            f"seed={row['seed']}",
            "duration=500ms",
            f"{BER}=2e-3",
        ],
    )
    link = api.run(again).summary["links"]["link"]
    assert row["link.scans"] == str(link["scans"])
    assert row["link.scan_time_max_ms"] == str(link["scan_time_ms"]["max"])
    assert main(arguments) == 0
    assert "18 runs at 6 points, 18 of them were there already" in capsys.readouterr().out


def test_json_is_the_points_and_nothing_else(
    here: Path, quick: None, capsys: pytest.CaptureFixture[str]
) -> None:
    del here, quick
    assert main(["sweep", "noisy.yaml", "--vary", f"{RETRIES}=0,1", "--repeat", "3", "--json"]) == 0
    said = capsys.readouterr()
    assert said.err == ""
    data = json.loads(said.out)
    assert data["schema"] == 1
    assert data["vary"] == [{"key": RETRIES, "column": RETRIES, "values": [0, 1]}]
    assert (data["repeat"], data["runs"], data["scenario"]) == (3, 6, "noisy pair")
    assert [point["at"] for point in data["points"]] == [{RETRIES: 0}, {RETRIES: 1}]
    scans = data["points"][1]["figures"]["link.scans"]
    assert scans["mean"] == 14.0  # 13, 14 and 15
    assert scans["high"] - 14.0 == pytest.approx(14.0 - scans["low"])
    assert data["points"][0]["figures"]["link.scan_time_p99_ms"] == dict.fromkeys(
        ("mean", "low", "high", "needed")
    )


def test_folders_of_other_sweeps(here: Path, quick: None, capsys: pytest.CaptureFixture[str]) -> None:
    del quick
    one, other = (["sweep", "noisy.yaml", "--vary", f"{RETRIES}={values}"] for values in ("0,1", "2,3"))
    for arguments, name in ((one, "noisy"), (other, "noisy-2"), (one, "noisy"), (other, "noisy-2")):
        assert main(arguments) == 0
        assert f"results: {Path('sweeps') / name}\n" in capsys.readouterr().out
    assert names(here / "sweeps") == {"noisy", "noisy-2"}
    assert main([*other, "--out", "sweeps/noisy"]) == 2
    assert f"another sweep: {RETRIES} is varied over 2,3 here, 0,1 there" in capsys.readouterr().err
    assert main([*other, "--out", "sweeps/noisy", "--force"]) == 0
    assert rows(here / "sweeps" / "noisy" / "runs.csv")[0][RETRIES] == "2"


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ([], "Missing option '--vary'"),
        (["--vary", f"{RETRIES}=9:12:1"], f"--vary {RETRIES}=12: {RETRIES} is 12, allowed 0..10"),
        (["--vary", "plcs.pres.nn.retries=1"], "did you mean press?"),
        (["--vary", f"{TIMEOUT}=50:200:10"], "a time without a unit"),
        (["--vary", f"{RETRIES}=1", "--repeat", "many"], "'--repeat'"),
        (["--vary", f"{RETRIES}=1", "--repeat", "0"], "--repeat is 0, allowed 1..100000"),
        (["--vary", f"{RETRIES}=1", "--workers", "0"], "--workers is 0"),
        (["--vary", f"{RETRIES}=1", "--scheduler", "here"], "expected an address such as tcp://"),
        (["--vary", f"{RETRIES}=1", "--duration", "5"], "--duration 5"),
        (["--vary", "duration=1s,2s", "--duration", "5s"], "duration is varied and set"),
        (["--vary", f"{RETRIES}=1", "--out", "noisy.yaml"], "exists and is a file"),
    ],
)
def test_mistakes_exit_with_2_and_write_nothing(
    here: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], expected: str
) -> None:
    assert main(["sweep", "noisy.yaml", *arguments]) == 2
    said = capsys.readouterr()
    assert expected in said.err
    assert said.out == ""
    assert "Traceback" not in said.err
    assert names(here) == {"noisy.yaml"}


def test_interrupted_from_the_keyboard(
    here: Path, quick: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    del quick

    class Interrupted(HereExecutor):
        def run(self, jobs: object) -> object:  # type: ignore[override] # it never returns
            yield next(super().run(jobs))  # type: ignore[arg-type] # as it was given
            raise KeyboardInterrupt

    arguments = ["sweep", "noisy.yaml", "--vary", f"{RETRIES}=0:4:1", "--out", "o"]
    with monkeypatch.context() as patch:
        patch.setattr(run, "open_executor", lambda *_: Interrupted(real=False))
        assert main(arguments) == 130
    said = capsys.readouterr()
    assert said.out == ""
    assert "the same command goes on from what was run" in said.err
    assert names(here) == {"noisy.yaml", "o.incomplete"}
    assert main(arguments) == 0
    assert "5 runs at 5 points, 1 of them were there already" in capsys.readouterr().out


def test_what_takes_long_is_said_before_it_begins_and_refused_beyond_a_bound(
    here: Path, quick: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    del quick
    arguments = ["sweep", "noisy.yaml", "--vary", "duration=10s,20s", "--repeat", "3", "--out", "o"]
    monkeypatch.setattr(run, "cost_of", lambda *_: 100 / 72e6)  # 100 s for each simulated second
    assert main([*arguments, "--longest", "2"]) == 2
    assert capsys.readouterr().err == (
        "Error: the sweep would take about 2.5 h, allowed are 2 h: vary or repeat less, shorten --duration, "
        "have more --workers, or raise --longest\n"
    )
    assert names(here) == {"noisy.yaml"}
    assert main([*arguments, "--longest", "3"]) == 0
    assert capsys.readouterr().err == "about 2.5 h in all\n"


class _Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_progress_only_on_a_terminal_and_only_after_a_while(
    here: Path, quick: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    del here, quick
    shown: list[tuple[str, float, float | None]] = []

    class Watched(rich.progress.Progress):
        def start(self) -> None:
            super().start()
            shown.extend((task.description, task.completed, task.total) for task in self.tasks)

    monkeypatch.setattr(rich.progress, "Progress", Watched)
    for patience, terminal, name in ((0.0, False, "a"), (1e9, True, "b"), (0.0, True, "c")):
        stream = _Terminal() if terminal else io.StringIO()
        monkeypatch.setattr(sys, "stderr", stream)
        monkeypatch.setattr(progress, "_PATIENCE", patience)
        assert main(["sweep", "noisy.yaml", "--vary", f"{RETRIES}=0:4:1", "--out", name]) == 0
        assert bool(shown) == (name == "c")
        assert bool(stream.getvalue()) == (name == "c")
    assert (shown[0][0], shown[0][2]) == ("checking", 5)
    assert "left" in stream.getvalue()


def test_keys_are_shown_as_short_as_they_can_be() -> None:
    assert sweep._short(["plcs.a.nn.retries", BER]) == ["retries", "ber"]
    assert sweep._short(["plcs.a.scan.mean", "plcs.b.scan.mean"]) == ["a.scan.mean", "b.scan.mean"]
    assert sweep._short(["noise.0.ber", "noise.1.ber"]) == ["0.ber", "1.ber"]
    assert sweep._short(["seed", "plcs.a.seed"]) == ["seed", "a.seed"]
    assert sweep._short(["seed"]) == ["seed"]


def test_help_has_an_example_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sweep", "--help"]) == 0
    examples = re.findall(r"^ +--vary (\S+)$", capsys.readouterr().out, re.MULTILINE)
    assert len(examples) == 4
    for example in examples:
        Plan("press_line", [example], sets=["noise=[{bus: link, ber: 0}]"]).check()


@pytest.mark.usefixtures("pictures_undrawn")
def test_modbus_masters_have_a_table_and_pictures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    key = "plcs.press.ports.COM3.timeout"
    arguments = [
        "sweep",
        "timeout_too_short",
        "--vary",
        f"{key}=20ms,100ms",
        "--duration",
        "3s",
        "--out",
        "o",
    ]
    assert main([*arguments, "--workers", "1"]) == 0
    said = capsys.readouterr().out
    assert "Modbus master press.COM3" in said
    assert "link" not in said.split("results:")[0]
    assert (tmp_path / "o" / "sweep_press.COM3.png").is_file()
    with (tmp_path / "o" / "runs.csv").open(newline="") as file:
        short, long = csv.DictReader(file)
    assert int(short["press.COM3.timeouts"]) > 20
    assert int(long["press.COM3.timeouts"]) == 0
    assert float(long["press.COM3.response_ms.max"]) > 35
    assert short["press.COM3.response_ms.max"] == ""
    assert int(short["press.COM3.mismatched_responses"]) > 20
    assert int(long["press.COM3.errors.09"]) == 0  # it occurred in the other run


@pytest.mark.slow
def test_latencies_are_figures_like_others(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    arguments = ["sweep", "counter_preset", "--vary", "plcs.line.scan.mean=10ms,20ms", "--repeat", "3"]
    assert main([*arguments, "--duration", "6s", "--workers", "1"]) == 0
    said = capsys.readouterr().out
    bits = said[said.index("latency full-box") : said.index("data age preset")]
    assert re.search(r"never arrived *\n *10ms +–", bits)
    # Of the age of a word nothing is lost.
    words = said[said.index("data age preset") :]
    assert re.search(r"of a run \(ms\) *\n *10ms +\d", words)
    assert "arrived" not in words
    folder = here / "sweeps" / "counter_preset"
    for name in ("full-box", "preset"):
        assert f"picture: {Path('sweeps/counter_preset') / f'sweep_latency.{name}.png'}" in said
        assert (folder / f"sweep_latency.{name}.svg").is_file()
    runs, points = rows(folder / "runs.csv"), rows(folder / "points.csv")
    for column in ("latency.preset.ms.p50", "latency.full-box.ms.max", "latency.full-box.lost_share"):
        for number, point in enumerate(points):
            values = [float(run[column]) for run in runs[3 * number : 3 * number + 3]]
            assert float(point[column]) == pytest.approx(sum(values) / 3)
    # Slower scans of the source make its word older, beyond the spread of the repeats.
    assert float(points[0]["latency.preset.ms.p50_high"]) < float(points[1]["latency.preset.ms.p50_low"])
    assert points[0]["latency.full-box.lost_share_low"] == ""  # never lost here is not never
