"""Cut what a listener hears into frames.

A listener on a PC cannot trust silences: the system hands request and reply over in one chunk. So
frames are found by their content (header and sum, length and CRC, colon and LF); silence only ends
what is unfinished.
"""

from __future__ import annotations

from typing import Protocol, assert_never

from bussim.engines.modbus import adu as modbus
from bussim.engines.modbus.adu import Adu, Damage, decode_rtu
from bussim.engines.modbus.ascii import AsciiReader
from bussim.engines.modbus.gaps import STANDARD_GAPS, silences
from bussim.engines.nn.frames import QUIET_CHARS, Frame, FrameReader
from bussim.line.characters import LineTiming
from bussim.line.checksums import crc16
from bussim.live.arrival import Timed
from bussim.live.sniff.heard import Heard, LineProtocol
from bussim.units import TICKS_PER_SECOND, round_half_up

#: Characters of damage that are reported at once at most; more is reported in pieces.
MOST_DAMAGE = 600


class Splitter(Protocol):
    """Finds the frames of one protocol; memory is bounded whatever comes."""

    def character(self, char: Timed) -> list[Heard]:
        """Take a character; returns what is complete now, in order."""

    def idle(self, now: int) -> list[Heard]:
        """Nothing was heard up to ``now``; returns what that ends."""


def splitter(protocol: LineProtocol, timing: LineTiming, tolerance: int) -> Splitter:
    """The splitter of a protocol. ``tolerance`` ticks are added to every silence."""
    match protocol:
        case LineProtocol.NN:
            return NnSplitter(timing.characters(QUIET_CHARS) + tolerance)
        case LineProtocol.ASCII:
            return AsciiSplitter(TICKS_PER_SECOND + tolerance)
        case LineProtocol.RTU:
            return RtuSplitter(round_half_up(silences(timing, STANDARD_GAPS).end) + tolerance)
        case _:
            assert_never(protocol)


def _damage(protocol: LineProtocol, chars: list[Timed], reason: str, *, whole: bool = True) -> Heard:
    data = bytes(char.value for char, _, _ in chars)
    return Heard(protocol, chars[0][1], chars[-1][2], data, None, reason, whole=whole)


class NnSplitter:
    """Frames of the N:N link: from header to sum."""

    def __init__(self, quiet: int) -> None:
        self._quiet = quiet
        self._reader = FrameReader()
        self._chars: list[Timed] = []

    def character(self, char: Timed) -> list[Heard]:
        """See the protocol."""
        found = self.idle(char[1])
        result = self._reader.character(char[0], char[1])
        if isinstance(result, Frame):
            self._chars.append(char)
            before = self._chars[: -len(result.chars)]
            if before:
                found.append(_damage(LineProtocol.NN, before, "noise"))
            found.append(Heard(LineProtocol.NN, self._reader.start, char[2], result.chars, result))
            self._chars = []
        elif result is not None:
            found += self._flush()
            self._chars.append(char)
        else:
            self._chars.append(char)
            if len(self._chars) >= MOST_DAMAGE:
                found += self._flush(whole=False)
        return found

    def idle(self, now: int) -> list[Heard]:
        """See the protocol."""
        if not self._chars or now - self._chars[-1][2] < self._quiet:
            return []
        self._reader.quiet()
        return self._flush()

    def _flush(self, *, whole: bool = True) -> list[Heard]:
        chars, self._chars = self._chars, []
        return [_damage(LineProtocol.NN, chars, "damaged", whole=whole)] if chars else []


class AsciiSplitter:
    """Modbus ASCII frames: from colon to LF. What is outside them is reported as damage."""

    def __init__(self, quiet: int) -> None:
        self._reader = AsciiReader(quiet)
        self._outside: list[Timed] = []

    def character(self, char: Timed) -> list[Heard]:
        """See the protocol."""
        found: list[Heard] = []
        result = self._reader.character(*char)
        if not self._reader.open and result is None:
            self._outside.append(char)
            return self._flush(whole=False) if len(self._outside) >= MOST_DAMAGE else []
        found += self._flush()
        if isinstance(result, Adu):
            start, end = self._reader.heard
            found.append(Heard(LineProtocol.ASCII, start, end, result.chars, result))
        elif result is not None:
            found.append(_torn(result))
        return found

    def idle(self, now: int) -> list[Heard]:
        """See the protocol."""
        reader = self._reader
        if reader.open and now - reader.end >= reader.quiet and (damage := reader.silence()) is not None:
            return [_torn(damage)]
        if self._outside and now - self._outside[-1][2] >= reader.quiet:
            return self._flush()
        return []

    def _flush(self, *, whole: bool = True) -> list[Heard]:
        chars, self._outside = self._outside, []
        return [_damage(LineProtocol.ASCII, chars, "outside a frame", whole=whole)] if chars else []


def _torn(damage: Damage) -> Heard:
    return Heard(LineProtocol.ASCII, damage.start, damage.end, damage.chars, None, str(damage.reason))


