"""What became of the requests to each station: outages, and of the rest the share lost and damaged."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from math import log

from bussim.live.fit.statistics import Estimate, proportion

#: A silence is an outage if runs of its length would be found by chance in fewer recordings than this.
_BY_CHANCE = 0.01
#: So many attempts without a reply in a row are an outage before anything is known of the loss.
_SURELY = 8
_ROUNDS = 10

#: Outcomes of an attempt whose request was heard sound.
REPLIED, SILENT, DAMAGED = 0, 1, 2


@dataclass(frozen=True, slots=True)
class Outage:
    """A time in which a station gave no reply; ``end`` is None where it lasts to the end."""

    station: int
    start: int  # first edge of the first request without a reply
    end: int | None  # end of the last one


@dataclass(slots=True)
class Outcomes:
    """Outcomes of the attempts at one station, with first edge and end of each request (ticks)."""

    outcomes: bytearray = field(default_factory=bytearray)
    starts: array[int] = field(default_factory=lambda: array("q"))
    ends: array[int] = field(default_factory=lambda: array("q"))

    def add(self, outcome: int, start: int, end: int) -> None:
        """An attempt is over."""
        self.outcomes.append(outcome)
        self.starts.append(start)
        self.ends.append(end)

    def apart_from(self, losses: Losses) -> Iterator[tuple[int, int]]:
        """Starts and outcomes of the attempts outside of outages."""
        at = 0
        for first, last in (*losses.runs, (len(self.outcomes), 0)):
            yield from zip(self.starts[at:first], self.outcomes[at:first], strict=True)
            at = last


@dataclass(frozen=True, slots=True)
class Losses:
    """What became of the requests to one station outside of its outages."""

    outages: tuple[Outage, ...]
    runs: tuple[tuple[int, int], ...]  # of attempts in outages: the first, and the next that is in none
    lost: int
    damaged: int
    trials: int

    @property
    def loss(self) -> Estimate | None:
        """The share without a reply."""
        return proportion(self.lost, self.trials) if self.trials else None

    @property
    def damaged_replies(self) -> Estimate | None:
        """The share whose reply was damaged."""
        return proportion(self.damaged, self.trials) if self.trials else None


def losses(stations: Mapping[int, Outcomes]) -> dict[int, Losses]:
    """Outages by station, and what became of all other attempts.

    Runs are judged by the loss of all stations, or by that of their own where it is higher.
    """
    longest = dict.fromkeys(stations, _SURELY)
    for _ in range(_ROUNDS):
        found = {number: _without_outages(number, seen, longest[number]) for number, seen in stations.items()}
        hits, total = (sum(getattr(each, key) for each in found.values()) for key in ("lost", "trials"))
        limits = {}
        for number, each in found.items():
            rate = max(hits / max(1, total), each.lost / max(1, each.trials))
            limits[number] = 2 if rate == 0 else _SURELY
            if 0 < rate < 1:
                limits[number] = max(2, int(log(_BY_CHANCE / total) / log(rate)) + 1)
        if limits == longest:
            break
        longest = limits
    return {number: _without_outages(number, seen, longest[number]) for number, seen in stations.items()}


def _without_outages(number: int, seen: Outcomes, longest: int) -> Losses:
    outcomes, outages, runs = seen.outcomes, [], _runs(seen.outcomes, longest)
    silent, damaged, count = outcomes.count(SILENT), outcomes.count(DAMAGED), len(outcomes)
    for first, last in runs:
        silent -= outcomes[first:last].count(SILENT)
        damaged -= outcomes[first:last].count(DAMAGED)
        count -= last - first
        end = seen.ends[last - 1] if last < len(outcomes) else None
        outages.append(Outage(number, seen.starts[first], end))
    return Losses(tuple(outages), tuple(runs), silent, damaged, count)


def _runs(outcomes: bytearray, longest: int) -> list[tuple[int, int]]:
    """Runs of at least ``longest`` attempts without a reply: the first, and the next one with a reply.

    Before its first reply the station may not have been there at all: that is a run, however short.
    """
    found = []
    at = 0
    while (at := outcomes.find(SILENT, at)) >= 0:
        end = outcomes.find(REPLIED, at)
        end = len(outcomes) if end < 0 else end
        never = REPLIED not in outcomes[:at]
        if outcomes[at:end].count(SILENT) >= (1 if never else longest):
            found.append((at, end))
        at = end
    return found
