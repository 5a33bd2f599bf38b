"""The splitters of the three protocols."""

from bisect import bisect_right
from collections.abc import Callable, Iterator
from typing import assert_never

from bussim.engines.modbus.adu import ASCII_MAX, COLON, CR, LF, RTU_MAX, RTU_MIN, Adu, decode_ascii
from bussim.engines.modbus.gaps import STANDARD_GAPS, silences
from bussim.engines.nn.frames import Frame
from bussim.line.characters import LineTiming
from bussim.line.checksums import crc16
from bussim.live.layout.value import ASSUMED, MOST_DATA, FrameLayout, Layout
from bussim.live.sniff.functions import Asked, request_size, response_size
from bussim.live.sniff.heard import LineProtocol
from bussim.live.sniff.splitter import Splitter
from bussim.units import TICKS_PER_SECOND, round_half_up

#: Gives the request that is open for a response on a wire.
Expects = Callable[[int], Asked | None]


def silence_of(protocol: LineProtocol, timing: LineTiming) -> int:
    """The ticks of silence that end a frame.

    On the N:N link one character: its frames are 1.2 to 2 characters apart, characters inside a frame are
    not apart at all, and the two characters of its receivers would glue a damaged reply to the next poll.
    """
    match protocol:
        case LineProtocol.NN:
            return timing.characters(1)
        case LineProtocol.ASCII:
            return TICKS_PER_SECOND  # Modbus over serial line, section 2.5.2.1
        case LineProtocol.RTU:
            return round_half_up(silences(timing, STANDARD_GAPS).end)
        case _:
            assert_never(protocol)


def splitter(
    protocol: LineProtocol,
    timing: LineTiming,
    tolerance: int,
    *,
    wire: int = 0,
    expects: Expects = lambda _: None,
    layout: Layout = ASSUMED,
) -> Splitter:
    """The splitter of a protocol.

    ``tolerance`` ticks of silence may be inside a frame; ``layout`` is that of N:N frames.
    """
    silence = silence_of(protocol, timing)
    match protocol:
        case LineProtocol.NN:
            return NnSplitter(silence, tolerance, wire, layout)
        case LineProtocol.ASCII:
            return AsciiSplitter(silence, tolerance, wire)
        case LineProtocol.RTU:
            return RtuSplitter(silence, tolerance, wire, expects)
        case _:
            assert_never(protocol)


class NnSplitter(Splitter):
    """Frames of the N:N link, as a layout has them: from header to sum."""

    protocol = LineProtocol.NN
    reason = "sum or layout"

    def __init__(self, silence: int, tolerance: int, wire: int, layout: Layout) -> None:
        super().__init__(silence, tolerance, wire)
        self._layout = layout

    def _frame_at(self, at: int, *, closed: bool) -> Frame | int:
        data, need = self._data, 0
        for frame in self._layout.frames:
            if frame.header is None and at not in self._breaks:
                continue
            if frame.header in (None, data[at]):
                end = self._end_of(frame, at)
                if not end:
                    continue
                if end <= len(data):
                    found = self._layout.decode_as(frame, bytes(data[at:end]))
                    if found is not None:
                        return found
                # A header ends what is open: no frame has one inside.
                elif not closed and self._layout.headers.isdisjoint(data[at + 1 :]):
                    need = max(need, end)
        return need

    def _end_of(self, frame: FrameLayout, at: int) -> int:
        """The index behind a frame that begins at an index, beyond the data where more is needed; 0: none."""
        data, count = self._data, len(self._data)
        if not frame.any_length:
            return at + frame.size
        limit = at + frame.size + MOST_DATA * self._layout.digits
        if frame.end is not None and self._layout.data != "binary":
            char, behind = frame.end
            found = data.find(char, at + frame.before, limit)
            if found >= 0:
                return max(found + 1 + behind, at + frame.size)
            return count + 1 if count <= limit else 0
        gap = next((gap for gap in self._breaks if gap > at), count if self._closed else 0)
        return gap or (count + 1 if count <= limit else 0)


