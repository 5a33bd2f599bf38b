"""Texts by key: each is there in both languages, and can be said with its values."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Mapping
from string import Formatter
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.engines.modbus.codes import MEANINGS, PortError
from bussim.errors import UsageError
from bussim.results.verdict.catalogue import is_fault
from bussim.results.verdict.link import _times
from bussim.wording import in_ms
from bussim.words.formats import cause_in_words, meaning, render
from bussim.words.language import current_language, said_text, say, shown, system_language, use_language
from bussim.words.tables import LANGUAGES, PAGES, Said, entries, recognised

#: Words that a reader of codes, names and figures is not to meet.
WORDS = re.compile(r"\b((?<!level )typical|somebody|nobody|tries|try)\b")


def placeholders(text: str) -> dict[str, str]:
    return {name: spec or "" for _, name, spec, _ in Formatter().parse(text) if name}


def test_each_text_is_there_in_every_language_with_the_same_values() -> None:
    for key, (english, *others) in entries().items():
        assert others[len(LANGUAGES) - 1 :] in ([], ["fault"]), key
        for text in others[: len(LANGUAGES) - 1]:
            assert text or not english.strip(), key
            assert placeholders(text).keys() == placeholders(english).keys(), key
        assert not WORDS.search(english), key


def test_no_chinese_text_is_left_in_english() -> None:
    for key, (_, chinese, *_) in entries().items():
        if re.search("[a-z]{3}", re.sub(r"\{.*?\}", "", chinese)):
            assert re.search("[\u4e00-\u9fff]", chinese), key


#: A value for each format of a sentence.
_VALUES: Mapping[str, Any] = {
    "": "x_1",
    "n": 1234,
    "ms": 50.41,
    "most_ms": 50.41,
    "list": ["a_b", "c"],
    "listed": ["a_b", "c"],
    "joined": ["a_b", "c"],
    "station": "station 3 (a_b)",
    "counted": 2,
    "counts": {"frame length": 2},
    "codes": {"01": 2, "04": 1},
    "exceptions": {"02": 12},
    "meanings": "01, 04",
    "brief": "station 1 (a): 1 attempt, 01; station 2 replied 20 ms after its poll",
    "reason": "frame length",
    "frame": "data",
    "message": "whole",
    ".6f": 1.0,
    ".1f": 1.0,
    ",.3f": 1.0,
    "reasons": {"frame length": 2},
    "cause": "station 1 (a): 6 attempts, all 01; parameter frame",
    "part": "in_stop",
    "d": 7348,
    "when": {"times": 2, "first_s": 1.25, "last_s": 9.5, "total_s": 3.5, "from_s": 1.25, "for_s": 2.0},
    "times": {"p50": 20.25, "mean": 21.5, "max": 30.75},
    "devices": {"D8203": 2, "D8211": 0x14, "M8183": 1},
    "serial": 7309,
    "g": 20,
    ",g": 20,
    ".1%": 0.5,
    ".2g": 1e-6,
    ".1e": 1e-6,
    "02": 3,
    "plus": ["a_b", "c"],
    "spaced": ["a_b", "c"],
    ".2f": 1.0,
    ".3f": 1.0,
    "02X": 3,
    "04X": 3,
    "05": 3,
    "either": ["a_b", "c"],
    "line": "at line 3 of the program",
}


@pytest.mark.parametrize("lang", LANGUAGES)
def test_every_text_can_be_said(lang: str) -> None:
    for key in entries():
        formats = placeholders(entries()[key][LANGUAGES.index(lang)])
        values = {name: _VALUES[spec.partition(" ")[0]] for name, spec in formats.items()}
        text = render(key, values, lang)
        braces = "{{" in entries()[key][LANGUAGES.index(lang)]
        assert "{" not in text or braces or key.partition(".")[0] in PAGES, key
        if is_fault(key) and lang == "en":
            assert text[0].isupper() or text.startswith(("x_1", "a_b"))
            assert text.endswith(".")


def test_a_text_is_english_until_it_is_shown_in_another_language() -> None:
    said = say("not_polled", plc="a", station=3, bus="link", slaves=2)
    text = "a has station number 3, but the master of link polls only 2."
    assert said == text == shown(said)
    assert json.dumps([said]) == json.dumps([text])
    with use_language("zh"):
        assert shown({"said": [said, 1, "a"]}) == {
            "said": ["a 的站号是 3，但 link 的主站只轮询 2 个从站。", 1, "a"]
        }
        assert shown(copy.deepcopy(said)) == said_text("not_polled", **said.values)
    assert current_language() == "en"


def test_parts_of_a_text_are_in_its_language() -> None:
    reasons = {"CRC or LRC wrong": 2, "own text": 1}
    said = say("requests_ignored", node="a", reasons=reasons)
    assert said == "a ignored frames that were no sound request: CRC or LRC wrong 2×, own text 1×."
    with use_language("zh"):
        assert shown(said) == "a 忽略了不是完好请求的帧：CRC 或 LRC 错误 2×、own text 1×。"
        cause = said_text("cause_missing", station="station 3 (press)", bus="link")
        assert cause == "link 上没有站 3（press）这个站号的 PLC。"


def test_a_text_of_a_file_is_known_again_with_its_values() -> None:
    said = recognised("a has station number 3, but the master of link polls only 2.")
    assert isinstance(said, Said)
    assert said.key == "not_polled"
    with use_language("zh"):
        assert shown(said) == "a 的站号是 3，但 link 的主站只轮询 2 个从站。"
    assert type(recognised("pump and valve")) is str


@pytest.mark.parametrize(
    ("settings", "lang"),
    [
        ({}, "en"),
        ({"LANG": "zh_CN.UTF-8"}, "zh"),
        ({"LANG": "zh_CN.UTF-8", "LC_MESSAGES": "de_DE.UTF-8"}, "en"),
        ({"LANG": "de_DE.UTF-8", "LC_ALL": "zh_CN.UTF-8", "LC_MESSAGES": "C"}, "zh"),
        ({"LANG": "zh_CN.UTF-8", "LC_ALL": ""}, "zh"),
    ],
)
def test_the_language_is_that_of_the_system(
    settings: dict[str, str], lang: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("LC_ALL", "LC_MESSAGES", "LANG"):
        monkeypatch.delenv(name, raising=False)
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    assert system_language() == lang


def test_another_language_is_refused() -> None:
    with pytest.raises(UsageError, match="language is 'de', allowed are en and zh"), use_language("de"):
        pass


def test_codes_stay_codes_and_names_keep_their_underscores() -> None:
    names = {"flag": "M8063", "error": "D8063"}
    text = render("settings_refused", {"plc": "main_plc", "code": 7348, **names})
    assert text.startswith("main_plc refuses its N:N settings: M8063 is on, D8063 = 7348 (bad parameters)")
    assert "vfd_status" in render(
        "no_response", {"node": "a.COM3", "requests": 1200, "polls": ["vfd_status"]}
    )


def test_codes_are_said_in_words() -> None:
    assert meaning("01") == "no reply within the timeout"
    assert meaning("04") == "a damaged reply"
    assert meaning("7F") == "code 7F"
    assert [meaning(code, kind="exception") for code in ("02", "7F")] == ["illegal address", "unknown"]
    assert [meaning(code, kind="port_error") for code in ("09", "41")] == [
        "no response in time",
        "the port board",
    ]
    assert render("exceptions", {"node": "a.COM3", "codes": {"02": 1200}, "when": None}).endswith(
        "at times that were not kept: 02 1,200× (illegal address)."
    )


def test_port_errors_have_the_words_of_the_engine_that_raises_them() -> None:
    """Results are made from traces alone, and so have a table of their own."""
    assert {code: meaning(f"{code:02}", kind="port_error") for code in PortError} == MEANINGS


def test_milliseconds_have_one_decimal() -> None:
    assert [in_ms(value) for value in (50.412, 348.64, 5279.2)] == ["50.4 ms", "348.6 ms", "5.28 s"]


def test_what_is_not_exceeded_is_rounded_up() -> None:
    values = (50.4, 50.400001, 348.61, 999.96, 5279.2, 5280.0, 5280.001)
    shown = ["50.4 ms", "50.5 ms", "348.7 ms", "1,000.0 ms", "5.28 s", "5.28 s", "5.29 s"]
    assert [in_ms(value, most=True) for value in values] == shown


@given(st.lists(st.floats(0, 20_000).map(lambda value: round(value, 6)), min_size=3, max_size=3).map(sorted))
def test_no_rounding_puts_a_quantile_above_the_maximum(times: list[float]) -> None:
    median, p99, longest = times
    link = {
        "scans": 9,
        "scan_time_ms": {"p50": median, "p99": p99, "max": longest, "max_at_s": 0, "max_cause": ""},
    }
    said = " ".join(render(key, {"bus": "link", **values}) for key, values in _times(link))
    numbers = [
        float(number.replace(",", "")) * (1000 if unit == "s" else 1)
        for number, unit in re.findall(r"([0-9,.]+) (m?s)\b", said)[:3]
    ]
    assert numbers == sorted(numbers)
    assert numbers[1] >= p99
    assert numbers[2] >= longest


@pytest.mark.parametrize(
    ("cause", "words"),
    [
        (
            "station 1 (press2): 6 attempts, all 01; parameter frame",
            (
                "station 1 (press2) failed all its 6 attempts (no reply within the timeout) and the master sent "
                "its parameters again"
            ),
        ),
        (
            "station 2 (trolley): 2 failed attempts before the reply, 01, 04",
            (
                "station 2 (trolley) replied only at attempt 3 (before: no reply within the timeout, then a "
                "damaged reply)"
            ),
        ),
        (
            "station 7: 1 attempt, 02",
            "station 7 failed its only attempt (a reply with another station's number)",
        ),
        ("station 1 (a) replied 42 ms after its poll", "station 1 (a) replied 42 ms after its poll"),
    ],
)
def test_a_cause_becomes_a_part_of_a_sentence(cause: str, words: str) -> None:
    assert cause_in_words(cause) == words


@pytest.mark.parametrize(
    ("number", "language"), [(0x0804, "zh"), (0x0404, "zh"), (0x0409, "en"), (0x10000, "en")]
)
def test_the_language_of_windows(number: int, language: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """No variable names it there: 2052 is Chinese as in China, 1028 as in Taiwan, 1033 English."""
    for name in ("LC_ALL", "LC_MESSAGES", "LANG"):
        monkeypatch.delenv(name, raising=False)
    kernel = SimpleNamespace(GetUserDefaultUILanguage=lambda: number)
    monkeypatch.setattr("ctypes.windll", SimpleNamespace(kernel32=kernel), raising=False)
    monkeypatch.setattr("sys.platform", "win32")
    assert system_language() == language
    monkeypatch.setenv("LANG", "zh_CN.UTF-8")
    assert system_language() == "zh"
