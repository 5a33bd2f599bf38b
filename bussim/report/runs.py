"""What a report is made from: finished runs and their links' exact distributions, as plain data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from bussim.report.scene import Scene
from bussim.results.meters.histogram import Histogram
from bussim.results.run_record import RunRecord


@dataclass(frozen=True, slots=True)
class ExactDistribution:
    """The exact distribution of one link's scan time.

    ``figures`` are one link of ``bussim exact --json``. ``said`` is a sentence on how often a station that
    is not dead is in error. ``notes`` name what was left out of the distribution, such as faults that act for
    a part of the run. ``x`` (ms, ascending) and ``tail`` are points of P(link scan > x); empty
    where there is no distribution.
    """

    figures: Mapping[str, Any]
    said: str = ""
    notes: Sequence[str] = ()
    x: Sequence[float] = ()
    tail: Sequence[float] = ()

    @property
    def valid(self) -> bool:
        """Whether the closed form holds for the line."""
        return bool(self.figures["valid"])


@dataclass(frozen=True, slots=True)
class Source:
    """One run to report.

    ``label`` is its name among the others; ``folder`` is its folder as the user named it.
    ``distributions``, ``turnarounds`` and ``scenes`` are by bus; ``turnarounds`` (of a trace) by station
    number below.
    ``no_trace`` is the reason why a timeline is missing, ``no_distribution`` why the exact distributions are.
    """

    label: str
    folder: str
    record: RunRecord
    scenario: str
    distributions: Mapping[str, ExactDistribution] = field(default_factory=dict)
    no_distribution: str = ""
    turnarounds: Mapping[str, Mapping[int, Histogram]] = field(default_factory=dict)
    scenes: Mapping[str, Scene] = field(default_factory=dict)
    no_trace: str = ""

    @property
    def summary(self) -> dict[str, Any]:
        """The content of ``summary.json``."""
        return self.record.summary

    def valid_distribution(self, bus: str) -> ExactDistribution | None:
        """The exact distribution of a link, None where there is none or it does not hold."""
        distribution = self.distributions.get(bus)
        return distribution if distribution is not None and distribution.valid else None

    def registers(self, plc: str) -> dict[str, int]:
        """The registers of a PLC at the end of the run, by name; empty where none were kept."""
        found: dict[str, int] = self.summary["plcs"].get(plc, {}).get("registers", {})
        return found

    def station_names(self, bus: str) -> dict[int, str]:
        """The names of a link's stations by number: of several with one number the first."""
        names: dict[int, str] = {}
        for plc in self.record.links[bus].plc_names:
            registers = self.registers(plc)
            if "D8176" in registers:
                names.setdefault(int(registers["D8176"]), plc)
        return names
