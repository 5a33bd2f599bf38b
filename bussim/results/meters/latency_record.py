"""What was measured of one entry of a scenario's ``latency``. All times are ticks."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from bussim.results.meters.histogram import Histogram
from bussim.results.meters.plain_data import FLAT, LATER, named

#: What a latency is made of: waiting for the source's scan (to the END after it, or of
#: those that its program takes), for the station's turn on the link, the frame on the wire, waiting for the
#: destination's END, and for its output.
PARTS = ("scan", "turn", "wire", "destination", "output")


class Sample(NamedTuple):
    """One latency: when the change was, and its parts in the order of :data:`PARTS`."""

    at: int
    parts: tuple[int, ...]

    @property
    def total(self) -> int:
        """The sum of all parts."""
        return sum(self.parts)


@dataclass(slots=True)
class LatencyRecord:
    """What was measured of one entry.

    Bits: ``changes`` = ``delivered`` + ``lost`` + ``unseen`` + ``open`` (under way at the end). Words:
    ``changes`` counts those of the source, ``delivered`` the scans at which an age was measured.
    ``parts`` has of each part the sum and the longest; ``shortest`` and ``longest`` are whole latencies.

    ``way`` says whether programs and link lead from source to target: "direct", "unknown" or "none" (empty:
    not asked; older runs also "over other stations"). ``reasons`` say why nothing leads there, or why no age
    of a word can be measured: then nothing is delivered. ``longest_gap`` is between
    two data frames of the source's that the target's PLC heard (None: there were no two), and ``lost_short``
    how many of the lost changes began or ended a level that did not last so long.
    """

    source: str = field(metadata=named("from"))
    target: str = field(metadata=named("to"))
    edge: str
    inverted: bool
    word: bool
    changes: int = 0
    delivered: int = 0
    lost: int = 0
    unseen: int = 0
    open: int = 0
    way: str = field(default="", metadata=LATER)
    reasons: tuple[str, ...] = field(default=(), metadata=LATER)
    lost_short: int = field(default=0, metadata=LATER)
    longest_gap: int | None = field(default=None, metadata=LATER)
    parts: dict[str, list[int]] = field(default_factory=lambda: {part: [0, 0] for part in PARTS})
    shortest: Sample | None = None
    longest: Sample | None = None
    histogram: Histogram = field(default_factory=Histogram, metadata=FLAT)

    def __post_init__(self) -> None:
        """Raise ValueError for other parts, as of a file that was changed."""
        whole = [sample.parts for sample in (self.shortest, self.longest) if sample]
        pairs = (*self.parts,) == PARTS and all(len(part) == 2 for part in self.parts.values())
        if not pairs or any(len(parts) != len(PARTS) for parts in whole):
            raise ValueError(f"{self.source} to {self.target} has not the parts {', '.join(PARTS)}")

    def add(self, sample: Sample) -> None:
        """Count a latency; of several longest ones the first is kept."""
        self.delivered += 1
        total = sample.total
        if self.histogram.maximum is None or total > self.histogram.maximum:
            self.longest = sample
        if self.histogram.minimum is None or total < self.histogram.minimum:
            self.shortest = sample
        self.histogram.add(total)
        for part, ticks in zip(self.parts.values(), sample.parts, strict=True):
            part[0] += ticks
            part[1] = max(part[1], ticks)

    def examples(self) -> dict[str, Sequence[float]]:
        """The parts (ticks) of the shortest, the mean and the longest one; empty where nothing has any."""
        if not self.delivered:
            return {}
        found: dict[str, Sequence[float]] = {
            "mean": [total / self.delivered for total, _ in self.parts.values()]
        }
        if self.shortest is not None and self.longest is not None:
            found = {"shortest": self.shortest.parts, **found, "longest": self.longest.parts}
        return found
