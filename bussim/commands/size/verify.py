"""Does the simulation agree with the exact distribution? For ``bussim size --verify``.

A good setting has no false station error in the link scans that can be simulated while a user waits. So it is
simulated once more with the noise raised until errors are seen, and compared with the law at that noise: it
counts attempts and multiplies their chances there as it does at little noise.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass, replace
from statistics import fmean, variance
from typing import TYPE_CHECKING, assert_never

from bussim.exact.from_scenario import from_scenario
from bussim.exact.metrics import Figures, Request, figures_of
from bussim.exact.sizing.grid import evaluate
from bussim.exact.sizing.noise_levels import BAD, LEVELS, with_level
from bussim.scenario import fault_kinds, model
from bussim.sweep.intervals import student_t
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND
from bussim.wording import about
from bussim.words.language import say

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bussim.exact.link import LinkModel
    from bussim.exact.sizing.size import Sizing

#: Two-sided 99.99 %: of ten comparisons one in a thousand is a false alarm.
_CONFIDENCE, _WIDTH = 0.9999, 3.89
#: So many exchanges are simulated with retries, of which hardly one ends in an error, without, and at raised
#: noise, where each takes long; the first scans have the start-up in them.
_RETRIED, _ONCE, _RAISED, _FIRST = 2_000, 6_000, 1_500, 10
#: With fewer errors expected than this, that none were seen would say nothing about them; noise is raised
#: until so many are expected.
_SEEN, _WANTED = 3.0, 40.0
#: Scans are averaged in so many batches, so that neighbours that hang together do no harm.
_BATCHES = 40
#: By how many times noise is raised.
_TIMES = tuple(
    digit * 10.0**power for power in range(8) for digit in (1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
)


@dataclass(frozen=True, slots=True)
class Verification:
    """One setting: exact figures beside simulated ones. Times in ms.

    ``times`` is by how much the noise was raised. ``half`` is half the width of the simulated mean's 99.99 %
    interval, or of the distribution's, if that is wider; ``errors`` are scans that left a living station in
    error, ``allowed`` the range that the law gives them with 99.99 %, ``independent`` how many of those
    expected are so of each other. ``reason`` says why nothing was compared, empty where it was.
    """

    retries: int
    timeout: int
    times: float = 1.0
    scans: int = 0
    exact_mean: float = 0.0
    mean: float = 0.0
    half: float = 0.0
    expected_errors: float = 0.0
    independent: float = 0.0
    errors: int = 0
    allowed: tuple[int, int] = (0, 0)
    reason: str = ""

    @property
    def agrees(self) -> bool | None:
        """Whether the distribution lies within the simulation's intervals; None without a comparison."""
        if self.reason:
            return None
        low, high = self.allowed
        return abs(self.exact_mean - self.mean) <= self.half and low <= self.errors <= high

    @property
    def about_errors(self) -> bool:
        """Whether so many errors are expected that the check says something about them."""
        return self.independent >= _SEEN

    def in_words(self) -> str:
        """What was compared, and with what result."""
        units = self.timeout // (10 * TICKS_PER_MS)
        setting = say("verify_setting", retries=self.retries, units=units)
        if self.reason:
            return say("verify_nothing", setting=setting, reason=self.reason)
        low, high = self.allowed
        found = {"errors": self.errors, "expected": about(self.expected_errors)}
        errors = say("verify_few", **found)
        if self.about_errors:
            errors = say("verify_errors", **found, low=low, high=high)
        scans = say("verify_scans", scans=self.scans)
        if self.times > 1:
            scans = say("verify_raised", scans=self.scans, times=self.times)
        times = {"mean": self.mean, "half": self.half, "exact": self.exact_mean}
        sign = say("verify_agrees" if self.agrees else "verify_disagrees")
        return say("verify_said", setting=setting, scans=scans, errors=errors, sign=sign, **times)

    def to_json(self) -> dict[str, object]:
        """As plain data."""
        return {
            "D8179": self.retries,
            "D8180": self.timeout // (10 * TICKS_PER_MS),
            "times_the_noise": self.times,
            "scans": self.scans,
            "exact_mean_ms": round(self.exact_mean, 6),
            "simulated_mean_ms": round(self.mean, 6),
            "half_width_ms": round(self.half, 6),
            "expected_station_errors": self.expected_errors,
            "station_errors": self.errors,
            "allowed_station_errors": list(self.allowed),
            "about_errors": self.about_errors,
            "agrees": self.agrees,
            "reason": self.reason,
        }


