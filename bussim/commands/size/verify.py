"""Does the simulation agree with the exact distribution? For ``bussim size --verify``."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from bussim.exact.from_scenario import from_scenario
from bussim.exact.metrics import Request, figures_of
from bussim.scenario import model
from bussim.sweep.intervals import student_t
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND
from bussim.wording import about, counted

if TYPE_CHECKING:
    from bussim.exact.link import LinkModel

#: Two-sided 99.9 %: with some tens of comparisons a false alarm stays rare.
_WIDTH = 3.29
#: So many link scans are simulated, a few seconds' work.
_SCANS = 3_000
#: With fewer errors expected than this, that none were seen would say nothing about them.
_SEEN = 3.0
#: Scans are averaged in so many batches, so that neighbours that hang together do no harm.
_BATCHES = 40


@dataclass(frozen=True, slots=True)
class Verification:
    """One setting: exact figures beside simulated ones. Times in ms.

    ``half`` is half the width of the simulated mean's 99.9 % interval, or of the distribution's, if that
    is wider; ``errors`` are scans that left a station in error, ``allowed`` the range that the distribution
    gives them with 99.9 %. ``reason`` says why nothing was compared, empty where it was.
    """

    retries: int
    timeout: int
    scans: int = 0
    exact_mean: float = 0.0
    mean: float = 0.0
    half: float = 0.0
    expected_errors: float = 0.0
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
        return self.expected_errors >= _SEEN

    def in_words(self) -> str:
        """What was compared, and with what result."""
        setting = f"D8179 = {self.retries}, D8180 = {self.timeout // (10 * TICKS_PER_MS)}"
        if self.reason:
            return f"{setting}: nothing to compare a simulation with: {self.reason}"
        low, high = self.allowed
        sign = "agrees" if self.agrees else "DISAGREES"
        expected = about(self.expected_errors)
        seen = counted(self.errors, "false station error")
        errors = f"{seen} (exact {expected}, within {low} to {high})"
        if not self.about_errors:
            errors = (
                f"{seen}; hardly one is expected to be seen (exact {expected}), "
                "so that this says nothing about errors"
            )
        return (
            f"simulated {setting}, {counted(self.scans, 'scan')}: mean {self.mean:.3f} ± {self.half:.3f} ms "
            f"(exact {self.exact_mean:.3f}), {errors}: {sign}"
        )

    def to_json(self) -> dict[str, object]:
        """As plain data."""
        return {
            "D8179": self.retries,
            "D8180": self.timeout // (10 * TICKS_PER_MS),
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
    scenario: model.Scenario, bus: str, retries: int, timeout: int, loss: float | None
) -> model.Scenario:
    """One link of a scenario, without faults and with another D8179 and D8180 (``timeout`` in ticks).

    Other buses, the stations' other ports and their programs are left out: the link does not notice them.
    ``loss``, where given, replaces the noise: each reply of the link vanishes with that chance.
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
    if loss is not None:
        noise = (model.Noise("assumed", model.Target(bus), model.ReplyLoss(loss)),)
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


def verify(
    scenario: model.Scenario, bus: str, retries: int, timeout: int, loss: float | None
) -> Verification:
    """Simulate one link with a setting (``timeout`` in ticks) and compare it with its distribution."""
    from bussim import api

    changed = with_setting(scenario, bus, retries, timeout, loss)
    exact: LinkModel = from_scenario(changed)[bus]
    figures = figures_of(exact, Request(levels={}, refresh=False))
    if not figures.valid:
        return Verification(retries, timeout, reason="; ".join(figures.reasons))
    result = api.run(replace(changed, duration=round(_SCANS * (figures.mean or TICKS_PER_SECOND))))
    scans = result.link_scans
    times = scans.loc[scans["bus"] == bus, "duration_ms"].to_numpy()[1:]  # the first has the start-up in it
    mean, half = _mean_and_half(times.tolist())
    # A sample that saw few of the rare long scans knows their spread badly; the distribution knows it.
    half = max(half, _WIDTH * (figures.sd or 0.0) / TICKS_PER_MS / math.sqrt(max(len(times), 1)))
    errors = sum(result.summary["links"][bus]["station_errors"].values())
    expected = len(times) * sum(figures.error_per_scan.values())
    spread = _WIDTH * math.sqrt(max(expected, 1.0))
    # For rare errors the normal range is too narrow above: with an expectation of 0.01 one is no wonder.
    allowed = (max(0, math.floor(expected - spread)), math.ceil(expected + spread + 2))
    exact_mean = figures.mean / TICKS_PER_MS if figures.mean is not None else math.nan
    return Verification(retries, timeout, len(times), exact_mean, mean, half, expected, errors, allowed)


def _mean_and_half(times: list[float]) -> tuple[float, float]:
    """Mean, and half of its 99.9 % interval from batch means."""
    size = len(times) // _BATCHES
    if size < 1:
        return math.nan, math.inf
    batches = [math.fsum(times[i * size : (i + 1) * size]) / size for i in range(_BATCHES)]
    mean = math.fsum(batches) / _BATCHES
    variance = math.fsum((batch - mean) ** 2 for batch in batches) / (_BATCHES - 1)
    return mean, student_t(_BATCHES - 1, 0.999) * math.sqrt(variance / _BATCHES)
