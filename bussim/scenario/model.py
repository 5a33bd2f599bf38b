"""A validated scenario as frozen values: what the simulation and the exact solver read.

Times are ticks (1/72 MHz). Nothing here checks anything: :mod:`bussim.scenario.loader` makes these
values from a file and reports every mistake before one exists.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import StrEnum
from fractions import Fraction
from typing import TYPE_CHECKING, assert_never

from bussim.line.characters import LineTiming
from bussim.line.contention import Contention
from bussim.line.protocols import BusProtocol
from bussim.plc.inputs import InputSpec
from bussim.plc.ports.spec import FreeSpec, PollSpec, PortSpec
from bussim.plc.profiles import Profile
from bussim.plc.scan import Scan
from bussim.plc.sources import Source
from bussim.plc.system_devices import WATCHDOG
from bussim.scenario.fault_kinds import Direction, FaultKind
from bussim.units import TICKS_PER_MS, round_half_up

if TYPE_CHECKING:  # what only a scenario with devices or programs pays
    from bussim.devices.contract import BusDevice
    from bussim.plc.program.program import Program


@dataclass(frozen=True, slots=True)
class Bus:
    """One RS485 line. That of an N:N link is 38400 7E1 by protocol."""

    name: str
    protocol: BusProtocol
    timing: LineTiming
    contention: Contention = Contention.UNDEFINED


@dataclass(frozen=True, slots=True)
class Window:
    """When a noise or a fault acts: from ``at`` for ``duration`` ticks (None: to the end)."""

    at: int = 0
    duration: int | None = None

    @property
    def until(self) -> int | None:
        """The first tick at which it no longer acts, None for never."""
        return None if self.duration is None else self.at + self.duration


ALWAYS = Window()


@dataclass(frozen=True, slots=True)
class Target:
    """What a noise acts on: a whole bus, or one direction of one station on it.

    ``station`` is the name of a node: a PLC (its link port), ``press1.COM3``, or a device.
    """

    bus: str
    station: str | None = None
    direction: Direction = Direction.RX


@dataclass(frozen=True, slots=True)
class BitErrors:
    """Independent bit errors with probability ``ber`` (0…1) for every transmitted bit."""

    ber: float


@dataclass(frozen=True, slots=True)
class Burst:
    """Gilbert–Elliott noise: exponential sojourns of mean ``good`` and ``bad`` ticks, a BER in each."""

    good: int
    bad: int
    ber_good: float
    ber_bad: float


@dataclass(frozen=True, slots=True)
class Impulse:
    """Periodic impulses: bits whose centre lies in one are inverted with probability ``ber``.

    ``phase`` is the start of the first impulse after ``at`` (0 <= phase < every), None for random.
    """

    every: int
    width: int
    ber: float
    phase: int | None = None


@dataclass(frozen=True, slots=True)
class ReplyLoss:
    """Replies of the target station (of every station: no station) vanish whole, with a probability."""

    probability: float


NoiseKind = BitErrors | Burst | Impulse | ReplyLoss


@dataclass(frozen=True, slots=True)
class Noise:
    """One entry of ``noise:``. ``name`` is unique and names its random stream.

    ``measured`` names the recording that it was measured in, empty where it was entered.
    """

    name: str
    target: Target
    kind: NoiseKind
    window: Window = ALWAYS
    measured: str = ""

    @property
    def harmless(self) -> bool:
        """Whether it never does anything."""
        match self.kind:
            case BitErrors(ber=rate) | Impulse(ber=rate) | ReplyLoss(probability=rate):
                return rate == 0
            case Burst():
                return self.kind.ber_good == self.kind.ber_bad == 0
            case _:
                assert_never(self.kind)


@dataclass(frozen=True, slots=True)
class Fault:
    """One entry of ``faults:``. ``name`` is unique, names its random stream and labels plots."""

    name: str
    kind: FaultKind
    window: Window = ALWAYS


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
    random one. ``power_on`` is when it is switched on (tick). ``origins`` say where the fields of its
    profile come from that the scenario gives: ``entered``, or ``measured in`` a recording. ``scan_origin``
    says it of the scan. ``comments`` are the names that its user gave to devices.
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
    origins: dict[str, str] = field(default_factory=dict)
    scan_origin: str = field(default="assumed", compare=False)
    comments: dict[str, str] = field(default_factory=dict)

    def comment(self, device: str) -> str:
        """A device's comment, "" for none; the value TN5 of a timer has that of T5."""
        return self.comments.get(device) or self.comments.get(device.replace("N", "", 1), "")

    @property
    def longest_scan(self) -> int:
        """The longest scan in ticks, under N:N if it takes part, with a transaction on every other port.

        A program whose instructions have no bound counts with its watchdog's time (D8000 at power-on).
        """
        factor = self.profile.scan_factor if self.link is not None else Fraction(1)
        scan = sum(round_half_up(part * factor) for part in (Fraction(self.scan.mean), self.scan.jitter))
        spent: int | None = 0
        if self.program is not None:
            from bussim.plc.program.longest import longest_scan  # what only a scenario with programs pays

            spent = longest_scan(self.program, self.profile.instruction_times)
        if spent is None:
            spent = self.registers.get("D8000", WATCHDOG) * TICKS_PER_MS
        return scan + spent + len(self.ports) * self.profile.transaction_time

    def port_node(self, port: str) -> str:
        """The name of one of its ports as a node of a bus: ``press1.COM3``; the link's port: ``press1``."""
        return self.name if self.link is not None and self.link.port == port else f"{self.name}.{port}"


