"""Estimates from a recording of an N:N link: times of the master and of each station, loss and bit errors."""

from __future__ import annotations

from array import array
from collections import Counter
from dataclasses import dataclass, field
from math import log

from bussim.engines.nn.frames import DATA, MODES, PARAMETERS, POLL, Frame, LinkSettings
from bussim.line.characters import NN_LINE
from bussim.live.fit.statistics import Estimate, bit_error_rate, mean, median, proportion
from bussim.live.fit.turnaround import TurnaroundDistribution, distribution_of
from bussim.live.sniff.heard import Heard
from bussim.units import TICKS_PER_MS

#: 10 ms, the unit of D8180, in ticks.
TIMEOUT_UNIT = 10 * TICKS_PER_MS
#: A silence is an outage if runs of its length would be found by chance in fewer recordings than this.
_BY_CHANCE = 0.01
#: So many silent attempts in a row are an outage before anything is known of the loss.
_SURELY = 8
_ROUNDS = 10

#: Outcomes of an attempt whose poll was heard sound.
ANSWERED, SILENT, DAMAGED = 0, 1, 2


@dataclass(frozen=True, slots=True)
class Outage:
    """A time in which a station answered nothing; ``end`` is None where it lasts to the end."""

    station: int
    start: int  # first edge of the first poll without an answer
    end: int | None  # end of the last one


@dataclass(frozen=True, slots=True)
class StationEstimate:
    """One slave. ``distribution`` and ``turnaround`` are None where it never answered."""

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
    begin: int
    end: int


@dataclass(slots=True)
class _Station:
    """What was seen of one slave."""

    turnarounds: array[int] = field(default_factory=lambda: array("q"))
    outcomes: bytearray = field(default_factory=bytearray)
    starts: array[int] = field(default_factory=lambda: array("q"))  # of each poll
    ends: array[int] = field(default_factory=lambda: array("q"))


