"""What outages do: how long a one goes unnoticed, how long a scan then takes."""

from itertools import combinations
from typing import NamedTuple

import numpy as np

from bussim.exact.bursts.timeout_stacks import Scans
from bussim.exact.link import LinkModel, Station
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


def longest_unnoticed(model: LinkModel, station: Station, timeouts: Floats) -> Floats:
    """The longest time from a station's death to its error on a line without errors, in ticks by timeout."""
    own = model.replied(station) - station.extra + station.slowest
    waits = model.attempts + model.attempts_at(flagged=True) * len(model.dead)
    fixed = clean_scan(model.with_setting(model.attempts, 0), slowest=True) - own
    return fixed + model.attempts * (model.gap + model.poll) + waits * timeouts


def dead_means(solved: Solved, count: int) -> float | None:
    """The mean scan, in ticks, with ``count`` more stations dead, those with which it is longest.

    Their flags are on already. None where not so many stations live.
    """
    model = solved.model
    alive = model.alive
    if len(alive) < count:
        return None
    choices = [tuple(station.number for station in chosen) for chosen in combinations(alive, count)]
    if model.absent.probes and not model.noise.memoryless:
        return max(Solved(model.with_dead(*dead)).distribution.mean for dead in choices)
    return float(Scans(solved.stacks, model.attempts, choices).mean.max())