class Edge(StrEnum):
    """Which changes of a bit a latency counts."""

    RISING = "rising"
    FALLING = "falling"
    BOTH = "both"


@dataclass(frozen=True, slots=True)
class Latency:
    """How long a change takes from one device to another: an entry of ``latency:``.

    Bits: from the change of ``source`` (an input's wire, or an END that left it changed) to the END
    at which ``target`` follows; ``inverted``: it follows with the other level. Words: the age of what
    ``target`` holds whenever its PLC's program reads it.
    """

    name: str
    source_plc: str
    source: str
    target_plc: str
    target: str
    edge: Edge = Edge.BOTH
    inverted: bool = False


@dataclass(frozen=True, slots=True)
class CarriedWarning:
    """What the command that wrote a scenario wants repeated wherever it is used."""

    code: str
    text: str


@dataclass(frozen=True, slots=True)
class Scenario:
    """Everything a run needs. ``warnings`` are what it carries and what the loader found odd but possible.

    ``source`` is the scenario as plain data with every default filled in, in the file's own form
    (times as text with units), so that a run can leave it behind as YAML.
    """

    name: str
    duration: int
    seed: int
    buses: tuple[Bus, ...]
    plcs: tuple[Plc, ...]
    noise: tuple[Noise, ...] = ()
    faults: tuple[Fault, ...] = ()
    warnings: tuple[str, ...] = ()
    devices: tuple[BusDevice, ...] = ()
    latency: tuple[Latency, ...] = ()
    carried: tuple[CarriedWarning, ...] = ()
    source: dict[str, object] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        """Devices draw from the seed: also a replaced one changes their noise."""
        devices = tuple(
            replace(device, settings=device.settings.seeded(self.seed, device.name))
            for device in self.devices
        )
        object.__setattr__(self, "devices", devices)

    @property
    def links(self) -> list[str]:
        """The names of the N:N links."""
        return [bus.name for bus in self.buses if bus.protocol is BusProtocol.NN]

    def nodes_on(self, bus: str) -> tuple[str, ...]:
        """What sits on a bus, in the order of its cable: PLCs' ports as in ``plcs``, then devices."""
        names: list[str] = []
        for plc in self.plcs:
            ports = [spec.name for spec in plc.ports if spec.bus == bus]
            if plc.link is not None and plc.link.bus == bus:
                ports.append(plc.link.port)
            names += [plc.port_node(port) for port in sorted(ports)]
        return (*names, *(device.name for device in self.devices if device.bus == bus))
