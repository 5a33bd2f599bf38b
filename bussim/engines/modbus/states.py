"""The state machines of the Modbus master and slave, as tables.

The engines take every change of state from these tables.
"""

from enum import StrEnum


class MasterState(StrEnum):
    """What the master does now."""

    STOPPED = "stopped"
    IDLE = "idle"
    DUE = "due"  # a request waits for its first edge
    SENDING = "sending"
    REPLY = "reply"  # it receives until the timeout
    TURNAROUND = "turnaround"  # after a broadcast


class MasterInput(StrEnum):
    """What changes the master's state."""

    START = "RUN"
    STOP = "STOP or power-off"
    SUBMITTED = "request submitted"
    BEGUN = "first edge"
    REQUESTED = "request sent"
    BROADCAST = "broadcast sent"
    DECIDED = "response taken, failed or timed out"
    TURNED = "turnaround over"


MASTER: dict[tuple[MasterState, MasterInput], MasterState] = {
    (MasterState.STOPPED, MasterInput.START): MasterState.IDLE,
    (MasterState.IDLE, MasterInput.SUBMITTED): MasterState.DUE,
    (MasterState.DUE, MasterInput.BEGUN): MasterState.SENDING,
    (MasterState.SENDING, MasterInput.REQUESTED): MasterState.REPLY,
    (MasterState.SENDING, MasterInput.BROADCAST): MasterState.TURNAROUND,
    (MasterState.REPLY, MasterInput.DECIDED): MasterState.IDLE,
    (MasterState.TURNAROUND, MasterInput.TURNED): MasterState.IDLE,
    **{(state, MasterInput.STOP): MasterState.STOPPED for state in MasterState},
}


class SlaveState(StrEnum):
    """What the slave does now."""

    STOPPED = "stopped"
    REFUSING = "refusing"  # its station number is impossible: silent until STOP
    LISTENING = "listening"
    SERVING = "serving"  # a request waits to be carried out
    RESPONDING = "responding"  # a response is due
    SENDING = "sending"


class SlaveInput(StrEnum):
    """What changes the slave's state."""

    START = "RUN"
    BAD_STATION = "RUN with an impossible station number"
    STOP = "STOP or power-off"
    REQUEST = "request for it"
    SERVED = "request carried out or refused"
    SERVED_ALL = "broadcast carried out"
    BEGUN = "first edge"
    SENT = "reply sent"
    LOST = "reply given up"


SLAVE: dict[tuple[SlaveState, SlaveInput], SlaveState] = {
    (SlaveState.STOPPED, SlaveInput.START): SlaveState.LISTENING,
    (SlaveState.STOPPED, SlaveInput.BAD_STATION): SlaveState.REFUSING,
    (SlaveState.LISTENING, SlaveInput.REQUEST): SlaveState.SERVING,
    (SlaveState.SERVING, SlaveInput.SERVED): SlaveState.RESPONDING,
    (SlaveState.SERVING, SlaveInput.SERVED_ALL): SlaveState.LISTENING,
    (SlaveState.RESPONDING, SlaveInput.BEGUN): SlaveState.SENDING,
    (SlaveState.RESPONDING, SlaveInput.LOST): SlaveState.LISTENING,
    (SlaveState.SENDING, SlaveInput.SENT): SlaveState.LISTENING,
    **{(state, SlaveInput.STOP): SlaveState.STOPPED for state in SlaveState},
}
