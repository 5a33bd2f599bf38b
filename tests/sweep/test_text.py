"""Means of a sweep as text."""

from __future__ import annotations

import re

import numpy as np
import pytest

from bussim.sweep.intervals import NEVER, TOO_FEW, Mean, footnotes, mean_of, with_interval


def printed(*values: float | None, events: bool = False) -> str:
    return with_interval(mean_of(values, events=events), values)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ((50.42, 50.44, 50.41), "50.423 ± 0.038"),
        ((43.375, 43.375, 43.375), "43.38 ± 0"),
        ((1000.0, 1001.0, 1002.0), "1,001.0 ± 2.5"),
        ((56.1, 140.0, 83.4), "56.10–140*"),
        ((66.82, 66.82), "66.82*"),  # two are too few, whatever they say
        ((7.25,), "7.25"),
        ((7.25, None), "–"),
        ((), "–"),
        ((0.00012, 0.00012, 0.00012), "0.00012 ± 0"),
    ],
)
def test_a_mean_is_told_with_its_interval_or_not_at_all(values: tuple[float, ...], text: str) -> None:
    assert printed(*values) == text


def test_counts_are_told_by_what_was_seen() -> None:
    assert printed(0, 2, 1, events=True) == "0–2*"
    assert printed(0, 0, 0, events=True) == "0°"
    assert printed(0, events=True) == "0"
    assert printed(0, 0, 0) == "0 ± 0"
    assert re.fullmatch(r"4\d\d ± \d\d", printed(412, 390, 425, 401, 433, 405, events=True))


def test_no_printed_interval_is_narrower_than_the_true_one_or_wider_than_a_tenth() -> None:
    rng = np.random.default_rng(7)
    told_at_all = 0
    for scale in (0.003, 0.9, 50.0, 4321.0):
        for spread in (1e-7, 1e-4, 0.01, 0.05, 0.3):
            for count in (2, 3, 5, 20):
                values = np.abs(rng.normal(scale, scale * spread, count)).round(9).tolist()
                mean = mean_of(values)
                text = with_interval(mean, values)
                found = re.fullmatch(r"([0-9.,]+) ± ([0-9.,]+)", text)
                assert (found is None) == mean.too_few(count) == text.endswith(TOO_FEW)
                if found is None:
                    continue
                told_at_all += 1
                number, half = (float(part.replace(",", "")) for part in found.groups())
                assert mean.mean is not None
                assert mean.high is not None
                assert half >= mean.high - mean.mean - 1e-9
                assert number == pytest.approx(
                    mean.mean, abs=0.5 * 10 ** -len(found[1].partition(".")[2]) + 1e-9
                )
                assert half <= 0.1 * number * 1.1 or half < 1e-5
    assert told_at_all > 30


def test_marks_are_explained_where_they_are() -> None:
    assert footnotes("50.4 ± 0.1", 3) == []
    few, never = footnotes(f"1–2{TOO_FEW} 0{NEVER}", 3, {"longest scan": 1234})
    assert few == (
        "* least and greatest run: 3 repeats are too few for a mean within ±10 %; it takes at least 1,234 "
        "(longest scan)"
    )
    # 0.64³ = 0.047: with a chance above 64 % less than one time in twenty no run of three has it.
    assert never == "° in none of 3 runs; with 95 % confidence in at most 64 % of all"
    assert (1 - 0.64) ** 3 <= 0.05 < (1 - 0.63) ** 3


def test_a_table_of_an_earlier_version_has_means_all_the_same() -> None:
    assert with_interval(Mean(5.25, 5.0, 5.5), [5.0, 5.5, 5.25]) == "5.25 ± 0.25"
