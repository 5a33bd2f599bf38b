"""The distribution of one link scan on a line without memory (no bursts), in closed form.

All attempts are then independent. A station's exchange ends with a reply after i failed attempts with
probability p^i × a, and in error after all attempts with p^A, where p = silent + torn and a = 1 - p.
Stations with equal probabilities and times form a group, whose components are counted: how many of the
group replied, how many attempts failed in all, and how many of these ran to their deadline.

With the policy ``probe`` a station whose flag is on gets one attempt. Each station is then a chain of
two states from scan to scan, independent of the others; its stationary distribution weighs the two cases.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby
from typing import NamedTuple

import numpy as np

from bussim.exact.bursts.exchange import alike, attempt_at, line_of, sums_of
from bussim.exact.link import LinkModel, Station
from bussim.exact.scan.mixture import FLOOR, Distribution, merged
from bussim.exact.scan.turnaround_sums import COUNTS, Codes, Floats, TurnaroundSums, spread_of
from bussim.plc.profiles import AbsentStation

#: Above the counts of a code: where the timeouts waited for (at most 77) and a flag begin.
_WAITS = COUNTS
_FLAG = _WAITS + 7


class AttemptProbabilities(NamedTuple):
    """How one attempt at a station ends: the probabilities add up to 1."""

    replied: float
    silent: float
    torn: float

    @property
    def failed(self) -> float:
        """The probability that an attempt fails; the sum of both must not round to more than 1."""
        return min(1.0, self.silent + self.torn)


@dataclass(frozen=True, slots=True)
class Fails:
    """What an attempt's failing does to a station from scan to scan.

    ``error`` is the probability that it is in error at the end of a scan, ``onset`` that it is so
    and was not at the scan before, ``flagged`` that a scan finds its flag on and this matters
    (policy ``probe``).
    """

    error: float
    onset: float
    flagged: float

    @classmethod
    def of(cls, error: float, onset: float, flagged: float = 0.0) -> Fails:
        """The chances from sums that rounding may have lifted above 1, or the onset's above the error's."""
        error = min(1.0, error)
        return cls(error, min(onset, error), flagged)


def probabilities_of(model: LinkModel) -> tuple[AttemptProbabilities, ...]:
    """How one attempt at each station ends, in order. Raises ValueError for a line with bursts."""
    if not model.noise.memoryless:
        raise ValueError("on a link with bursts attempts differ in their probabilities")
    return _probabilities(model.with_setting(1, 0, 0))


@lru_cache(maxsize=64)
def _probabilities(model: LinkModel) -> tuple[AttemptProbabilities, ...]:
    line = line_of(model)
    known: dict[object, AttemptProbabilities] = {}
    for station in model.stations:
        replied, silent, torn, _ = attempt_at(line, model, station)
        ends = replied, silent, sum(matrix for _, _, matrix in torn) + 0 * silent
        known.setdefault(alike(model, station), AttemptProbabilities(*(float(end[0, 0]) for end in ends)))
    return tuple(known[alike(model, station)] for station in model.stations)


def fails_of(probabilities: AttemptProbabilities, attempts: int, absent: AbsentStation) -> Fails:
    """The stationary chances of a station whose attempts end so."""
    all_fail = probabilities.failed**attempts
    if not absent.probes:
        return Fails.of(all_fail, all_fail * _replied_once(probabilities, attempts))
    # On → on with p, off → on with p^A.
    flagged = all_fail / (probabilities.replied + all_fail)
    off = probabilities.replied / (probabilities.replied + all_fail)
    return Fails.of(flagged, off * all_fail, flagged)


def _replied_once(probabilities: AttemptProbabilities, attempts: int) -> float:
    """1 - p^A without cancellation, and never above 1 as a sum of powers of p may be."""
    replied = probabilities.replied
    return 1.0 if replied >= 1.0 else -math.expm1(attempts * math.log1p(-replied))


class ScanComponents(NamedTuple):
    """The components of a link scan, or of some of its stations, before its timeout is known.

    One entry a component: ``waits`` attempts ran to their deadline, ``fixed`` ticks come on top of these
    timeouts, ``code`` names the spreads, ``flagged``: whether some flag is on at the end (the
    parameter frame that this costs is in a scan's ``fixed``). ``lost`` is the weight of those dropped.
    """

    waits: Codes
    fixed: Floats
    code: Codes
    flagged: np.ndarray
    weight: Floats
    sums: TurnaroundSums
    lost: float = 0.0

    def distribution(self, timeout: int) -> Distribution:
        """The distribution for one timeout in ticks."""
        shift = self.fixed + self.waits * float(timeout)
        return Distribution(shift, self.code, self.weight, self.sums, self.lost)


def scan_components(model: LinkModel, floor: float = FLOOR) -> ScanComponents:
    """The components of a scan; those lighter than ``floor`` are dropped and counted in ``lost``."""
    sums = sums_of(model)
    parts = [_dead(model, len(model.dead), sums)] if model.dead else []
    pairs = [(s, p) for s, p in zip(model.stations, probabilities_of(model), strict=True) if s.alive]

    def same(pair: tuple[Station, AttemptProbabilities]) -> tuple[object, ...]:
        station, outcome = pair
        distribution = station.turnaround
        return outcome, spread_of(distribution)[0], station.extra, station.reply, sums.unit(distribution)

    for _, group in groupby(sorted(pairs, key=same), key=same):
        members = list(group)
        parts.append(_group(model, members[0][0], members[0][1], len(members), sums, floor))
    none = np.zeros(1, dtype=np.int64)
    total = ScanComponents(
        none, np.full(1, float(model.base)), none, np.zeros(1, dtype=bool), np.ones(1), sums
    )
    for part in parts:
        total = _combined(total, part, floor)
    fixed = total.fixed + np.where(total.flagged, float(model.parameters_cost), 0.0)
    return total._replace(fixed=fixed, lost=max(0.0, 1.0 - float(total.weight.sum())))


def _dead(model: LinkModel, count: int, sums: TurnaroundSums) -> ScanComponents:
    waits = count * model.attempts_at(flagged=True)
    return ScanComponents(
        np.full(1, waits, dtype=np.int64),
        np.full(1, float(waits * (model.gap + model.poll))),
        np.zeros(1, dtype=np.int64),
        np.ones(1, dtype=bool),
        np.ones(1),
        sums,
    )


def _combined(one: ScanComponents, two: ScanComponents, floor: float) -> ScanComponents:
    weight = (one.weight[:, None] * two.weight).reshape(-1)
    keep = np.nonzero(weight >= floor)[0]
    i, j = np.divmod(keep, two.weight.size)
    # Equal components become one; what distinguishes them but for the time goes into one number.
    flagged = (one.flagged[i] | two.flagged[j]).astype(np.int64)
    key = one.code[i] + two.code[j] + ((one.waits[i] + two.waits[j]) << _WAITS) + (flagged << _FLAG)
    fixed, key, weight = merged(one.fixed[i] + two.fixed[j], key, weight[keep])
    waits = (key >> _WAITS) & ((1 << _FLAG - _WAITS) - 1)
    code, flags = key & ((1 << _WAITS) - 1), (key >> _FLAG).astype(bool)
    return ScanComponents(waits, fixed, code, flags, weight, one.sums)


def _group(
    model: LinkModel,
    station: Station,
    probabilities: AttemptProbabilities,
    count: int,
    sums: TurnaroundSums,
    floor: float,
) -> ScanComponents:
    """The components of ``count`` stations like this one."""
    p = probabilities.failed
    flagged = fails_of(probabilities, model.attempts, model.absent).flagged
    table = _outcome_weights(count, model.attempts, flagged)
    fails = np.arange(table.shape[1])
    replied = np.arange(count + 1)
    weight = table * np.power(probabilities.replied, replied)[:, None] * np.power(p, fails)
    c, i = np.nonzero(weight >= floor)
    weight = weight[c, i]
    # Of i failed attempts, a ran to their deadline.
    sizes = i + 1
    row = np.repeat(np.arange(i.size), sizes)
    a = np.arange(row.size) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    c, i = c[row], i[row]
    b = i - a
    if p > 0:
        weight = (
            weight[row]
            * _pascal()[i, a]
            * np.power(probabilities.silent / p, a)
            * np.power(probabilities.torn / p, b)
        )
    else:
        weight = weight[row]
    keep = weight >= floor
    a, b, c, weight = a[keep], b[keep], c[keep], weight[keep]
    least = spread_of(station.turnaround)[0]
    whole = float(model.replied(station) + least)
    fixed = a * float(model.gap + model.poll) + b * (whole + model.quiet + sums.earliest) + c * whole
    code = (b + c) * sums.unit(station.turnaround) + b * sums.torn
    return ScanComponents(a, fixed, code, c < count, weight, sums)


@lru_cache(maxsize=512)
def _outcome_weights(count: int, attempts: int, flagged: float) -> Floats:
    """Entry (c, i): weight with which c of ``count`` stations replied, i attempts having failed in all.

    The factors of the single attempts are left out. ``flagged``: chance that a station has one attempt.
    """
    once = np.full(attempts, 1.0 - flagged)
    once[0] = 1.0
    error = np.zeros(attempts + 1)
    error[attempts] += 1.0 - flagged
    error[1] += flagged
    table = np.zeros((count + 1, count * attempts + 1))
    errors = [np.ones(1)]
    for _ in range(count):
        errors.append(np.convolve(errors[-1], error))
    replied = np.ones(1)
    for c in range(count + 1):
        row = np.convolve(replied, errors[count - c])[: table.shape[1]]
        table[c, : row.size] = row * float(_pascal()[count, c])
        replied = np.convolve(replied, once)
    table.setflags(write=False)
    return table


@lru_cache(maxsize=1)
def _pascal() -> Floats:
    """Binomial coefficients up to 127, relatively exact to rounding."""
    size = 128
    table = np.zeros((size, size))
    table[:, 0] = 1.0
    for n in range(1, size):
        table[n, 1 : n + 1] = table[n - 1, :n] + table[n - 1, 1 : n + 1]
    return table


def scan_distribution(model: LinkModel) -> Distribution:
    """The distribution of a scan on a line without memory."""
    return scan_components(model).distribution(model.timeout)
