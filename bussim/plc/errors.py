"""M8063 and D8063: the serial error flag and code that all ports of one PLC share."""

from __future__ import annotations

from array import array
from collections.abc import Hashable

from bussim.plc.memory import Device, Memory

#: Serial error flag and code (PW10 board manual, section 8).
SERIAL_ERROR = 8063


def serial_error(port: str, code: int) -> int:
    """D8063 = 7xyy: x the port's number, yy the code (PW10, section 8; 72yy of COM2: assumed)."""
    return 7000 + 100 * int(port[3:]) + code


def note_errors(bits: bytearray, words: array[int]) -> None:
    """M8004 and D8004, of a memory's M and D: whether one of M8060–M8067 is on, and which."""
    first = bits.find(1, 8060, 8068)
    bits[8004], words[8004] = first >= 0, max(first, 0)


class SerialErrors:
    """The causes that keep M8063 on, so that one port's recovery does not hide another's error.

    A cause is whatever names it, and has one code at a time. M8063 is on while there is any; D8063
    shows the latest one of those, and keeps the last code when all are over.
    """

    def __init__(self, memory: Memory) -> None:
        self._memory = memory
        self._codes: dict[Hashable, int] = {}

    def report(self, cause: Hashable, port: str, code: int) -> int:
        """A cause raises 7xyy now; returns the number."""
        self._codes.pop(cause, None)
        number = self._codes[cause] = serial_error(port, code)
        self._show(number)
        return number

    def over(self, cause: Hashable) -> None:
        """A cause is over; nothing happens if it was none."""
        if self._codes.pop(cause, None) is None:
            return
        if self._codes:
            self._show(next(reversed(self._codes.values())))
        else:
            self._memory.set(Device("M", SERIAL_ERROR), 0)

    def _show(self, number: int) -> None:
        self._memory.set(Device("M", SERIAL_ERROR), 1)
        self._memory.set_word("D", SERIAL_ERROR, number)
        note_errors(self._memory.bits("M"), self._memory.words("D"))
