"""PLCs of a scenario, as frozen values. Times are ticks (1/72 MHz)."""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING

from bussim.plc.inputs import InputSpec
from bussim.plc.ports.spec import FreeSpec, PollSpec, PortSpec
from bussim.plc.profiles import Profile
from bussim.plc.scan import Scan
from bussim.plc.sources import Source
from bussim.units import TICKS_PER_MS, round_half_up

if TYPE_CHECKING:  # what only a scenario with programs pays
    from bussim.plc.program.program import Program


@dataclass(frozen=True, slots=True)
class LinkAttachment:
    """Where a PLC is connected to an N:N link: the bus and the port that M8179 selects."""

    bus: str
    port: str  # "COM3" or "COM4"


@dataclass(frozen=True, slots=True)
class Plc:
    """One PLC.

    ``registers`` are the special and data devices set at power-on, by their name on this PLC: the
    raw ``registers:`` of the scenario together with what ``nn:`` stands for. ``link`` is None for
    a PLC that takes no part in N:N. ``phase`` is the time from RUN to the first END, None for a
    random one. ``power_on`` is when it is switched on (tick).
    """

    name: str
    profile: Profile
    scan: Scan
    link: LinkAttachment | None
    registers: dict[str, int] = field(default_factory=dict)
    sources: dict[str, Source] = field(default_factory=dict)
    phase: int | None = None
    power_on: int = 0
    ports: tuple[PortSpec, ...] = ()
    polls: tuple[PollSpec | FreeSpec, ...] = ()
    program: Program | None = None
    inputs: dict[str, InputSpec] = field(default_factory=dict)  # X devices by name
    observed: tuple[str, ...] = ()  # devices whose every change is recorded, by name

    @property
    def instruction_time(self) -> int | None:
        """Ticks that a scan's instructions take at most; None where the program's text does not tell."""
        if self.program is None:
            return 0
        from bussim.plc.program.longest import longest_scan  # what only a scenario with programs pays

        return longest_scan(self.program, self.profile.instruction_times)

    @property
    def longest_scan(self) -> int:
        """The longest scan in ticks, under N:N if it takes part, with a transaction on every other port.

        A program whose instructions have no bound counts with its watchdog's time (D8000 at power-on).
        """
        factor = self.profile.scan_factor if self.link is not None else Fraction(1)
        scan = sum(round_half_up(part * factor) for part in (Fraction(self.scan.mean), self.scan.jitter))
        spent = self.instruction_time
        if spent is None:
            from bussim.plc.program.run import WATCHDOG

            spent = self.registers.get("D8000", WATCHDOG) * TICKS_PER_MS
        return scan + spent + len(self.ports) * self.profile.transaction_time

    def port_node(self, port: str) -> str:
        """The name of one of its ports as a node of a bus: ``press1.COM3``; the link's port: ``press1``."""
        return self.name if self.link is not None and self.link.port == port else f"{self.name}.{port}"
