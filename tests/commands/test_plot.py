from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path

import pytest

from bussim.api import open_run
from bussim.cli import main
from tests.undrawn import undrawn

PNG = b"\x89PNG\r\n\x1a\n"


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("plot")
    for seed in (1, 2):
        for name, scenario, duration in (
            ("seed", "press_line", "3s"),
            ("ports", "nn_with_modbus", "4s"),
            ("words", "counter_preset", "5s"),
        ):
            # Pictures of the first one are compared with those that `plot` draws.
            with nullcontext() if (seed, name) == (1, "seed") else undrawn():
                arguments = [
                    "run",
                    scenario,
                    "--duration",
                    duration,
                    "--seed",
                    str(seed),
                    "--no-rows",
                    "--out",
                ]
                assert main([*arguments, str(folder / f"{name}{seed}")]) == 0
    return folder


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def printed(capsys: pytest.CaptureFixture[str]) -> list[Path]:
    said = capsys.readouterr()
    assert said.err == ""
    return [Path(line) for line in said.out.splitlines()]


def assert_pictures(paths: list[Path]) -> None:
    for path in paths:
        content = path.read_bytes()
        assert content.startswith(PNG) if path.suffix == ".png" else b"<svg" in content[:1000]


def test_one_run_into_its_own_folder(here: Path, runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drawn_by_run = (runs / "seed1" / "scan_time_link.png").read_bytes()
    capsys.readouterr()
    assert main(["plot", str(runs / "seed1"), "--force"]) == 0  # the run drew some of them
    paths = printed(capsys)
    assert [path.name for path in paths] == [
        "scan_time_link.png",
        "scan_time_link.svg",
        "scan_time_over_run_link.png",
        "scan_time_over_run_link.svg",
    ]
    assert {path.parent for path in paths} == {runs / "seed1"}
    assert_pictures(paths)
    assert paths[0].read_bytes() == drawn_by_run
    assert list(here.iterdir()) == []


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("histogram", {"scan_time_link_seed1_seed2"}),
        ("over-run", {"scan_time_over_run_link_seed1", "scan_time_over_run_link_seed2"}),
    ],
)
def test_several_runs_into_this_folder(
    here: Path, runs: Path, capsys: pytest.CaptureFixture[str], kind: str, expected: set[str]
) -> None:
    capsys.readouterr()
    assert main(["plot", str(runs / "seed1"), str(runs / "seed2"), "--kind", kind, "--bus", "link"]) == 0
    paths = printed(capsys)
    assert {path.stem for path in paths} == {path.stem for path in here.iterdir()} == expected
    assert_pictures(paths)


def test_out_is_made(here: Path, runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert main(["plot", str(runs / "seed1"), "--kind", "histogram", "--out", "a/b"]) == 0
    assert printed(capsys) == [Path("a/b/scan_time_link.png"), Path("a/b/scan_time_link.svg")]
    assert_pictures(list((here / "a" / "b").iterdir()))


@pytest.mark.slow
def test_response_times_are_drawn_too(here: Path, runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    again = ["run", str(runs / "ports1" / "scenario.yaml"), "--no-rows", "--out", "ports1"]
    assert main(again) == 0
    drawn_by_run = (here / "ports1" / "response_time_press1.COM3.png").read_bytes()
    capsys.readouterr()
    assert main(["plot", "ports1", "--out", "all"]) == 0
    paths = printed(capsys)
    assert [path.name for path in paths if path.suffix == ".png"] == [
        "scan_time_link.png",
        "scan_time_over_run_link.png",
        "response_time_press1.COM3.png",
        "response_time_press2.COM5.png",
    ]
    assert_pictures(paths)
    assert (here / "all" / "response_time_press1.COM3.png").read_bytes() == drawn_by_run


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--kind", "responses"], {"response_time_press1.COM3", "response_time_press2.COM5"}),
        (["--port", "press2.COM5"], {"response_time_press2.COM5"}),
        (["--bus", "link"], {"scan_time_link", "scan_time_over_run_link"}),
        (["--bus", "link", "--port", "press1.COM3", "--kind", "all"],
         {"scan_time_link", "scan_time_over_run_link", "response_time_press1.COM3"}),
        (["--kind", "histogram"], {"scan_time_link"}),
    ],
)  # fmt: skip
@pytest.mark.usefixtures("here")
def test_one_thing_is_chosen(
    runs: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], expected: set[str]
) -> None:
    capsys.readouterr()
    with undrawn():
        assert main(["plot", str(runs / "ports1"), "--out", "o", "--force", *arguments]) == 0
    assert {path.stem for path in printed(capsys)} == expected


