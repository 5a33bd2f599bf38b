"""The level on a bus, from the frames of its trace."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from functools import lru_cache

from bussim.errors import UsageError
from bussim.line.characters import CharFormat, LineTiming
from bussim.line.contention import Disputed, Driver, disputed_level, line_lows
from bussim.line.uart import Sampled, Uart
from bussim.line.wave import Wave, clip, low_intervals
from bussim.trace.records import FrameRecord, TraceHeader


@lru_cache(maxsize=256)
def timing_of(baud: int, fmt: str, ppm: float) -> LineTiming:
    """The timing of a transmitter. Raises UsageError for what no UART can be set to."""
    try:
        parsed = CharFormat.parse(fmt)
    except ValueError as error:
        raise UsageError(f"the trace is damaged: a format {error}") from None
    if not 1 <= baud <= 100_000_000 or not abs(ppm) < 1_000_000:
        raise UsageError(f"the trace is damaged: a frame at {baud} bps with a clock {ppm} ppm off")
    # The shortest text of the float is the number that the scenario had.
    return LineTiming(baud, parsed, Fraction(repr(ppm)))


def timing_of_frame(frame: FrameRecord) -> LineTiming:
    """The timing of a frame's sender; raises as :func:`timing_of`."""
    return timing_of(frame.baud, frame.format, frame.ppm)


def driver_of(frame: FrameRecord, flips: Sequence[int]) -> Driver:
    """The driver of a frame's sender if these of its bits are inverted; the part cut off left out."""
    timing = timing_of_frame(frame)
    lows = low_intervals(frame.chars, timing, frame.start, flips, frame.pauses)
    if lows and lows[-1][1] > frame.end:
        lows = clip(lows, frame.start, frame.end)
    begun = frame.start, frame.sender
    return Driver(begun, frame.start, frame.driven_until, lows, timing, frame.pauses)


def is_plain(frame: FrameRecord, timing: LineTiming) -> bool:
    """Whether a receiver of this timing reads the characters that were sent, if no other node sends."""
    damaged = frame.damaged_bits or frame.collided or frame.cut or frame.ppm
    return not damaged and frame.baud == timing.baud and frame.format == str(timing.format)


def characters_of(frames: Sequence[FrameRecord], timing: LineTiming, disputed: Disputed) -> Iterator[Sampled]:
    """The characters that a receiver of this timing reads of frames that come by their starts."""
    drivers = [driver_of(frame, frame.damaged_bits) for frame in frames]
    wave, uart, ready = Wave([line_lows(drivers, disputed)]), Uart(timing), frames[0].start
    while (char := uart.next_character(wave, ready)) is not None:
        yield char
        ready = char.ready


def disputed_of(header: TraceHeader, bus: str) -> Disputed:
    """How disputed bits of a bus were decided in the run of a trace."""
    found = header.bus(bus)
    return None if found is None else disputed_level(found.contention, header.seed or 0, bus)
