"""The catalogue of sentences: one table, whose columns are languages."""

from __future__ import annotations

import re
from collections.abc import Mapping
from string import Formatter
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.engines.modbus.codes import MEANINGS, PortError
from bussim.results.verdict import catalogue
from bussim.results.verdict.catalogue import (
    LANGUAGES,
    SENTENCES,
    cause_in_words,
    in_ms,
    is_fault,
    meaning,
    render,
)
from bussim.results.verdict.link import _times

#: Words that a reader of codes, names and figures is not to meet.
WORDS = re.compile(r"\b(typical|somebody|nobody|tries|try)\b")


def placeholders(text: str) -> dict[str, str]:
    return {name: spec or "" for _, name, spec, _ in Formatter().parse(text) if name}


def test_every_language_is_a_column() -> None:
    assert set(LANGUAGES) == set(catalogue.Sentence._fields) - {"fault"}


@pytest.mark.parametrize("key", SENTENCES)
def test_placeholders_agree_in_all_languages(key: str) -> None:
    texts = [getattr(SENTENCES[key], lang) for lang in LANGUAGES]
    assert all(placeholders(text) == placeholders(texts[0]) for text in texts)
    assert not WORDS.search(texts[0])


#: A value for each format of a sentence.
_VALUES: Mapping[str, Any] = {
    "": "x_1",
    "n": 1234,
    "ms": 50.41,
    "most_ms": 50.41,
    "list": ["a_b", "c"],
    "counts": {"frame length": 2},
    "codes": {"01": 2, "04": 1},
    "exceptions": {"02": 12},
    "meanings": "01, 04",
    "cause": "station 1 (a): 6 attempts, all 01; parameter frame",
    "part": "in_stop",
    "d": 7348,
    "when": {"times": 2, "first_s": 1.25, "last_s": 9.5, "total_s": 3.5, "from_s": 1.25, "for_s": 2.0},
    "times": {"p50": 20.25, "mean": 21.5, "max": 30.75},
    "devices": {"D8203": 2, "D8211": 0x14, "M8183": 1},
    "serial": 7309,
    "g": 20,
    ".2f": 1.0,
    ".3f": 1.0,
}


@pytest.mark.parametrize("key", SENTENCES)
def test_every_sentence_can_be_said(key: str) -> None:
    values = {name: _VALUES[spec] for name, spec in placeholders(SENTENCES[key].en).items()}
    text = render(key, values)
    assert text
    assert "{" not in text
    if is_fault(key):
        assert text[0].isupper() or text.startswith(("x_1", "a_b"))
        assert text.endswith(".")


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
