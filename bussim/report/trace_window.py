"""A window of a traced run on one bus: the records that a timeline is drawn from.

Times are ticks of 1/72 MHz from the start of the run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby

from bussim.results.meters.timeline import Span
from bussim.trace.records import (
    AttemptRecord,
    DeviceValueRecord,
    FrameRecord,
    InputRecord,
    NoteRecord,
    ScanRecord,
    TransactionRecord,
)
from bussim.units import format_ms, milliseconds

#: How the text of a part ends that is an ordinary exchange.
ANSWERED = "answered"


@dataclass(frozen=True, slots=True)
class TraceWindow:
    """What happened on ``bus`` from ``begin`` to ``end`` (ticks), records that reach in included.

    ``nodes`` are the nodes of the bus in cable order; ``stations`` the names of an N:N
    link's stations by number; ``ends`` are the ENDs of each PLC. ``values`` are what memories
    hold at ENDs, ``inputs`` the changes on the wires of driven inputs. ``faults`` are the texts of faults and
    when they acted, ``flags`` when the master had each station in error.
    """

    bus: str
    begin: int
    end: int
    nodes: Sequence[str]
    stations: Mapping[int, str] = field(default_factory=dict)
    frames: Sequence[FrameRecord] = ()
    attempts: Sequence[AttemptRecord] = ()
    transactions: Sequence[TransactionRecord] = ()
    scans: Sequence[ScanRecord] = ()
    notes: Sequence[NoteRecord] = ()
    values: Sequence[DeviceValueRecord] = ()
    inputs: Sequence[InputRecord] = ()
    ends: Mapping[str, Sequence[int]] = field(default_factory=dict)
    faults: Sequence[tuple[str, Span]] = ()
    flags: Mapping[int, Sequence[Span]] = field(default_factory=dict)

    def station(self, number: int | None) -> str:
        """``station 1 (press2)``."""
        if number is None:
            return "no station"
        name = self.stations.get(number)
        return f"station {number} ({name})" if name else f"station {number}"


@dataclass(frozen=True, slots=True)
class Part:
    """A part of a link scan: what took so many ticks. ``lost`` marks what a plain scan has not.

    ``attempt`` is the attempt's number where the part is one, else 0.
    """

    start: int
    end: int
    what: str
    attempt: int = 0
    lost: bool = False

    @property
    def ticks(self) -> int:
        """How long it took."""
        return self.end - self.start

    @property
    def answered(self) -> bool:
        """Whether it is an ordinary exchange."""
        return self.what.endswith(ANSWERED)


def parts_of_scan(window: TraceWindow, scan: ScanRecord) -> list[Part]:
    """A link scan cut into what its time went to; the parts' lengths add up to its duration.

    The master's data frame, then each attempt with the gap before its poll, then what is left until
    the next data frame. A part without the records that explain it says so.
    """
    end = scan.start + scan.duration
    parts: list[Part] = []
    at = scan.start
    opening = next((f for f in window.frames if f.start == scan.start and f.kind == "data"), None)
    if opening is not None and opening.end <= end:
        parts.append(Part(at, opening.end, f"data frame of {opening.sender}"))
        at = opening.end
    inside = (a for a in window.attempts if scan.start <= a.start and a.end <= end)
    for attempt in sorted(inside, key=lambda record: record.start):
        what = _outcome(window, attempt)
        parts.append(Part(at, attempt.end, what, attempt.number, lost=attempt.code != 0))
        at = attempt.end
    frame = next((f for f in window.frames if f.kind == "parameters" and at <= f.start < end), None)
    if frame is not None:
        parts.append(Part(at, frame.start, "overhead of the scan"))
        parts.append(Part(frame.start, end, "parameter frame", lost=True))
    elif at < end:
        parts.append(Part(at, end, "overhead of the scan"))
    return parts


#: A reply is named when its turnaround is so many times the shortest one.
_LATE = 4


def _outcome(window: TraceWindow, attempt: AttemptRecord) -> str:
    where = f"at {window.station(attempt.station)}: "
    if attempt.code:
        return f"{where}{attempt.outcome}, code {attempt.code:02X}"
    shortest = min((a.turnaround for a in window.attempts if a.turnaround is not None), default=0)
    if attempt.turnaround is not None and attempt.turnaround > _LATE * shortest:
        return f"{where}reply {format_ms(attempt.turnaround)} after the poll"
    return f"{where}{ANSWERED}"


def in_words(parts: Sequence[Part]) -> list[str]:
    """The parts in words: neighbours in which nothing was lost as one, attempts that failed alike as well."""
    words = []
    for group in (list(alike) for _, alike in groupby(parts, _likeness)):
        first, total = group[0], ms(sum(part.ticks for part in group))
        if len(group) == 1:
            words.append(f"{total} ({_named(first)})")
        elif first.lost:
            attempts = f"attempts {first.attempt} to {group[-1].attempt}"
            words.append(f"{len(group)} × {ms(first.ticks)} ({attempts} {first.what})")
        else:
            answered = sum(part.answered for part in group)
            names = [_named(part) for part in group if not part.answered]
            names += [f"{answered} answered poll{'s' if answered > 1 else ''}"] if answered else []
            words.append(f"{total} ({', '.join(names)})")
    return words


def _likeness(part: Part) -> tuple[str, str] | None:
    # To the microsecond that is shown: two attempts seldom end on the same tick.
    return (part.what, ms(part.ticks)) if part.lost else None


def _named(part: Part) -> str:
    return f"attempt {part.attempt} {part.what}" if part.attempt else part.what


def ms(ticks: float) -> str:
    """``51.719 ms``."""
    return f"{milliseconds(ticks):.3f} ms"
