"""The state machines of the N:N link, as tables.

The engines take every change of state from these tables; a test holds the guide's diagram to them. That
settings are taken over at STOP→RUN, and that a slave waits for the master's: FX communication manual
JY992D69901.
"""

from enum import StrEnum


class MasterState(StrEnum):
    """What the master does now or next."""

    STOPPED = "stopped"
    PARAMETERS = "parameters"  # the parameter frame is due or being sent
    DATA = "data"  # its own data frame is due or being sent
    POLL = "poll"  # a poll is due or being sent
    REPLY = "reply"  # an attempt runs: it listens until its deadline


class MasterInput(StrEnum):
    """What changes the master's state."""

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
    """What a slave does now."""

    STOPPED = "stopped"
    WAITING = "waiting"  # for parameters
    LINKED = "linked"
    REFUSING = "refusing"  # the master's mode does not exist here: silent until STOP


class SlaveInput(StrEnum):
    """What changes a slave's state."""

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
