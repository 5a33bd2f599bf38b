"""What a listener received: frames, and characters that are none."""

from enum import StrEnum
from typing import NamedTuple

from bussim.engines.modbus.adu import Adu
from bussim.engines.nn.frames import Frame
from bussim.line.characters import CharFormat
from bussim.line.protocols import BusProtocol
from bussim.live.arrival import STOP
from bussim.trace.records import FrameRecord


class LineProtocol(StrEnum):
    """The protocols that are recognised, by their names in a trace."""

    NN = "nn"
    RTU = "modbus-rtu"
    ASCII = "modbus-ascii"


#: How the nodes share a bus of each protocol.
BUS_PROTOCOLS = {
    LineProtocol.NN: BusProtocol.NN,
    LineProtocol.RTU: BusProtocol.SERIAL,
    LineProtocol.ASCII: BusProtocol.SERIAL,
}


class Verdict(StrEnum):
    """What became of characters that belong together.

    Sound and damaged frames are frames. A stray is what a driver leaves behind that switches off. Torn is
    what the recording's begin or end cut, and the continuation of endless noise: nothing is said of it.
    """

    SOUND = "sound"
    DAMAGED = "damaged"
    STRAY = "stray"
    TORN = "torn"


class Heard(NamedTuple):
    """Characters that belong together. ``frame`` is None where they are no sound frame: ``reason`` says why.

    ``start`` is the first edge, ``end`` the last stop bit, in ticks. ``flags`` has one of 0, PARITY, STOP and
    their sum for each character; b"" where all are 0. ``wire`` counts the wires of a line from 0. ``part``:
    it is no whole piece, but continues the one before, or the recording ends in it.
    """

    protocol: LineProtocol
    start: int
    end: int
    chars: bytes
    frame: Frame | Adu | None
    reason: str = ""
    flags: bytes = b""
    wire: int = 0
    part: bool = False
    verdict: Verdict = Verdict.SOUND

    def record(self, bus: str, kind: str, sender: str, baud: int, fmt: str) -> FrameRecord:
        """The record of a trace. Of a wrong character the parity or stop bit is marked as damaged."""
        frame = self.frame
        form = CharFormat.parse(fmt)
        bits = [
            number * form.bits + 1 + form.data_bits + (flag == STOP and form.parity != "N")
            for number, flag in enumerate(self.flags)
            if flag
        ]
        return FrameRecord(
            bus=bus,
            start=self.start,
            end=self.end,
            sender=sender,
            kind=kind,
            station=None if frame is None else frame.station,
            counter=frame.counter if isinstance(frame, Frame) else None,
            chars=self.chars,
            damaged_bits=tuple(bits),
            damaged_at={},
            collided=False,
            cut=False,
            protocol=self.protocol.value,
            baud=baud,
            format=fmt,
        )
