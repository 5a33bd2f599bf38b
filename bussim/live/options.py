"""How a port on a real wire is to be treated: settings that a simulation does not need."""

from dataclasses import dataclass
from enum import StrEnum

from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND

#: Bytes that a port reads at once. More stay with the system: memory is bounded whatever comes.
CHUNK = 4096


class DirectionControl(StrEnum):
    """Who switches an RS485 driver on and off."""

    ADAPTER = "adapter"  # the adapter itself, or there is nothing to switch
    DRIVER = "driver"  # the port's own driver in the operating system (pyserial's rs485_mode)
    RTS = "rts"  # this program, with RTS around every write: late by the system's delays


@dataclass(frozen=True, slots=True)
class PortOptions:
    """Settings of one port. Times in ticks.

    ``tolerance`` is added to every silence that damages a frame or ends an unfinished one, because
    bytes come from the system in chunks (an FTDI adapter holds them back for up to 16 ms). A frame
    that is whole and sound ends after the protocol's own silence all the same.

    ``paced`` sends a byte only when it could leave at the line's rate. ``echo``: the adapter hears
    what it sends, so that many characters as were sent are dropped. ``instant`` says that bytes
    take no time on this wire (a pseudo-terminal, a socket); None: as the kind of URL suggests.

    A lost port is tried again after ``retry_first``, then twice as long each time up to ``retry_last``.
    """

    tolerance: int = 20 * TICKS_PER_MS
    paced: bool = False
    echo: bool = False
    direction: DirectionControl = DirectionControl.ADAPTER
    instant: bool | None = None
    retry_first: int = TICKS_PER_SECOND // 10
    retry_last: int = 5 * TICKS_PER_SECOND


DEFAULT_OPTIONS = PortOptions()
