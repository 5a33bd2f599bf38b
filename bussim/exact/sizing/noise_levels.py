"""What to assume where the noise is not known: levels of noise and outages, always shown as assumed.

A scenario without noise says nothing about retries: on a perfect line none would ever be needed. So
every number of retries is shown against three levels of noise, each a bit error rate, and three outages.
A level costs time as silence does: every attempt that its bit errors damage runs to its deadline.
"""

import math
from dataclasses import dataclass, replace

from bussim.exact.bursts.exchange import reply_path
from bussim.exact.link import MASTER, LineNoise, LinkModel, NoiseSource
from bussim.exact.sizing.grid import evaluate, worst_of
from bussim.exact.text import in_ms
from bussim.plc.profiles import MAX_RETRIES, attempts_per_poll
from bussim.units import TICKS_PER_MS

#: Bit error rate by the level's name (assumed).
LEVELS = {"quiet": 1e-9, "typical": 1e-7, "bad": 1e-5}
TYPICAL, BAD = "typical", "bad"
#: Bit error rates in bursts about the one that causes most errors, eight a decade.
_BURSTS = tuple(10 ** (exponent / 8) for exponent in range(-27, -7))
#: Outages in ticks (assumed).
OUTAGES = tuple(ms * TICKS_PER_MS for ms in (20, 100, 300))


@dataclass(frozen=True, slots=True)
class NoiseLevel:
    """One number of retries.

    ``dead``: mean scan with a dead station at the level bad, ``ride``: ride-through, in ticks; ``errors``:
    false station errors a year by level; ``survived``: the outages (ticks) that raise no error.
    """

    retries: int
    attempts: int
    dead: float
    ride: float
    errors: dict[str, float]
    survived: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class NoiseLevels:
    """The table for one timeout (ticks); ``failing`` is by level the chance that an attempt fails."""

    timeout: int
    failing: dict[str, float]
    rungs: tuple[NoiseLevel, ...]

    def to_json(self) -> dict[str, object]:
        """The table, times in ms."""
        return {
            "timeout_ms": self.timeout / TICKS_PER_MS,
            "bit_error_rate": dict(LEVELS),
            "attempt_fails": self.failing,
            "outages_ms": [outage / TICKS_PER_MS for outage in OUTAGES],
            "rows": [
                {
                    "D8179": rung.retries,
                    "attempts": rung.attempts,
                    "one_dead_ms": in_ms(rung.dead),
                    "ride_through_ms": in_ms(rung.ride),
                    "false_errors_per_year": rung.errors,
                    "survives_ms": [outage / TICKS_PER_MS for outage in rung.survived],
                }
                for rung in self.rungs
            ],
        }


def scaled_noise(model: LinkModel, factor: float) -> LinkModel:
    """The same link with all bit error rates and losses times a factor.

    No loss is above 1 and no rate made higher than 1 in 2, at which a bit says nothing.
    """
    sources = tuple(
        replace(source, good=_scaled(source.good, factor, 0.5), bad=_scaled(source.bad, factor, 0.5))
        for source in model.noise.sources
    )
    return replace(
        model,
        noise=LineNoise(sources, model.noise.chains),
        stations=tuple(replace(s, loss=_scaled(s.loss, factor, 1.0)) for s in model.stations),
    )


def _scaled(chance: float, factor: float, most: float) -> float:
    return min(chance * factor, max(chance, most))


def weaker_bursts(model: LinkModel) -> tuple[LinkModel, ...]:
    """The same link with weaker bursts, as far as these may cause more station errors than the entered ones.

    Bit errors in bursts damage replies, which fails an attempt at once, and headers and polls, which fails it
    at the timeout, when a burst may be over. The more of them, the more of the latter: errors are most where
    nearly each reply in a burst is damaged, but hardly a header. All else stays as it was entered.
    """
    sources = model.noise.sources
    rate = max((max(s.good, s.bad) for s in sources if s.chain is not None), default=0.0)
    replies = {source for station in model.alive for source in reply_path(model, station, MASTER)}
    if all(source.chain is None for source in replies):
        return ()  # each failed attempt takes the whole timeout
    return tuple(
        replace(model, noise=LineNoise(tuple(_weaker(s, level / rate) for s in sources), model.noise.chains))
        for level in _BURSTS
        if level < rate
    )


def _weaker(source: NoiseSource, factor: float) -> NoiseSource:
    if source.chain is None:
        return source
    least = min(source.good, source.bad)
    return replace(
        source, good=_rounded(max(least, source.good * factor)), bad=_rounded(max(least, source.bad * factor))
    )


def _rounded(rate: float) -> float:
    """So that the same level of multiples of the same noise is the same value, worked out once."""
    return float(f"{rate:.9g}")


def failing(model: LinkModel, ber: float) -> float:
    """The chance that a bit error rate damages an attempt: its poll or its reply."""
    return _damaged(model.poll_bits + model.data_bits, ber)


def with_level(model: LinkModel, ber: float) -> LinkModel:
    """A link with a level of noise instead of its own: what it damages on the wire does not arrive at all.

    Replies are lost whole; what the master sends is damaged, its data frames too, which are not repeated.
    """
    loss = _damaged(model.data_bits, ber)
    return replace(
        model,
        noise=LineNoise((NoiseSource("tx", MASTER, ber),)),
        stations=tuple(replace(station, loss=loss) for station in model.stations),
    )


def _damaged(bits: int, ber: float) -> float:
    return -math.expm1(bits * math.log1p(-ber))


def noise_levels_of(model: LinkModel, timeout: int) -> NoiseLevels:
    """The noise levels of a link for one timeout in ticks, for D8179 0…10."""
    every = range(1, MAX_RETRIES + 2)
    grids = {
        name: worst_of(evaluate(with_level(line, ber), every, (timeout,)) for line in model.lines)
        for name, ber in LEVELS.items()
    }
    bad = grids[BAD]
    rungs = []
    for retries in range(MAX_RETRIES + 1):
        attempts = attempts_per_poll(model.reading, retries)
        i, j = bad.at(attempts, timeout)
        ride = float(bad.silence[i, j])
        rungs.append(
            NoiseLevel(
                retries,
                attempts,
                float(bad.one_dead[i, j]),
                ride,
                {name: float(grid.errors[i, j]) for name, grid in grids.items()},
                tuple(outage for outage in OUTAGES if ride >= outage),
            )
        )
    return NoiseLevels(timeout, {name: failing(model, ber) for name, ber in LEVELS.items()}, tuple(rungs))
