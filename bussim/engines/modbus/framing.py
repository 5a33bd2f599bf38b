"""How one port frames: the mode and its silences in ticks."""

from __future__ import annotations

from dataclasses import dataclass

from bussim.engines.modbus.adu import Adu, Mode, adu_chars, encode_adu
from bussim.engines.modbus.gaps import STANDARD_GAPS, GapRule, silences
from bussim.engines.modbus.readers import AduReader, AsciiReader, RtuReader
from bussim.line.characters import LineTiming
from bussim.units import TICKS_PER_SECOND, round_half_up


@dataclass(frozen=True, slots=True)
class Framing:
    """Mode and silences of one port, in ticks.

    ``quiet`` ends an RTU frame, and abandons an unfinished ASCII one. More than ``inner`` inside an
    RTU frame damages it; ASCII has no use for it.
    """

    mode: Mode
    quiet: int
    inner: int

    @property
    def closing(self) -> int:
        """The silence before a whole frame counts as over; in ASCII its last character says so."""
        return self.quiet if self.mode is Mode.RTU else 0

    @classmethod
    def rtu(cls, timing: LineTiming, rule: GapRule = STANDARD_GAPS) -> Framing:
        """RTU at a rate and format. Raises ValueError unless the format has 8 data bits."""
        if timing.format.data_bits != 8:
            raise ValueError(f"RTU needs 8 data bits, {timing.format} has {timing.format.data_bits}")
        inner, end = silences(timing, rule)
        return cls(Mode.RTU, round_half_up(end), round_half_up(inner))

    @classmethod
    def ascii(cls, gap: int = TICKS_PER_SECOND) -> Framing:
        """ASCII; ``gap`` is the longest time between two characters of a frame (standard: 1 s)."""
        return cls(Mode.ASCII, gap, gap)

    def encode(self, station: int, pdu: bytes) -> Adu:
        """The frame that carries a PDU."""
        return encode_adu(self.mode, station, pdu)

    def chars(self, pdu_size: int) -> int:
        """Characters of the frame that carries a PDU of so many bytes."""
        return adu_chars(self.mode, pdu_size)

    def reader(self) -> AduReader:
        """A new reader for what this port receives."""
        return AsciiReader(self.quiet) if self.mode is Mode.ASCII else RtuReader(self.quiet, self.inner)


def reply_times(
    framing: Framing, *, delay: int, jitter: int = 0, end: int = 0
) -> tuple[tuple[int, int], tuple[int, int]]:
    """When a slave takes its values, and when its reply begins: least and most ticks from a request's end.

    ``end`` is how long it may wait for its END (0: it has no scan), ``delay`` its least time from the
    request's end to the reply, during which it may be waiting for END, ``jitter`` what is added at most.
    """
    heard = framing.closing
    return (heard, heard + end), (max(heard, delay), max(heard + end, delay) + jitter)
