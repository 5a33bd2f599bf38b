"""What the readers of RTU and ASCII frames have in common: the frame that is open."""

from abc import ABC, abstractmethod

from bussim.engines.contract import RxChar
from bussim.engines.modbus.adu import (
    ASCII_MAX,
    COLON,
    CR,
    HEX_DIGITS,
    LF,
    RTU_MAX,
    Adu,
    Damage,
    decode_ascii,
    decode_rtu,
)
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
        self._buffer = bytearray()
        self._length = 0
        self._reason = None
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
        return self._complete() if value == LF and clean else None

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
