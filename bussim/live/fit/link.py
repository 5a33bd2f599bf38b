"""Estimates from a recording of an N:N link: times of the master and of each station, loss and bit errors."""

from __future__ import annotations

from array import array
from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import log
from statistics import median_low

from bussim.engines.nn.codes import NO_REPLY
from bussim.engines.nn.frames import DATA, MODES, POLL, Frame, LinkSettings
from bussim.line.characters import NN_LINE
from bussim.live.fit.statistics import Estimate, bit_error_rate, mean, median, proportion
from bussim.live.fit.turnaround import TurnaroundDistribution, distribution_of
from bussim.live.sniff.decoder import Line
from bussim.live.sniff.heard import Heard, Verdict
from bussim.live.sniff.link import LinkDecoder, OpenPoll
from bussim.trace.records import Sink
from bussim.units import TICKS_PER_MS

#: 10 ms, the unit of D8180, in ticks.
TIMEOUT_UNIT = 10 * TICKS_PER_MS
#: A silence is an outage if runs of its length would be found by chance in fewer recordings than this.
_BY_CHANCE = 0.01
#: So many attempts without a reply in a row are an outage before anything is known of the loss.
_SURELY = 8
_ROUNDS = 10

#: Outcomes of an attempt whose poll was heard sound.
REPLIED, SILENT, DAMAGED = 0, 1, 2


@dataclass(frozen=True, slots=True)
class Outage:
    """A time in which a station gave no reply; ``end`` is None where it lasts to the end."""

    station: int
    start: int  # first edge of the first poll without a reply
    end: int | None  # end of the last one


@dataclass(frozen=True, slots=True)
class StationEstimate:
    """One slave. ``distribution`` and ``turnaround`` are None where it never replied."""

    station: int
    polls: int
    turnaround: Estimate | None  # ticks
    distribution: TurnaroundDistribution | None
    loss: Estimate | None
    outages: tuple[Outage, ...]


@dataclass(frozen=True, slots=True)
class LinkEstimate:
    """One link. Times in ticks; ``settings`` are those of a parameter frame, or what was seen instead."""

    settings: LinkSettings
    settings_received: bool  # in a parameter frame
    master_gap: Estimate | None
    scan_overhead: Estimate | None
    loss: Estimate | None
    ber: Estimate | None
    stations: tuple[StationEstimate, ...]
    scans: tuple[int, ...]  # durations of link scans
    damaged: int
    frames: int
    recording: str = ""  # where it was measured


@dataclass(slots=True)
class _Station:
    """What was seen of one slave."""

    turnarounds: array[int] = field(default_factory=lambda: array("q"))
    outcomes: bytearray = field(default_factory=bytearray)
    starts: array[int] = field(default_factory=lambda: array("q"))  # of each poll
    ends: array[int] = field(default_factory=lambda: array("q"))


