"""A validated scenario as frozen values: what the simulation and the exact solver read.

Times are ticks (1/72 MHz). Nothing here checks anything: :mod:`bussim.scenario.loader` makes these
values from a file and reports every mistake before one exists.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import StrEnum
from fractions import Fraction
from typing import TYPE_CHECKING

from bussim.devices.stepper.profile import STEPPER_PROFILE, StepperProfile
from bussim.engines.modbus.adu import Mode
from bussim.engines.modbus.server import Space
from bussim.line.characters import LineTiming
from bussim.plc.inputs import InputSpec
from bussim.plc.ports.spec import FreeSpec, PollSpec, PortSpec
from bussim.plc.profiles import Profile
from bussim.plc.sources import Source
from bussim.units import TICKS_PER_MS, round_half_up

if TYPE_CHECKING:  # what only a scenario with devices or programs pays
    from bussim.devices.stepper.axis import Switch
    from bussim.devices.talker import Saying
    from bussim.devices.user import Entry
    from bussim.plc.program.program import Program


@dataclass(frozen=True, slots=True)
class Bus:
    """One RS485 line. ``nn`` lines are 38400 7E1 by protocol."""

    name: str
    nn: bool
    timing: LineTiming


@dataclass(frozen=True, slots=True)
class Scan:
    """A PLC's scan time without N:N: uniform over mean ± jitter (0 <= jitter < mean)."""

    mean: int
    jitter: int = 0


@dataclass(frozen=True, slots=True)
class Seat:
    """Where a PLC is connected to an N:N link: the bus and the port that M8179 selects."""

    bus: str
    port: str  # "COM3" or "COM4"


@dataclass(frozen=True, slots=True)
class Plc:
    """One PLC.

    ``registers`` are the special and data devices set at power-on, by their name on this PLC: the
    raw ``registers:`` of the scenario together with what ``nn:`` stands for. ``seat`` is None for
    a PLC that takes no part in N:N. ``phase`` is the time from RUN to the first END, None for a
    random one. ``power_on`` is when it is switched on (tick).
    """

    name: str
    profile: Profile
    scan: Scan
    seat: Seat | None
    registers: dict[str, int] = field(default_factory=dict)
    sources: dict[str, Source] = field(default_factory=dict)
    phase: int | None = None
    power_on: int = 0
    ports: tuple[PortSpec, ...] = ()
    polls: tuple[PollSpec | FreeSpec, ...] = ()
    program: Program | None = None
    inputs: dict[str, InputSpec] = field(default_factory=dict)  # X devices by name
    observed: tuple[str, ...] = ()  # devices whose every change is told, by name

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
        factor = self.profile.scan_factor if self.seat is not None else Fraction(1)
        scan = sum(round_half_up(part * factor) for part in (Fraction(self.scan.mean), self.scan.jitter))
        spent = self.instruction_time
        if spent is None:
            from bussim.plc.program.run import WATCHDOG

            spent = self.registers.get("D8000", WATCHDOG) * TICKS_PER_MS
        return scan + spent + len(self.ports) * self.profile.transaction_time

    def port_node(self, port: str) -> str:
        """The name of one of its ports as a node of a bus: ``press1.COM3``; the link's port: ``press1``."""
        return self.name if self.seat is not None and self.seat.port == port else f"{self.name}.{port}"


