"""Frames of external nodes, for the trace."""

from __future__ import annotations

from typing import TYPE_CHECKING, assert_never

from bussim.engines.modbus.adu import Adu, decode_rtu
from bussim.engines.nn.frames import DATA, Frame
from bussim.line.characters import LineTiming
from bussim.live.arrival import Timed
from bussim.live.sniff.heard import LineProtocol
from bussim.live.sniff.splitter import MOST_DAMAGE, Splitter
from bussim.live.sniff.splitters import splitter
from bussim.sim.serial.node import SerialNode
from bussim.trace.records import FrameRecord

if TYPE_CHECKING:
    from bussim.serve.external_node import PartlyExternalLine

_PROTOCOLS = {protocol.value: protocol for protocol in LineProtocol}


class ExternalFrames:
    """Cuts what comes into frames and records them. Its memory is bounded whatever comes."""

    def __init__(self, line: PartlyExternalLine, timing: LineTiming, tolerance: int) -> None:
        self._line = line
        self._timing = timing
        self._tolerance = tolerance
        self._splitters: dict[str, Splitter] = {}
        self._protocol = ""
        self._chars: list[Timed] = []

    def heard(self, chars: list[Timed]) -> None:
        """Take in characters."""
        protocol = self._protocol_now()
        if protocol != self._protocol:
            self.cut()
            self._protocol = protocol
        match known := _PROTOCOLS.get(protocol):
            case LineProtocol.NN | LineProtocol.ASCII:
                cutter = self._splitters.setdefault(protocol, splitter(known, self._timing, self._tolerance))
                for heard in cutter.take(chars):
                    self._record(heard.start, heard.end, heard.chars, heard.frame)
            case LineProtocol.RTU | None:  # None: free protocol
                self._gather(chars)
            case _:
                assert_never(known)

    def _gather(self, chars: list[Timed]) -> None:
        """Keep what comes between two silences, or two frames of this line."""
        kept = self._chars
        if kept and chars[0][1] - kept[-1][2] > self._timing.characters(2) + self._tolerance:
            self.cut()
        for char in chars:
            kept.append(char)
            if len(kept) >= MOST_DAMAGE:
                self.cut()

    def cut(self) -> None:
        """What has come so far is over."""
        chars = self._chars
        if not chars:
            return
        data = bytes(char.value for char, _, _ in chars)
        found = decode_rtu(data) if self._protocol == LineProtocol.RTU else None
        self._record(chars[0][1], chars[-1][2], data, found if isinstance(found, Adu) else None)
        chars.clear()

    def close(self) -> None:
        """Nothing more will come."""
        self.cut()
        for cutter in self._splitters.values():
            for heard in cutter.close(None):
                self._record(heard.start, heard.end, heard.chars, heard.frame)

    def _protocol_now(self) -> str:
        return next((self._line.protocol_of(port) for port in self._line.ports), self._line.protocol)

    def _record(self, start: int, end: int, chars: bytes, frame: Frame | Adu | None) -> None:
        line, station, counter = self._line, None, None
        sender, kind = "outside", "damaged"
        if isinstance(frame, Frame):
            station, counter, kind = frame.station, frame.counter, frame.kind_name
            sender = line.external_name(frame.station if frame.kind == DATA else 0)
        elif isinstance(frame, Adu):
            station = frame.station
            asked = any(isinstance(port, SerialNode) and port.kind == "response" for port in line.ports)
            kind = "request" if asked else "response"
        elif self._protocol == "free":
            kind = "data"
        line.frames += 1
        line.sink.take(
            FrameRecord(
                bus=line.name,
                start=start,
                end=end,
                sender=sender,
                kind=kind,
                station=station,
                counter=counter,
                chars=chars,
                damaged_bits=(),
                damaged_at={},
                collided=False,
                cut=False,
                protocol=self._protocol,
                baud=self._timing.baud,
                format=str(self._timing.format),
            )
        )