def with_setting(
    scenario: model.Scenario, bus: str, retries: int, timeout: int, level: LinkModel | None = None
) -> model.Scenario:
    """One link of a scenario, without faults and with another D8179 and D8180 (``timeout`` in ticks).

    Other buses, the stations' other ports and their programs are left out: the link does not notice them.
    ``level``, where given, is the link with an assumed level of noise, which replaces the scenario's.
    """
    settings = {"D8179": retries, "D8180": timeout // (10 * TICKS_PER_MS)}
    plcs = tuple(
        replace(plc, ports=(), polls=(), program=None, observed=(), inputs={})
        for plc in scenario.plcs
        if plc.link is not None and plc.link.bus == bus
    )
    plcs = tuple(
        replace(plc, registers={**plc.registers, **settings}) if plc.registers.get("D8176", 0) == 0 else plc
        for plc in plcs
    )
    always = model.Window()
    noise = tuple(each for each in scenario.noise if each.window == always and each.target.bus == bus)
    if level is not None:
        sends = model.Target(bus, level.master, fault_kinds.Direction.TX)
        noise = (
            model.Noise("assumed", sends, model.BitErrors(level.noise.sources[0].good)),
            model.Noise("assumed loss", model.Target(bus), model.ReplyLoss(level.stations[0].loss)),
        )
    here = {plc.name for plc in plcs}
    faults = tuple(
        fault
        for fault in scenario.faults
        if fault.window == always and getattr(fault.kind, "node", None) in here
    )
    return replace(
        scenario,
        buses=tuple(each for each in scenario.buses if each.name == bus),
        plcs=plcs,
        devices=(),
        latency=(),
        noise=noise,
        faults=faults,
    )


def _raised(kind: model.NoiseKind, times: float) -> model.NoiseKind:
    """Noise with all its chances so many times as great, bit errors at most one in two."""
    match kind:
        case model.BitErrors(ber):
            return model.BitErrors(min(0.5, ber * times))
        case model.Impulse(ber=ber):
            return replace(kind, ber=min(0.5, ber * times))
        case model.Burst(_, _, good, bad):
            return replace(kind, ber_good=min(0.5, good * times), ber_bad=min(0.5, bad * times))
        case model.ReplyLoss(probability):
            return model.ReplyLoss(min(1.0, probability * times))
        case _:
            assert_never(kind)


def _noisier(scenario: model.Scenario, times: float) -> model.Scenario:
    return replace(
        scenario, noise=tuple(replace(each, kind=_raised(each.kind, times)) for each in scenario.noise)
    )


def verify(scenario: model.Scenario, bus: str, sizing: Sizing) -> list[Verification]:
    """Simulate the recommended setting of a link, one retry less and none, and compare each with its law.

    Where hardly an error is expected to be seen with the first, it is simulated at raised noise too.
    """
    found = []
    level = None if sizing.model.noisy else with_level(sizing.model, LEVELS[BAD])
    for retries, timeout in sizing.neighbours():
        changed, slaves = with_setting(scenario, bus, retries, timeout, level), len(sizing.model.stations)
        scans = (_RETRIED if retries else _ONCE) // slaves
        found.append(compare(changed, bus, Verification(retries, timeout), scans))
        if len(found) == 1 and not (found[0].reason or found[0].about_errors):
            scans = _RAISED // slaves
            times = _times_wanted(changed, bus, scans)
            if times is not None:
                setting = Verification(retries, timeout, times)
                found.append(compare(_noisier(changed, times), bus, setting, scans))
    return found


def _times_wanted(scenario: model.Scenario, bus: str, scans: int) -> float | None:
    """By how many times noise is raised for enough errors in so many scans; None where none is enough."""

    def expected(times: float) -> float:
        exact = from_scenario(_noisier(scenario, times))[bus]
        grid = evaluate(exact, (exact.attempts,), (exact.timeout,), details=False)
        return scans * float(grid.error_per_scan[0, 0])

    index = bisect_left(_TIMES, _WANTED, key=expected)
    return _TIMES[index] if index < len(_TIMES) else None


def compare(scenario: model.Scenario, bus: str, setting: Verification, scans: int) -> Verification:
    """Simulate so many scans of the link of a scenario, which has a setting, beside its law."""
    from bussim import api

    exact: LinkModel = from_scenario(scenario)[bus]
    figures = figures_of(exact, Request(levels={}, refresh=False))
    if not figures.valid:
        return replace(setting, reason=say("semicolon_list", texts=figures.reasons))
    rows = api.run(replace(scenario, duration=round(scans * (figures.mean or TICKS_PER_SECOND)))).link_scans
    rows = rows[rows["bus"] == bus][_FIRST:]
    count, factor = len(rows), _variance_factor(figures)
    mean, half, _ = _batches(rows["duration_ms"].tolist())
    # A sample that saw few of the rare long scans knows their spread badly; the distribution knows it.
    half = max(half, _WIDTH * (figures.sd or 0.0) / TICKS_PER_MS * math.sqrt(factor / max(count, 1)))
    _, many, errors = _batches((rows["stations_in_error"] - len(exact.dead)).tolist())
    expected = count * sum(figures.error_per_scan.values())
    spread = _WIDTH * math.sqrt(max(expected * factor, 1.0))
    if exact.noise.chains:  # several bursts may belong together
        spread = max(spread, many * count)
    return replace(
        setting,
        scans=count,
        exact_mean=math.nan if figures.mean is None else figures.mean / TICKS_PER_MS,
        mean=mean,
        half=half,
        expected_errors=expected,
        independent=expected / factor,
        errors=round(errors),
        # For rare errors the normal range is too narrow above: with an expectation of 0.01 one is no wonder.
        allowed=(max(0, math.floor(expected - spread)), math.ceil(expected + spread + 2)),
    )


def _variance_factor(figures: Figures) -> float:
    """How many errors come together: with bursts at all stations, and for as long as an error lasts.

    The variance of a count of errors is so many times that of independent ones; a length that is spread
    geometrically about a mean m has a mean square of m (2 m - 1).
    """
    if not figures.onsets_per_year or not figures.errors_per_year:
        return 1.0
    model = figures.model
    lasting = 2 * figures.errors_per_year / figures.onsets_per_year - 1
    return max(1.0, lasting) * (1 if model.noise.memoryless else len(model.alive))


def _batches(values: Sequence[float]) -> tuple[float, float, float]:
    """Mean, half of its 99.99 % interval from batch means, and sum."""
    size, total = len(values) // _BATCHES, math.fsum(values)
    if size < 1:
        return math.nan, math.inf, total
    batches = [fmean(values[i * size : (i + 1) * size]) for i in range(_BATCHES)]
    half = student_t(_BATCHES - 1, _CONFIDENCE) * math.sqrt(variance(batches) / _BATCHES)
    return fmean(batches), half, total
