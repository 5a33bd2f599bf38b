"""What the readers of RTU and ASCII frames have in common: the frame that is open."""

from __future__ import annotations

from abc import ABC, abstractmethod

from bussim.engines.contract import RxChar
from bussim.engines.modbus.adu import Adu, Damage
from bussim.engines.modbus.codes import Rejection


class AduReader(ABC):
    """Cuts characters into frames; the roles of stations play no part.

    ``immediate``: a frame is complete with its last character, else only with the silence behind it.
    """

    immediate = False

    def __init__(self, quiet: int) -> None:
        self.quiet = quiet
        #: First edge and last stop bit of the open frame, meaningful only while there is one.
        self.start = 0
        self.end = 0
        #: The same two of the frame that was completed last.
        self.heard = (0, 0)
        self.reset()

    def reset(self) -> None:
        """Forget the open frame."""
        self._buffer = bytearray()
        self._length = 0
        self._reason: Rejection | None = None

    @property
    def open(self) -> bool:
        """Whether something was received that neither its last character nor a silence has ended."""
        return self._length > 0

    @property
    def lone(self) -> bool:
        """Whether the open frame is a whole one that was delivered as such."""
        return False

    @property
    def reason(self) -> Rejection | None:
        """The first error of the open frame so far."""
        return self._reason

    @abstractmethod
    def character(self, char: RxChar, start: int, end: int) -> Adu | Damage | None:
        """Take one character; returns what it, or the silence before it, has ended."""

    @abstractmethod
    def whole(self, adu: Adu, start: int, end: int) -> Adu | Damage | None:
        """Take a whole undamaged frame; returns what the silence before it has ended."""

    @abstractmethod
    def silence(self) -> Adu | Damage | None:
        """The line has been idle for ``quiet`` ticks: the open frame is over."""

    def _taken(self) -> tuple[bytes, int, int]:
        """The open frame's characters and its two ends; it is over."""
        chars = bytes(self._buffer)
        self.heard = start, end = self.start, self.end
        self.reset()
        return chars, start, end
