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

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bussim.exact.bursts.exchange import Attempt, alike, attempts_at, different, line_of, sums_of
from bussim.exact.link import LinkModel, Station
from bussim.exact.scan.turnaround_sums import Floats

Stack = NDArray[np.float64]  # (state before, state after, choice of dead stations, timeout)


def _dot(one: Stack, other: Stack) -> Stack:
    if other.shape[1] == 1:
        return np.asarray(one * other)
    return np.asarray(np.einsum("ij...,jk...->ik...", one, other))


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
        return cls(matrix, matrix * mean, matrix * (mean * mean + variance))

    def then(self, other: _Timed) -> _Timed:
        """This, then the other, the times independent given the states."""
        return _Timed(
            _dot(self.zero, other.zero),
            _dot(self.one, other.zero) + _dot(self.zero, other.one),
            _dot(self.two, other.zero) + 2 * _dot(self.one, other.one) + _dot(self.zero, other.two),
        )

    def scaled(self, share: Floats) -> _Timed:
        """The same with a part of the probability, by choice and timeout."""
        return _Timed(self.zero * share, self.one * share, self.two * share)

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
        """The same with a part of the probability, as :meth:`_Timed.scaled`."""
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
        self.zero = np.zeros((self.line.states, self.line.states, 1, tau.size))
        self._attempts: dict[object, Attempt] = {}
        self._exchanges: dict[tuple[object, int], _Exchange] = {}

    def attempt(self, station: Station) -> Attempt:
        """The ends of an attempt; equal stations share theirs."""
        kind = alike(self.model, station)
        if kind not in self._attempts:
            replied, silent, torn, over = attempts_at(self.line, self.model, station, self.tau)
            ends = tuple((later, code, _stack(matrix)) for later, code, matrix in torn)
            self._attempts[kind] = Attempt(_stack(replied), _stack(silent), ends, over)
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
        after = self.line.after(ticks)[..., None, None]
        return _Timed.lasting(after + self.zero, np.full(self.tau.size, float(ticks)))


def _stack(matrices: NDArray[np.float64]) -> Stack:
    return np.ascontiguousarray(np.moveaxis(matrices, 0, -1)[:, :, None])


