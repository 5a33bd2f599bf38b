"""The seed of every run of a sweep."""

from __future__ import annotations

import json
from collections.abc import Sequence
from hashlib import blake2b

from bussim.sweep.vary import Axis, Point

# 48 bits: spreadsheets keep 15 digits of a number, and a seed is there to be copied from one.
_BYTES = 6


def run_seed(
    base: int, axes: Sequence[Axis], point: Point, repeat: int, *, common_random_numbers: bool
) -> int:
    """The seed (0 <= seed < 2**48) of a repeat (from 1) at a point, of the scenario's seed ``base``.

    It depends on nothing else: not on the process, the number of workers, the order of the runs or
    the other points of the grid, so that a finer or longer sweep repeats the runs of a coarser one.
    Seeds of different points and repeats are independent, as far as a cryptographic hash is.

    With ``common_random_numbers`` the point is left out: every point has the same seeds. Then the
    difference between two points has a smaller variance than with independent seeds, since
    both meet the same noise; the points' own confidence intervals are valid one by one, but their
    errors are no longer independent of each other.
    """
    at = sorted([axis.key, value.same] for axis, value in zip(axes, point, strict=True))
    text = json.dumps([base, [] if common_random_numbers else at, repeat], ensure_ascii=True)
    return int.from_bytes(blake2b(text.encode("ascii"), digest_size=_BYTES).digest(), "big")