class LinkObserver(LinkDecoder):
    """Decodes a link, and keeps what the estimates need."""

    def __init__(self, line: Line, sink: Sink, names: Mapping[int, str] | None = None) -> None:
        super().__init__(line, sink, names)
        self._seen: defaultdict[int, _Station] = defaultdict(_Station)
        self._gaps = array("q")  # behind frames of the master or good replies
        self._waits = array("q")  # from the end of a poll without a reply to the master's next frame
        self._turns = array("q")  # from the last good reply of a scan to the next scan
        self._sizes: dict[int, list[int]] = {}  # bits → sound, damaged
        self._scans = array("q")
        self._blocks: Counter[int] = Counter()

    def heard(self, heard: Heard) -> None:
        """See the base class."""
        frame = heard.frame if isinstance(heard.frame, Frame) else None
        if heard.verdict in (Verdict.SOUND, Verdict.DAMAGED):
            sizes = self._sizes.setdefault(len(heard.chars) * NN_LINE.format.bits, [0, 0])
            sizes[frame is None] += 1
        before = self._before
        if frame is not None and before is not None and self._poll is None and not _replies(frame):
            # Behind the last slave's reply comes the overhead, else the master's gap alone.
            turn = _replies(before[1]) and frame.kind != POLL
            (self._turns if turn else self._gaps).append(heard.start - before[0])
        super().heard(heard)

    def _attempted(self, poll: OpenPoll, code: int, now: int, turnaround: int | None) -> None:
        super()._attempted(poll, code, now, turnaround)
        station, outcome = self._seen[poll.station], REPLIED
        if turnaround is not None:
            station.turnarounds.append(turnaround)
        elif code == NO_REPLY:
            outcome = SILENT
            self._waits.append(now - poll.end)
        else:
            outcome = DAMAGED
        station.outcomes.append(outcome)
        station.starts.append(poll.start)
        station.ends.append(poll.end)

    def _scan_begins(self, start: int, counter: int) -> None:
        scans, begun = self.scans, self._scan
        super()._scan_begins(start, counter)
        if self.scans > scans and begun is not None:
            self._scans.append(start - begun[0])

    def _refreshed(self, heard: Heard, frame: Frame) -> None:
        super()._refreshed(heard, frame)
        self._blocks[len(frame.data)] += 1

    # -- estimating ----------------------------------------------------------------------------

    def estimate(self) -> LinkEstimate | None:
        """The estimates; None where there was no poll."""
        if not self._stations:
            return None
        # A station whose only poll is the last frame has no outcome yet.
        self._seen |= {number: _Station() for number in self._stations - self._seen.keys()}
        gap = median_low(self._gaps) if self._gaps else 0
        outages, lost, trials = self._losses()
        stations = []
        for number in sorted(self._stations):
            seen = self._seen[number]
            distribution = distribution_of(seen.turnarounds) if seen.turnarounds else None
            stations.append(
                StationEstimate(
                    number,
                    len(seen.outcomes),
                    mean(seen.turnarounds) if seen.turnarounds else None,
                    distribution,
                    proportion(lost[number], trials[number]) if trials[number] else None,
                    tuple(outages[number]),
                )
            )
        total = sum(trials.values())
        overhead = median([turn - gap for turn in self._turns]) if self._turns else None
        return LinkEstimate(
            settings=self.settings or self._seen_settings(gap),
            settings_received=self.settings is not None,
            master_gap=median(self._gaps) if self._gaps else None,
            scan_overhead=overhead,
            loss=proportion(sum(lost.values()), total) if total else None,
            ber=bit_error_rate({bits: (sound, bad) for bits, (sound, bad) in self._sizes.items()}),
            stations=tuple(stations),
            scans=tuple(self._scans),
            damaged=self.damaged,
            frames=self.frames,
        )

    def _seen_settings(self, gap: int) -> LinkSettings:
        """Settings that explain what was seen, where there was no parameter frame."""
        block = self._blocks.most_common(1)[0][0] if self._blocks else 0
        mode = next((number for number, one in enumerate(MODES) if one.size == block), 0)
        timeout = round((median_low(self._waits) - gap) / TIMEOUT_UNIT) if self._waits else 5
        return LinkSettings(
            max(self._stations), mode, min(10, self.most_attempts - 1), min(255, max(5, timeout))
        )

    def _losses(self) -> tuple[dict[int, list[Outage]], dict[int, int], dict[int, int]]:
        """Outages by station, and of all other attempts those without a reply and their number."""
        longest = _SURELY
        for _ in range(_ROUNDS):
            lost, trials = self._without_outages(longest)
            hits, total = sum(lost.values()), sum(trials.values())
            rate = hits / total if total else 0.0
            limit = _SURELY
            if 0 < rate < 1:
                limit = max(2, int(log(_BY_CHANCE / total) / log(rate)) + 1)
            elif rate == 0:
                limit = 2
            if limit == longest:
                break
            longest = limit
        lost, trials = self._without_outages(longest)
        outages = {
            number: [
                Outage(number, seen.starts[first], seen.ends[last - 1] if last < len(seen.outcomes) else None)
                for first, last in _runs(seen.outcomes, longest)
            ]
            for number, seen in self._seen.items()
        }
        return outages, lost, trials

    def _without_outages(self, longest: int) -> tuple[dict[int, int], dict[int, int]]:
        lost: dict[int, int] = {}
        trials: dict[int, int] = {}
        for number, seen in self._seen.items():
            outcomes = seen.outcomes
            silent = outcomes.count(SILENT)
            count = len(outcomes)  # a damaged reply is no lost one
            for first, last in _runs(outcomes, longest):
                silent -= outcomes[first:last].count(SILENT)
                count -= last - first
            lost[number], trials[number] = silent, count
        return lost, trials


def _replies(frame: Frame) -> bool:
    """Whether a frame is a slave's."""
    return frame.kind == DATA and frame.station > 0


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
