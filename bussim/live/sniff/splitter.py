"""Cut what is received on a wire into frames, and into pieces that are none.

Frames are found by their content (header and sum, length and CRC, colon and LF), since a system hands
over request and response in one chunk. A piece is what lies between two of: silence, sound frame, begin,
end. Headers inside it do not divide it.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from typing import ClassVar

from bussim.engines.modbus.adu import Adu
from bussim.engines.nn.frames import Frame
from bussim.live.arrival import PARITY, STOP, Timed
from bussim.live.sniff.heard import Heard, LineProtocol

#: Characters of a piece that are reported at once at most; more come as parts.
MOST_DAMAGE = 600


class Splitter(ABC):
    """Finds the frames of one protocol on one wire. Memory is bounded whatever comes.

    ``silence`` ends a frame, in ticks; ``tolerance`` is how much longer one may be inside a frame that a
    system handed over in parts. Each frame is given as soon as it is known: what is done with it may
    change what is expected next.
    """

    protocol: ClassVar[LineProtocol]
    reason: ClassVar[str]

    def __init__(self, silence: int, tolerance: int = 0, wire: int = 0) -> None:
        self.silence, self.longest = silence, silence + tolerance
        self.wire = wire
        self._data = bytearray()
        self._flags = bytearray()
        self._starts: list[int] = []
        self._ends: list[int] = []
        self._breaks: list[int] = []  # indices of characters behind a silence
        self._at = 0  # no frame begins before this index
        self._need = 0  # characters that are needed before more can be said
        self._inside = 0  # index of the silence inside what may be one frame, 0: none
        self._end: int | None = None
        self._in_parts = False  # a sound frame came in parts, with a silence inside
        self._reported = 0  # characters of the piece under way that were reported as parts
        self._closed = False  # a silence follows the characters that there are

    def take(self, chars: Iterable[Timed]) -> Iterator[Heard]:
        """Take characters; gives what is complete now, in order."""
        data, flags, starts, ends = self._data, self._flags, self._starts, self._ends
        for (value, parity_ok, stop_ok), start, end in chars:
            before = self._end
            if before is None or start - before >= self.silence:
                if before is not None and start - before >= self.longest and data:
                    yield from self._split(closed=True)
                self._breaks.append(len(data))
            data.append(value)
            flags.append(0 if parity_ok and stop_ok else PARITY * (not parity_ok) + STOP * (not stop_ok))
            starts.append(start)
            ends.append(end)
            self._end = end
        yield from self._split(closed=False)

    def idle(self, now: int) -> Iterator[Heard]:
        """Nothing was received up to ``now``; gives what that ends."""
        if self._data and self._end is not None and now - self._end >= self.longest:
            yield from self._split(closed=True)

    def close(self, now: int | None) -> Iterator[Heard]:
        """The recording ends, at ``now`` if that is known; gives the rest."""
        if not self._data:
            return
        cut = now is None or (self._end is not None and now - self._end < self.longest)
        last: Heard | None = None
        for heard in self._split(closed=True):
            if last is not None:
                yield last
            last = heard if heard.frame is None else None
            if last is None:
                yield heard
        if self._data:  # what could go on
            if last is not None:
                yield last
            last = self._heard(0, len(self._data), None, self.reason, part=cut)
            self._drop(len(self._data))
        if last is not None:
            # What ends with a recording whose end is known is cut there.
            yield last._replace(part=last.part or (cut and now is not None))

    @abstractmethod
    def _frame_at(self, at: int, *, closed: bool) -> Frame | Adu | int:
        """The frame that begins at an index; else how many characters decide (0: none begins there).

        Parity and stop bits are not checked. ``closed``: the characters that there are, are all.
        """

    def _split(self, *, closed: bool) -> Iterator[Heard]:
        count, self._closed = len(self._data), closed
        if count < self._need and not closed:
            return
        first, at = 0, self._at
        if self._inside:  # what began before a silence may end behind it
            found = self._frame_at(0, closed=False)
            if isinstance(found, int) and found > count and not closed:
                self._need = found
                return
            whole = isinstance(found, (Frame, Adu))
            first = at = len(found.chars) if isinstance(found, (Frame, Adu)) else self._inside
            self._inside = 0
            yield self._heard(0, first, None, "silence inside" if whole else self.reason)
        self._need = 0
        while at < count:
            if at > first and self._ends_piece(first, at):
                yield self._piece(first, at)
                first, self._reported = at, 0
            found = self._frame_at(at, closed=closed)
            if isinstance(found, (Frame, Adu)):
                if at > first:
                    yield self._piece(first, at)
                first = at + len(found.chars)
                self._reported = 0
                sound = not any(self._flags[at:first])
                self._in_parts |= sound and any(at < gap < first for gap in self._breaks)
                yield self._heard(at, first, found if sound else None, "" if sound else self.reason)
                at = first
            elif found:
                self._need = found
                break
            else:
                at += 1
                if at - first >= MOST_DAMAGE:
                    yield self._piece(first, at)
                    self._reported += at - first
                    first = at
        if closed and first < count:
            waits = not self._reported and first in self._breaks and self._frame_at(first, closed=False)
            if waits and isinstance(waits, int):
                self._drop(first)
                self._at, self._inside = 0, count - first
                self._need = waits - first
                return
            yield self._piece(first, count)
            first = at = count
            self._reported = 0
        self._drop(first)
        self._at = at - first
        self._need = max(0, self._need - first)

    def _ends_piece(self, first: int, at: int) -> bool:
        """Whether a piece ends before an index without a frame behind it."""
        return at in self._breaks and not self._in_parts

    def _piece(self, first: int, last: int) -> Heard:
        return self._heard(first, last, None, self.reason, part=self._reported > 0)

    def _heard(
        self, first: int, last: int, frame: Frame | Adu | None, reason: str, *, part: bool = False
    ) -> Heard:
        flags = bytes(self._flags[first:last])
        if not any(flags):
            flags = b""
        elif frame is None and reason == self.reason:
            reason = "parity" if any(flag & PARITY for flag in flags) else "stop bit"
        return Heard(
            self.protocol,
            self._starts[first],
            self._ends[last - 1],
            bytes(self._data[first:last]),
            frame,
            reason,
            flags,
            self.wire,
            part,
        )

    def _drop(self, size: int) -> None:
        if size:
            del self._data[:size], self._flags[:size], self._starts[:size], self._ends[:size]
            self._breaks = [at - size for at in self._breaks if at >= size]
