"""Every reader gets its first inputs and those that once were too much for it; ``python -m tests.fuzz`` goes on."""

from __future__ import annotations

from pathlib import Path
from random import Random

import pytest

from bussim.errors import UsageError
from tests.fuzz import __main__ as program
from tests.fuzz.mutations import changed_value
from tests.fuzz.targets import TARGETS, Target


@pytest.mark.parametrize("name", TARGETS)
def test_first_inputs(name: str) -> None:
    kept = len(list((program.CORPUS / name).glob("*")))
    inputs = kept + len(TARGETS[name].seeds()) + (4 if name == "commands" else 20)
    outcome = program.fuzz(name, inputs, 3600, 0)
    assert (outcome.fault, outcome.inputs) == (None, inputs)


def test_a_fault_is_kept_and_tried_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def check(data: bytes) -> None:
        if data[:1] == b"x":
            raise UsageError("begins with x")
        assert b"9" not in data

    monkeypatch.setitem(TARGETS, "rtu", Target(lambda: [b"x123456780"], check))
    monkeypatch.setattr(program, "CORPUS", tmp_path)
    found = program.fuzz("rtu", 100_000, 3600, 1)
    assert found.fault is not None
    assert "AssertionError" in found.fault
    assert found.refused > 0
    (kept,) = (tmp_path / "rtu").iterdir()
    assert b"9" in kept.read_bytes()
    assert program.fuzz("rtu", 100_000, 3600, 2).inputs == 2


def test_values_are_changed_in_every_way() -> None:
    random, value = Random(1), {"a": [1, {"b": "x"}], "c": None}
    made = {repr(changed_value(random, value)) for _ in range(500)}
    assert len(made) > 200
    assert value == {"a": [1, {"b": "x"}], "c": None}
