"""What to assume where the noise is not known: levels of noise and outages, always shown as assumed.

A scenario without noise says nothing about retries: on a perfect line none would ever be needed. So
every number of retries is shown against three levels of noise, each the chance that one attempt
fails by silence, and three outages.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from bussim.exact.link import LinkModel
from bussim.exact.sizing.grid import evaluate
from bussim.exact.text import in_ms
from bussim.plc.profiles import MAX_RETRIES, attempts_per_poll
from bussim.units import TICKS_PER_MS

#: Chance that one attempt fails, by the level's name (assumed).
LEVELS = {"quiet": 1e-6, "typical": 1e-4, "bad": 1e-2}
BAD = "bad"
#: Outages in ticks (assumed), and the one that a recommendation must survive.
OUTAGES = tuple(ms * TICKS_PER_MS for ms in (20, 100, 300))
OUTAGE = OUTAGES[1]


@dataclass(frozen=True, slots=True)
class NoiseLevel:
    """One number of retries.

    ``dead``: mean scan with a dead station, ``ride``: ride-through, in ticks; ``errors``: false
    station errors a year by level; ``survived``: the outages (ticks) that raise no error.
    """

    retries: int
    attempts: int
    dead: float
    ride: float
    errors: dict[str, float]
    survived: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class NoiseLevels:
    """The table for one timeout (ticks)."""

    timeout: int
    rungs: tuple[NoiseLevel, ...]

    def to_json(self) -> dict[str, object]:
        """The table, times in ms."""
        return {
            "timeout_ms": self.timeout / TICKS_PER_MS,
            "attempt_fails": dict(LEVELS),
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


def with_failing(model: LinkModel, chance: float) -> LinkModel:
    """A link without noise, each attempt of which fails with this chance: the reply does not come."""
    stations = tuple(replace(station, loss=chance) for station in model.without_noise().stations)
    return replace(model.without_noise(), stations=stations)


def under_bad_noise(model: LinkModel) -> LinkModel:
    """The link under the level ``bad``."""
    return with_failing(model, LEVELS[BAD])


def noise_levels_of(model: LinkModel, timeout: int) -> NoiseLevels:
    """The noise levels of a link for one timeout in ticks, for D8179 0…10."""
    every = range(1, MAX_RETRIES + 2)
    clean = evaluate(model.without_noise(), every, (timeout,))
    grids = {
        name: evaluate(with_failing(model, chance), every, (timeout,), details=False)
        for name, chance in LEVELS.items()
    }
    rungs = []
    for retries in range(MAX_RETRIES + 1):
        attempts = attempts_per_poll(model.reading, retries)
        i, j = clean.at(attempts, timeout)
        ride = float(clean.silence[i, j])
        rungs.append(
            NoiseLevel(
                retries,
                attempts,
                float(clean.one_dead[i, j]),
                ride,
                {name: float(grid.errors_per_year[i, j]) for name, grid in grids.items()},
                tuple(outage for outage in OUTAGES if ride >= outage),
            )
        )
    return NoiseLevels(timeout, tuple(rungs))
