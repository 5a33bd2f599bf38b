"""A run's trace as a recording: what a receiver on the bus reads of its frames."""

import heapq
from collections.abc import Iterator
from pathlib import Path

from bussim.engines.contract import RxChar
from bussim.line.characters import CharFormat, LineTiming
from bussim.live.arrival import GOOD, Timed, placed
from bussim.live.recordings.source import PROGRESS_EVERY, Chunk, Facts, LineSetup, Source
from bussim.trace.file import Trace, read_trace
from bussim.trace.levels import characters_of, disputed_of, is_plain
from bussim.trace.records import FrameRecord, TraceBus
from bussim.words.language import say

#: A trace has frames in the order in which they ended; so many may begin before one that is recorded earlier.
_LATE = 256
#: The free protocol has no frames of its own: nothing of it is damage.
_FREE = "free"
#: Most frames that are read at once: a station that sends without end overlaps every other.
_AT_ONCE = 512


class TraceFile(Source):
    """The frames of one bus of a trace. A frame is as damaged as the level on the wire makes it."""

    def __init__(self, trace: Trace, bus: TraceBus) -> None:
        self._trace, self.bus, self.header = trace, bus, trace.header
        header = trace.header
        self.facts = Facts()
        if trace.is_cut:
            self.facts.warnings["cut_file"] = say("trace_cut_off")
        self.begin, self.resolution = 0, 1
        self.exact, self.tolerant = header.exact, not header.exact
        self.times = "exact" if header.exact else "system"
        self._disputed = disputed_of(header, bus.name)
        self._recorded = header.seed is None  # by this program's sniffer: frames are as they were heard

    @property
    def protocol(self) -> str | None:
        """The protocol of its first frame that has one."""
        protocols = (frame.protocol for frame in self._trace.of(FrameRecord, bus=self.bus.name))
        return next((protocol for protocol in protocols if protocol != _FREE), None)

    def chunks(self, setup: LineSetup) -> Iterator[Chunk]:
        """See the source of a recording."""
        batch: list[FrameRecord] = []
        until = 0
        character = setup.timing.characters(1)
        for frame in self._in_order():
            if batch and (frame.start >= until or len(batch) >= _AT_ONCE):
                yield Chunk(self._received(batch, setup.timing))
                batch, until = [], 0
            batch.append(frame)
            # A receiver may still be inside a character that began in what is damaged.
            until = max(
                until, frame.driven_until, frame.end + (0 if self._plain(frame, setup.timing) else character)
            )
        if batch:
            yield Chunk(self._received(batch, setup.timing))

    def _in_order(self) -> Iterator[FrameRecord]:
        """The frames by their starts."""
        waiting: list[tuple[int, int, FrameRecord]] = []
        for number, frame in enumerate(self._trace.of(FrameRecord, bus=self.bus.name)):
            if frame.protocol != _FREE and frame.chars:
                heapq.heappush(waiting, (frame.start, number, frame))
            if not number % PROGRESS_EVERY:
                self.progress("reading", frame.end, self.header.duration or frame.end)
            if len(waiting) > _LATE:
                yield heapq.heappop(waiting)[2]
        while waiting:
            yield heapq.heappop(waiting)[2]

    def _plain(self, frame: FrameRecord, timing: LineTiming) -> bool:
        return self._recorded or (is_plain(frame, timing) and not frame.pauses)

    def _received(self, frames: list[FrameRecord], timing: LineTiming) -> list[Timed]:
        if self._recorded:
            return [char for frame in frames for char in _as_heard(frame, timing.format)]
        if len(frames) == 1 and self._plain(frames[0], timing):
            mask = (1 << timing.format.data_bits) - 1
            return placed(bytes(value & mask for value in frames[0].chars), frames[0].start, timing)
        return [
            (RxChar(char.value, char.parity_ok, char.stop_ok), char.start, char.end)
            for char in characters_of(frames, timing, self._disputed)
        ]

    def end(self) -> int | None:
        """See the source of a recording."""
        return None if self._trace.is_cut else self.header.duration


def open_trace(path: Path, bus: str | None) -> TraceFile:
    """The bus of this name of a trace, else its first one. Raises UsageError."""
    trace = read_trace(path)
    buses = trace.header.buses
    return TraceFile(trace, buses[0] if bus is None and buses else trace.bus(bus or "line"))


def _as_heard(frame: FrameRecord, form: CharFormat) -> Iterator[Timed]:
    """The characters of a frame that a recorder heard: its damaged bits are wrong parity and stop bits."""
    count, length = len(frame.chars), frame.end - frame.start
    parity = 1 + form.data_bits if form.parity != "N" else 0
    wrong = {divmod(bit, form.bits) for bit in frame.damaged_bits}
    for number, value in enumerate(frame.chars):
        char = GOOD[value]
        if wrong:
            bits = {bit for at, bit in wrong if at == number}
            char = RxChar(value, parity not in bits or not parity, not bits - {parity})
        yield char, frame.start + length * number // count, frame.start + length * (number + 1) // count
