"""What a PLC's entry means: its profile, its registers, its config on a link, its other ports.

Rules check these values and the builder puts them into the scenario, so that both mean the same.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from bussim.plc.link_registers import (
    D_MODE,
    D_RETRIES,
    D_SLAVES,
    D_STATION,
    D_TIMEOUT,
    M_PORT,
    TAKE_PART,
    TIMEOUT_UNIT,
    bad_parameters,
    setting_defaults,
    setting_values,
)
from bussim.plc.memory import parse_device
from bussim.plc.profiles import Profile
from bussim.scenario.resolve.buses import PLAIN_LINE, Line
from bussim.scenario.resolve.plc_logic import PlcLogic, read_logic
from bussim.scenario.resolve.port_configuration import PortConfiguration, configure_port, is_set_up
from bussim.scenario.resolve.profiles import profile_of
from bussim.scenario.schema.document import NNIn, PlcIn
from bussim.scenario.yaml.files import Files
from bussim.scenario.yaml.source_map import Path, Report
from bussim.units import round_half_up

#: The keys of ``nn`` beside bus and port, and the registers that they stand for.
NN_KEYS = {
    "station": D_STATION,
    "slaves": D_SLAVES,
    "mode": D_MODE,
    "retries": D_RETRIES,
    "timeout": D_TIMEOUT,
}
PORT_DEVICE = f"M{M_PORT}"
#: The keys of ``nn`` but the bus, by the devices that they stand for.
KEYS_OF_DEVICES = {**{f"D{address}": key for key, address in NN_KEYS.items()}, PORT_DEVICE: "port"}


def _friendly_registers(nn: NNIn) -> dict[str, int]:
    """The registers that the given keys of ``nn`` stand for."""
    registers = {
        f"D{address}": value for key, address in NN_KEYS.items() if (value := getattr(nn, key)) is not None
    }
    if nn.timeout is not None:
        registers[f"D{D_TIMEOUT}"] = nn.timeout // TIMEOUT_UNIT
    if nn.port is not None:
        registers[PORT_DEVICE] = int(nn.port == "COM4")
    return registers


def device_name(name: str) -> str | None:
    """The proper name of a device (D007 is D7), None if there is no such device."""
    try:
        return str(parse_device(name))
    except ValueError:
        return None


@dataclass(frozen=True, slots=True)
class Member:
    """One PLC as its buses see it.

    ``port`` and ``bus`` are those of the N:N link; ``bus`` is None if it takes no part, or none is
    given for its port. ``ports`` are the others. ``raw`` and ``friendly`` are the registers that its keys
    ``registers`` and ``nn`` give, ``registers`` all that it has at power-on, by the devices' proper names.
    """

    path: Path
    plc: PlcIn
    profile: Profile
    raw: dict[str, int]
    friendly: dict[str, int]
    registers: dict[str, int]
    takes_part: bool
    port: str
    bus: str | None
    ports: tuple[PortConfiguration, ...] = ()
    logic: PlcLogic = field(default_factory=PlcLogic)

    @property
    def name(self) -> str:
        """The PLC's name."""
        return self.plc.name

    @property
    def unread(self) -> bool:
        """Whether it has a program with mistakes, so that nothing follows from what it seems not to do."""
        return self.plc.program is not None and self.logic.program is None

    @property
    def drives_ports(self) -> bool:
        """Whether its program has an RS2 or a CPAVL."""
        return self.logic.program is not None and self.logic.program.uses_ports

    @property
    def settings(self) -> dict[int, int]:
        """D8176 to D8180 after power-on, as 16-bit values by address."""
        values = setting_values(self.profile, self.registers)
        return {address: value & 0xFFFF for address, value in values.items()}

    @property
    def station(self) -> int:
        """D8176; 0 is the master."""
        return self.settings[D_STATION]

    @property
    def refused(self) -> list[str]:
        """What the PLC refuses of its settings, in words."""
        return bad_parameters(self.profile, self.settings)

    @property
    def longest_scan(self) -> int:
        """Its longest PLC scan while N:N runs, in ticks."""
        scan = self.plc.scan
        return round_half_up((scan.mean + scan.jitter) * self.profile.scan_factor)

    def setting_path(self, address: int) -> Path:
        """Where the scenario sets one of D8176 to D8180, or the PLC itself."""
        key = next(key for key, device in NN_KEYS.items() if device == address)
        if self.plc.nn is not None and getattr(self.plc.nn, key) is not None:
            return (*self.path, "nn", key)
        for name in self.plc.registers:
            if device_name(name) == f"D{address}":
                return (*self.path, "registers", name)
        return (*self.path, "program") if f"D{address}" in self.logic.first.link else self.path


def member_of(
    path: Path,
    plc: PlcIn,
    lines: Mapping[str, Line],
    power_on: int,
    files: Files,
    report: Report,
    *,
    skips: bool,
) -> Member:
    """The meaning of a PLC's entry, which is switched on at the tick ``power_on``.

    ``nn`` of a master also stands for the defaults of what it leaves open, so that a scenario says
    with which settings it runs. What its program sets in the first scan wins, as it does in the PLC.
    Mistakes in programs and tables of times are reported. ``skips``: ``allow_unsimulated``.
    """
    profile = profile_of(plc.profile)
    raw = {proper: value for name, value in plc.registers.items() if (proper := device_name(name))}
    friendly = _friendly_registers(plc.nn) if plc.nn is not None else {}
    logic = read_logic(path, plc, profile, {**friendly, **raw}, power_on, files, report, skips=skips)
    takes_part = plc.nn is not None or any(name in raw or name in logic.first.link for name in TAKE_PART)
    registers = {**friendly, **raw}
    if plc.nn is not None:
        registers.setdefault(PORT_DEVICE, 0)
        if plc.nn.station == 0:
            for address, default in setting_defaults(profile).items():
                registers.setdefault(f"D{address}", default)
    registers |= logic.first.link
    port = "COM4" if registers.get(PORT_DEVICE) else "COM3"
    bus = plc.nn.bus if plc.nn is not None else None
    if bus is None and takes_part and port in plc.ports:
        bus = plc.ports[port].bus
    for found in logic.first.ports.values():
        registers.update(found.registers)
    configs: list[PortConfiguration] = []
    added: dict[str, int] = {}
    for name, given in sorted(plc.ports.items()):
        programmed = logic.first.ports.get(name)
        if (programmed or is_set_up(name, given)) and not (takes_part and name == port):
            config, more = configure_port(
                (*path, "ports", name),
                plc.name,
                name,
                given,
                lines[given.bus].timing if given.bus in lines else PLAIN_LINE,
                registers,
                (programmed.words, programmed.bits) if programmed is not None else None,
                com2_station=profile.com2_station,
            )
            configs.append(config)
            added |= more
    ordered = dict(sorted({**registers, **added}.items()))
    return Member(path, plc, profile, raw, friendly, ordered, takes_part, port, bus, tuple(configs), logic)
