"""State machines as tables: from (state, input) to the next state.

Each protocol has its tables in its own ``states.py``; an engine takes every change of state from them.
"""

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
