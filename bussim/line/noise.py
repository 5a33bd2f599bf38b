"""Bit errors on a line: independent, in bursts, and by periodic impulses.

Each process says with which probability each bit of a frame is inverted. Whether a frame is hit at
all is drawn first, as one number against the exact probability; only a hit frame has its bits drawn.
Errors act on the bits of transmitted characters, start and stop bits included, at their
centres; the idle line has none. Times are ticks.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING

from bussim.line.random_streams import Streams, Uniforms

if TYPE_CHECKING:
    import numpy as np

#: Consecutive bits of a frame with one error probability: (number of bits, probability).
Run = tuple[int, float]
#: By more than rounding can make a chance differ that is worked out from other runs of the same bits.
_ROUNDED = 1 + 1e-12


class ConstantRate:
    """Every bit with the same probability."""

    def __init__(self, ber: float) -> None:
        self.ber = ber

    def runs(self, start: int, bits: int, bit: Fraction, begun: int | None = None) -> list[Run]:
        """Bits that are back to back, in order, as runs.

        ``start``: their first edge; ``bit``: ticks of a bit; ``begun``: the first edge of their frame, None
        if they are its first.
        """
        return [(bits, self.ber)]

    def at_most(self, starts: np.ndarray, bits: int, bit: Fraction) -> float:
        """How likely a hit is, at most, of each of some frames with so many bits (with these first edges)."""
        return hit_probability([(bits, self.ber)])


def _bits_before(tick: int, start: int, bit: Fraction) -> int:
    """How many bits of a frame have their centre before a tick (never negative)."""
    # Bit n's centre is start + (2n + 1) * bit / 2; count the n with centre < tick. In whole numbers,
    # because this is asked several times for every frame.
    ticks, parts = bit.numerator, bit.denominator
    return max(0, -((ticks - 2 * (tick - start) * parts) // (2 * ticks)))


class BurstRate:
    """Gilbert–Elliott: a good and a bad state with exponential sojourns, one probability in each.

    It begins in the stationary state. Frames must be asked for by non-decreasing start.
    """

    def __init__(self, good: int, bad: int, ber_good: float, ber_bad: float, draws: Iterator[float]) -> None:
        self._means = (good, bad)
        self._rates = (ber_good, ber_bad)
        self._draws = draws
        self._state = 1 if next(draws) * (good + bad) < bad else 0
        # Ticks at which the state changes, from some past one on; the state before the first.
        self._changes: list[int] = []
        self._horizon = 0

    def forget(self, tick: int) -> None:
        """No frame begins before a tick any more."""
        passed = bisect_right(self._changes, tick)
        if passed:
            del self._changes[:passed]
            self._state = (self._state + passed) & 1

    def at_most(self, starts: np.ndarray, bits: int, bit: Fraction) -> np.ndarray:
        """See :class:`ConstantRate`: a frame has all of its bits in the worst state that it meets."""
        import numpy as np

        over = math.ceil(bit * bits)
        self._extend(int(starts[-1]) + over)
        changes, state = np.array(self._changes), self._state
        first, last = (np.searchsorted(changes, at, side="right") for at in (starts, starts + over))
        chances = np.array([hit_probability([(bits, rate)]) for rate in self._rates])
        worst: np.ndarray = np.where(first == last, chances[(first + state) & 1], chances.max())
        return worst

    def _extend(self, tick: int) -> None:
        state = (self._state + len(self._changes)) & 1
        while self._horizon <= tick:
            sojourn = -self._means[state] * math.log1p(-next(self._draws))
            self._horizon += max(1, round(sojourn))
            self._changes.append(self._horizon)
            state ^= 1

    def runs(self, start: int, bits: int, bit: Fraction, begun: int | None = None) -> list[Run]:
        """See :class:`ConstantRate`."""
        self._extend(start + math.ceil(bit * bits))
        self.forget(start if begun is None else begun)
        changes = self._changes
        found: list[Run] = []
        state, done = self._state, 0
        for change in changes:
            upto = min(bits, _bits_before(change, start, bit))
            if upto > done:
                found.append((upto - done, self._rates[state]))
                done = upto
            if done == bits:
                return found
            state ^= 1
        found.append((bits - done, self._rates[state]))
        return found


class ImpulseRate:
    """Impulses of ``width`` ticks that begin every ``every`` ticks, the first at ``first``."""

    def __init__(self, every: int, width: int, ber: float, first: int) -> None:
        self._every, self._width, self._ber, self._first = every, width, ber, first

    def runs(self, start: int, bits: int, bit: Fraction, begun: int | None = None) -> list[Run]:
        """See :class:`ConstantRate`."""
        found: list[Run] = []
        done = 0
        number = max(0, (start - self._first) // self._every)
        while done < bits:
            begin = self._first + number * self._every
            before = min(bits, _bits_before(begin, start, bit))
            inside = min(bits, _bits_before(begin + self._width, start, bit))
            if before > done:
                found.append((before - done, 0.0))
                done = before
            if inside > done:
                found.append((inside - done, self._ber))
                done = inside
            number += 1
        return found

    def at_most(self, starts: np.ndarray, bits: int, bit: Fraction) -> np.ndarray:
        """See :class:`ConstantRate`: a frame that an impulse touches has all of its bits in impulses."""
        import numpy as np

        last = (starts + math.ceil(bit * bits) - self._first) // self._every  # that begins before its end
        over = self._first + last * self._every + self._width
        return np.where((last >= 0) & (over > starts), hit_probability([(bits, self._ber)]), 0.0)


#: How likely each bit of a frame is inverted.
ErrorRate = ConstantRate | BurstRate | ImpulseRate


class BitNoise:
    """One error process with its window and its random streams.

    Draws come from a stream of their own for each ``key`` (sender, kind and receiver of a frame), so that a
    frame more or less on the line changes no other frame's draws.
    """

    def __init__(
        self, name: str, rate: ErrorRate, streams: Streams, since: int = 0, until: int | None = None
    ) -> None:
        self._name = name
        self._rate = rate
        self._streams = streams
        self._since, self._until = since, until
        self._draws: dict[str, tuple[Uniforms, Uniforms]] = {}
        # The chance of a hit by number of bits, where it does not depend on the time.
        self._steady: dict[int, float] | None = (
            {} if isinstance(rate, ConstantRate) and since == 0 and until is None else None
        )

    def _draws_for(self, key: str) -> tuple[Uniforms, Uniforms]:
        draws = self._draws.get(key)
        if draws is None:
            draws = self._draws[key] = (
                self._streams.uniforms("noise", self._name, key),
                self._streams.uniforms("noise", self._name, key, "bits"),
            )
        return draws

    def edge(self, now: int) -> int | None:
        """When its window begins or ends next."""
        return next((at for at in (self._since, self._until) if at is not None and at > now), None)

    @property
    def varies(self) -> bool:
        """Whether the chance of a hit depends on when a frame is sent, within the window too."""
        return not isinstance(self._rate, ConstantRate)

    def calm(self, key: str, starts: np.ndarray, bits: int, bit: Fraction) -> int:
        """How many of the next frames with a key, from the first on, are surely not hit.

        They begin at ``starts`` (of a constant rate only the first counts) and meet no edge of the window.
        """
        most = len(starts)
        if not most:
            return 0
        if starts[0] < self._since or (self._until is not None and starts[0] >= self._until):
            return most
        chance, draws = self._rate.at_most(starts, bits, bit), self._draws_for(key)[0]
        if isinstance(chance, float):
            return draws.before(chance, most)
        hit = draws.ahead(most) < chance * _ROUNDED
        first = int(hit.argmax())
        return first if hit[first] else most

    def skip(self, key: str, count: int, now: int) -> None:
        """So many frames with a key were not hit; all frames from now on begin at ``now`` or later."""
        if isinstance(self._rate, BurstRate):
            self._rate.forget(now)
        if self._until is None or now < self._until:
            self._draws_for(key)[0].skip(count)

    def inverted(
        self, start: int, bits: int, bit: Fraction, key: str, pieces: Sequence[tuple[int, int]] = ()
    ) -> tuple[int, ...]:
        """The numbers of a frame's bits that are inverted, in order; usually none.

        ``pieces``, of a frame with pauses: the first edge and the number of the bits that are back to back.
        """
        if self._until is not None and start >= self._until:
            return ()
        draws = self._draws_for(key)
        steady = self._steady
        if steady is not None:
            chance = steady.get(bits)
            if chance is None:
                chance = steady[bits] = hit_probability(self._rate.runs(start, bits, bit))
            draw = next(draws[0])
            if draw >= chance:
                return ()
            return _errors(self._rate.runs(start, bits, bit), draw, draws[1])
        runs = [
            run
            for at, count in pieces or ((start, bits),)
            for run in self._clipped(self._rate.runs(at, count, bit, start), at, count, bit)
        ]
        draw = next(draws[0])
        return () if draw >= hit_probability(runs) else _errors(runs, draw, draws[1])

    def _clipped(self, runs: list[Run], start: int, bits: int, bit: Fraction) -> list[Run]:
        first = min(bits, _bits_before(self._since, start, bit))
        last = bits if self._until is None else min(bits, _bits_before(self._until, start, bit))
        if first == 0 and last == bits:
            return runs
        clipped: list[Run] = []
        at = 0
        for count, rate in runs:
            inside = max(0, min(at + count, last) - max(at, first))
            before = max(0, min(at + count, first) - at)
            clipped += [(before, 0.0), (inside, rate), (count - before - inside, 0.0)]
            at += count
        return [run for run in clipped if run[0]]


def _log_survival(count: int, rate: float) -> float:
    return -math.inf if rate >= 1.0 else count * math.log1p(-rate)


def hit_probability(runs: list[Run]) -> float:
    """The probability that at least one bit is inverted."""
    return 0.0 - math.expm1(sum(_log_survival(count, rate) for count, rate in runs if rate > 0.0))


def _errors(runs: list[Run], draw: float, draws: Iterator[float]) -> tuple[int, ...]:
    """The inverted bits of a frame that is hit; ``draw`` is below the chance of a hit.

    The first error is the first bit by which the probability of a hit so far exceeds ``draw``; all
    bits after it are independent again, and the distance to the next error is geometric.
    """
    found: list[int] = []
    wanted = math.log1p(-draw)  # the survival that the first error's bit falls below
    at, survived = 0, 0.0
    for count, rate in runs:
        if rate > 0.0:
            step = _log_survival(1, rate)
            bit = 0
            if not found:
                total = survived + count * step
                if total < wanted or math.isinf(step):
                    bit = 0 if math.isinf(step) else _first_below(survived, step, wanted, count)
                    found.append(at + bit)
                    bit += 1
                else:
                    survived = total
                    at += count
                    continue
            while bit < count:
                if not math.isinf(step):
                    bit += int(math.log1p(-next(draws)) / step)
                if bit < count:
                    found.append(at + bit)
                    bit += 1
        at += count
    return tuple(found)


def _first_below(survived: float, step: float, wanted: float, count: int) -> int:
    """The bit of a run by which the log survival falls below ``wanted`` (0…count-1)."""
    return min(count - 1, max(0, int((wanted - survived) / step)))
