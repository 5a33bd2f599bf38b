"""What a link scan, an exchange, an END and a transaction cost, in Python calls: a time is no verdict."""

from __future__ import annotations

import json

import pytest

from tests.benchmarks.bench_speed import RECORDED, calls


@pytest.mark.slow
def test_no_part_takes_a_tenth_more_calls_than_recorded() -> None:
    recorded = json.loads(RECORDED.read_text("utf-8"))["calls"]
    now = calls()
    assert now.keys() == recorded.keys()
    assert {what: number for what, number in now.items() if number > 1.1 * recorded[what]} == {}
