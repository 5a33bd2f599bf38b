"""The N:N frames: the only module that writes and reads them by the assumed layout.

Recordings are read by a layout that is a value (:mod:`bussim.live.layout.value`), by default the same one.

No public source gives the bytes of the N:N link. What is known: 38400 7E1, a fixed header, a fixed
terminator and a fixed sum (PW10 board manual, section 7.3); a station number and a communication
counter in every message (FX communication manual JY992D69901, error codes 02 and 03); and the
published link times, whose slopes are the arithmetic of hexadecimal text. The layout below is our
assumption that agrees with all of that:

==========  =======================  =====================================================  ==========
frame       sender                   layout                                                 characters
==========  =======================  =====================================================  ==========
data        master, slave            STX station counter data… ETX sum sum                  6 + 2/byte
poll        master                   ENQ station counter sum sum                            5
parameters  master, to all slaves    SOH ``F`` counter D8177 D8178 D8179 D8180 ETX sum sum  14
==========  =======================  =====================================================  ==========

Station and counter are one hexadecimal digit, data, settings and sum two per byte, upper case. The
data are the M block, low byte first with the lowest M in bit 0, then the D words, high byte first.
The sum is the low byte of the sum of all characters after the header, up to and including ETX (in a
poll: up to the counter).
"""

from __future__ import annotations

from binascii import hexlify
from collections.abc import Iterable
from functools import lru_cache
from typing import Final, NamedTuple

SOH: Final = 0x01
STX: Final = 0x02
ETX: Final = 0x03
ENQ: Final = 0x05
HEADERS: Final = frozenset((SOH, STX, ENQ))

#: Kinds of frames; plain numbers because every listener compares them for every frame.
DATA: Final = 0
POLL: Final = 1
PARAMETERS: Final = 2
KIND_NAMES: Final = ("data", "poll", "parameters")

POLL_CHARS: Final = 5
PARAMETERS_CHARS: Final = 14
#: Characters of a data frame besides its data.
DATA_OVERHEAD_CHARS: Final = 6

#: Two character times of silence end an unfinished frame in every receiver (assumed).
QUIET_CHARS: Final = 2

_HEX: Final = b"0123456789ABCDEF"
_IS_HEX: Final = frozenset(_HEX)


class Block(NamedTuple):
    """The devices that each station shares in one refresh mode (PW10, section 7.2)."""

    bits: int  # M points
    words: int  # D words

    @property
    def size(self) -> int:
        """Bytes of a block's image."""
        return self.bits // 8 + 2 * self.words


#: Blocks by D8178.
MODES: Final = (Block(0, 4), Block(32, 4), Block(64, 8), Block(64, 16), Block(64, 32))


class LinkSettings(NamedTuple):
    """D8177 (slaves, 1–7), D8178 (mode, 0–4), D8179 (retries, 0–10), D8180 (timeout, × 10 ms)."""

    slaves: int
    mode: int
    retries: int
    timeout: int

    @property
    def possible(self) -> bool:
        """Whether a master could have these settings: D8177–D8179 as in every family, any timeout."""
        return (
            1 <= self.slaves <= 7
            and self.mode < len(MODES)
            and self.retries <= 10
            and 1 <= self.timeout <= 255
        )


class Frame(NamedTuple):
    """One valid frame. ``data`` is the block's image (empty unless a data frame)."""

    kind: int
    station: int
    counter: int
    chars: bytes
    data: bytes = b""
    settings: LinkSettings | None = None

    @property
    def kind_name(self) -> str:
        """``data``, ``poll`` or ``parameters``."""
        return KIND_NAMES[self.kind]


def data_chars(mode: int) -> int:
    """Characters of a data frame in a refresh mode."""
    return DATA_OVERHEAD_CHARS + 2 * MODES[mode].size


def _sealed(header: int, body: bytes) -> bytes:
    return bytes((header,)) + body + b"%02X" % (sum(body) & 0xFF)


@lru_cache(1024)  # of each station and counter while its block stays the same
def encode_data(station: int, counter: int, data: bytes) -> Frame:
    """The data frame of a station (0–7) with a counter (0–15) and its block's image."""
    body = b"%X%X%b\x03" % (station, counter, hexlify(data).upper())
    return Frame(DATA, station, counter, _sealed(STX, body), data)


@lru_cache(1024)
def encode_poll(station: int, counter: int) -> Frame:
    """The master's poll of a slave (1–7)."""
    return Frame(POLL, station, counter, _sealed(ENQ, b"%X%X" % (station, counter)))


def encode_parameters(counter: int, settings: LinkSettings) -> Frame:
    """The frame that carries the master's settings to all slaves."""
    body = b"F%X%02X%02X%02X%02X\x03" % (counter, *settings)
    return Frame(PARAMETERS, 0, counter, _sealed(SOH, body), settings=settings)


def decode(chars: bytes) -> Frame | None:
    """The frame that these characters, header to sum, are; None if they are not a valid one."""
    if len(chars) < POLL_CHARS or chars[0] not in HEADERS:
        return None
    header, body = chars[0], chars[1:-2]
    if chars[-2:] != b"%02X" % (sum(body) & 0xFF):
        return None
    if header == ENQ:
        return _decode_poll(chars, body)
    if body[-1] != ETX:
        return None
    inner = body[:-1]
    if not _IS_HEX.issuperset(inner):
        return None
    return _decode_data(chars, inner) if header == STX else _decode_parameters(chars, inner)


