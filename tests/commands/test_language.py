"""What commands print in Chinese: no English word is left but names, and JSON stays as it is."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from bussim.cli import main
from bussim.scenario import builtin

#: Registers, levels, units, keys and what programs and boards call themselves.
_NAMES = (
    r"D\d+|M\d+|K\d+|LD|MOV|END|STOP|RUN|ON|OFF|PLC|HMI|CPAVL|RS2|COM\d|CRC|LRC|ms|bps|y|x|N:N|Modbus|modbus-\w+|free|"
    r"pymodbus|ModbusSerialClient|port|baudrate|bytesize|parity|stopbits|timeout|retries|retries\+1|framer|FramerType\.ASCII|"
    r"quiet|typical|bad|attempts|absent_station|full|probe|skip_after_failure|--json|--ignore-faults|cable_cut|bussim|summary|json|yaml|UTF|7xyy|yy"
)


def english(text: str, scenario: str) -> set[str]:
    """Words of a text that are neither names of the scenario nor of :data:`_NAMES`."""
    own = {*re.findall("[A-Za-z]+", scenario)}
    found = re.findall("[A-Za-z]{3,}", re.sub(rf"(?a:(?<!\w)(?:{_NAMES})(?!\w))", "", text))
    return {word for word in found if word not in own}


@pytest.mark.parametrize(
    ("command", "scenario"),
    [
        ("size", "electrical_noise"),
        ("size", "feeder_off"),
        ("size", "dead_from_start"),
        ("exact", "manual_example"),
        ("exact", "nn_with_modbus"),
        ("exact", "interlock"),
        ("run", "press_line"),
        ("run", "wrong_parity"),
        ("run", "two_masters"),
        ("run", "barcode_reader"),
        ("run", "feeder_off"),
        ("check", "two_masters"),
        ("check", "setting_programs"),
    ],
)
def test_no_english_word_is_left_but_names(
    command: str, scenario: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    args = ["--duration", "3s", "--no-plots", "-o", str(tmp_path / "out")] if command == "run" else []
    assert main([command, scenario, "--lang", "zh", *args]) == 0
    printed = capsys.readouterr().out.replace(str(tmp_path), "")
    assert re.search("[\u4e00-\u9fff]{4}", printed)
    assert english(printed, builtin.read(scenario) + " out link") == set()


def test_the_language_is_that_of_the_system_and_json_is_the_same_in_each(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    args, printed = ["size", "--stations", "3"], {}
    for locale in ("C.UTF-8", "zh_CN.UTF-8"):
        monkeypatch.setenv("LC_ALL", locale)
        assert main(args) == 0
        printed[locale] = capsys.readouterr().out
    assert "false station errors" in printed["C.UTF-8"]
    assert "误报站错误" in printed["zh_CN.UTF-8"]
    assert main([*args, "--lang", "en"]) == 0
    assert capsys.readouterr().out == printed["C.UTF-8"]
    texts = []
    for lang in ("en", "zh"):
        assert main([*args, "--json", "--lang", lang]) == 0
        texts.append(capsys.readouterr().out)
    assert texts[0] == texts[1]


def test_the_files_of_a_run_are_the_same_in_each_language(tmp_path: Path) -> None:
    for lang in ("en", "zh"):
        args = ["--duration", "1s", "--no-plots", "--trace", "-o", str(tmp_path / lang), "--lang", lang]
        assert main(["run", "press_line", *args]) == 0
    names = sorted(path.name for path in (tmp_path / "en").iterdir())
    assert names == sorted(path.name for path in (tmp_path / "zh").iterdir())
    for name in names:
        assert (tmp_path / "en" / name).read_bytes() == (tmp_path / "zh" / name).read_bytes(), name


def test_an_option_that_names_no_key_is_said_in_chinese(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["size", "press_line", "--lang", "zh", "--set", "sede=1"]) == 2
    assert "错误：--set sede=1：sede：这里没有这个键" in capsys.readouterr().err
    assert main(["size", "press_line", "--lang", "zh", "--set", "seed=x"]) == 2
    assert "seed：是 'x'，应为整数" in capsys.readouterr().err
    assert main(["size", "press_line", "--set", "seed=x", "--lang", "en"]) == 2
    assert "seed is 'x', expected a whole number" in capsys.readouterr().err
