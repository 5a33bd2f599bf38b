"""What a dead station costs against false station errors, for each D8179, at several levels of noise."""

from __future__ import annotations

from dataclasses import dataclass

from bussim.exact.link import TIMEOUT_UNIT, LinkModel
from bussim.exact.sizing.grid import evaluate
from bussim.exact.sizing.margin import FACTORS
from bussim.exact.sizing.noise_levels import LEVELS, with_level
from bussim.exact.sizing.size import Sizing
from bussim.exact.sizing.unmet_goals import scaled_noise
from bussim.plc.profiles import MAX_RETRIES, attempts_per_poll


@dataclass(frozen=True, slots=True)
class TradeOff:
    """Points of one link at one timeout (ticks).

    ``series`` has by the noise's name one (mean scan in ticks with a dead station, false station errors a
    year) for each D8179 of ``retries``; of settings with equal attempts only the lowest is among them.
    ``chosen_for`` is the noise under which the goals are checked.
    """

    timeout: int
    retries: tuple[int, ...]
    chosen_for: str
    series: dict[str, tuple[tuple[float, float], ...]]


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
    series = {}
    for name, noisy in _noises(model, assumed=assumed).items():
        grid = evaluate(noisy, lowest, (timeout,))
        series[name] = tuple(zip(grid.one_dead[:, 0].tolist(), grid.errors[:, 0].tolist(), strict=True))
    names = list(series)
    return TradeOff(timeout, tuple(lowest.values()), names[-1] if assumed else names[0], series)


def _noises(model: LinkModel, *, assumed: bool) -> dict[str, LinkModel]:
    if assumed:
        return {
            f"{name} (assumed): 1 bit in {1 / ber:,.0f} wrong": with_level(model, ber)
            for name, ber in LEVELS.items()
        }
    return {
        "noise as entered" if factor == 1 else f"{factor} times the noise": scaled_noise(model, factor)
        for factor in FACTORS
    }
