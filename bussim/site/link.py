"""The law of a readout's link: what its scans cost and what its registers count, per scan.

All of it is :mod:`bussim.exact`'s link, made of a scenario that the readout describes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from bussim.exact.from_scenario import from_scenario
from bussim.exact.link import LineNoise, LinkModel, NoiseSource
from bussim.exact.scan.memoryless import AttemptProbabilities, fails_of, probabilities_of
from bussim.exact.scan.mixture import Distribution
from bussim.exact.solve import Solved
from bussim.plc.profiles import Attempts
from bussim.scenario.loader import from_data
from bussim.scenario.model import Scenario
from bussim.site.forms import Settings
from bussim.site.readout import Readout, SiteProfile
from bussim.units import TICKS_PER_MS, format_time

BUS = "link"


@dataclass(frozen=True, slots=True)
class SteadyNoise:
    """Noise without memory: bit error rates by place, and shares of replies that are lost.

    The keys of the mappings are station numbers, the master's 0.
    """

    wire: float = 0.0
    receivers: Mapping[int, float] = field(default_factory=dict)
    senders: Mapping[int, float] = field(default_factory=dict)
    lost: Mapping[int, float] = field(default_factory=dict)

    def applied(self, model: LinkModel) -> LinkModel:
        """The solver's link with it."""
        sides = (("rx", self.receivers), ("tx", self.senders))
        ends = [NoiseSource(side, k, ber) for side, each in sides for k, ber in each.items()]
        sources = tuple(each for each in (NoiseSource("bus", None, self.wire), *ends) if each.good > 0)
        stations = tuple(replace(s, loss=self.lost.get(s.number, 0.0)) for s in model.stations)
        return replace(model, noise=LineNoise(sources), stations=stations)

    def entries(self, names: Sequence[str]) -> list[dict[str, object]]:
        """The entries of a scenario's ``noise``; ``names`` are its PLCs by station number."""
        found: list[dict[str, object]] = [{"bus": BUS, "ber": self.wire}] if self.wire > 0 else []
        kinds: tuple[tuple[dict[str, object], str, Mapping[int, float]], ...] = (
            ({"direction": "rx"}, "ber", self.receivers),
            ({"direction": "tx"}, "ber", self.senders),
            ({}, "reply_loss", self.lost),
        )
        return found + [
            {"bus": BUS, "station": names[number], **side, key: value}
            for side, key, by_station in kinds
            for number, value in sorted(by_station.items())
            if value > 0
        ]


def plc_name(place: str, index: int) -> str:
    """The name of a scenario's PLC for a cabinet."""
    name = re.sub(r"[^\w-]+", "_", place).strip("_-")[:60]
    return name if re.search(r"[^\W\d_]", name) else f"station_{index}"


