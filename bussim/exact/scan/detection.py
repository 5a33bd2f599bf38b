"""How soon a dead station is noticed: the time from its death, at a random instant, to its next error.

See :mod:`bussim.exact.bursts.timeout_stacks`.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bussim.exact.bursts.scan_chain import FLOOR
from bussim.exact.bursts.state_mixture import Transitions
from bussim.exact.bursts.timeout_stacks import Attempts, Between, mean_time
from bussim.exact.link import Station
from bussim.exact.scan.mixture import Distribution
from bussim.exact.scan.outages import longest_scan
from bussim.exact.scan.turnaround_sums import Floats, spread_of
from bussim.exact.solve import Solved


@dataclass(frozen=True, eq=False)
class Detection:
    """The time to notice a station's death, in ticks, under the noise of the link.

    ``between``: number of attempts of the next exchange, share of the scans, distribution of the time to it.
    """

    solved: Solved
    station: Station
    between: tuple[tuple[int, float, Distribution], ...]
    attempts: tuple[Attempts, ...]

    @cached_property
    def mean(self) -> float:
        """The mean."""
        found = [
            Between(following, share * gap.mean, share * (gap.variance + gap.mean**2))
            for following, share, gap in self.between
        ]
        model, scan = self.solved.model, self.solved.distribution.mean
        timeout = np.full(1, float(model.timeout))
        return float(mean_time(model, self.station, timeout, scan, found, self.attempts)[0])

    def tail(self, x: Floats) -> Floats:
        """P(time > x), x in ticks."""
        model, station, sums = self.solved.model, self.station, self.solved.chain.sums
        wait, character, quiet = model.silent_cost, model.character, model.quiet + sums.torn_mean
        unit, least = sums.unit(station.turnaround), spread_of(station.turnaround)[0] + station.extra
        least += model.gap + model.poll + character
        heading = least + station.average - station.extra - spread_of(station.turnaround)[0]
        total = np.zeros(x.shape)
        for following, share, gap in self.between:
            total += share * gap.excess(np.maximum(x - following * wait, 0.0))
        for left, replied, silent, torn in self.attempts:
            more = left * wait - x
            total += silent * np.clip(wait + more, 0, wait)
            begun = heading - sums.excess(unit, np.maximum(wait + more, 0.0) - least)
            cut = (station.reply - character) * np.clip((model.quiet + more) / character + 1, 0, 1)
            total += (replied + torn) * (begun + cut) + torn * np.clip(quiet + more, 0, quiet)
        return total / self.solved.distribution.mean

    def quantiles(self, levels: Iterable[float]) -> list[float]:
        """For each level the least time, in ticks, that is exceeded with a probability of at most it."""
        wanted = np.array([*levels], dtype=np.float64)[:, None]
        low = np.zeros(wanted.shape)
        high = np.full(wanted.shape, float(longest_scan(self.solved.model)))
        while np.any(high - low > 1.0):
            cuts = low + (high - low) * np.linspace(0.0, 1.0, 34)
            place = np.count_nonzero(self.tail(cuts[:, 1:-1]) > wanted, axis=1)[:, None]
            low, high = (np.take_along_axis(cuts, place + side, axis=1) for side in (0, 1))
        return [float(each) for each in high[:, 0]]


def detection(solved: Solved, station: Station) -> Detection:
    """The time to notice the death of a station that lives so far."""
    chain = solved.chain
    attempt, mark = chain.attempt(station), chain.mark(station)
    tries, over = [], []
    for components, attempts in chain.by_attempts(chain.begun_exchange(station), station):
        replied, failed = np.zeros_like(attempt.over), np.eye(len(attempt.over))
        for left in range(attempts - 1, -1, -1):
            begun = components.times(failed)
            torn = sum(begun.times(matrix).total for _, _, matrix in attempt.torn)
            ends = begun.times(attempt.replied).total, begun.times(attempt.silent).total
            tries.append(Attempts(left, *ends, torn))
            replied, failed = replied + failed @ attempt.replied, failed @ attempt.failed
        over.append(components.then(Transitions.of([(0.0, 0, replied), (0.0, mark, failed)]), FLOOR))
    rest = chain.rest(over[0].mixed(*over[1:]), station, FLOOR)
    between = tuple(
        (attempts, part.total, part.distribution(chain.sums, part.total))
        for part, attempts in chain.by_attempts(rest, station)
        if part.total > 0
    )
    return Detection(solved, station, between, tuple(tries))
