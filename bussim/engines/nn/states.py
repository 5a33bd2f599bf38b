"""The state machines of the N:N link, as tables.

The engines take every change of state from these tables; the diagrams in the README are generated
from them. Inputs are words for what the driver tells the engine. That settings are taken over at
STOP→RUN, and that a slave waits for the master's: FX communication manual JY992D69901.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import TypeVar


class MasterState(StrEnum):
    """What the master does next, or now."""

    STOPPED = "stopped"
    PARAMETERS = "parameters"  # the parameter frame is due or being sent
    DATA = "data"  # its own data frame is due or being sent
    POLL = "poll"  # a poll is due or being sent
    REPLY = "reply"  # an attempt runs: it listens until its deadline


class MasterInput(StrEnum):
    """What moves the master on."""

    START = "first END in RUN"
    STOP = "STOP or power-off"
    SENT = "frame sent"
    MORE = "attempt decided, more polls to send"
    SCAN_OVER = "last slave done"
    SCAN_OVER_FLAGGED = "last slave done, a flag is on"


MASTER: dict[tuple[MasterState, MasterInput], MasterState] = {
    (MasterState.STOPPED, MasterInput.START): MasterState.PARAMETERS,
    (MasterState.PARAMETERS, MasterInput.SENT): MasterState.DATA,
    (MasterState.DATA, MasterInput.SENT): MasterState.POLL,
    (MasterState.POLL, MasterInput.SENT): MasterState.REPLY,
    (MasterState.REPLY, MasterInput.MORE): MasterState.POLL,
    (MasterState.REPLY, MasterInput.SCAN_OVER): MasterState.DATA,
    (MasterState.REPLY, MasterInput.SCAN_OVER_FLAGGED): MasterState.PARAMETERS,
    **{(state, MasterInput.STOP): MasterState.STOPPED for state in MasterState},
}


class SlaveState(StrEnum):
    """How far a slave has got."""

    STOPPED = "stopped"
    WAITING = "waiting"  # for parameters
    LINKED = "linked"
    REFUSING = "refusing"  # the master's mode does not exist here: silent until STOP


class SlaveInput(StrEnum):
    """What moves a slave on."""

    START = "RUN"
    STOP = "STOP or power-off"
    PARAMETERS = "parameters"
    FOREIGN_MODE = "parameters with a mode that it does not have"


SLAVE: dict[tuple[SlaveState, SlaveInput], SlaveState] = {
    (SlaveState.STOPPED, SlaveInput.START): SlaveState.WAITING,
    (SlaveState.WAITING, SlaveInput.PARAMETERS): SlaveState.LINKED,
    (SlaveState.LINKED, SlaveInput.PARAMETERS): SlaveState.LINKED,
    (SlaveState.WAITING, SlaveInput.FOREIGN_MODE): SlaveState.REFUSING,
    (SlaveState.LINKED, SlaveInput.FOREIGN_MODE): SlaveState.REFUSING,
    **{(state, SlaveInput.STOP): SlaveState.STOPPED for state in SlaveState},
}


StateT = TypeVar("StateT", bound=StrEnum)
CauseT = TypeVar("CauseT", bound=StrEnum)


def mermaid(table: Mapping[tuple[StateT, CauseT], StateT]) -> str:
    """The table as a Mermaid state diagram (STOP, which leads to ``stopped`` from everywhere, left out)."""
    lines = ["stateDiagram-v2", "    [*] --> stopped"]
    lines += [
        f"    {state.value} --> {target.value}: {cause.value}"
        for (state, cause), target in table.items()
        if not cause.value.startswith("STOP")
    ]
    return "\n".join(lines)