@dataclass(frozen=True)
class SiteLink:
    """One link on site. Times in ticks.

    ``attempts`` is what D8179 means; of a profile whose calibration left that open the caller takes both.
    ``shown`` is the least look at D8201, in its unit, None without any.
    """

    profile: SiteProfile
    settings: Settings
    names: tuple[str, ...]
    attempts: Attempts | None = None
    shown: int | None = None

    @classmethod
    def of(cls, readout: Readout, attempts: Attempts | None = None) -> SiteLink:
        """The link of a readout."""
        found = [(number, readout.at(number)) for number in range(readout.settings.slaves + 1)]
        names = [plc_name(station.place if station else "", number) for number, station in found]
        if len({*names}) < len(names):
            names = [f"{name}_{number}" for number, name in enumerate(names)]
        looks = [look for station in readout.stations for look in station.after.looks if look]
        return cls(readout.profile, readout.settings, tuple(names), attempts, min(looks, default=None))

    def scenario(self, noise: SteadyNoise) -> Scenario:
        """The link as a scenario, disturbed by some noise."""
        given, meaning = self.settings, self.attempts
        form = self.profile.form if meaning is None else {**self.profile.form, "attempts": meaning.value}
        plcs: list[dict[str, Any]] = []
        for number, name in enumerate(self.names):
            link = {"bus": BUS, "port": "COM4", "station": number}
            if not number:
                link |= {"slaves": given.slaves, "mode": given.mode, "retries": given.retries}
                link["timeout"] = format_time(given.timeout)
            plcs.append({"name": name, "profile": form, "nn": link})
        data = {"schema": 1, "name": "readout", "duration": "60 s", "plcs": plcs}
        data |= {"buses": [{"name": BUS, "nn": True}], "noise": noise.entries(self.names)}
        return from_data(data, name="readout")

    @cached_property
    def model(self) -> LinkModel:
        """The solver's link without any noise."""
        return from_scenario(self.scenario(SteadyNoise()), bound_end=True)[BUS]

    # -- times -------------------------------------------------------------------------------------

    @cached_property
    def healthy(self) -> float:
        """The mean of a scan without failed attempts; what was seen, where that is less than the law has."""
        return self.lawful if self.fits else float(self.shown or 0) * self.model.unit

    @cached_property
    def lawful(self) -> float:
        """The same by the profile; where replies wait for END, the longest."""
        model = self.model
        return model.base + sum(model.replied(station) + station.average for station in model.stations)

    @property
    def fits(self) -> bool:
        """Whether no scan was seen that is shorter than the law allows."""
        return self.shown is None or self.shown >= self.units(self.lawful) - 2

    @property
    def slot(self) -> float:
        """A slave's exchange with one attempt."""
        station = self.model.stations[0]
        return self.model.replied(station) + station.average

    @property
    def n(self) -> int:
        """Attempts a poll."""
        return self.model.attempts

    @property
    def torn(self) -> float:
        """What a scan is longer by where a reply was damaged."""
        if self.n == 1:  # its slot was spent all the same; then a flag costs a parameter frame
            return self.model.quiet + self.model.parameters_cost
        return self.slot + self.model.quiet

    @property
    def silent(self) -> float:
        """What a scan is longer by where an attempt ran to its deadline."""
        if self.n == 1:
            return self.model.silent_cost - self.slot + self.model.parameters_cost
        return self.model.silent_cost

    def units(self, ticks: float) -> float:
        """A time in the unit of D8201."""
        return ticks / self.model.unit

    @cached_property
    def normal(self) -> int:
        """The longest D8202 without a failed attempt, in its unit."""
        model, unit = self.model, self.model.unit
        jitter = sum(station.slowest - station.average for station in model.stations)
        return int((2 * (self.healthy + jitter) + unit) // (2 * unit))

    def thresholds(self) -> tuple[float, float, float]:
        """The ladder's three thresholds: any failed attempt, one that was silent, more than one."""
        ms = self.model.unit
        first = 2.6 * TICKS_PER_MS
        return (
            (self.healthy + first) / ms,
            (self.healthy + (self.torn + self.silent) / 2) / ms,
            (self.healthy + self.silent + 2.5 * first) / ms,
        )

    # -- counts ------------------------------------------------------------------------------------

    @property
    def data_bits(self) -> int:
        """Bits of a data frame."""
        return self.model.data_bits

    def damaged(self, ber: float, bits: int) -> float:
        """The probability that a frame is damaged."""
        return float(1 - (1 - ber) ** bits)

    def master_damaged(self, ber: float, polls: float | None = None) -> float:
        """Starts of runs of damaged frames of the master that a slave counts in D8203, per scan."""
        polls = self.settings.slaves if polls is None else polls
        data, poll = self.damaged(ber, self.data_bits), self.damaged(ber, self.model.poll_bits)
        return data * (1 - poll) + poll * (1 - data) + max(0.0, polls - 1) * poll * (1 - poll)

    def attempt(self, noise: SteadyNoise) -> tuple[AttemptProbabilities, ...]:
        """How one attempt at each slave ends under memoryless noise."""
        return probabilities_of(noise.applied(self.model))

    def mean_scan(self, noise: SteadyNoise) -> float:
        """The mean of a scan under some noise: the healthy one and what failed attempts cost."""
        return self.healthy + sum(map(self._failures, self.attempt(noise)))

    def _failures(self, each: AttemptProbabilities) -> float:
        """What failed attempts at a slave add to a scan on average."""
        p, n = each.failed, self.n
        failed = p * (1 - p**n) / (1 - p) if p < 1 else n
        share = each.silent / p if p else 0.0
        ended = self.model.parameters_cost - self.slot if n > 1 else 0.0
        return failed * (share * self.silent + (1 - share) * self.torn) + p**n * ended

    def distribution(self, noise: SteadyNoise) -> Distribution | None:
        """The distribution of a scan under some noise; None where there is no closed form of it."""
        model = noise.applied(self.model)
        return Solved(model).distribution if model.valid else None

    def station_errors(self, p: float) -> float:
        """What the master counts about a slave whose attempts fail with p, per scan, by its policies."""
        fails = fails_of(AttemptProbabilities(1 - p, p, 0.0), self.n, self.model.absent)
        return fails.onset if self.model.error_count.on_edge else fails.error
