"""What outages do: how long a one goes unnoticed, how long a scan then takes, how soon it is noticed."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from bussim.exact.link import LinkModel, Station
from bussim.exact.scan.memoryless import mean_exchange, probabilities_of
from bussim.exact.scan.mixture import Distribution
from bussim.exact.scan.turnaround_sums import Floats
from bussim.exact.solve import Solved


class RideThrough(NamedTuple):
    """The longest disturbances, in ticks by timeout, that raise no station error whenever they begin.

    ``silence``: during it no reply arrives (a supply dip, a loose connector). ``corruption``: it
    damages frames as it likes, so that attempts end as soon as they can.
    """

    silence: Floats
    corruption: Floats


def ride_through(model: LinkModel, attempts: int, timeouts: Floats) -> RideThrough:
    """The ride-through for many timeouts (ticks), of the station where it is shortest.

    The worst moment to begin is just before the end of the first attempt's reply: that attempt fails
    two quiet characters later, and the master goes on at once. The disturbance must reach into the
    last attempt's poll to fail that one too. Between them lie all attempts but the first and the
    last, each of which takes a timeout in silence, and under corruption of replies perhaps only a
    damaged reply and two quiet characters. With one attempt any damaged frame is an error: 0.
    """
    if attempts < 2:
        return RideThrough(np.zeros(timeouts.size), np.zeros(timeouts.size))
    silent = model.gap + model.poll + timeouts
    torn = [model.replied(s) - s.extra + s.quickest + model.quiet for s in model.alive]
    until_next, between = model.quiet + model.gap, attempts - 2
    quickest = np.minimum(silent, min(torn, default=np.inf))
    return RideThrough(until_next + between * silent, until_next + between * quickest)


def clean_scan(model: LinkModel, *, slowest: bool) -> int:
    """Ticks of a scan without a failed attempt at the living stations, shortest or longest.

    Stations that are dead take all the attempts that a flagged station gets.
    """
    total = model.base + (model.parameters_cost if model.dead else 0)
    for station in model.stations:
        if station.alive:
            turnaround = station.slowest if slowest else station.quickest
            total += model.replied(station) - station.extra + turnaround
        else:
            total += model.attempts_at(flagged=True) * model.silent_cost
    return total


def longest_scan(model: LinkModel) -> int:
    """Ticks that no scan exceeds: every station silent, all attempts, and a parameter frame."""
    attempts = [
        model.attempts_at(flagged=True) if not station.alive else model.attempts for station in model.stations
    ]
    return model.base + sum(attempts) * model.silent_cost + (model.parameters_cost if attempts else 0)


@dataclass(frozen=True, slots=True)
class Detection:
    """The time from a station's death, at a random instant, to its flag in the master.

    ``mean`` and quantiles (by probability of exceeding) in ticks under the noise of the link;
    ``longest`` on a line without errors.
    """

    station: int
    mean: float
    longest: int
    quantiles: dict[float, float]


def detection(
    model: LinkModel, distribution: Distribution, station: Station, levels: tuple[float, ...] = ()
) -> Detection:
    """The time to detect that a station died; ``distribution`` is that of the link scan while it lives.

    It dies uniformly in time, so in a scan of length T with probability in proportion to T, and the
    instant is uniform over the scan, counted from the end of its last reply. If that is before its
    next reply began, all attempts run to their deadline; a reply that is cut off fails its attempt
    two quiet characters later (at the deadline if not even its first character came out). The
    turnaround within T is taken at its mean, and the scan as one with a reply to each first attempt.
    """
    attempts, wait = model.attempts, model.silent_cost
    slot = model.replied(station) + station.average - station.extra
    mean, square = distribution.mean, distribution.variance + distribution.mean**2
    average = detection_means(model, station, attempts, np.full(1, float(model.timeout)), mean, square)
    others = clean_scan(model, slowest=True) - (model.replied(station) - station.extra + station.slowest)
    return Detection(
        station.number,
        float(average[0]),
        others + attempts * wait,
        {level: _residual(distribution, level, station.reply) + attempts * wait - slot for level in levels},
    )


def detection_means(
    model: LinkModel, station: Station, attempts: int, timeouts: Floats, mean: ArrayLike, square: ArrayLike
) -> Floats:
    """The mean time of :func:`detection` for many timeouts, from the scan's mean and mean square."""
    mean, square = np.asarray(mean), np.asarray(square)
    wait, cut, character = model.gap + model.poll + timeouts, station.reply, model.character
    slot = model.replied(station) + station.average - station.extra
    before = (square - cut * cut) / 2 + (mean - cut) * (attempts * wait - slot)
    unseen = character * (timeouts - station.average - character / 2)
    torn = (cut - character) * (model.quiet + character / 2)
    return np.asarray((before + unseen + torn + cut * (attempts - 1) * wait) / mean, dtype=np.float64)


def _residual(distribution: Distribution, level: float, least: int) -> float:
    """What is left of the scan at a random instant and exceeded with a probability; at least ``least``."""
    mean = distribution.mean
    low, high = 0.0, distribution.support[1]
    while high - low > 1.0:
        cuts = np.linspace(low, high, 34)[1:-1]
        above = distribution.excess(cuts) > level * mean
        index = int(np.count_nonzero(above))
        low, high = (
            (float(cuts[index - 1]) if index else low),
            (float(cuts[index]) if index < cuts.size else high),
        )
    return max(high, float(least))


def dead_means(solved: Solved, count: int) -> float | None:
    """The mean scan, in ticks, with ``count`` more stations dead, those with which it is longest.

    Their flags are on already. None where not so many stations live.
    """
    model = solved.model
    alive = model.alive
    if len(alive) < count:
        return None
    choices = combinations(alive, count)
    if not model.noise.memoryless:
        numbers = [tuple(station.number for station in chosen) for chosen in choices]
        return max(Solved(model.with_dead(*chosen)).distribution.mean for chosen in numbers)
    means = {
        station: mean_exchange(model, station, probabilities)
        for station, probabilities in zip(model.stations, probabilities_of(model), strict=True)
    }
    total = sum(mean.fixed + mean.waits * model.timeout for mean in means.values())
    dead = model.attempts_at(flagged=True) * model.silent_cost
    gain = max(
        sum(dead - means[station].fixed - means[station].waits * model.timeout for station in chosen)
        for chosen in choices
    )
    return model.base + total + gain + model.parameters_cost