class AsciiSplitter(Splitter):
    """Modbus ASCII frames: from colon to LF.

    Frames that end with CR or LF alone, or have lower-case digits, are read: devices send them.
    ``unusual`` counts them.
    """

    protocol = LineProtocol.ASCII
    reason = "LRC or layout"

    def __init__(self, silence: int, tolerance: int, wire: int) -> None:
        super().__init__(silence, tolerance, wire)
        self.unusual = 0

    def _frame_at(self, at: int, *, closed: bool) -> Adu | int:
        data, count = self._data, len(self._data)
        if data[at] != COLON:
            return 0
        ends = [
            end for end in (data.find(CR, at, at + ASCII_MAX), data.find(LF, at, at + ASCII_MAX)) if end > 0
        ]
        if not ends:
            open_ = count - at < ASCII_MAX and data.find(COLON, at + 1) < 0
            return count + 1 if open_ and not closed else 0
        end = min(ends)
        if data[end] == CR:
            if end + 1 == count and not closed:
                return count + 1
            if end + 1 < count and data[end + 1] == LF:
                end += 1
            elif end + 1 < count and not self._begins(end + 1):
                return 0  # an LF that was damaged
        chars = bytes(data[at : end + 1])
        text = chars.rstrip(b"\r\n").upper() + b"\r\n"
        found = decode_ascii(text)
        if not isinstance(found, Adu):
            return 0
        self.unusual += text != chars
        return found._replace(chars=chars)

    def _begins(self, at: int) -> bool:
        """Whether something new begins at an index: not close behind the character before, or a colon."""
        return self._data[at] == COLON or self._apart(at)

    def _apart(self, at: int) -> bool:
        before = self._ends[at - 1]
        return self._starts[at] - before > before - self._starts[at - 1]

    def _ends_piece(self, first: int, at: int) -> bool:
        """A damaged frame ends with its LF, or before a colon behind a pause."""
        ends = (self._data[at - 1] == LF and self._begins(at)) or (
            self._data[at] == COLON and self._apart(at)
        )
        return ends or super()._ends_piece(first, at)


class RtuSplitter(Splitter):
    """Modbus RTU frames: by the lengths that function, byte count and open request allow, and the CRC.

    The response that is expected comes first, though a shorter frame with a right CRC lie inside: of the
    responses of nine characters one in 256 has it, where the seventh character is the low byte of the CRC of
    the six before it. A frame of a function that is not known is found where silence surrounds it.
    """

    protocol = LineProtocol.RTU
    reason = "CRC or length"

    def __init__(self, silence: int, tolerance: int, wire: int, expects: Expects) -> None:
        super().__init__(silence, tolerance, wire)
        self._expects = expects

    def _frame_at(self, at: int, *, closed: bool) -> Adu | int:
        count = len(self._data)
        for size in self._sizes(at):
            if size < 0 or at + size > count:
                if not closed:
                    return at + abs(size)
            elif size >= RTU_MIN:
                chars = bytes(self._data[at : at + size])
                if not crc16(chars):  # with its own CRC behind it, a frame's CRC is 0
                    return Adu(chars[0], chars[1:-2], chars)
        return 0

    def _sizes(self, at: int) -> Iterator[int]:
        """Sizes that a frame may have, the likeliest first; negative: so many characters decide."""
        data, count = self._data, len(self._data)
        if at + 1 == count:
            yield -2
            return
        asked = self._expects(self.wire)
        expected = response_size(data, at + 1, asked) if asked and asked.station == data[at] else 0
        for size in (expected, request_size(data, at + 1), response_size(data, at + 1, None)):
            if size:
                yield size - 3 if size < 0 else size + 3
        if at in self._breaks:
            behind = bisect_right(self._breaks, at)
            if behind < len(self._breaks):
                yield self._breaks[behind] - at
            elif count - at <= RTU_MAX:
                yield count - at if self._closed else at - count - 1
