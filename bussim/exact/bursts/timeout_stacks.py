"""Scans, stations' errors and detection of deaths for many timeouts at once.

The matrices of :mod:`bussim.exact.bursts.scan_chain` with a first axis for the timeouts, and with each the
first two moments of the time that passes. With the policy ``probe`` a station's flag is followed
exactly together with the line's state while the other stations' flags are taken as off; for all else the
flags are then taken as independent of the line's state and of each other. On a line without memory that
is exact; with bursts it neglects what is of the order of the chance that two stations are in error at once.

A death falls into an exchange with the station or between two of them, the longer they last the more
often. Between them it has all attempts of the next exchange before it. Within one it has the rest of the
attempt under way and those after it: an attempt that fails anyway takes as long as it would have, a
reply that is cut off fails its attempt two quiet characters later, or at the deadline if not even its first
character came out. After the death no attempt succeeds.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bussim.exact.bursts.exchange import Attempt, alike, attempts_at, different, line_of, sums_of
from bussim.exact.link import LinkModel, Station
from bussim.exact.scan.turnaround_sums import Floats

Stack = NDArray[np.float64]  # (timeout, state, state)


@dataclass(frozen=True, slots=True, eq=False)
class _Timed:
    """Matrices of something that takes time: its probability, times the time, times the time's square.

    With one row they are weights over the states.
    """

    zero: Stack
    one: Stack
    two: Stack

    @classmethod
    def lasting(cls, matrix: Stack, mean: Floats, variance: float = 0.0) -> _Timed:
        """Every entry takes a time of this mean (by timeout) and variance."""
        time = mean[:, None, None]
        return cls(matrix, matrix * time, matrix * (time * time + variance))

    def then(self, other: _Timed) -> _Timed:
        """This, then the other, the times independent given the states."""
        dot = np.matmul if other.zero.shape[-1] > 1 else np.multiply
        return _Timed(
            dot(self.zero, other.zero),
            dot(self.one, other.zero) + dot(self.zero, other.one),
            dot(self.two, other.zero) + 2 * dot(self.one, other.one) + dot(self.zero, other.two),
        )

    def scaled(self, share: Floats) -> _Timed:
        """The same with a part of the probability, by timeout."""
        part = share.reshape(-1, 1, 1)
        return _Timed(self.zero * part, self.one * part, self.two * part)

    def still(self) -> _Timed:
        """The same without the time that has passed."""
        return _Timed(self.zero, 0 * self.one, 0 * self.two)

    def __add__(self, other: _Timed) -> _Timed:
        return _Timed(self.zero + other.zero, self.one + other.one, self.two + other.two)


class _Exchange(NamedTuple):
    """The ends of an exchange: a reply, or the station in error."""

    replied: _Timed
    error: _Timed

    def scaled(self, share: Floats) -> _Exchange:
        """The same with a part of the probability, by timeout."""
        return _Exchange(self.replied.scaled(share), self.error.scaled(share))


def _carried(good: _Timed, bad: _Timed, exchanges: Iterable[_Exchange]) -> tuple[_Timed, _Timed]:
    """Scans without and with an error so far, after these exchanges."""
    for replied, error in exchanges:
        good, bad = good.then(replied), bad.then(replied) + (good + bad).then(error)
    return good, bad


class Attempts(NamedTuple):
    """How many attempts a scan there are on average after which ``left`` more may follow, by their ends."""

    left: int
    replied: Floats | float
    silent: Floats | float
    torn: Floats | float


class Between(NamedTuple):
    """Time between two exchanges a scan: mean and mean square in ticks, and the next one's attempts."""

    attempts: int
    mean: Floats | float
    square: Floats | float


def mean_time(
    model: LinkModel,
    station: Station,
    timeouts: Floats,
    scan: Floats | float,
    between: Iterable[Between],
    attempts: Iterable[Attempts],
) -> Floats:
    """The mean time from a station's death to its next error, in ticks by timeout; ``scan`` is the scan's."""
    sums, wait, character = sums_of(model), model.gap + model.poll + timeouts, model.character
    unit = np.array([sums.unit(station.turnaround)])
    heading = model.gap + model.poll + station.average + character  # up to the reply's second character
    heading_square = heading**2 + sums.variances(unit)[0]
    quiet = model.quiet + sums.torn_mean
    total = np.zeros(timeouts.shape)
    for following, mean, square in between:
        total += square / 2 + mean * following * wait
    for left, replied, silent, torn in attempts:
        after = left * wait
        total += silent * wait * (wait / 2 + after)
        cut = (station.reply - character) * (model.quiet + character / 2 + after)
        total += (replied + torn) * (heading * (wait + after) - heading_square / 2 + cut)
        total += torn * quiet * (quiet / 2 + after)
    return np.asarray(total / scan, dtype=np.float64)