@pytest.mark.slow
@pytest.mark.usefixtures("here")
def test_several_runs_share_the_panels(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert main(["plot", str(runs / "ports1"), str(runs / "ports2"), "--port", "press1.COM3"]) == 0
    assert {path.stem for path in printed(capsys)} == {"response_time_press1.COM3_ports1_ports2"}
    # Of a run with ports and one without only the link is common.
    assert main(["plot", str(runs / "ports1"), str(runs / "seed1"), "--kind", "histogram"]) == 0
    assert {path.stem for path in printed(capsys)} == {"scan_time_link_ports1_seed1"}


@pytest.mark.slow
@pytest.mark.usefixtures("here")
def test_latencies_are_drawn_too(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    open_run(runs / "words1").save_plots()
    drawn_by_run = (runs / "words1" / "latency_preset.png").read_bytes()
    capsys.readouterr()
    assert main(["plot", str(runs / "words1"), "--out", "all"]) == 0
    paths = printed(capsys)
    assert [path.name for path in paths if path.suffix == ".png"] == [
        "scan_time_link.png",
        "scan_time_over_run_link.png",
        "latency_full-box.png",
        "latency_preset.png",
    ]
    assert_pictures(paths)
    assert Path("all/latency_preset.png").read_bytes() == drawn_by_run
    for arguments, expected in (
        (["--kind", "latency"], {"latency_full-box", "latency_preset"}),
        (["--latency", "preset"], {"latency_preset"}),
        (["--latency", "preset", "--bus", "link"],
         {"latency_preset", "scan_time_link", "scan_time_over_run_link"}),
    ):  # fmt: skip
        with undrawn():
            assert main(["plot", str(runs / "words1"), "--out", "o", "--force", *arguments]) == 0
        assert {path.stem for path in printed(capsys)} == expected
    assert main(["plot", str(runs / "words1"), str(runs / "words2"), "--kind", "latency"]) == 0
    paths = printed(capsys)
    assert {path.stem for path in paths} == {
        "latency_full-box_words1_words2",
        "latency_preset_words1_words2",
    }
    assert_pictures(paths)


def test_mistakes(here: Path, runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    seed1, words1 = str(runs / "seed1"), str(runs / "words1")
    (here / "file").write_text("x")
    for arguments, expected in (
        ([], "RUN_DIR"),
        (["nowhere"], "nowhere does not exist"),
        ([str(runs)], "folders of runs in it: ports1, ports2, seed1, seed2, words1"),
        ([seed1, "--bus", "lonk"], "no N:N link 'lonk'; it has 'link'"),
        ([seed1, seed1], "named twice"),
        ([seed1, "--kind", "pie"], "pie"),
        ([seed1, "--out", "file"], "file cannot be written: File exists"),
        ([seed1, "--port", "press1.COM3"], "no Modbus master 'press1.COM3'; it has none"),
        (
            [seed1, "--kind", "responses"],
            "no Modbus master with a response in this run (masters: seed1: none)",
        ),
        (
            [seed1, "--kind", "responses", "--bus", "link"],
            "--bus is about link scans, --kind responses draws none",
        ),
        (
            [seed1, "--kind", "over-run", "--port", "x"],
            "--port is about response times, --kind over-run draws none",
        ),
        ([seed1, "--latency", "door"], "has no latency 'door'; it has none"),
        ([words1, "--latency", "presett"], "has no latency 'presett'; it has 'full-box', 'preset'"),
        ([seed1, "--kind", "latency"], "no measured latency in this run (latencies: seed1: none)"),
        (
            [seed1, words1, "--kind", "latency"],
            "no measured latency common to these runs (latencies: seed1: none; words1: full-box, preset)",
        ),
        (
            [words1, "--kind", "responses", "--latency", "preset"],
            "--latency is about latencies, --kind responses draws none",
        ),
        (
            [words1, "--kind", "latency", "--bus", "link"],
            "--bus is about link scans, --kind latency draws none",
        ),
    ):
        capsys.readouterr()
        assert main(["plot", *arguments]) == 2, arguments
        said = capsys.readouterr()
        assert expected in said.err
        assert "Traceback" not in said.err
        assert said.out == ""
    assert [path.name for path in here.iterdir()] == ["file"]
