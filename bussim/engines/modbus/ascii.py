"""Cuts characters into ASCII frames; knows nothing of roles."""

from __future__ import annotations

from bussim.engines.contract import RxChar
from bussim.engines.modbus.adu import ASCII_MAX, COLON, CR, HEX_DIGITS, LF, Adu, Damage, decode_ascii
from bussim.engines.modbus.codes import Rejection

# What may follow the colon; whether it is in the right place is judged at the end.
_CHARACTERS = HEX_DIGITS | {CR, LF}


class AsciiReader:
    """A frame begins with a colon and ends with CR LF; a colon always begins a new one.

    Outside a frame everything is ignored. Inside, a character that is wrong or does not fit spoils
    the frame until its LF, the next colon or ``quiet`` ticks of silence; the latter two also end a
    frame that is merely unfinished.
    """

    __slots__ = ("_buffer", "_length", "_reason", "end", "heard", "quiet", "start")

    #: A frame is complete with its last character.
    immediate = True

    def __init__(self, quiet: int) -> None:
        self.quiet = quiet
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

    @property
    def open(self) -> bool:
        """Whether a frame, sound or spoilt, is unfinished."""
        return self._length > 0

    @property
    def lone(self) -> bool:
        """Never: a whole frame is complete at once."""
        return False

    @property
    def reason(self) -> Rejection | None:
        """What went wrong so far with what is open."""
        return self._reason

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
            self._reason = self._judge(value, parity_ok=parity_ok, stop_ok=stop_ok)
        if self._length <= ASCII_MAX:
            self._buffer.append(value)
        if value == LF and clean:
            return self._complete()
        return None

    def _judge(self, value: int, *, parity_ok: bool, stop_ok: bool) -> Rejection | None:
        if not stop_ok:
            return Rejection.FRAMING
        if not parity_ok:
            return Rejection.PARITY
        if self._length > ASCII_MAX:
            return Rejection.OVERFLOW
        return None if value in _CHARACTERS else Rejection.NOT_HEX

    def _complete(self) -> Adu | Damage:
        reason, chars = self._reason, bytes(self._buffer)
        self.heard = start, end = self.start, self.end
        self.reset()
        if reason is None:
            decoded = decode_ascii(chars)
            if isinstance(decoded, Adu):
                return decoded
            reason = decoded
        return Damage(reason, chars, start, end, _head(chars))

    def whole(self, adu: Adu, start: int, end: int) -> Damage | None:
        """Take a whole undamaged frame, which is complete; returns the damage that it ends."""
        del adu
        before = self.silence()
        self.heard = start, end
        return before

    def silence(self) -> Damage | None:
        """The line has been quiet for ``quiet`` ticks: what was open is over."""
        if self._length == 0:
            return None
        reason, chars = self._reason or Rejection.UNFINISHED, bytes(self._buffer)
        self.heard = start, end = self.start, self.end
        self.reset()
        return Damage(reason, chars, start, end, _head(chars))


def _head(chars: bytes) -> bytes | None:
    """Station and function of an ASCII frame that is damaged somewhere."""
    digits = chars[1:5]
    if len(digits) < 4 or not HEX_DIGITS.issuperset(digits):
        return None
    return bytes.fromhex(digits.decode("ascii"))
