"""``bussim check``."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path

import pytest

from bussim.cli import main
from bussim.scenario import builtin

GOOD = builtin.read("two_stations")


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_clean_one_is_described_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "press_line"]) == 0
    assert capsys.readouterr().out == (
        "press_line: ok: three presses in a line: 3 PLCs, 1 N:N link, 1 noise entry, 1 fault, 60 s, seed 7\n"
    )


@pytest.mark.parametrize(
    ("name", "described"),
    [
        (
            "nn_with_modbus",
            "N:N with Modbus beside it: 3 PLCs, 1 N:N link, 2 other buses, 2 devices, 4 polls, 60 s, seed 22",
        ),
        ("hmi_on_com2", "HMI on COM2: 1 PLC, 1 bus, 1 device, 5 polls, 60 s, seed 23"),
    ],
)
def test_ports_and_devices_are_described(
    name: str, described: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", name]) == 0
    assert capsys.readouterr().out == f"{name}: ok: {described}\n"


def test_a_file(capsys: pytest.CaptureFixture[str]) -> None:
    Path("mine.yaml").write_text(GOOD, encoding="utf-8")
    assert main(["check", "mine.yaml"]) == 0
    assert capsys.readouterr().out == "mine.yaml: ok: two stations: 2 PLCs, 1 N:N link, 60 s, seed 1\n"


def test_warnings_have_positions_and_leave_the_exit_code_at_0(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "bad_parameter"]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert printed.out.splitlines() == [
        (
            "bad_parameter.yaml:16:34: warning: master refuses its N:N settings (D8177 is 0, allowed 1..7): "
            "M8063 on, D8063 = 7348, and it sends nothing"
        ),
        "bad_parameter: ok: bad parameter: 2 PLCs, 1 N:N link, 10 s, seed 15",
    ]


def test_mistakes_go_to_stderr_with_exit_code_2(capsys: pytest.CaptureFixture[str]) -> None:
    Path("mine.yaml").write_text(GOOD.replace("retries: 3", "retries: 12"), encoding="utf-8")
    assert main(["check", "mine.yaml"]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err == "mine.yaml:16:74: nn.retries is 12, allowed 0..10\n"


def test_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "same_number_twice", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["schema"], found["ok"]) == (2, True)
    (found,) = found["files"]
    assert (found["file"], found["ok"], found["errors"]) == ("same_number_twice", True, [])
    assert [(w["file"], w["line"], w["column"]) for w in found["warnings"]] == [
        ("same_number_twice.yaml", 17, 53),
        ("same_number_twice.yaml", 25, 42),
    ]
    Path("mine.yaml").write_text(GOOD.replace("seed: 1", "seed: x"), encoding="utf-8")
    assert main(["check", "mine.yaml", "--json"]) == 2
    printed = capsys.readouterr()
    assert printed.err == ""
    assert json.loads(printed.out) == {
        "schema": 2,
        "ok": False,
        "files": [
            {
                "file": "mine.yaml",
                "ok": False,
                "scenario": None,
                "programs": {},
                "errors": [
                    {
                        "file": "mine.yaml",
                        "line": 8,
                        "column": 7,
                        "path": "seed",
                        "text": "seed is 'x', expected a whole number 0..9223372036854775807",
                    }
                ],
                "warnings": [],
            }
        ],
    }


PROGRAM = "program: |\n      LD X0\n      OTU Y0\n      END\n"


@pytest.mark.parametrize(
    ("old", "new", "path"),
    [
        ("retries: 3", "retries: 12", "plcs.press.nn.retries"),
        ("retries: 3", "retrys: 3", "plcs.press.nn.retrys"),
        ("  - {name: link, nn: true}", "  - {nme: link, nn: true}", "buses.0.name"),
        ("plcs:\n", "plcs:\n  - name: alone\n    " + PROGRAM, "plcs.alone.program"),
    ],
)
def test_json_has_the_key_as_set_takes_it(
    old: str, new: str, path: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert old in GOOD
    Path("mine.yaml").write_text(GOOD.replace(old, new, 1), encoding="utf-8")
    assert main(["check", "mine.yaml", "--json"]) == 2
    errors = json.loads(capsys.readouterr().out)["files"][0]["errors"]
    assert path in [error["path"] for error in errors]


def test_several_files_and_standard_input_are_checked_whatever_is_wrong_with_one(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    Path("mine.yaml").write_text(GOOD.replace("retries: 3", "retries: 12"), encoding="utf-8")
    piped = io.TextIOWrapper(io.BytesIO(GOOD.replace("duration: ", "duration:").encode()))
    monkeypatch.setattr(sys, "stdin", piped)
    assert main(["check", "mine.yaml", "gone.yaml", "-", "two_stations", "bad_parameter"]) == 2
    printed = capsys.readouterr()
    assert printed.err.splitlines() == [
        "mine.yaml:16:74: nn.retries is 12, allowed 0..10",
        "gone.yaml: no such file, and no built-in scenario of that name; bussim scenarios lists them all",
        "<stdin>:7:1: duration has no blank after its colon; write duration: 60 s",
    ]
    assert [line.split(": ")[0] for line in printed.out.splitlines()] == [
        "two_stations",
        "bad_parameter.yaml:16:34",
        "bad_parameter",
    ]
    assert main(["check", "two_stations", "press_line", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [(each["file"], each["ok"]) for each in found["files"]] == [
        ("two_stations", True),
        ("press_line", True),
    ]


def test_standard_input_may_name_files_beside_the_user(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    Path("mine.il").write_text("LD X0\nOUT Y0\nEND\n", encoding="utf-8")
    text = GOOD.replace("plcs:\n", "plcs:\n  - {name: alone, program: mine.il}\n")
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text.encode())))
    assert main(["check", "-"]) == 0
    assert "alone: program of 3 steps (3 instructions)" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("argument", "message"),
    [
        (
            "nix",
            "no such file, and no built-in scenario of that name; bussim scenarios lists them all",
        ),
        ("x/two_station", "no such file"),
        ("two_station", "no such file, and no built-in scenario of that name; did you mean two_stations?"),
        (".", "is a folder, not a scenario file"),
    ],
)
def test_what_is_not_there(argument: str, message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", argument]) == 2
    assert capsys.readouterr().err == f"{argument}: {message}\n"


def test_nothing_is_written(tmp_path: Path) -> None:
    main(["check", "press_line"])
    assert list(tmp_path.iterdir()) == []