class TimeoutStacks:
    """One link for many timeouts (ticks) and any number of attempts; its own setting does not matter."""

    def __init__(self, model: LinkModel, tau: Floats) -> None:
        self.model, self.tau = model, tau
        self.line = line_of(model)
        self.zero = np.zeros((tau.size, self.line.states, self.line.states))
        self._attempts: dict[object, Attempt] = {}
        self._exchanges: dict[tuple[object, int], _Exchange] = {}

    def attempt(self, station: Station) -> Attempt:
        """The ends of an attempt; equal stations share theirs."""
        kind = alike(self.model, station)
        if kind not in self._attempts:
            self._attempts[kind] = attempts_at(self.line, self.model, station, self.tau)
        return self._attempts[kind]

    def exchange(self, station: Station, attempts: int) -> _Exchange:
        """The ends of an exchange of so many attempts; equal stations share theirs."""
        key = alike(self.model, station), attempts
        if key not in self._exchanges:
            if attempts == 1:
                found = self._once(station)
            else:
                once, before = self.exchange(station, 1), self.exchange(station, attempts - 1)
                replied = before.replied + before.error.then(once.replied)
                found = _Exchange(replied, before.error.then(once.error))
            self._exchanges[key] = found
        return self._exchanges[key]

    def _once(self, station: Station) -> _Exchange:
        """An exchange of one attempt."""
        model, attempt, sums = self.model, self.attempt(station), sums_of(self.model)
        failed = _Timed.lasting(attempt.silent, model.gap + model.poll + self.tau)
        unit = np.array([sums.unit(station.turnaround)])
        variance = float(sums.variances(unit)[0])
        whole = np.full(self.tau.size, model.replied(station) + station.average - station.extra)
        for later, code, matrix in attempt.torn:
            mean, more = (float(figure(np.array([code]))[0]) for figure in (sums.means, sums.variances))
            failed += _Timed.lasting(matrix, whole + later + mean, variance + more)
        return _Exchange(_Timed.lasting(attempt.replied, whole, variance), failed)

    def fixed(self, ticks: float) -> _Timed:
        """A time in which nothing is decided."""
        return _Timed.lasting(self.line.after(ticks) + self.zero, np.full(self.tau.size, float(ticks)))


