"""Mean, mean square and chances of error of a link with bursts, for many timeouts at once.

The matrices of :mod:`bussim.exact.bursts.scan_chain` with a first axis for the timeouts, and with each the
first two moments of the time that passes. With the policy ``probe`` a station's flag is followed
exactly together with the line's state, while the other stations' flags are taken as off; what that
neglects is of the order of the chance that two stations are in error at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bussim.exact.bursts.exchange import attempts_at, line_of, poll_path, reply_path
from bussim.exact.link import MASTER, LinkModel, Station
from bussim.exact.scan.turnaround_sums import Floats, TurnaroundSums

Stack = NDArray[np.float64]  # (timeout, state, state)


class Moments(NamedTuple):
    """Of a scan, by timeout: mean in ticks, mean square in ticks², errors by living station and timeout.

    ``onsets`` are errors of stations that were not in error at the scan before.
    """

    mean: Floats
    square: Floats
    errors: Floats
    onsets: Floats


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
        return _Timed(
            self.zero @ other.zero,
            self.one @ other.zero + self.zero @ other.one,
            self.two @ other.zero + 2 * (self.one @ other.one) + self.zero @ other.two,
        )

    def __add__(self, other: _Timed) -> _Timed:
        return _Timed(self.zero + other.zero, self.one + other.one, self.two + other.two)


class _Exchange(NamedTuple):
    """The ends of an exchange and what is left after all its attempts but none more."""

    replied: _Timed
    error: _Timed


class BurstStacks:
    """One link for many timeouts (ticks) and any number of attempts; its own setting does not matter."""

    def __init__(self, model: LinkModel, tau: Floats) -> None:
        self.model, self.tau = model, tau
        self.line = line_of(model)
        self._attempts: dict[object, tuple[_Timed, _Timed]] = {}
        self._exchanges: dict[tuple[object, int], _Exchange] = {}

    def moments(self, attempts: int, dead: int | None = None) -> Moments:
        """The moments of a scan; with ``dead`` that station is dead (then no errors are worked out)."""
        model = self.model if dead is None else self.model.with_dead(dead)
        model = model.with_setting(attempts, 0)
        ends = [self.exchange(model, s, model.attempts_at(flagged=not s.alive)) for s in model.stations]
        plain = model.overhead + model.gap
        short, long = self._fixed(plain), self._fixed(plain + model.parameters_cost)
        data = self._fixed(model.data)
        # First the chain from scan to scan, for its stationary distribution; then the moments from it.
        clean, marked = data.zero, np.zeros_like(data.zero)
        before = []
        for replied, error in ends:
            before.append(clean + marked)
            clean, marked = clean @ replied.zero, marked @ replied.zero + before[-1] @ error.zero
        start = _stationary(clean @ short.zero + marked @ long.zero)
        zero = np.zeros((self.tau.size, 1, self.line.states))
        good, bad = _Timed(start[:, None, :], zero, zero).then(data), _Timed(zero, zero, zero)
        for replied, error in ends:
            good, bad = good.then(replied), bad.then(replied) + (good + bad).then(error)
        scan = good.then(short) + bad.then(long)
        counted = [] if dead is not None else [i for i, s in enumerate(model.stations) if s.alive]
        each = np.array([self._fails(model, index, ends, start, before[index]) for index in counted])
        errors, onsets = np.minimum(each, 1.0).reshape(len(counted), 2, self.tau.size).swapaxes(0, 1)
        return Moments(scan.one.sum(axis=(1, 2)), scan.two.sum(axis=(1, 2)), errors, onsets)

    # -- one exchange ------------------------------------------------------------------------------

    def exchange(self, model: LinkModel, station: Station, attempts: int) -> _Exchange:
        """The ends of an exchange of so many attempts; equal stations share theirs."""
        alike = (
            (
                station.loss,
                station.extra,
                station.reply,
                station.turnaround,
                poll_path(model, station.number),
                reply_path(model, station, MASTER),
            )
            if station.alive
            else None
        )
        found = self._exchanges.get((alike, attempts))
        if found is None:
            if alike not in self._attempts:
                self._attempts[alike] = self._attempt(model, station)
            replied, failed = self._attempts[alike]
            if attempts == 1:
                found = _Exchange(replied, failed)
            else:
                before = self.exchange(model, station, attempts - 1)
                found = _Exchange(before.replied + before.error.then(replied), before.error.then(failed))
            self._exchanges[alike, attempts] = found
        return found

    def _attempt(self, model: LinkModel, station: Station) -> tuple[_Timed, _Timed]:
        """An attempt with a reply, and one that fails."""
        replied, silent, torn = attempts_at(self.line, model, station, self.tau)
        wait = model.gap + model.poll + self.tau
        if not station.alive:
            return _Timed.lasting(replied, wait), _Timed.lasting(silent, wait)
        sums = TurnaroundSums([station.turnaround])
        variance = float(sums.variances(np.array([sums.unit(station.turnaround)]))[0])
        whole = np.full(self.tau.size, model.replied(station) + station.average - station.extra)
        failed = _Timed.lasting(silent, wait) + _Timed.lasting(torn, whole + model.quiet, variance)
        return _Timed.lasting(replied, whole, variance), failed

    def _fixed(self, ticks: float) -> _Timed:
        matrix = np.broadcast_to(self.line.after(ticks), (self.tau.size, self.line.states, self.line.states))
        return _Timed.lasting(matrix, np.full(self.tau.size, float(ticks)))

    # -- a station's flag --------------------------------------------------------------------------

    def _fails(
        self, model: LinkModel, index: int, ends: list[_Exchange], start: Floats, before: Stack
    ) -> tuple[Floats, Floats]:
        """The chances that a station is in error and that its error begins, by timeout.

        Its flag is followed together with the line's state.
        """
        probed = model.absent.probes
        flagged = self.exchange(model, model.stations[index], 1) if probed else ends[index]
        states = self.line.states
        chain = np.empty((self.tau.size, 2 * states, 2 * states))
        for flag, own in enumerate((ends[index], flagged)):
            for outcome in (0, 1):
                rows = slice(flag * states, (flag + 1) * states)
                columns = slice(outcome * states, (outcome + 1) * states)
                chain[:, rows, columns] = self._scan(
                    model, [*ends[:index], own, *ends[index + 1 :]], (index, outcome)
                )
        both = _stationary(chain)
        onset = np.einsum("ts,tsu,tuv->t", both[:, :states], before, ends[index].error.zero)
        if probed:
            return np.asarray(both[:, states:].sum(axis=1), dtype=np.float64), onset
        return np.einsum("ts,tsu,tuv->t", start, before, ends[index].error.zero), onset

    def _scan(self, model: LinkModel, ends: list[_Exchange], only: tuple[int, int]) -> Stack:
        """The states' transitions over a whole scan in which the exchange at an index had one outcome.

        ``only`` is the index and 0 for a reply, 1 for in error.
        """
        clean = self._fixed(model.data).zero
        marked = np.zeros_like(clean)
        for index, (replied, error) in enumerate(ends):
            good = replied.zero if (index, 1) != only else np.zeros_like(clean)
            bad = error.zero if (index, 0) != only else np.zeros_like(clean)
            clean, marked = clean @ good, marked @ good + (clean + marked) @ bad
        plain = model.overhead + model.gap
        return clean @ self._fixed(plain).zero + marked @ self._fixed(plain + model.parameters_cost).zero


def _stationary(step: Stack) -> Floats:
    """The stationary distribution of each chain of a stack, whose rows add up to 1 but for rounding."""
    step = step / step.sum(axis=2, keepdims=True)
    size = step.shape[1]
    system = np.swapaxes(step, 1, 2) - np.eye(size)
    system[:, -1] = 1.0
    right = np.zeros((step.shape[0], size, 1))
    right[:, -1] = 1.0
    distribution = np.maximum(np.linalg.solve(system, right)[..., 0], 0.0)
    # Subtraction left errors near 1e-16; a few steps of the chain wash them out of small weights.
    for _ in range(4):
        distribution = np.einsum("ts,tsu->tu", distribution, step)
    return np.asarray(distribution / distribution.sum(axis=1, keepdims=True), dtype=np.float64)