class LinkObserver:
    """Takes what a listener heard, in order, and estimates."""

    def __init__(self) -> None:
        self._stations: dict[int, _Station] = {}
        self._gaps = array("q")  # behind frames of the master or good replies
        self._waits = array("q")  # from a silent poll's end to the master's next frame
        self._turns = array("q")  # from the last good reply of a scan to the next scan
        self._sizes: dict[int, list[int]] = {}  # bits → sound, damaged
        self._scans = array("q")
        self._scan: int | None = None
        self._settings: LinkSettings | None = None
        self._blocks: Counter[int] = Counter()
        self._poll: Heard | None = None  # unanswered
        self._hit = False  # something damaged was received since
        self._before: Heard | None = None  # the sound frame right before, nothing damaged since
        self._attempt = 0
        self._most_attempts = 1
        self._asked: int | None = None  # station of the latest poll that failed
        self._frames = self._damaged = 0
        self._begin: int | None = None
        self._end = 0

    def heard(self, heard: Heard) -> None:
        """Take in what was heard next."""
        self._frames += 1
        if self._begin is None:
            self._begin = heard.start
        self._end = max(self._end, heard.end)
        frame = heard.frame if isinstance(heard.frame, Frame) else None
        sizes = self._sizes.setdefault(len(heard.chars) * NN_LINE.format.bits, [0, 0])
        sizes[frame is None] += 1
        if frame is None:
            self._damaged += 1
            self._hit = True
            self._before = None
            return
        if frame.kind == DATA and frame.station:
            self._reply(heard, frame)
        else:
            self._masters(heard, frame)
        self._before = heard

    def _reply(self, heard: Heard, frame: Frame) -> None:
        poll, self._poll = self._poll, None
        asked = poll.frame if poll is not None else None
        if poll is None or not isinstance(asked, Frame):
            return
        if (frame.station, frame.counter) != (asked.station, asked.counter):
            self._poll = poll
            self._hit = True
            return
        station = self._station(frame.station)
        station.turnarounds.append(heard.start - poll.end)
        self._outcome(station, poll, ANSWERED)
        self._asked = None
        self._blocks[len(frame.data)] += 1

    def _masters(self, heard: Heard, frame: Frame) -> None:
        before = self._before
        if self._poll is not None:
            self._failed(self._poll, heard)
        elif before is not None and isinstance(before.frame, Frame):
            # Behind the last slave's reply comes the overhead, else the master's gap alone.
            waited = heard.start - before.end
            turn = before.frame.kind == DATA and before.frame.station and frame.kind != POLL
            (self._turns if turn else self._gaps).append(waited)
        if frame.kind == POLL:
            self._attempt = self._attempt + 1 if self._asked == frame.station else 1
            self._most_attempts = max(self._most_attempts, self._attempt)
            self._poll, self._hit = heard, False
            self._station(frame.station)
        elif frame.kind == PARAMETERS:
            self._settings = frame.settings
        else:
            self._blocks[len(frame.data)] += 1
            if self._scan is not None:
                self._scans.append(heard.start - self._scan)
            self._scan = heard.start
        if frame.kind != POLL:
            self._asked = None

    def _failed(self, poll: Heard, heard: Heard) -> None:
        self._poll = None
        asked = poll.frame
        assert isinstance(asked, Frame)  # noqa: S101 - narrows the type; only sound polls are kept
        self._asked = asked.station
        self._outcome(self._station(asked.station), poll, DAMAGED if self._hit else SILENT)
        if not self._hit:
            self._waits.append(heard.start - poll.end)

    def _station(self, number: int) -> _Station:
        return self._stations.setdefault(number, _Station())

    @staticmethod
    def _outcome(station: _Station, poll: Heard, outcome: int) -> None:
        station.outcomes.append(outcome)
        station.starts.append(poll.start)
        station.ends.append(poll.end)

    # -- estimating ----------------------------------------------------------------------------

    def estimate(self) -> LinkEstimate | None:
        """The estimates; None where there was no poll."""
        if not self._stations:
            return None
        gap = median(self._gaps) if self._gaps else 0
        outages, lost, trials = self._losses()
        stations = []
        for number, seen in sorted(self._stations.items()):
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
        overhead = None
        if self._turns:
            usual = median(self._turns)
            middle = mean([turn - gap for turn in self._turns if turn < 2 * usual])
            overhead = Estimate(usual - gap, middle.low, middle.high, middle.count)
        return LinkEstimate(
            settings=self._settings or self._seen_settings(gap),
            settings_received=self._settings is not None,
            master_gap=_around(self._gaps, gap) if self._gaps else None,
            scan_overhead=overhead,
            loss=proportion(sum(lost.values()), total) if total else None,
            ber=bit_error_rate({bits: (sound, bad) for bits, (sound, bad) in self._sizes.items()}),
            stations=tuple(stations),
            scans=tuple(self._scans),
            damaged=self._damaged,
            frames=self._frames,
            begin=self._begin or 0,
            end=self._end,
        )

    def _seen_settings(self, gap: int) -> LinkSettings:
        """Settings that explain what was seen, where there was no parameter frame."""
        block = self._blocks.most_common(1)[0][0] if self._blocks else 0
        mode = next((number for number, one in enumerate(MODES) if one.size == block), 0)
        timeout = round((median(self._waits) - gap) / TIMEOUT_UNIT) if self._waits else 5
        return LinkSettings(
            max(self._stations), mode, min(10, self._most_attempts - 1), min(255, max(5, timeout))
        )

    def _losses(self) -> tuple[dict[int, list[Outage]], dict[int, int], dict[int, int]]:
        """Outages by station, and outside them silent attempts and all attempts."""
        longest = dict.fromkeys(self._stations, _SURELY)
        for _ in range(_ROUNDS):
            lost, trials = self._outside(longest)
            hits, total = sum(lost.values()), sum(trials.values())
            rate = hits / total if total else 0.0
            limit = _SURELY
            if 0 < rate < 1:
                limit = max(2, int(log(_BY_CHANCE / total) / log(rate)) + 1)
            elif rate == 0:
                limit = 2
            if all(limit == known for known in longest.values()):
                break
            longest = dict.fromkeys(self._stations, limit)
        lost, trials = self._outside(longest)
        outages = {
            number: [
                Outage(number, seen.starts[first], seen.ends[last - 1] if last < len(seen.outcomes) else None)
                for first, last in _runs(seen.outcomes, longest[number])
            ]
            for number, seen in self._stations.items()
        }
        return outages, lost, trials

    def _outside(self, longest: dict[int, int]) -> tuple[dict[int, int], dict[int, int]]:
        lost: dict[int, int] = {}
        trials: dict[int, int] = {}
        for number, seen in self._stations.items():
            outcomes = seen.outcomes
            silent = outcomes.count(SILENT)
            count = len(outcomes)  # a damaged answer is no lost one
            for first, last in _runs(outcomes, longest[number]):
                silent -= outcomes[first:last].count(SILENT)
                count -= last - first
            lost[number], trials[number] = silent, count
        return lost, trials


def _runs(outcomes: bytearray, longest: int) -> list[tuple[int, int]]:
    """Where at least ``longest`` attempts in a row got no answer: from, and up to the next answered one.

    Before the first answer ever the station may not have been there at all: that is a run, however
    short.
    """
    found = []
    at = 0
    while (at := outcomes.find(SILENT, at)) >= 0:
        end = outcomes.find(ANSWERED, at)
        end = len(outcomes) if end < 0 else end
        never = ANSWERED not in outcomes[:at]
        if outcomes[at:end].count(SILENT) >= (1 if never else longest):
            found.append((at, end))
        at = end
    return found


def _around(values: array[int], usual: int) -> Estimate:
    """The usual value, with the interval of the mean of those that are not far from it."""
    near = mean([value for value in values if value < 2 * usual + 1])
    return Estimate(usual, near.low, near.high, near.count)