class Scans:
    """The scans with one number of attempts, some stations dead. Figures by timeout, times in ticks."""

    def __init__(self, stacks: TimeoutStacks, attempts: int, *dead: int) -> None:
        self.stacks = stacks
        self.model = model = stacks.model.with_dead(*dead).with_setting(attempts, 0)
        self._short = stacks.fixed(model.overhead + model.gap)
        self._long = stacks.fixed(model.overhead + model.gap + model.parameters_cost)
        self._data, nothing = stacks.fixed(model.data), stacks.zero[:, :1]
        self._none = _Timed(nothing, nothing, nothing)
        self._different = different(model)
        # By how many attempts a station has, in which share of the scans.
        self._shares: list[list[tuple[int, Floats]]] = [
            [(model.attempts_at(flagged=not station.alive), np.ones(1))] for station in model.stations
        ]
        self._ends = self._mixed()
        if model.absent.probes:
            errors = self.fails[0]
            for station, share in zip(model.alive, errors, strict=True):
                self._shares[model.stations.index(station)] = [(attempts, 1 - share), (1, share)]
            self._ends = self._mixed()

    def _mixed(self) -> list[_Exchange]:
        """The exchanges with all stations, by how many attempts they have."""
        found = []
        for station, shares in zip(self.model.stations, self._shares, strict=True):
            first, *others = (
                self.stacks.exchange(station, attempts).scaled(share) for attempts, share in shares
            )
            for other in others:
                first = _Exchange(first.replied + other.replied, first.error + other.error)
            found.append(first)
        return found

    def _scan(self, ends: list[_Exchange], only: tuple[int, int] | None = None) -> Stack:
        """The states' transitions over a scan; ``only``: where its exchange at an index had this end."""
        clean, marked = self._data.zero, self.stacks.zero
        for index, (replied, error) in enumerate(ends):
            good = replied.zero if (index, 1) != only else self.stacks.zero
            bad = error.zero if (index, 0) != only else self.stacks.zero
            clean, marked = clean @ good, marked @ good + (clean + marked) @ bad
        return np.asarray(clean @ self._short.zero + marked @ self._long.zero, dtype=np.float64)

    def _begun(self) -> _Timed:
        """Stationary weights at the end of the master's data frame, its time behind them."""
        start = _stationary(self._scan(self._ends))[:, None, :]
        return _Timed(start, self._none.zero, self._none.zero).then(self._data)

    @property
    def mean(self) -> Floats:
        """The mean scan."""
        good, bad = _carried(self._begun(), self._none, self._ends)
        scan = good.then(self._short) + bad.then(self._long)
        return np.asarray(scan.one.sum(axis=(1, 2)), dtype=np.float64)

    # -- stations' flags ---------------------------------------------------------------------------

    @cached_property
    def fails(self) -> tuple[Floats, Floats]:
        """The chances that each living station is in error, and that its error begins (station, timeout).

        Its flag is followed together with the line's state.
        """
        stations = self.model.stations
        known = {kind: self._fails(stations.index(station)) for kind, station in self._different.items()}
        each = [known.get(alike(self.model, s)) or known[s.number] for s in self.model.alive]
        errors, onsets = np.minimum(np.array(each), 1.0).reshape(-1, 2, self.stacks.tau.size).swapaxes(0, 1)
        return errors, onsets

    def _fails(self, index: int) -> tuple[Floats, Floats]:
        ends, states = self._ends, self.stacks.line.states
        flagged = self.stacks.exchange(self.model.stations[index], 1)
        chain = np.empty((self.stacks.tau.size, 2 * states, 2 * states))
        for flag, own in enumerate((ends[index], flagged if self.model.absent.probes else ends[index])):
            for end in (0, 1):
                rows, columns = (slice(part * states, (part + 1) * states) for part in (flag, end))
                chain[:, rows, columns] = self._scan([*ends[:index], own, *ends[index + 1 :]], (index, end))
        both = _stationary(chain)
        onset = (both[:, None, :states] @ chain[:, :states, states:]).sum(axis=(1, 2))
        again = (both[:, None, states:] @ chain[:, states:, states:]).sum(axis=(1, 2))
        return np.asarray(onset + again, dtype=np.float64), np.asarray(onset, dtype=np.float64)

    # -- a station's death -------------------------------------------------------------------------

    def noticed(self, scan: Floats) -> Floats:
        """The mean time to notice a death, the longest of all living stations'; ``scan``: the mean scan."""
        return np.asarray(np.max([self._noticed(s, scan) for s in self._different.values()], axis=0))

    def _noticed(self, station: Station, scan: Floats) -> Floats:
        model, index = self.model, self.model.stations.index(station)
        good, bad = (part.still() for part in _carried(self._begun(), self._none, self._ends[:index]))
        replied, error = (end.still() for end in self._ends[index])
        attempt, tries, both = self.stacks.attempt(station), [], good + bad
        for attempts, share in self._shares[index]:
            reached = both.scaled(share).zero
            for left in range(attempts - 1, -1, -1):
                torn = attempt.failed - attempt.silent
                ends = (reached @ end for end in (attempt.replied, attempt.silent, torn))
                tries.append(Attempts(left, *(end.sum(axis=(1, 2)) for end in ends)))
                reached = reached @ attempt.failed
        between = []
        for flagged, after in (
            (False, (good.then(replied), bad.then(replied))),
            (True, (self._none, both.then(error))),
        ):
            good, bad = _carried(*after, self._ends[index + 1 :])
            begun = (good.then(self._short) + bad.then(self._long)).then(self._data)
            good, bad = _carried(begun, self._none, self._ends[:index])
            rest = good + bad
            moments = rest.one.sum(axis=(1, 2)), rest.two.sum(axis=(1, 2))
            between.append(Between(model.attempts_at(flagged=flagged), *moments))
        return mean_time(model, station, self.stacks.tau, scan, between, tries)


def _stationary(step: Stack) -> Floats:
    """The stationary distribution of each chain of a stack, whose rows add up to 1 but for rounding."""
    step = step / step.sum(axis=2, keepdims=True)
    size = step.shape[1]
    if size == 1:
        return np.ones(step.shape[:2])
    system = np.swapaxes(step, 1, 2) - np.eye(size)
    system[:, -1] = 1.0
    right = np.zeros((step.shape[0], size, 1))
    right[:, -1] = 1.0
    distribution = np.maximum(np.linalg.solve(system, right)[..., 0], 0.0)
    # Subtraction left errors near 1e-16; 64 steps of the chain wash them out of small weights.
    for _ in range(6):
        step = step @ step
    distribution = (distribution[:, None, :] @ step)[:, 0]
    return np.asarray(distribution / distribution.sum(axis=1, keepdims=True), dtype=np.float64)
