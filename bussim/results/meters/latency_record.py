"""What was measured of one entry of a scenario's ``latency``. All times are ticks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from bussim.results.meters.histogram import Histogram

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
    ``sums`` and ``longest_parts`` are of each part; ``shortest`` and ``longest`` whole latencies.

    ``way`` says whether programs and link lead from source to target: "direct", "unknown" or "none" (empty:
    not asked; older runs also "over other stations"). ``reasons`` say why nothing leads there, or why no age
    of a word can be measured: then nothing is delivered. ``longest_gap`` is between
    two data frames of the source's that the target's PLC heard (None: there were no two), and ``lost_short``
    how many of the lost changes began or ended a level that did not last so long.
    """

    source: str
    target: str
    edge: str
    inverted: bool
    word: bool
    changes: int = 0
    delivered: int = 0
    lost: int = 0
    unseen: int = 0
    open: int = 0
    way: str = ""
    reasons: tuple[str, ...] = ()
    lost_short: int = 0
    longest_gap: int | None = None
    histogram: Histogram = field(default_factory=Histogram)
    sums: list[int] = field(default_factory=lambda: [0] * len(PARTS))
    longest_parts: list[int] = field(default_factory=lambda: [0] * len(PARTS))
    shortest: Sample | None = None
    longest: Sample | None = None

    def add(self, sample: Sample) -> None:
        """Count a latency; of several longest ones the first is kept."""
        self.delivered += 1
        total = sample.total
        if self.histogram.maximum is None or total > self.histogram.maximum:
            self.longest = sample
        if self.histogram.minimum is None or total < self.histogram.minimum:
            self.shortest = sample
        self.histogram.add(total)
        for place, ticks in enumerate(sample.parts):
            self.sums[place] += ticks
            if ticks > self.longest_parts[place]:
                self.longest_parts[place] = ticks

    def examples(self) -> dict[str, Sequence[float]]:
        """The parts (ticks) of the shortest, the mean and the longest one; empty where nothing has any."""
        if not self.delivered:
            return {}
        found: dict[str, Sequence[float]] = {"mean": [total / self.delivered for total in self.sums]}
        if self.shortest is not None and self.longest is not None:
            found = {"shortest": self.shortest.parts, **found, "longest": self.longest.parts}
        return found

    def to_json(self) -> dict[str, Any]:
        """Plain data, times in ticks."""
        return {
            "from": self.source,
            "to": self.target,
            "edge": self.edge,
            "inverted": self.inverted,
            "word": self.word,
            "changes": self.changes,
            "delivered": self.delivered,
            "lost": self.lost,
            "unseen": self.unseen,
            "open": self.open,
            "way": self.way,
            "reasons": list(self.reasons),
            "lost_short": self.lost_short,
            "longest_gap": self.longest_gap,
            "parts": dict(
                zip(PARTS, map(list, zip(self.sums, self.longest_parts, strict=True)), strict=True)
            ),
            "shortest": _sample_to_json(self.shortest),
            "longest": _sample_to_json(self.longest),
            **self.histogram.to_json(),
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> LatencyRecord:
        """The value of :meth:`to_json`. Raises KeyError, TypeError or ValueError for anything else."""
        parts = [data["parts"][name] for name in PARTS]
        gap = data.get("longest_gap")
        return cls(
            source=str(data["from"]),
            target=str(data["to"]),
            edge=str(data["edge"]),
            inverted=bool(data["inverted"]),
            word=bool(data["word"]),
            **{key: int(data[key]) for key in ("changes", "delivered", "lost", "unseen", "open")},
            # Runs of before lack these.
            way=str(data.get("way", "")),
            reasons=tuple(map(str, data.get("reasons", ()))),
            lost_short=int(data.get("lost_short", 0)),
            longest_gap=None if gap is None else int(gap),
            histogram=Histogram.from_json(data),
            sums=[int(total) for total, _ in parts],
            longest_parts=[int(longest) for _, longest in parts],
            shortest=_sample_from_json(data["shortest"]),
            longest=_sample_from_json(data["longest"]),
        )


def _sample_to_json(sample: Sample | None) -> list[Any] | None:
    return None if sample is None else [sample.at, list(sample.parts)]


def _sample_from_json(data: Any) -> Sample | None:
    return None if data is None else Sample(int(data[0]), tuple(int(part) for part in data[1]))