class RtuSplitter:
    """Modbus RTU frames: by the lengths that function and byte count allow, and the CRC.

    While a frame may begin where something began, it is waited for. Once that is ruled out, the first
    whole frame behind ends the damage. A frame of a function that is not known here is found only
    where silence surrounds it.
    """

    def __init__(self, quiet: int) -> None:
        self._quiet = quiet
        self._chars: list[Timed] = []
        self._data = bytearray()
        self._least = 2  # characters before which no frame can be complete
        self._lost = False  # no frame begins where what is open begins
        # While lost: where frames could end (counted from the very first character), and begin.
        self._ends: dict[int, list[int]] = {}
        self._base = 0  # number of the first character of what is open

    def character(self, char: Timed) -> list[Heard]:
        """See the protocol."""
        found = self.idle(char[1])
        self._chars.append(char)
        self._data.append(char[0].value)
        if self._lost:
            self._expect(len(self._data) - 1)
            return found + self._behind()
        if len(self._data) >= self._least:
            found += self._frames()
        return found

    def idle(self, now: int) -> list[Heard]:
        """See the protocol."""
        if not self._chars or now - self._chars[-1][2] < self._quiet:
            return []
        return self._resolve()

    def _frames(self) -> list[Heard]:
        """Frames at the beginning of what is open, and behind damage."""
        found: list[Heard] = []
        while self._data:
            size, self._least = _frame_at(self._data, 0)
            if size:
                found.append(self._take(size))
            elif len(self._data) < self._least:
                break
            else:
                at = next((at for at in range(1, len(self._data)) if _frame_at(self._data, at)[0]), 0)
                if not at:
                    self._lose()
                    break
                found.append(self._take_damage(at))
        return found

    def _lose(self) -> None:
        self._lost = True
        for at in range(1, len(self._data)):
            self._expect(at)
        self._ends = {end: starts for end, starts in self._ends.items() if end > self._base + len(self._data)}

    def _expect(self, at: int) -> None:
        """Note the frames whose size the character at a position determines."""
        data = self._data
        value = data[at]
        sizes: list[tuple[int, int]] = []
        if value & 0x80:
            sizes.append((at - 1, _EXCEPTION))
        elif value in _KNOWN:
            sizes.append((at - 1, _FIXED))
        if at >= 2 and data[at - 1] in _READS and 5 + value != _FIXED:
            sizes.append((at - 2, 5 + value))
        if at >= 6 and data[at - 5] in _MANY:
            sizes.append((at - 6, 9 + value))
        for start, size in sizes:
            if start >= 0 and size <= modbus.RTU_MAX:
                self._ends.setdefault(self._base + start + size, []).append(self._base + start)

    def _behind(self) -> list[Heard]:
        """The frame that the latest character completes, with the damage before it."""
        size = len(self._data)
        for begun in self._ends.pop(self._base + size, ()):
            at = begun - self._base
            if at >= 0 and not crc16(bytes(self._data[at:])):
                damage = [self._take_damage(at)] if at else []
                return [*damage, self._take(size - at)]
        if size > MOST_DAMAGE:
            return [self._take_damage(size - modbus.RTU_MAX, whole=False, lost=True)]
        return []

    def _resolve(self) -> list[Heard]:
        """The line was quiet: all that is open is over."""
        found: list[Heard] = []
        if isinstance(decode_rtu(bytes(self._data)), Adu):
            found.append(self._take(len(self._data)))
            return found
        at, size = 0, len(self._data)
        while at < size:
            length, _ = _frame_at(self._data, at)
            if not length:
                at += 1
                continue
            if at:
                found.append(self._take_damage(at))
            found.append(self._take(length))
            at, size = 0, len(self._data)
        if self._data:
            found.append(self._take_damage(len(self._data)))
        return found

    def _take(self, size: int) -> Heard:
        chars = bytes(self._data[:size])
        frame = Adu(chars[0], chars[1:-2], chars)
        heard = Heard(LineProtocol.RTU, self._chars[0][1], self._chars[size - 1][2], chars, frame)
        self._drop(size)
        return heard

    def _take_damage(self, size: int, *, whole: bool = True, lost: bool = False) -> Heard:
        heard = _damage(LineProtocol.RTU, self._chars[:size], "CRC or length", whole=whole)
        self._drop(size, lost=lost)
        return heard

    def _drop(self, size: int, *, lost: bool = False) -> None:
        del self._chars[:size]
        del self._data[:size]
        self._base += size
        self._least = 2
        self._lost = lost
        if not lost:
            self._ends.clear()


_READS = frozenset((1, 2, 3, 4))
_MANY = frozenset((15, 16))
_KNOWN = _READS | {5, 6} | _MANY
#: Sizes of frames that follow from the function alone: requests and echoes.
_FIXED = 8
_EXCEPTION = 5


def _frame_at(data: bytearray, at: int) -> tuple[int, int]:
    """The size of the frame that begins at a position, and how many characters of ``data`` decide on more.

    The size is 0 where no frame begins there, or not all of it is there yet.
    """
    have = len(data) - at
    if have < 2:
        return 0, at + 2
    function = data[at + 1]
    if function & 0x80:
        sizes = [_EXCEPTION]
    elif function in _READS:
        if have < 3:
            return 0, at + 3
        sizes = sorted({_FIXED, 5 + data[at + 2]})
    elif function in (5, 6):
        sizes = [_FIXED]
    elif function in _MANY:
        if have < 7:
            return 0, at + 7
        sizes = sorted({_FIXED, 9 + data[at + 6]})
    else:
        return 0, at
    wanted = 0
    for size in sizes:
        if size > modbus.RTU_MAX:
            continue
        if size > have:
            wanted = wanted or at + size
        elif not crc16(bytes(data[at : at + size])):
            return size, 0
    return 0, wanted or at
