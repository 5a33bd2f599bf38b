"""A fault injected from the command line, checked as if it stood in the scenario."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from bussim.errors import ScenarioError, UsageError
from bussim.scenario import loader, model
from bussim.scenario.yaml import parser as yaml
from bussim.wording import shorten, suggest

#: Kinds of faults that can be injected: all that a scenario may schedule.
KINDS = (
    "drop_reply",
    "slow",
    "power_off",
    "stop",
    "jabber",
    "late_release",
    "wrong_format",
    "clock_ppm",
    "flip_bits",
    "lose_char",
    "insert_char",
    "pause",
    "cable_cut",
    "board_error",
)
#: What belongs to the fault itself, not to its kind.
_OWN = ("count", "for")


def entry(scenario: model.Scenario, node: str, kind: str, values: Mapping[str, str]) -> dict[str, object]:
    """The fault as an entry of ``faults:``. Raises UsageError."""
    if kind not in KINDS:
        raise UsageError(f"no fault {shorten(kind)!r}; {suggest(kind, KINDS)}")
    given = {key: _value(key, text) for key, text in values.items()}
    whole = {key: given.pop(key) for key in _OWN if key in given}
    if kind == "cable_cut":
        bus = next((bus.name for bus in scenario.buses if node in scenario.nodes_on(bus.name)), None)
        if bus is None:
            raise UsageError(f"{node} is on no bus: there is no cable behind it")
        return {**whole, kind: {"bus": bus, "after": node, **given}}
    if kind == "board_error":
        plc, _, port = node.partition(".")
        return {**whole, kind: {"plc": plc, "port": port, **given}}
    return {**whole, kind: {"station": node, **given}}


def _value(key: str, text: str) -> object:
    value, _, problems = yaml.read(text, f"--{key}")
    if problems:
        raise UsageError(f"--{key}: {problems[0].message}")
    return value


def checked(
    scenario: model.Scenario,
    fault: Mapping[str, object],
    number: int,
    *,
    allow_code: bool = False,
    folder: Path | None = None,
) -> tuple[model.Fault, tuple[str, ...]]:
    """The fault of an entry, and warnings about it. Raises UsageError with every mistake.

    ``number`` distinguishes it from other injected faults: it has random streams of its own.
    """
    named = {"name": f"injected_{number}", **fault}
    data = {**scenario.source, "faults": [named]}
    try:
        found = loader.from_data(data, name="inject", allow_code=allow_code, folder=folder)
    except ScenarioError as error:
        own = f"faults.injected_{number}."
        texts = (problem.message.removeprefix(own) for problem in error.problems)
        raise UsageError("; ".join(texts)) from error
    usual = set(loader.from_data({**data, "faults": []}, allow_code=allow_code, folder=folder).warnings)
    odd = tuple(text for text in found.warnings if text not in usual)
    return replace(found.faults[-1], name=f"injected {number}"), odd