class Scans:
    """The scans with one number of attempts. Figures by choice and timeout, times in ticks.

    Each of the ``choices`` are stations (numbers) that are dead as well.
    """

    def __init__(
        self, stacks: TimeoutStacks, attempts: int, choices: Sequence[Sequence[int]] = ((),)
    ) -> None:
        self.stacks = stacks
        self.model = model = stacks.model.with_setting(attempts, 0)
        self._short = stacks.fixed(model.overhead + model.gap)
        self._long = stacks.fixed(model.overhead + model.gap + model.parameters_cost)
        self._data, nothing = stacks.fixed(model.data), stacks.zero[:1]
        self._none = _Timed(nothing, nothing, nothing)
        self._different = different(model)
        # By how many attempts a station has, in which share of the scans.
        self._shares: list[list[tuple[int, Floats]]] = [
            [(model.attempts_at(flagged=not station.alive), np.ones(1))] for station in model.stations
        ]
        self._ends = self._mixed(choices)
        if model.absent.probes:
            errors = self.fails[0]
            for station, share in zip(model.alive, errors, strict=True):
                self._shares[model.stations.index(station)] = [(attempts, 1 - share), (1, share)]
            self._ends = self._mixed(choices)

    def _mixed(self, choices: Sequence[Sequence[int]]) -> list[_Exchange]:
        """The exchanges with all stations, by how many attempts they have and where they are dead."""
        found = []
        for station, shares in zip(self.model.stations, self._shares, strict=True):
            parts = [(station, attempts, share) for attempts, share in shares]
            dead = np.array([[float(station.number in choice)] for choice in choices])
            if dead.any():
                parts = [(station, attempts, share * (1 - dead)) for _, attempts, share in parts]
                silent = replace(station, alive=False, hears=False)
                parts.append((silent, self.model.attempts_at(flagged=True), dead))
            first, *others = (self.stacks.exchange(s, attempts).scaled(share) for s, attempts, share in parts)
            for other in others:
                first = _Exchange(first.replied + other.replied, first.error + other.error)
            found.append(first)
        return found

    def _scan(self) -> Stack:
        clean, marked = self._reached[-1]
        return _dot(clean, self._short.zero) + _dot(marked, self._long.zero)

    @property
    def _reached(self) -> list[tuple[Stack, Stack]]:
        """From a scan's start to each exchange's and to the last one's end, without and after an error."""
        found = [(self._data.zero, self.stacks.zero)]
        for replied, error in self._ends:
            clean, marked = found[-1]
            bad = _dot(marked, replied.zero) + _dot(clean + marked, error.zero)
            found.append((_dot(clean, replied.zero), bad))
        return found

    @property
    def _left(self) -> list[tuple[Stack, Stack]]:
        """From each exchange's end to the scan's, without and after an error up to there."""
        found = [(self._short.zero, self._long.zero)]
        for replied, error in self._ends[:0:-1]:
            clean, marked = found[-1]
            failed = _dot(error.zero, marked)
            found.append((_dot(replied.zero, clean) + failed, _dot(replied.zero, marked) + failed))
        return found[::-1]

    def _begun(self) -> _Timed:
        """Stationary weights at the end of the master's data frame, its time behind them."""
        start = _stationary(self._scan())
        return _Timed(start, self._none.zero, self._none.zero).then(self._data)

    @property
    def mean(self) -> Floats:
        """The mean scan."""
        good, bad = _carried(self._begun(), self._none, self._ends)
        scan = good.then(self._short) + bad.then(self._long)
        return np.asarray(scan.one.sum(axis=(0, 1)), dtype=np.float64)

    # -- stations' flags ---------------------------------------------------------------------------

    @cached_property
    def fails(self) -> tuple[Floats, Floats]:
        """The chances of each living station that it is in error, and that its error begins.

        By station, choice and timeout. Its flag is followed together with the line's state.
        """
        stations = self.model.stations
        reached, left = self._reached, self._left
        known = {
            kind: self._fails(station, *reached[(at := stations.index(station))], *left[at])
            for kind, station in self._different.items()
        }
        each = [known.get(alike(self.model, s)) or known[s.number] for s in self.model.alive]
        if not each:
            return (np.zeros((0, 1, self.stacks.tau.size)),) * 2
        errors, onsets = np.moveaxis(np.minimum(np.array(each), 1.0), 1, 0)
        return errors, onsets

    def _fails(
        self, station: Station, clean: Stack, marked: Stack, end_clean: Stack, end_marked: Stack
    ) -> tuple[Floats, Floats]:
        """The same of one station, whose exchange lies between these transitions."""
        states, model, rows = self.stacks.line.states, self.model, []
        for flagged in (False, True):
            # Alive, also in the choices in which it is dead: it stands for all of its kind.
            replied, error = self.stacks.exchange(station, model.attempts_at(flagged=flagged))
            good = _dot(_dot(clean, replied.zero), end_clean) + _dot(_dot(marked, replied.zero), end_marked)
            bad = _dot(_dot(clean + marked, error.zero), end_marked)
            rows.append(np.concatenate((good, bad), axis=1))
        chain = np.concatenate(rows)
        both = _stationary(chain)
        onset = _dot(both[:, :states], chain[:states, states:]).sum(axis=(0, 1))
        again = _dot(both[:, states:], chain[states:, states:]).sum(axis=(0, 1))
        return np.asarray(onset + again, dtype=np.float64), np.asarray(onset, dtype=np.float64)

    # -- a station's death -------------------------------------------------------------------------

    def noticed(self, scan: Floats) -> Floats:
        """The mean time to notice a death, the longest of all living stations', by timeout.

        ``scan``: the mean scan; no other station is dead by choice.
        """
        return np.asarray(np.max([self.noticed_of(s, scan) for s in self._different.values()], axis=0))

    def noticed_of(self, station: Station, scan: Floats) -> Floats:
        """The mean time to notice a living station's death."""
        model, index = self.model, self.model.stations.index(station)
        good, bad = (part.still() for part in _carried(self._begun(), self._none, self._ends[:index]))
        replied, error = (end.still() for end in self._ends[index])
        attempt, tries, both = self.stacks.attempt(station), [], good + bad
        for attempts, share in self._shares[index]:
            reached = both.scaled(share).zero
            for left in range(attempts - 1, -1, -1):
                torn = attempt.failed - attempt.silent
                ends = (_dot(reached, end) for end in (attempt.replied, attempt.silent, torn))
                tries.append(Attempts(left, *(end.sum(axis=(0, 1))[0] for end in ends)))
                reached = _dot(reached, attempt.failed)
        between = []
        for flagged, after in (
            (False, (good.then(replied), bad.then(replied))),
            (True, (self._none, both.then(error))),
        ):
            good, bad = _carried(*after, self._ends[index + 1 :])
            begun = (good.then(self._short) + bad.then(self._long)).then(self._data)
            good, bad = _carried(begun, self._none, self._ends[:index])
            rest = good + bad
            moments = (moment.sum(axis=(0, 1))[0] for moment in (rest.one, rest.two))
            between.append(Between(model.attempts_at(flagged=flagged), *moments))
        return mean_time(model, station, self.stacks.tau, scan, between, tries)


def _stationary(step: Stack) -> Stack:
    """The stationary distribution of each chain, as one row; rows add up to 1 but for rounding."""
    step = step / step.sum(axis=1, keepdims=True)
    size = step.shape[0]
    if size == 1:
        return np.ones_like(step)
    system = np.moveaxis(step, (1, 0), (-2, -1)) - np.eye(size)
    system[..., -1, :] = 1.0
    right = np.zeros((*system.shape[:-1], 1))
    right[..., -1, :] = 1.0
    distribution = np.moveaxis(np.maximum(np.linalg.solve(system, right), 0.0), (-1, -2), (0, 1))
    # Subtraction left errors near 1e-16; 64 steps of the chain wash them out of small weights.
    for _ in range(6):
        step = _dot(step, step)
    distribution = _dot(distribution, step)
    return np.asarray(distribution / distribution.sum(axis=1, keepdims=True), dtype=np.float64)
