"""A frame as a listener received it."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

from bussim.engines.modbus.adu import Adu
from bussim.engines.nn.frames import Frame
from bussim.trace.records import FrameRecord


class LineProtocol(StrEnum):
    """The protocols that are recognised, by their names in a trace."""

    NN = "nn"
    RTU = "modbus-rtu"
    ASCII = "modbus-ascii"


class Heard(NamedTuple):
    """Characters that belong together. ``frame`` is None where they are damaged: then ``reason`` says how.

    ``start`` is the first edge, ``end`` the last stop bit, in ticks. ``sender`` is a name where the
    recording has one, else "". ``whole`` is False where the characters may be several damaged frames,
    or only a part of one.
    """

    protocol: LineProtocol
    start: int
    end: int
    chars: bytes
    frame: Frame | Adu | None
    reason: str = ""
    sender: str = ""
    whole: bool = True

    def record(self, bus: str, kind: str, sender: str, baud: int, fmt: str) -> FrameRecord:
        """The record of a trace; ``sender`` is its name where the recording has none."""
        frame = self.frame
        return FrameRecord(
            bus=bus,
            start=self.start,
            end=self.end,
            sender=self.sender or sender,
            kind=kind,
            station=None if frame is None else frame.station,
            counter=frame.counter if isinstance(frame, Frame) else None,
            chars=self.chars,
            damaged_bits=(),
            damaged_at={},
            collided=False,
            cut=False,
            protocol=self.protocol.value,
            baud=baud,
            format=fmt,
        )