def _decode_poll(chars: bytes, body: bytes) -> Frame | None:
    if len(chars) != POLL_CHARS or not _IS_HEX.issuperset(body):
        return None
    station = int(body[0:1], 16)
    return None if not 1 <= station <= 7 else Frame(POLL, station, int(body[1:2], 16), chars)


def _decode_data(chars: bytes, inner: bytes) -> Frame | None:
    if len(inner) < 2 or len(inner) % 2:
        return None
    station = int(inner[0:1], 16)
    if station > 7:
        return None
    return Frame(DATA, station, int(inner[1:2], 16), chars, bytes.fromhex(inner[2:].decode("ascii")))


def _decode_parameters(chars: bytes, inner: bytes) -> Frame | None:
    if len(chars) != PARAMETERS_CHARS or inner[:1] != b"F":
        return None
    settings = LinkSettings(*bytes.fromhex(inner[2:].decode("ascii")))
    if not settings.possible:
        return None
    return Frame(PARAMETERS, 0, int(inner[1:2], 16), chars, settings=settings)


class Damage(NamedTuple):
    """A frame that was damaged or left unfinished, or noise, now over.

    ``header`` is its clean header (SOH, STX, ENQ) or None where it began otherwise; ``first`` the
    clean character after a clean header, None if there was none.
    """

    header: int | None
    first: int | None


_MAX_CHARS: Final = data_chars(len(MODES) - 1)


class FrameReader:
    """Cuts characters into frames; the roles of stations play no part.

    A cleanly received header always starts a new frame. A character that is damaged or does not fit
    the layout damages the frame until the next clean header or the line's silence.
    """

    __slots__ = ("_buffer", "_header", "_sound", "data_size", "length", "start")

    def __init__(self) -> None:
        #: Bytes of data that a data frame must carry; None while the mode is unknown.
        self.data_size: int | None = None
        #: First edge of the frame that is open, meaningful only while one is.
        self.start = 0
        self.reset()

    def reset(self) -> None:
        """Forget the open frame: the line was idle, or the station itself sends."""
        self._buffer = bytearray()
        self._header: int | None = None
        self._sound = True
        #: Characters of what is open.
        self.length = 0  # received since the line was idle or a frame was complete

    @property
    def open(self) -> bool:
        """Whether something is unfinished: a frame, a damaged frame or noise."""
        return self.length > 0

    @property
    def in_frame(self) -> bool:
        """Whether an undamaged frame is in progress."""
        return self._sound and self.length > 0

    @property
    def header(self) -> int | None:
        """The clean header of what is open, None if it began otherwise or nothing is open."""
        return self._header

    def character(self, char: RxCharLike, start: int) -> Frame | Damage | None:
        """Take one character; returns what it completes: a valid frame, or the damage before it."""
        value, parity_ok, stop_ok = char
        clean = parity_ok and stop_ok
        if clean and value in HEADERS:
            before = self._ended()
            self._begin(value, start)
            return before
        self.length += 1
        if not self._sound:
            return None
        if self._header is None:
            self._sound = False
            self.start = start
            return None
        if not clean or (value != ETX and value not in _IS_HEX):
            self._sound = False
            return None
        buffer = self._buffer
        buffer.append(value)
        return self._complete() if self._ends_here() else None

    def take(self, chars: Iterable[tuple[int, RxCharLike]]) -> int:
        """Take characters, each with its first edge, up to one that may end something; returns how many."""
        taken = 0
        for start, char in chars:
            value, parity_ok, stop_ok = char
            header = parity_ok and stop_ok and value in HEADERS
            held = self._sound and not header and self._header is not None
            ends = self._header != STX or ETX in self._buffer[-2:] or len(self._buffer) >= _MAX_CHARS
            if (header and self.length) or (held and ends):
                break
            self.character(char, start)
            taken += 1
        return taken

    def follow(self, other: FrameReader) -> None:
        """Receive what another reader has taken, both from a silence on."""
        self._buffer, self.start = other._buffer.copy(), other.start
        self._header, self._sound, self.length = other._header, other._sound, other.length

    def reject(self, frame: Frame, start: int) -> None:
        """A whole frame was heard that cannot be right here (another mode's length): damage."""
        self.reset()
        self._begin(frame.chars[0], start)
        self._buffer += frame.chars[1:]
        self.length = len(frame.chars)
        self._sound = False

    def quiet(self) -> Damage | None:
        """The line has been quiet: whatever was open is damage."""
        before = self._ended()
        self.reset()
        return before

    def _begin(self, header: int, start: int) -> None:
        self._buffer = bytearray((header,))
        self._header = header
        self._sound = True
        self.length = 1
        self.start = start

    def _ended(self) -> Damage | None:
        if self.length == 0:
            return None
        return Damage(self._header, self._buffer[1] if len(self._buffer) > 1 else None)

    def _ends_here(self) -> bool:
        buffer = self._buffer
        if self._header == ENQ:
            return len(buffer) == POLL_CHARS
        if self._header == SOH:
            return len(buffer) == PARAMETERS_CHARS
        if len(buffer) > 2 and buffer[-3] == ETX:
            return True
        if len(buffer) > _MAX_CHARS:
            self._sound = False
        return False

    def _complete(self) -> Frame | None:
        frame = decode(bytes(self._buffer))
        if frame is None or (frame.kind == DATA and self.data_size not in (None, len(frame.data))):
            self._sound = False
            return None
        self.reset()
        return frame


RxCharLike = tuple[int, bool, bool]
