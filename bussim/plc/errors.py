"""M8063 and D8063: the serial error flag and code that all ports of one PLC share."""

from __future__ import annotations

from array import array
from collections.abc import Hashable
from typing import assert_never

from bussim.plc.memory import Device, Memory
from bussim.plc.profiles import ErrorCodes

#: Serial error flag and code (PW10 board manual, section 8).
SERIAL_ERROR = 8063

#: The xx of an FX by the PW10's yy: 1 reception, 3 sum, 4 format, 5 command, 6 timeout, 8 N:N parameters.
_FX_CODES = {0: 8, 1: 4, 2: 5, 3: 3, 4: 5, 5: 1, 6: 4, 7: 1, 8: 1, 9: 6, 48: 8, 49: 8}


def serial_error(codes: ErrorCodes, port: str, code: int) -> int:
    """What D8063 says of a port's error.

    PW10, section 8: D8063 = 7xyy, x the port's number, yy the code (72yy of COM2: assumed). What an FX calls
    it, 6308 for N:N parameters among them: from memory, assumed; an error of the board is one of reception.
    """
    match codes:
        case ErrorCodes.PW10:
            return 7000 + 100 * int(port[3:]) + code
        case ErrorCodes.FX3U if port == "COM4":
            return 3800 + _FX_CODES.get(code, 1)
        case ErrorCodes.FX | ErrorCodes.FX3U:
            return 6300 + _FX_CODES.get(code, 1)
        case _:
            assert_never(codes)


def shown_at(code: int) -> int:
    """The number of M and D that show a code of :func:`serial_error`."""
    return 8438 if code // 100 == 38 else SERIAL_ERROR


def note_errors(bits: bytearray, words: array[int]) -> None:
    """M8004 and D8004, of a memory's M and D: whether one of M8060–M8067 is on, and which."""
    first = bits.find(1, 8060, 8068)
    bits[8004], words[8004] = first >= 0, max(first, 0)


class SerialErrors:
    """The causes that keep M8063 on, so that one port's recovery does not hide another's error.

    A cause is whatever names it, and has one code at a time. M8063 is on while there is any; D8063
    shows the latest one of those, and keeps the last code when all are over.
    """

    def __init__(self, memory: Memory, codes: ErrorCodes = ErrorCodes.PW10) -> None:
        self._memory = memory
        self._numbering = codes
        self._codes: dict[Hashable, int] = {}

    def report(self, cause: Hashable, port: str, code: int) -> int:
        """A cause raises its code now; returns the number in D8063."""
        self._codes.pop(cause, None)
        number = self._codes[cause] = serial_error(self._numbering, port, code)
        self._show(number)
        return number

    def over(self, cause: Hashable) -> None:
        """A cause is over; nothing happens if it was none."""
        gone = self._codes.pop(cause, 0)
        left = [number for number in self._codes.values() if shown_at(number) == shown_at(gone)]
        if gone and left:
            self._show(left[-1])
        elif gone:
            self._memory.set(Device("M", shown_at(gone)), 0)

    def _show(self, number: int) -> None:
        self._memory.set(Device("M", shown_at(number)), 1)
        self._memory.set_word("D", shown_at(number), number)
        note_errors(self._memory.bits("M"), self._memory.words("D"))
