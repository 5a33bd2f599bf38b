"""The state machine of a reception in the free protocol, as a table."""

from enum import StrEnum


class FreeState(StrEnum):
    """What the receiver does now. Sending is independent of it, but the line is half-duplex."""

    STOPPED = "stopped"
    OFF = "off"  # no RS2 instruction is driven
    READY = "ready"  # it waits for the first character
    RECEIVING = "receiving"
    COMPLETE = "complete"  # until the program resets the flag


class FreeInput(StrEnum):
    """What changes the receiver's state."""

    START = "RUN"
    STOP = "STOP or power-off"
    DRIVEN = "RS2 driven"
    RELEASED = "RS2 not driven any more"
    BEGUN = "first character"
    FULL = "end character, last byte or timeout"
    RESET = "reception complete reset"


FREE: dict[tuple[FreeState, FreeInput], FreeState] = {
    (FreeState.STOPPED, FreeInput.START): FreeState.OFF,
    (FreeState.OFF, FreeInput.DRIVEN): FreeState.READY,
    (FreeState.READY, FreeInput.BEGUN): FreeState.RECEIVING,
    (FreeState.READY, FreeInput.FULL): FreeState.COMPLETE,
    (FreeState.RECEIVING, FreeInput.FULL): FreeState.COMPLETE,
    (FreeState.COMPLETE, FreeInput.RESET): FreeState.READY,
    **{
        (state, FreeInput.RELEASED): FreeState.OFF
        for state in (FreeState.READY, FreeState.RECEIVING, FreeState.COMPLETE)
    },
    **{(state, FreeInput.STOP): FreeState.STOPPED for state in FreeState},
}
