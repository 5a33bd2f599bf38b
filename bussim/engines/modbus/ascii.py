"""Cuts characters into Modbus ASCII frames."""

from __future__ import annotations

from bussim.engines.contract import RxChar
from bussim.engines.modbus.adu import ASCII_MAX, COLON, CR, HEX_DIGITS, LF, Adu, Damage, decode_ascii
from bussim.engines.modbus.codes import Rejection
from bussim.engines.modbus.reader import AduReader

# What may follow the colon; whether it is where it may be is checked at the end.
_CHARACTERS = HEX_DIGITS | {CR, LF}


class AsciiReader(AduReader):
    """A frame begins with a colon and ends with CR LF; a colon always begins a new one.

    Outside a frame everything is ignored. Inside, a character that is wrong or does not fit damages
    the frame until its LF, the next colon or ``quiet`` ticks of silence; the latter two also end a
    frame that is merely unfinished.
    """

    immediate = True

    def character(self, char: RxChar, start: int, end: int) -> Adu | Damage | None:
        """Take one character; returns the frame that it completes, or the damage that it ends."""
        value, parity_ok, stop_ok = char
        clean = parity_ok and stop_ok
        before: Damage | None = None
        if self._length and (start - self.end >= self.quiet or (clean and value == COLON)):
            before = self.silence()
        if self._length == 0:
            if clean and value == COLON:
                self._buffer.append(value)
                self._length = 1
                self.start, self.end = start, end
            return before
        self._length += 1
        self.end = end
        if self._reason is None:
            self._reason = self._error_of(value, parity_ok=parity_ok, stop_ok=stop_ok)
        if self._length <= ASCII_MAX:
            self._buffer.append(value)
        if value == LF and clean:
            return self._complete()
        return None

    def _error_of(self, value: int, *, parity_ok: bool, stop_ok: bool) -> Rejection | None:
        if not stop_ok:
            return Rejection.FRAMING
        if not parity_ok:
            return Rejection.PARITY
        if self._length > ASCII_MAX:
            return Rejection.OVERFLOW
        return None if value in _CHARACTERS else Rejection.NOT_HEX

    def _complete(self) -> Adu | Damage:
        reason, (chars, start, end) = self._reason, self._taken()
        if reason is None:
            decoded = decode_ascii(chars)
            if isinstance(decoded, Adu):
                return decoded
            reason = decoded
        return Damage(reason, chars, start, end, _head(chars))

    def whole(self, adu: Adu, start: int, end: int) -> Damage | None:
        """Take a whole undamaged frame, which is complete; returns the damage that it ends."""
        before = self.silence()
        self.heard = start, end
        return before

    def silence(self) -> Damage | None:
        """See the base class."""
        if self._length == 0:
            return None
        reason, (chars, start, end) = self._reason or Rejection.UNFINISHED, self._taken()
        return Damage(reason, chars, start, end, _head(chars))


def _head(chars: bytes) -> bytes | None:
    """Station and function of an ASCII frame that is damaged somewhere."""
    digits = chars[1:5]
    if len(digits) < 4 or not HEX_DIGITS.issuperset(digits):
        return None
    return bytes.fromhex(digits.decode("ascii"))
