"""Everything between characters and records: recognise the protocol, decode its frames."""

from __future__ import annotations

from collections.abc import Mapping

from bussim.line.characters import LineTiming
from bussim.live.arrival import Timed
from bussim.live.sniff.heard import Heard, LineProtocol
from bussim.live.sniff.link import LinkDecoder
from bussim.live.sniff.modbus import ModbusDecoder
from bussim.live.sniff.recognise import Recogniser
from bussim.trace.records import RunTotals, Sink


class Listener:
    """Listens to one bus and records what it decodes. Feed it characters or, of a recording, whole frames.

    ``names`` are those of stations that are known; ``decoders`` are the classes that decode an N:N link and
    a Modbus bus.
    """

    def __init__(
        self,
        bus: str,
        timing: LineTiming,
        sink: Sink,
        *,
        tolerance: int,
        protocol: LineProtocol | None = None,
        names: Mapping[int, str] | None = None,
        decoders: tuple[type[LinkDecoder], type[ModbusDecoder]] = (LinkDecoder, ModbusDecoder),
    ) -> None:
        self.bus = bus
        self._decoders = decoders
        self._names = names
        self.timing = timing
        self._sink = sink
        self._recogniser = Recogniser(timing, tolerance, protocol)
        self._settled = protocol
        self.decoder: LinkDecoder | ModbusDecoder | None = None
        #: Characters so far.
        self.characters = 0
        self.last = 0

    @property
    def protocol(self) -> LineProtocol | None:
        """The protocol on the line, None while that is open."""
        return self._settled or self._recogniser.protocol

    def chars(self, chars: list[Timed]) -> list[Heard]:
        """Take in characters; returns the frames that are known now."""
        self.characters += len(chars)
        return self._watch(self._recogniser.chars(chars))

    def idle(self, now: int) -> list[Heard]:
        """Nothing was heard up to ``now``."""
        return self._watch(self._recogniser.idle(now))

    def heard(self, heard: Heard) -> list[Heard]:
        """Take in a whole frame of a recording that names its protocol."""
        if self._settled is None:
            self._settled = heard.protocol
        self.characters += len(heard.chars)
        return self._watch([heard])

    def close(self) -> list[Heard]:
        """Nothing more will be heard."""
        return self._watch(self._recogniser.close())

    def _watch(self, frames: list[Heard]) -> list[Heard]:
        for heard in frames:
            if self.decoder is None:
                baud, fmt = self.timing.baud, str(self.timing.format)
                link, modbus = self._decoders
                if heard.protocol is LineProtocol.NN:
                    self.decoder = link(self.bus, self._sink, baud=baud, fmt=fmt, names=self._names)
                else:
                    self.decoder = modbus(self.bus, self._sink, baud=baud, fmt=fmt)
            self.decoder.heard(heard)
            self.last = max(self.last, heard.end)
        return frames

    def totals(self, duration: int, warnings: tuple[str, ...] = ()) -> RunTotals:
        """What a run's totals are, as far as a listener knows them."""
        decoder = self.decoder
        links = (decoder.totals(),) if isinstance(decoder, LinkDecoder) else ()
        buses = (decoder.totals(),) if isinstance(decoder, ModbusDecoder) else ()
        return RunTotals(duration, links, (), warnings, buses)
