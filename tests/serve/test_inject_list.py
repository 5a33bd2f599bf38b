"""What ``bussim inject`` says that it takes is what faults are made of."""

from __future__ import annotations

import re
from dataclasses import fields
from typing import get_args

import pytest

from bussim.commands.inject import command
from bussim.errors import UsageError
from bussim.scenario.fault_kinds import FaultKind
from bussim.scenario.loader import load
from bussim.serve.requests import entry

#: The fields of each kind of fault, by its name in a scenario.
KINDS = {
    re.sub(r"(?<!^)(?=[A-Z])", "_", kind.__name__).lower(): {field.name for field in fields(kind)}
    for kind in get_args(FaultKind)
}
#: What NODE says: whom a fault befalls, and where.
OF_NODE = {"node", "bus", "after", "port"}
#: The options of a field that has another name.
OPTIONS = {"timing": ("format", "baud")}


def test_the_help_lists_every_fault() -> None:
    said = re.search(r"FAULT is (.*), as in a scenario", " ".join((command.help or "").split()))
    assert said is not None
    listed = re.findall(r"[a-z]+(?:_[a-z]+)?", re.sub(r"\(.*?\)|\bor\b", "", said[1]))
    assert sorted(listed) == sorted(KINDS)


def test_each_option_names_the_faults_that_have_its_field() -> None:
    found = {
        str(option.name).removeprefix("value_"): str(getattr(option, "help", ""))
        for option in command.params
        if str(option.name).startswith("value_")
    }
    names = {name for own in KINDS.values() for name in own} - OF_NODE
    of_field = {name: OPTIONS.get(name, (name,)) for name in names}
    assert set(found) == {"for", *(option for options in of_field.values() for option in options)}
    for name, options in of_field.items():
        having = {kind for kind, own in KINDS.items() if name in own}
        for option in options:
            assert {kind for kind in KINDS if re.search(rf"\b{kind}\b", found[option])} == having, option


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_every_fault_of_the_list_is_an_entry_of_a_scenario(kind: str) -> None:
    (key, value) = entry(load("press_line"), "press2", kind, {}).popitem()
    assert key == kind
    assert value[{"cable_cut": "after", "board_error": "plc"}.get(kind, "station")] == "press2"  # type: ignore[index]


def test_an_unknown_fault_is_answered_with_all_that_there_are() -> None:
    with pytest.raises(UsageError) as raised:
        entry(load("press_line"), "press2", "zzz", {})
    assert set(KINDS) <= set(re.findall(r"[a-z_]+", str(raised.value)))
