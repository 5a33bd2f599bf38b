"""The channel's state and what it does to frames.

Bursts are two-state chains in continuous time (Gilbert–Elliott); several of them together have a
product state. A frame's outcome is a matrix: entry (s, t) is the probability that the line is in t when
the frame ends and that the frame had this outcome, given s when it began. Without bursts there is one
state and the matrices are numbers. All entries are sums and products of positive numbers.

Times in ticks. A bit's error probability is taken from the state at its end instead of its centre.
"""

from collections.abc import Sequence
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bussim.exact.bursts.reading import read
from bussim.exact.link import LineNoise, NoiseSource, Station
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

    The outcomes of :class:`bussim.exact.bursts.reading.Reading`, each split by whether the listener had the
    reply undamaged, then not; all in the former where that was not asked for.
    """

    clean: tuple[Matrix, Matrix]
    torn: tuple[Matrix, Matrix]
    shifted: tuple[Matrix, Matrix]
    headless: tuple[Matrix, Matrix]
    ends: Matrix


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
        if key not in self._outcomes:
            (clean, _), (_, hit) = self.shared(sources, (), (), bits)
            self._outcomes[key] = FrameOutcome(clean, hit)
        return self._outcomes[key]

    def reply(
        self,
        wire: Sequence[NoiseSource],
        master: Sequence[NoiseSource],
        listener: Sequence[NoiseSource] | None,
        characters: int,
        *,
        zeros: bool = True,
    ) -> ReplyOutcome:
        """What becomes of a reply in the master and in a listener (None: whatever it hears)."""
        sources = tuple(wire), tuple(master), None if listener is None else tuple(listener)
        return _reply(self.noise.chains, self.bit, *sources, characters, zeros=zeros)

    def shared(
        self, wire: Sequence[NoiseSource], one: Sequence[NoiseSource], other: Sequence[NoiseSource], bits: int
    ) -> list[list[Matrix]]:
        """What becomes of so many bits in two receivers: by whether one has them hit, then the other."""
        s = self.states
        walk = np.zeros((4 * s, 4 * s))
        for old in range(4):
            for new, step in enumerate(self.bit_errors(wire, one, other)):
                rows, columns = slice(old * s, old * s + s), slice((old | new) * s, (old | new) * s + s)
                walk[rows, columns] += step
        power = _power(walk, bits)
        return [[power[:s, (2 * i + j) * s : (2 * i + j + 1) * s] for j in (0, 1)] for i in (0, 1)]

    def bit_errors(
        self, wire: Sequence[NoiseSource], one: Sequence[NoiseSource], other: Sequence[NoiseSource]
    ) -> tuple[Matrix, Matrix, Matrix, Matrix]:
        """From one bit to the next, where it is right in two receivers, hit in the other, one or both."""
        c, m, r = (self.error_rates(sources) for sources in (wire, one, other))
        step = self.after(self.bit)
        return (
            step * ((1 - c) * (1 - m) * (1 - r) + c * m * r),
            step * ((1 - c) * (1 - m) * r + c * m * (1 - r)),
            step * ((1 - c) * m * (1 - r) + c * (1 - m) * r),
            step * ((1 - c) * m * r + c * (1 - m) * (1 - r)),
        )


@lru_cache(maxsize=1024)
def _reply(
    chains: tuple[tuple[float, float], ...],
    bit: float,
    wire: tuple[NoiseSource, ...],
    master: tuple[NoiseSource, ...],
    listener: tuple[NoiseSource, ...] | None,
    characters: int,
    *,
    zeros: bool,
) -> ReplyOutcome:
    line = Line(LineNoise((), chains), bit)
    right, in_listener, in_master, in_both = line.bit_errors(wire, master, listener or ())
    s, nothing = line.states, np.zeros_like(right)
    kept, hit = right + in_listener, in_master + in_both
    if listener is None:
        found = read(kept, hit, characters, zeros=zeros)
        clean, torn, shifted, headless = ((matrix, nothing) for matrix in found[:4])
        return ReplyOutcome(clean, torn, shifted, headless, found.ends)
    # With the state goes whether the listener was hit.
    found = read(
        np.block([[right, in_listener], [nothing, kept]]),
        np.block([[in_master, in_both], [nothing, hit]]),
        characters,
        zeros=zeros,
    )
    clean, torn, shifted, headless = ((matrix[:s, :s], matrix[:s, s:]) for matrix in found[:4])
    return ReplyOutcome(clean, torn, shifted, headless, found.ends[:s])


def _power(walk: Matrix, steps: int) -> Matrix:
    power = np.linalg.matrix_power(walk, steps)
    # Rows add up to 1; rounding must not wear them down over a thousand bits.
    return np.asarray(power / power.sum(axis=1, keepdims=True), dtype=np.float64)


def _two_state(good: float, bad: float, ticks: Matrix) -> Matrix:
    moved = -np.expm1(-ticks * (1 / good + 1 / bad))
    to_bad, to_good = moved * bad / (good + bad), moved * good / (good + bad)
    rows = (np.stack((1 - to_bad, to_bad), axis=-1), np.stack((to_good, 1 - to_good), axis=-1))
    return np.stack(rows, axis=-2)
