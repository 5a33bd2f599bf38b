"""Exact intervals of a parameter from a count whose expectation rises with it.

Garwood's interval of a Poisson mean (Biometrika 28, 1936) and Clopper and Pearson's of a probability.
"""

from __future__ import annotations

from collections.abc import Callable

from bussim.live.fit.statistics import CONFIDENCE


def root(rising: Callable[[float], float], wanted: float, high: float) -> float:
    """The x in 0…``high`` at which a rising function has a value; an end of the range where it has not."""
    from scipy.optimize import brentq

    if rising(high) <= wanted:
        return high
    return (
        float(brentq(lambda x: rising(x) - wanted, 0.0, high, xtol=1e-15, rtol=1e-9)) if wanted > 0 else 0.0
    )


def poisson_mean(count: int) -> tuple[float, float]:
    """The interval of a Poisson mean; without events its upper end is one-sided."""
    from scipy.special import gammainccinv, gammaincinv

    tail = (1 - CONFIDENCE) / 2
    low = float(gammaincinv(count, tail)) if count else 0.0
    return low, float(gammainccinv(count + 1, tail if count else 2 * tail))
