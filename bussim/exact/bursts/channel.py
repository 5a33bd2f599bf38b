"""The channel's state and what it does to frames.

Bursts are two-state chains in continuous time (Gilbert–Elliott); several of them together have a
product state. A frame's outcome is a matrix: entry (s, t) is the probability that the line is in t when
the frame ends and that the frame had this outcome, given s when it began. Without bursts there is one
state and the matrices are numbers. All entries are sums and products of positive numbers.

Times in ticks. A bit's error probability is taken from the state at its end instead of its centre.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bussim.exact.link import CHAR_BITS, LineNoise, NoiseSource, Station
from bussim.exact.scan.turnaround_sums import spread_of

Matrix = NDArray[np.float64]

#: Gauss–Legendre nodes over a uniform turnaround; e^(-rate × jitter) needs no more.
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(6)


class FrameOutcome(NamedTuple):
    """A frame's outcome in one receiver: whole and undamaged, or hit."""

    clean: Matrix
    hit: Matrix


class ReplyOutcome(NamedTuple):
    """A reply's outcome in the master and in a listener.

    ``clean``: undamaged; ``torn``: its first character undamaged, a later one hit; ``headless``: its
    first character hit. Each is split by whether the listener had it undamaged, then not.
    """

    clean: tuple[Matrix, Matrix]
    torn: tuple[Matrix, Matrix]
    headless: tuple[Matrix, Matrix]


