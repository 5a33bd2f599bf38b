"""Cuts characters into Modbus RTU frames by the silences between them."""

from __future__ import annotations

from bussim.engines.contract import RxChar
from bussim.engines.modbus.adu import RTU_MAX, Adu, Damage, decode_rtu
from bussim.engines.modbus.codes import Rejection
from bussim.engines.modbus.reader import AduReader


class RtuReader(AduReader):
    """A frame begins after ``quiet`` ticks of silence and ends with the next such silence.

    More than ``inner`` ticks inside it damage it, as do a character that was received wrongly and a
    257th one; what follows until the silence belongs to the damage. A driver that does not report
    the silence loses nothing: the next character ends the frame too, later.
    """

    def __init__(self, quiet: int, inner: int) -> None:
        self._inner = inner
        super().__init__(quiet)

    def reset(self) -> None:
        """Forget the open frame."""
        super().reset()
        self._whole: Adu | None = None  # the buffer is this frame, whose check need not be computed

    @property
    def lone(self) -> bool:
        """See the base class."""
        return self._whole is not None

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
        else:  # no silence in between: not two frames, but one that is damaged
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
        """See the base class."""
        if self._length == 0:
            return None
        whole, reason = self._whole, self._reason
        chars, start, end = self._taken()
        if reason is None:
            decoded = decode_rtu(chars) if whole is None else whole
            if isinstance(decoded, Adu):
                return decoded
            reason = decoded
        return Damage(reason, chars, start, end, chars[:2] if len(chars) >= 2 else None)
