"""What a dead station costs against false station errors, for each D8179, at several levels of noise."""

import math
from dataclasses import dataclass

import numpy as np

from bussim.exact.link import TIMEOUT_UNIT, LinkModel
from bussim.exact.sizing.grid import evaluate, worst_of
from bussim.exact.sizing.margin import FACTORS
from bussim.exact.sizing.noise_levels import LEVELS, scaled_noise, with_level
from bussim.exact.sizing.size import Sizing
from bussim.plc.profiles import MAX_RETRIES, attempts_per_poll
from bussim.words.language import say


@dataclass(frozen=True, slots=True)
class TradeOff:
    """Points of one link at one timeout (ticks).

    ``series`` has by the noise's name one (mean scan in ticks with a dead station, false station errors a
    year) for each D8179 of ``retries``; of settings with equal attempts only the lowest is among them.
    ``chosen_for`` is the noise under which the goals are checked, ``onsets`` how often a year an error begins
    there, ``rides`` the ride-throughs in ticks.
    """

    timeout: int
    retries: tuple[int, ...]
    chosen_for: str
    series: dict[str, tuple[tuple[float, float], ...]]
    onsets: tuple[float, ...]
    rides: tuple[float, ...]

    def riding_from(self, ride: int) -> float:
        """The scan with a dead station, in ticks, from which a ride-through is reached: between two dots."""
        times = [time for time, _ in self.series[self.chosen_for]]
        reached = [passed >= ride for passed in self.rides]
        first = reached.index(True) if any(reached) else len(times)
        if first == len(times):
            return math.inf
        return (times[max(0, first - 1)] + times[first]) / 2

    def errors_at(self, onsets: float) -> float:
        """The errors a year at which they begin so often, between two dots; 0 where they never are so few."""
        errors = [found for _, found in self.series[self.chosen_for]]
        some = [(math.log(o), math.log(e)) for o, e in zip(self.onsets, errors, strict=True) if o > 0 < e]
        if not some or math.log(onsets) < min(some)[0]:
            return 0.0
        x, y = zip(*sorted(some), strict=True)
        return float(math.exp(np.interp(math.log(onsets), x, y)))


def trade_off(sizing: Sizing) -> TradeOff:
    """The points of a link that can be sized, at the recommended timeout, else at the least one considered.

    The noise is the link's own and multiples of it; for a link without noise, the assumed levels.
    """
    model = sizing.model
    timeout = sizing.floor if sizing.recommended is None else sizing.recommended.timeout
    timeout = max(timeout, model.timeout_range[0] * TIMEOUT_UNIT)
    lowest: dict[int, int] = {}  # D8179 by the attempts that it means
    for retries in range(MAX_RETRIES + 1):
        lowest.setdefault(attempts_per_poll(model.reading, retries), retries)
    assumed = sizing.noise_levels is not None
    grids = {
        name: worst_of(evaluate(line, lowest, (timeout,)) for line in noisy.lines)
        for name, noisy in _noises(model, assumed=assumed).items()
    }
    chosen_for = list(grids)[-1 if assumed else 0]
    series = {
        name: tuple(zip(grid.one_dead[:, 0].tolist(), grid.errors[:, 0].tolist(), strict=True))
        for name, grid in grids.items()
    }
    onsets, rides = (
        tuple(each[:, 0].tolist()) for each in (grids[chosen_for].onsets, grids[chosen_for].silence)
    )
    return TradeOff(timeout, tuple(lowest.values()), chosen_for, series, onsets, rides)


def _noises(model: LinkModel, *, assumed: bool) -> dict[str, LinkModel]:
    if assumed:
        return {
            say("trade_level", name=name, bits=round(1 / ber)): with_level(model, ber)
            for name, ber in LEVELS.items()
        }
    return {
        say("margin_entered") if factor == 1 else say("trade_times", factor=factor): scaled_noise(
            model, factor
        )
        for factor in FACTORS
    }
