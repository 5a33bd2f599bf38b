"""Diagrams of the engines' tables of states, as the guide shows them."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import TypeVar

StateT = TypeVar("StateT", bound=StrEnum)
InputT = TypeVar("InputT", bound=StrEnum)


def mermaid(table: Mapping[tuple[StateT, InputT], StateT]) -> str:
    """The table as a Mermaid state diagram (STOP, which leads to ``stopped`` from everywhere, left out)."""
    lines = ["stateDiagram-v2", "    [*] --> stopped"]
    lines += [
        f"    {state.value} --> {target.value}: {cause.value}"
        for (state, cause), target in table.items()
        if not cause.value.startswith("STOP")
    ]
    return "\n".join(lines)
