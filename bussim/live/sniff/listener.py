"""Everything between characters and records: frames, pieces that are none, exchanges."""

from collections.abc import Iterator, Mapping
from functools import partial
from typing import assert_never

from bussim.engines.modbus.adu import COLON, LAST_STATION, LF
from bussim.engines.modbus.gaps import STANDARD_GAPS
from bussim.line.characters import LineTiming
from bussim.live.arrival import Timed
from bussim.live.layout.value import ASSUMED, Layout
from bussim.live.sniff.decoder import Line
from bussim.live.sniff.functions import KNOWN
from bussim.live.sniff.heard import Heard, LineProtocol, Verdict
from bussim.live.sniff.link import LinkDecoder
from bussim.live.sniff.modbus import ModbusDecoder
from bussim.live.sniff.splitters import AsciiSplitter, silence_of, splitter
from bussim.trace.records import RunTotals
from bussim.trace.sink import Sink

#: A driver that switches off leaves at most so many characters: one fewer than the shortest RTU frame.
_LONGEST_STRAY = 3
_RESYNCHRONISED = 3


class Listener:
    """Listens to one bus of a known protocol, and records what it decodes.

    ``tolerance`` is the silence (ticks) inside a frame that a system may have made. ``exact``: times are
    those of the line, so that distances prove something. ``wires`` are the wires of the line, one a direction
    where there are two. ``begin`` is the tick at which the recording begins, None: with its first character.
    ``names`` are those of stations that are known; ``decoders`` are the classes that decode an N:N link and a
    Modbus bus. ``layout`` is that of N:N frames.
    """

    def __init__(
        self,
        bus: str,
        timing: LineTiming,
        sink: Sink,
        protocol: LineProtocol,
        *,
        exact: bool = True,
        tolerance: int = 0,
        wires: int = 1,
        echo: bool | None = None,
        begin: int | None = 0,
        names: Mapping[int, str] | None = None,
        decoders: tuple[type[LinkDecoder], type[ModbusDecoder]] = (LinkDecoder, ModbusDecoder),
        layout: Layout = ASSUMED,
    ) -> None:
        self.bus, self.timing, self.protocol = bus, timing, protocol
        self._layout = layout
        slack = 0 if exact else tolerance
        line = partial(Line, bus, timing.baud, str(timing.format), slack=slack, wires=wires, echo=echo)
        split = partial(splitter, protocol, timing, tolerance, layout=layout)
        self.decoder: LinkDecoder | ModbusDecoder
        # The silence of a line: behind a request no station begins to reply before.
        match protocol:
            case LineProtocol.NN:
                silence = silence_of(protocol, timing)
                known = line(silence=silence, closest=silence, counters=layout.modulo)
                self.decoder = decoders[0](known, sink, names)
            case LineProtocol.RTU | LineProtocol.ASCII:
                silence = silence_of(LineProtocol.RTU, timing)
                closest = min(silence, timing.characters(STANDARD_GAPS.end))
                self.decoder = modbus = decoders[1](line(silence=silence, closest=closest), sink)
                split = partial(split, expects=modbus.expected)
            case _:
                assert_never(protocol)
        self.splitters = [split(wire=wire) for wire in range(wires)]
        self._near = silence_of(protocol, timing) + slack
        self._begin = begin
        #: A receiver that is switched on inside a frame has its first character at the latest then.
        self._torn_until = max(self._near, timing.characters(_RESYNCHRONISED))
        self._first = True  # nothing was heard so far but what is torn
        self._sound_end: int | None = None
        self._piece: tuple[Heard, int | None] | None = None  # with the end of the sound frame before it
        #: Characters so far, and the end of the last one.
        self.characters = 0
        self.last = 0

    def chars(self, chars: list[Timed], wire: int = 0) -> list[Heard]:
        """Take in characters of a wire; returns what is known now, in order."""
        found: list[Heard] = []
        if not chars:
            return found
        self.characters += len(chars)
        if self._begin is None:
            self._begin = chars[0][1]
        if len(self.splitters) > 1:
            for other in self.splitters:
                if other.wire != wire:
                    self._take(other.idle(chars[0][1]), found)
        self._take(self.splitters[wire].take(chars), found)
        self.last = max(self.last, chars[-1][2])
        return found

    def idle(self, now: int) -> list[Heard]:
        """Nothing was heard up to ``now``."""
        found: list[Heard] = []
        for each in self.splitters:
            self._take(each.idle(now), found)
        if self._piece is not None and now - self._piece[0].end >= self._near:
            self._decide(None, found)
        return found

    def close(self, now: int | None = None) -> list[Heard]:
        """Nothing more will be heard; ``now`` is the recording's end, None: with its last character."""
        found: list[Heard] = []
        for each in self.splitters:
            self._take(each.close(now), found)
        self._decide(None, found)
        self.decoder.close()
        return found

    def lost(self) -> None:
        """The recording has something here that cannot be read."""
        self.decoder.lost()

    def _take(self, heards: Iterator[Heard], found: list[Heard]) -> None:
        """What a splitter found: a piece is decided on when it is known what follows it."""
        for heard in heards:
            if heard.frame is None:
                self._decide(None, found)
                self._piece = (heard, self._sound_end)
                continue
            self._decide(heard.start, found)
            self._first = False
            self._sound_end = heard.end
            self._report(heard, found)

    def _decide(self, follows: int | None, found: list[Heard]) -> None:
        """Say what became of the piece that waits; ``follows`` is the start of a sound frame behind it."""
        if self._piece is None:
            return
        (heard, before), self._piece = self._piece, None
        near = (before is not None and heard.start - before < self._near) or (
            follows is not None and follows - heard.end < self._near
        )
        verdict = self._verdict(heard, near=near)
        self._first = self._first and verdict is Verdict.TORN
        self._begin = heard.end  # what follows what is torn without a silence is torn, too
        self._report(heard._replace(verdict=verdict), found)

    def _verdict(self, heard: Heard, *, near: bool) -> Verdict:
        chars = heard.chars
        if heard.part or (
            self._first
            and heard.start - (self._begin or 0) < self._torn_until
            and not self._begins_frame(chars)
        ):
            return Verdict.TORN
        if len(chars) == 1 or (near and len(chars) <= _LONGEST_STRAY):
            return Verdict.STRAY
        if self.protocol is LineProtocol.ASCII and COLON not in chars and chars[-1] != LF:
            return Verdict.STRAY
        return Verdict.DAMAGED

    def _begins_frame(self, chars: bytes) -> bool:
        match self.protocol:
            case LineProtocol.NN:
                return self._layout.begins(chars)
            case LineProtocol.ASCII:
                return chars[0] == COLON
            case LineProtocol.RTU:
                return chars[0] <= LAST_STATION and len(chars) > 1 and chars[1] in KNOWN
            case _:
                assert_never(self.protocol)

    def _report(self, heard: Heard, found: list[Heard]) -> None:
        self.decoder.heard(heard)
        found.append(heard)

    @property
    def unusual(self) -> int:
        """Modbus ASCII frames with lower-case digits, CR or LF alone."""
        return sum(each.unusual for each in self.splitters if isinstance(each, AsciiSplitter))

    def totals(self, duration: int, warnings: tuple[str, ...] = ()) -> RunTotals:
        """What a run's totals are, as far as a listener knows them."""
        decoder = self.decoder
        links = (decoder.totals(),) if isinstance(decoder, LinkDecoder) else ()
        buses = (decoder.totals(),) if isinstance(decoder, ModbusDecoder) else ()
        return RunTotals(duration, links, (), warnings, buses)
