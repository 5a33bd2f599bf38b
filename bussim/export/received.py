"""Frames as a receiver on the bus reads them.

It stands for all of them: it has the bus's rate and format and an exact clock, sees what noise did on the
wire, and of two frames that collide what their bus has then (its ``contention``). What noise did in one
receiver only, it does not see.
A character belongs to the frame that began last before it.
"""

import heapq
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from bussim.export.selection import BusSurvey, Survey
from bussim.line.characters import LineTiming
from bussim.line.wave import paused_by
from bussim.trace.levels import characters_of, is_plain, timing_of_frame
from bussim.trace.records import FrameRecord
from bussim.units import format_time
from bussim.wording import counted

#: Most overlapping frames that are read at once: a jabbering station has no end.
_MOST_OVERLAPPING = 512


class Received(NamedTuple):
    """A frame and what was read of it.

    ``wrong`` are the characters (from 0) whose parity or stop bit was wrong, with which of the two;
    ``over`` are the other senders that were sending meanwhile; ``starts`` the first edges (ticks) of the
    characters where these are not those of the frame, else ().
    """

    frame: FrameRecord
    chars: bytes
    wrong: tuple[tuple[int, str], ...] = ()
    over: tuple[str, ...] = ()
    starts: tuple[int, ...] = ()

    def pieces(self, character: int) -> Iterator[tuple[int, int, int]]:
        """What lies between silences that end a frame: its first edge, and the range of its characters.

        On the N:N link a character (of so many ticks) of silence ends one, else 3.5 of them. Of frames that
        overlap it is what has no silence in it at all: each character keeps its time.
        """
        apart = 2 * character if self.frame.protocol == "nn" else 9 * character // 2
        if self.over:
            apart = character + character // 20
        first = 0
        for at in range(1, len(self.starts)):
            if self.starts[at] - self.starts[at - 1] >= apart:
                yield self.starts[first], first, at
                first = at
        yield self.starts[first] if self.starts else self.frame.start, first, len(self.chars)


def receive(frames: Iterable[FrameRecord], survey: Survey) -> Iterator[Received]:
    """What is read of frames that come by their starts; in the same order."""
    receivers = {name: _Receiver(bus) for name, bus in survey.buses.items()}
    ready: list[tuple[int, int, Received]] = []
    number = 0

    def close(receiver: _Receiver) -> None:
        nonlocal number
        for received in receiver.close():
            heapq.heappush(ready, (received.frame.start, number, received))
            number += 1

    for frame in frames:
        for receiver in receivers.values():
            if receiver.frames and (receiver.until <= frame.start or receiver.full):
                close(receiver)
        receivers[frame.bus].add(frame)
        begun = min(receiver.frames[0].start for receiver in receivers.values() if receiver.frames)
        while ready and ready[0][0] <= begun:
            yield heapq.heappop(ready)[2]
    for receiver in receivers.values():
        close(receiver)
    while ready:
        yield heapq.heappop(ready)[2]


class _Receiver:
    """One bus: ``frames`` that may overlap, and ``until`` when they are over."""

    def __init__(self, bus: BusSurvey) -> None:
        self._timing = timing = bus.timing
        self._disputed = bus.disputed
        self._mask = (1 << timing.format.data_bits) - 1
        self._character = timing.characters(1)
        self.frames: list[FrameRecord] = []
        self.until = 0

    @property
    def full(self) -> bool:
        return len(self.frames) >= _MOST_OVERLAPPING

    def add(self, frame: FrameRecord) -> None:
        """A frame begins before the others are over, or is the first."""
        self.frames.append(frame)
        # A receiver may still be inside a character that began in what is damaged.
        after = 0 if is_plain(frame, self._timing) else self._character
        self.until = max(self.until, frame.end + after, frame.driven_until)

    def close(self) -> list[Received]:
        """What was read of the frames; then there are none."""
        frames, self.frames, self.until = self.frames, [], 0
        if len(frames) == 1 and is_plain(frames[0], self._timing) and not frames[0].pauses:
            chars = frames[0].chars
            if self._mask != 0xFF:
                chars = bytes(value & self._mask for value in chars)
            return [Received(frames[0], chars)]
        return self._read(frames) if frames else []

    def _read(self, frames: list[FrameRecord]) -> list[Received]:
        chars = [bytearray() for _ in frames]
        wrong: list[list[tuple[int, str]]] = [[] for _ in frames]
        starts: list[list[int]] = [[] for _ in frames]
        at = 0
        for char in characters_of(frames, self._timing, self._disputed):
            while at + 1 < len(frames) and frames[at + 1].start <= char.start:
                at += 1
            if not (char.parity_ok and char.stop_ok):
                wrong[at].append((len(chars[at]), "parity" if char.stop_ok else "framing"))
            chars[at].append(char.value)
            starts[at].append(char.start)
        return [
            Received(
                frame, bytes(chars[at]), tuple(wrong[at]), _senders_over(frame, frames), tuple(starts[at])
            )
            for at, frame in enumerate(frames)
        ]


def _senders_over(frame: FrameRecord, others: Iterable[FrameRecord]) -> tuple[str, ...]:
    return tuple(
        dict.fromkeys(
            other.sender
            for other in others
            if other is not frame and other.start < frame.end and frame.start < other.driven_until
        )
    )


def remarks(received: Received, timing: LineTiming) -> list[str]:
    """What went wrong with a frame on its way to the receivers, in words."""
    frame = received.frame
    found: list[str] = []
    if frame.damaged_bits:
        found.append(f"{_numbered('bit', frame.damaged_bits)} inverted on the wire")
    found += [
        f"{_numbered('bit', bits)} inverted at {name} only" for name, bits in frame.damaged_at.items() if bits
    ]
    if received.over or frame.collided:
        found.append(f"collided with {', '.join(received.over)}" if received.over else "collided")
    found += [f"a pause of {format_time(ticks)} after character {index + 1}" for index, ticks in frame.pauses]
    own = timing_of_frame(frame)
    if frame.cut:
        took = frame.end - frame.start - paused_by(frame.end, own, frame.start, frame.pauses)
        left = min(len(frame.chars), int(took / own.character))
        found.append(f"cut off after {left} of {counted(len(frame.chars), 'character')}")
    if (own.baud, own.format) != (timing.baud, timing.format):
        found.append(f"sent at {frame.baud} {frame.format}, the bus has {timing.baud} {timing.format}")
    for kind in ("parity", "framing"):
        numbers = [index + 1 for index, which in received.wrong if which == kind]
        if numbers:
            found.append(f"{kind} error in {_numbered('character', numbers)}")
    mask = (1 << own.format.data_bits) - 1
    if received.chars != bytes(value & mask for value in frame.chars):
        found.append(f"sent was {frame.chars.hex(' ').upper()}")
    return found


#: Numbers that a remark lists.
_MOST_LISTED = 16


def _numbered(what: str, numbers: Sequence[int]) -> str:
    listed = ", ".join(map(str, numbers[:_MOST_LISTED]))
    more = f" and {len(numbers) - _MOST_LISTED} more" if len(numbers) > _MOST_LISTED else ""
    return f"{what}{'s' if len(numbers) > 1 else ''} {listed}{more}"
