"""Cuts characters into RTU frames by the silences between them; knows nothing of roles."""

from __future__ import annotations

from bussim.engines.contract import RxChar
from bussim.engines.modbus.adu import RTU_MAX, Adu, Damage, decode_rtu
from bussim.engines.modbus.codes import Rejection


class RtuReader:
    """A frame begins after ``quiet`` ticks of silence and ends with the next such silence.

    More than ``inner`` ticks inside it damage it, as do a character that was received wrongly and a
    257th one; what follows until the silence belongs to the damage. A driver that does not report
    the silence loses nothing: the next character tells of it too, later.
    """

    __slots__ = ("_buffer", "_inner", "_length", "_reason", "_whole", "end", "heard", "quiet", "start")

    #: A frame is complete only with the silence behind it.
    immediate = False

    def __init__(self, quiet: int, inner: int) -> None:
        self.quiet = quiet
        self._inner = inner
        #: First edge and last stop bit of what is open, meaningful only while something is.
        self.start = 0
        self.end = 0
        #: The same two of what was completed last.
        self.heard = (0, 0)
        self.reset()

    def reset(self) -> None:
        """Forget what is open."""
        self._buffer = bytearray()
        self._length = 0
        self._reason: Rejection | None = None
        self._whole: Adu | None = None  # the buffer is this frame, whose check need not be computed

    @property
    def open(self) -> bool:
        """Whether something was heard that the line's quiet has not ended yet."""
        return self._length > 0

    @property
    def lone(self) -> bool:
        """Whether what is open is one whole frame, told as such, and nothing else."""
        return self._whole is not None

    @property
    def reason(self) -> Rejection | None:
        """What went wrong so far with what is open."""
        return self._reason

    def character(self, char: RxChar, start: int, end: int) -> Adu | Damage | None:
        """Take one character; returns what the silence before it has ended, if anything."""
        before = self._gap(start)
        value, parity_ok, stop_ok = char
        if self._length == 0:
            self.start = start
        self._length += 1
        self.end = end
        self._whole = None
        if self._reason is None:
            if not stop_ok:
                self._reason = Rejection.FRAMING
            elif not parity_ok:
                self._reason = Rejection.PARITY
        if self._length <= RTU_MAX:
            self._buffer.append(value)
        elif self._reason is None:
            self._reason = Rejection.OVERFLOW
        return before

    def whole(self, adu: Adu, start: int, end: int) -> Adu | Damage | None:
        """Take a whole undamaged frame; returns what the silence before it has ended, if anything."""
        before = self._gap(start)
        if self._length == 0:
            self._whole = adu
            self._buffer = bytearray(adu.chars)
            self._length = len(adu.chars)
            self.start = start
        else:  # no silence in between: not two frames, but one that makes no sense
            self._whole = None
            self._length += len(adu.chars)
            self._buffer += adu.chars
            del self._buffer[RTU_MAX:]
            if self._length > RTU_MAX and self._reason is None:
                self._reason = Rejection.OVERFLOW
        self.end = end
        return before

    def _gap(self, start: int) -> Adu | Damage | None:
        if self._length == 0:
            return None
        gap = start - self.end
        if gap >= self.quiet:
            return self.silence()
        if gap > self._inner and self._reason is None:
            self._reason = Rejection.GAP
        return None

    def silence(self) -> Adu | Damage | None:
        """The line has been quiet for ``quiet`` ticks: what was open is over."""
        if self._length == 0:
            return None
        whole, reason, chars = self._whole, self._reason, bytes(self._buffer)
        self.heard = start, end = self.start, self.end
        self.reset()
        if reason is None:
            decoded = decode_rtu(chars) if whole is None else whole
            if isinstance(decoded, Adu):
                return decoded
            reason = decoded
        return Damage(reason, chars, start, end, chars[:2] if len(chars) >= 2 else None)