@dataclass(frozen=True, slots=True)
class LxSettings:
    """A PLC as Modbus slave of which nothing else is simulated. It answers at END.

    ``registers`` are its devices at power-on by name.
    """

    scan: Scan
    registers: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class V80Settings:
    """``items`` are the values at power-on, by address space and address (from 0)."""

    items: dict[tuple[Space, int], int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class StepperSettings:
    """``registers`` are parameters by their names in the register table, as saved before power-on.

    ``steps`` are those of the program's steps, from the first on.
    """

    profile: StepperProfile = STEPPER_PROFILE
    switches: tuple[Switch, ...] = ()
    registers: dict[str, int] = field(default_factory=dict)
    steps: tuple[dict[str, int], ...] = ()


@dataclass(frozen=True, slots=True)
class MapSettings:
    """A register map that the scenario defines."""

    entries: tuple[Entry, ...]
    functions: frozenset[int]


@dataclass(frozen=True, slots=True)
class HmiSettings:
    """A Modbus master without a PLC's scan: an HMI or a PC. Times in ticks."""

    polls: tuple[PollSpec, ...]
    timeout: int
    interval: int
    turnaround: int  # after a broadcast


@dataclass(frozen=True, slots=True)
class FreeSettings:
    """A device that speaks a protocol of its own: a barcode reader, a scale, a display."""

    sayings: tuple[Saying, ...]


DeviceSettings = LxSettings | V80Settings | StepperSettings | MapSettings | HmiSettings | FreeSettings


@dataclass(frozen=True, slots=True)
class BusDevice:
    """One entry of ``devices:``: something on a bus that is no PLC of the scenario.

    ``station`` is None for what has none (``hmi``, ``free``). ``delay`` is the least time from a
    request's end to its reply's first edge, ``jitter`` what is added to it at most, uniform.
    ``timing`` are its own rate and format, normally the bus's.
    """

    name: str
    model: str  # "lx", "v80", "stepper", "map", "hmi" or "free"
    bus: str
    station: int | None
    mode: Mode
    timing: LineTiming
    delay: int
    jitter: int
    settings: DeviceSettings
    power_on: int = 0


@dataclass(frozen=True, slots=True)
class Window:
    """When a noise or a fault acts: from ``at`` for ``duration`` ticks (None: to the end)."""

    at: int = 0
    duration: int | None = None

    @property
    def until(self) -> int | None:
        """The first tick at which it no longer acts, None for never."""
        return None if self.duration is None else self.at + self.duration


class Direction(StrEnum):
    """Which side of a station a disturbance sits on."""

    RX = "rx"  # in its receiver only
    TX = "tx"  # on what it sends, for everybody


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
    """One entry of ``noise:``. ``name`` is unique and names its random stream."""

    name: str
    target: Target
    kind: NoiseKind
    window: Window = Window()


# Faults. Those that damage single frames act ``count`` times; the others last for their window. A node is
# a PLC (its link port), a port such as ``press1.COM3``, or a device.


@dataclass(frozen=True, slots=True)
class PowerOff:
    """The PLC has no supply: silent, deaf, its memory back at power-on values afterwards."""

    node: str


@dataclass(frozen=True, slots=True)
class Stop:
    """The PLC is in STOP: silent and deaf, counts nothing; RUN again when it is over."""

    node: str


@dataclass(frozen=True, slots=True)
class DropReply:
    """The next ``count`` replies of a station (or all of them while it lasts) are never sent."""

    node: str
    count: int | None


@dataclass(frozen=True, slots=True)
class Slow:
    """A slave answers ``extra`` ticks later than its turnaround."""

    node: str
    extra: int


@dataclass(frozen=True, slots=True)
class Jabber:
    """A station's port sends random characters back to back, whatever its engine wants."""

    node: str


@dataclass(frozen=True, slots=True)
class CableCut:
    """The cable is broken behind a station (in the order of ``plcs``)."""

    bus: str
    after: str


@dataclass(frozen=True, slots=True)
class WrongFormat:
    """A station's port sends and receives with another character format or rate."""

    node: str
    timing: LineTiming


@dataclass(frozen=True, slots=True)
class ClockPpm:
    """A station's bit clock is off by ``ppm`` parts per million (positive: fast)."""

    node: str
    ppm: Fraction


@dataclass(frozen=True, slots=True)
class LateRelease:
    """A station's driver stays on, idle level, for ``by`` ticks after each of its frames."""

    node: str
    by: int


@dataclass(frozen=True, slots=True)
class LoseChar:
    """A character is missing: from what a station sends (tx) or only in its receiver (rx).

    ``index`` counts the frame's characters from 0; None: a random one.
    """

    node: str
    direction: Direction
    count: int | None
    index: int | None = None


@dataclass(frozen=True, slots=True)
class InsertChar:
    """A character too many: in what a station sends (tx) or only in its receiver (rx).

    It stands before the character ``index`` (None: a random place) and has ``value`` (None: random).
    """

    node: str
    direction: Direction
    count: int | None
    index: int | None = None
    value: int | None = None


@dataclass(frozen=True, slots=True)
class FlipBits:
    """Chosen bits of frames are inverted: of a station's frames (tx), in its receiver only (rx).

    ``bits`` count from 0, the first start bit of the frame; only frames of ``frame`` kind ("data",
    "poll", "parameters"; None: any) are touched and counted.
    """

    node: str
    direction: Direction
    bits: tuple[int, ...]
    count: int | None
    frame: str | None = None


@dataclass(frozen=True, slots=True)
class BoardError:
    """The exchange between a PLC and its port board fails with a code that no frame can cause.

    M8063 is set and D8063 becomes 7xyy (PW10, section 8); ``code`` is yy, ``port`` COM3…COM6.
    """

    node: str
    port: str
    code: int


FaultKind = (
    PowerOff
    | Stop
    | DropReply
    | Slow
    | Jabber
    | CableCut
    | WrongFormat
    | ClockPpm
    | LateRelease
    | LoseChar
    | InsertChar
    | FlipBits
    | BoardError
)


@dataclass(frozen=True, slots=True)
class Fault:
    """One entry of ``faults:``. ``name`` is unique, names its random stream and labels plots."""

    name: str
    kind: FaultKind
    window: Window = Window()


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
class Scenario:
    """Everything a run needs. ``warnings`` are what the loader found odd but possible.

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
    source: dict[str, object] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        """Give the noise in register maps its keys: also a replaced seed draws other values."""
        if any(isinstance(device.settings, MapSettings) for device in self.devices):
            devices = tuple(_with_keys(device, self.seed) for device in self.devices)
            object.__setattr__(self, "devices", devices)

    def nodes_on(self, bus: str) -> tuple[str, ...]:
        """What sits on a bus, in the order of its cable: PLCs' ports as in ``plcs``, then devices."""
        names: list[str] = []
        for plc in self.plcs:
            ports = [spec.name for spec in plc.ports if spec.bus == bus]
            if plc.seat is not None and plc.seat.bus == bus:
                ports.append(plc.seat.port)
            names += [plc.port_node(port) for port in sorted(ports)]
        return (*names, *(device.name for device in self.devices if device.bus == bus))


def _with_keys(device: BusDevice, seed: int) -> BusDevice:
    """A device whose noise is named by the seed, itself and the address, not by its place in the file."""
    from bussim.devices.values import Noise as NoiseValue
    from bussim.devices.values import noise_key

    if not isinstance(device.settings, MapSettings):
        return device
    entries = tuple(
        replace(
            entry,
            value=replace(entry.value, key=noise_key(seed, device.name, entry.space.value, entry.address)),
        )
        if isinstance(entry.value, NoiseValue)
        else entry
        for entry in device.settings.entries
    )
    return replace(device, settings=replace(device.settings, entries=entries))
