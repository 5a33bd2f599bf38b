"""Components that carry weights over the channel's states, and what follows them as matrices.

A scan with bursts, and any chain of several scans, is built by letting one group of components follow
another: shifts and codes add, weights over the states are multiplied by matrices. The bits of a code
above its counts are *marks*: which flags are on, or (one bit for all) that some station was in error on
the way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bussim.exact.bursts.channel import Matrix
from bussim.exact.bursts.exchange import Attempt
from bussim.exact.scan.mixture import Distribution, merged
from bussim.exact.scan.turnaround_sums import COUNTS, Codes, Floats, TurnaroundSums

#: The lowest mark, above all counts of a code; there is room for one a slave.
MARK = 1 << COUNTS
_COUNTS = MARK - 1

#: More components than this are thinned: the heaviest are kept, the others put together in cells of at
#: least so many ticks (0.1 ms), or so many cells over the range. Only chains of many scans under
#: heavy noise come to that.
_MANY, _KEPT, _CELL, _CELLS = 1_500, 600, 7_200.0, 600


class Transitions(NamedTuple):
    """What may follow: shift in ticks, code, and a matrix (state before, state after) each."""

    shift: Floats
    code: Codes
    matrix: NDArray[np.float64]

    @classmethod
    def single(cls, shift: float, matrix: Matrix, code: int = 0) -> Transitions:
        """A single transition."""
        return cls(np.full(1, float(shift)), np.full(1, code, dtype=np.int64), matrix[None])

    @classmethod
    def of(cls, parts: Sequence[tuple[float, int, Matrix]]) -> Transitions:
        """Transitions from (shift, code, matrix); those that cannot happen are left out."""
        kept = [part for part in parts if part[2].max(initial=0.0) > 0.0] or list(parts[:1])
        shifts, codes, matrices = zip(*kept, strict=True)
        return cls(np.array(shifts, dtype=np.float64), np.array(codes, dtype=np.int64), np.stack(matrices))


@dataclass(slots=True, eq=False)
class StateMixture:
    """Components with weights (component, start, state): their probability for each start."""

    shift: Floats
    code: Codes
    weight: NDArray[np.float64]

    @classmethod
    def begin(cls, weight: NDArray[np.float64], shift: float = 0.0, marks: int = 0) -> StateMixture:
        """One component; ``weight`` has the axes (start, state)."""
        return cls(np.full(1, float(shift)), np.full(1, marks, dtype=np.int64), weight[None])

    @property
    def total(self) -> float:
        """All weight."""
        return float(self.weight.sum())

    def then(self, transitions: Transitions, floor: float) -> StateMixture:
        """These components followed by transitions; those lighter than ``floor`` are dropped."""
        states = transitions.matrix.shape[2]
        starts = self.weight.shape[1]
        before = self.weight.reshape(-1, self.weight.shape[2])
        after = before @ transitions.matrix.transpose(1, 0, 2).reshape(before.shape[1], -1)
        after = after.reshape(-1, starts, transitions.shift.size, states).swapaxes(1, 2)
        weight = after.reshape(-1, starts, states)
        # Column by column, as the rows are short.
        keep = np.nonzero(np.maximum.reduce([*weight.reshape(-1, starts * states).T]) >= floor)[0]
        i, j = np.divmod(keep, transitions.shift.size)
        one, two = self.code[i], transitions.code[j]
        code = ((one & _COUNTS) + (two & _COUNTS)) | ((one | two) & ~_COUNTS)
        return StateMixture(*merged(self.shift[i] + transitions.shift[j], code, weight[keep]))

    def times(self, matrix: Matrix, shift: float = 0.0) -> StateMixture:
        """These components followed by something that always happens."""
        return StateMixture(self.shift + shift, self.code, self.weight @ matrix)

    def mixed(self, *others: StateMixture) -> StateMixture:
        """These and other components together."""
        every = (self, *others)
        return StateMixture(
            *merged(
                np.concatenate([v.shift for v in every]),
                np.concatenate([v.code for v in every]),
                np.concatenate([v.weight for v in every]),
            )
        )

    def parted(self, marks: int = ~_COUNTS) -> tuple[StateMixture, StateMixture]:
        """The components without any of these marks, and those with one, which loses them."""
        on = (self.code & marks) != 0
        off = ~on
        return (
            StateMixture(self.shift[off], self.code[off], self.weight[off]),
            StateMixture(self.shift[on], self.code[on] & ~marks, self.weight[on]),
        )

    def thinned(self, sums: TurnaroundSums) -> StateMixture:
        """The same if there are not too many components; else the light ones are put together in cells.

        A cell is at least 0.1 ms wide and at most a small part of the range; its mean is kept, and the
        marks stay apart.
        """
        if self.shift.size <= _MANY:
            return self
        weight = self.weight.sum(axis=(1, 2))
        middle = self.shift + sums.means(self.code & _COUNTS)
        heavy = np.argpartition(weight, -_KEPT)[-_KEPT:]
        width = max(_CELL, float(np.ptp(middle)) / _CELLS)
        cell = np.floor(middle / width).astype(np.int64)
        cell[heavy] = -1 - np.arange(heavy.size)  # each alone
        marks = self.code & ~_COUNTS
        order = np.lexsort((-weight, marks, cell))
        cell, marks = cell[order], marks[order]
        new = np.ones(order.size, dtype=bool)
        new[1:] = (cell[1:] != cell[:-1]) | (marks[1:] != marks[:-1])
        starts = np.nonzero(new)[0]
        code = self.code[order][starts]  # the heaviest component's spreads stand for all
        means = np.add.reduceat((weight * middle)[order], starts) / np.add.reduceat(weight[order], starts)
        shift = means - sums.means(code & _COUNTS)
        return StateMixture(shift, code, np.add.reduceat(self.weight[order], starts, axis=0))

    def distribution(self, sums: TurnaroundSums, scale: float = 1.0) -> Distribution:
        """The distribution over all starts and states; weights are divided by ``scale``."""
        weight = self.weight.sum(axis=(1, 2)) / scale
        shift, code, weight = merged(self.shift, self.code & _COUNTS, weight)
        return Distribution(shift, code, weight, sums, max(0.0, 1.0 - float(weight.sum())))


#: What may happen, or has happened: ticks, code, matrix.
Part = tuple[float, int, Matrix]


def failures(kinds: Sequence[Part], most: int) -> list[list[Part]]:
    """Components after 0, 1, … ``most`` failed attempts, each of one of these kinds."""
    levels: list[list[Part]] = [[(0.0, 0, np.eye(kinds[0][2].shape[0]))]]
    for _ in range(most):
        found: dict[tuple[float, int], Matrix] = {}
        for ticks, code, matrix in levels[-1]:
            for more, spread, then in kinds:
                key = ticks + more, code + spread
                found[key] = found[key] + matrix @ then if key in found else matrix @ then
        levels.append([(*key, matrix) for key, matrix in found.items()])
    return levels


def exchange_transitions(
    attempt: Attempt, silent: float, whole: float, unit: int, attempts: int, mark: int
) -> Transitions:
    """The components of an exchange: failed attempts, then a reply, or an error after all of them.

    Times in ticks: ``silent`` of an attempt that runs to its deadline, ``whole`` of one with a reply
    without its spread (whose code is ``unit``). An error sets ``mark``.
    """
    torn = [(whole + later, unit + code, matrix) for later, code, matrix in attempt.torn]
    levels = failures([(silent, 0, attempt.silent), *torn], attempts)
    parts = [
        (shift + whole, code + unit, matrix @ attempt.replied)
        for level in levels[:-1]
        for shift, code, matrix in level
    ]
    parts += [(shift, code | mark, matrix @ attempt.over) for shift, code, matrix in levels[-1]]
    return Transitions.of(parts)