class Line:
    """The matrices of one link's noise."""

    def __init__(self, noise: LineNoise, bit: float) -> None:
        self.noise = noise
        self.states = 1 << len(noise.chains)
        self.bit = bit
        self._after: dict[float, Matrix] = {}
        self._outcomes: dict[tuple[tuple[NoiseSource, ...], int], FrameOutcome] = {}

    # -- the chain ---------------------------------------------------------------------------------

    @cached_property
    def stationary(self) -> Matrix:
        """The state's distribution at a random instant."""
        distribution: Matrix = np.ones(1)
        for good, bad in self.noise.chains:
            distribution = np.asarray(
                np.kron(distribution, np.array([good, bad]) / (good + bad)), dtype=np.float64
            )
        return distribution

    def after(self, ticks: float) -> Matrix:
        """Transition probabilities over a time."""
        found = self._after.get(ticks)
        if found is None:
            found = self._after[ticks] = self.after_each(np.full(1, float(ticks)))[0]
        return found

    def after_each(self, ticks: Matrix) -> Matrix:
        """Transition probabilities over many times: (time, state, state)."""
        found = np.ones((ticks.size, 1, 1))
        for good, bad in self.noise.chains:
            step = _two_state(good, bad, ticks)
            found = np.einsum("tab,tcd->tacbd", found, step)
            found = found.reshape(ticks.size, 2 * found.shape[1], 2 * found.shape[1])
        return found

    def turnaround(self, station: Station) -> Matrix:
        """Transition probabilities over a station's turnaround, averaged over its distribution.

        The scan time's component and the state at the reply are thereby taken as independent given the
        state at the poll: wrong by at most jitter over shortest sojourn, relatively.
        """
        distribution = station.turnaround
        if self.states == 1:
            return np.ones((1, 1))
        least, width = spread_of(distribution)
        if distribution.values:
            total = sum(distribution.weights)
            parts = [
                (float(value + station.extra), weight / total)
                for value, weight in zip(distribution.values, distribution.weights, strict=True)
            ]
        else:
            parts = [
                (station.extra + least + width * (1 + node) / 2, weight / 2)
                for node, weight in zip(_NODES.tolist(), _WEIGHTS.tolist(), strict=True)
            ]
        return np.asarray(sum(weight * self.after(ticks) for ticks, weight in parts), dtype=np.float64)

    # -- bits --------------------------------------------------------------------------------------

    def error_rates(self, sources: Sequence[NoiseSource]) -> Matrix:
        """Probability, by state, that a bit is inverted; a bit inverted twice is right again."""
        rates = np.zeros(self.states)
        for source in sources:
            if source.chain is None:
                own = np.full(self.states, source.good)
            else:
                bit = len(self.noise.chains) - 1 - source.chain
                bad = (np.arange(self.states) >> bit) & 1
                own = np.where(bad == 1, source.bad, source.good)
            rates = rates + own - 2 * rates * own
        return rates

    def outcome(self, sources: Sequence[NoiseSource], bits: int) -> FrameOutcome:
        """What becomes of so many bits, one after the other, under these sources."""
        key = (tuple(sources), bits)
        found = self._outcomes.get(key)
        if found is None:
            found = self._outcomes[key] = self._outcome(self.error_rates(sources), bits)
        return found

    def _outcome(self, rates: Matrix, bits: int) -> FrameOutcome:
        if self.states == 1:
            log = bits * _log1m(float(rates[0]))
            return FrameOutcome(np.full((1, 1), np.exp(log)), np.full((1, 1), -np.expm1(log)))
        s, step = self.states, self.after(self.bit)
        walk = np.zeros((2 * s, 2 * s))
        walk[:s, :s] = step * (1 - rates)
        walk[:s, s:] = step * rates
        walk[s:, s:] = step
        power = _power(walk, bits)
        return FrameOutcome(power[:s, :s], power[:s, s:])

    def reply(
        self,
        wire: Sequence[NoiseSource],
        master: Sequence[NoiseSource],
        listener: Sequence[NoiseSource],
        bits: int,
    ) -> ReplyOutcome:
        """What becomes of a reply in the master and in a listener, with the noise that they share."""
        first = self._joint(wire, master, listener, CHAR_BITS)
        rest = self._joint(wire, master, listener, bits - CHAR_BITS)
        # Joint outcomes by (master hit, listener hit); rest of the frame after its first character.
        both = first[0][0] @ rest[0][0]
        only_master = first[0][0] @ rest[0][1] + first[0][1] @ (rest[0][0] + rest[0][1])
        torn_heard = first[0][0] @ rest[1][0]
        torn_missed = first[0][0] @ rest[1][1] + first[0][1] @ (rest[1][0] + rest[1][1])
        any_rest = rest[0][0] + rest[0][1] + rest[1][0] + rest[1][1]
        headless_heard = first[1][0] @ (rest[0][0] + rest[1][0])
        headless_missed = first[1][0] @ (rest[0][1] + rest[1][1]) + first[1][1] @ any_rest
        return ReplyOutcome((both, only_master), (torn_heard, torn_missed), (headless_heard, headless_missed))

    def _joint(
        self,
        wire: Sequence[NoiseSource],
        master: Sequence[NoiseSource],
        listener: Sequence[NoiseSource],
        bits: int,
    ) -> list[list[Matrix]]:
        """Outcomes of so many bits by (master hit, listener hit)."""
        if bits == 0:
            nothing, whole = np.zeros((self.states,) * 2), np.eye(self.states)
            return [[whole, nothing], [nothing, nothing]]
        c, m, r = (self.error_rates(sources) for sources in (wire, master, listener))
        fine = (1 - c) * (1 - m) * (1 - r) + c * m * r
        only_r = (1 - c) * (1 - m) * r + c * m * (1 - r)
        only_m = (1 - c) * m * (1 - r) + c * (1 - m) * r
        both = (1 - c) * m * r + c * (1 - m) * (1 - r)
        s, step = self.states, self.after(self.bit)
        walk = np.zeros((4 * s, 4 * s))
        hits = (fine, only_r, only_m, both)  # by the two bits (master, listener) of their index
        for old in range(4):
            for new, rates in enumerate(hits):
                rows, columns = slice(old * s, old * s + s), slice((old | new) * s, (old | new) * s + s)
                walk[rows, columns] += step * rates
        power = _power(walk, bits)
        return [[power[:s, (2 * i + j) * s : (2 * i + j + 1) * s] for j in (0, 1)] for i in (0, 1)]


def _power(walk: Matrix, steps: int) -> Matrix:
    power = np.linalg.matrix_power(walk, steps)
    # Rows add up to 1; rounding must not wear them down over a thousand bits.
    return np.asarray(power / power.sum(axis=1, keepdims=True), dtype=np.float64)


def _two_state(good: float, bad: float, ticks: Matrix) -> Matrix:
    moved = -np.expm1(-ticks * (1 / good + 1 / bad))
    to_bad, to_good = moved * bad / (good + bad), moved * good / (good + bad)
    rows = (np.stack((1 - to_bad, to_bad), axis=-1), np.stack((to_good, 1 - to_good), axis=-1))
    return np.stack(rows, axis=-2)


def _log1m(rate: float) -> float:
    return -np.inf if rate >= 1.0 else float(np.log1p(-rate))
