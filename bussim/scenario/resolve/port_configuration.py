"""What an entry of a PLC's ``ports`` means: CPAVL's words, and what they make of the port.

As with ``nn``, the friendly keys are another way to write registers of the PLC: what is checked and
built is read back from the registers, wherever they come from.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from bussim.engines.modbus.adu import Mode
from bussim.line.characters import LineTiming
from bussim.plc.memory import FIRST_SPECIAL, Device, Memory, parse_device
from bussim.plc.ports import cpavl
from bussim.scenario.schema.document import PortIn
from bussim.scenario.yaml.source_map import Path
from bussim.units import format_time

HMI, FREE = "hmi", "free"
MASTERS = {"modbus-rtu-master": Mode.RTU, "modbus-ascii-master": Mode.ASCII}
SLAVES = {"modbus-rtu-slave": Mode.RTU, "modbus-ascii-slave": Mode.ASCII}
MODES = {**MASTERS, **SLAVES}
#: Ports that CPAVL can set up.
CPAVL_PORTS = tuple(port for port, protocols in cpavl.PORT_PROTOCOLS.items() if protocols)

_FORMAT_KEYS = ("baud", "format", "eight_bit")
#: The keys beside the protocol that each kind of port has.
_KEYS = {
    **dict.fromkeys(MASTERS, ("timeout", "interval", "baud", "format")),
    **dict.fromkeys(SLAVES, ("station", "baud", "format")),
    FREE: ("timeout", "start", "end", *_FORMAT_KEYS),
    HMI: ("baud", "format"),
}
#: The keys that stand for one word each, and what a port has that does not give them.
_WORDS = {
    "station": cpavl.STATION,
    "interval": cpavl.INTERVAL,
    "start": cpavl.START,
    "end": cpavl.END,
    "timeout": cpavl.TIMEOUT,
}
_UNITS = {"interval": cpavl.INTERVAL_UNIT, "timeout": cpavl.TIMEOUT_UNIT}
_DEFAULTS = {
    "interval": cpavl.DEFAULT_INTERVAL,
    "timeout": cpavl.DEFAULT_TIMEOUT * cpavl.TIMEOUT_UNIT,
    "start": 0,
    "end": 0,
}


def keys_of(protocol: str | None) -> tuple[str, ...]:
    """The keys that a port of this protocol has; all of them if that is not known."""
    return _KEYS.get(protocol or "", (*_WORDS, *_FORMAT_KEYS))


@dataclass(frozen=True, slots=True)
class PortConfiguration:
    """One port of a PLC beside its link port, as its words describe it.

    ``line`` are rate and format of its bus. ``settings`` are what the PLC reads in the words at STOP→RUN,
    or why it refuses them. ``explicit`` are the registers that friendly keys stand for, by key.
    """

    path: Path
    plc: str
    name: str
    given: PortIn
    line: LineTiming
    words: Device
    bits: Device
    settings: cpavl.PortSettings | cpavl.BadSettings
    explicit: Mapping[str, tuple[str, int]]

    @property
    def bus(self) -> str:
        """The bus that it is wired to."""
        return self.given.bus

    @property
    def node(self) -> str:
        """Its name as a node of its bus."""
        return f"{self.plc}.{self.name}"

    @property
    def valid(self) -> cpavl.PortSettings | None:
        """Its settings; None where the PLC refuses them."""
        return self.settings if isinstance(self.settings, cpavl.PortSettings) else None

    @property
    def protocol(self) -> str | None:
        """What it does; None for nothing, whether because nothing sets it or because the PLC refuses."""
        return self.valid.protocol if self.valid is not None else None

    @property
    def mode(self) -> Mode | None:
        """RTU or ASCII; None for what is not Modbus."""
        return MODES.get(self.protocol or "")

    @property
    def is_master(self) -> bool:
        """Whether it is a Modbus master."""
        return self.protocol in MASTERS

    @property
    def is_slave(self) -> bool:
        """Whether it is a Modbus slave."""
        return self.protocol in SLAVES

    def register(self, key: str) -> str:
        """The register that a key stands for."""
        return register_of(self.name, self.words, key)


def _is_com2_station(port: str, key: str) -> bool:
    """COM2 has its station number in D8121, which is something from power-on."""
    return key == "station" and port == "COM2"


def register_of(port: str, words: Device, key: str) -> str:
    """The register that a key of a port stands for."""
    if _is_com2_station(port, key):
        return str(cpavl.COM2_STATION)
    offset = cpavl.FORMAT if key in _FORMAT_KEYS else _WORDS.get(key, cpavl.PROTOCOL)
    return f"D{words.address + offset}"


def own_line(given: PortIn, line: LineTiming) -> LineTiming:
    """Rate and format of a port that may have its own instead of its bus's."""
    return LineTiming(given.baud or line.baud, given.format or line.format)


def is_set_up(name: str, port: PortIn) -> bool:
    """Whether an entry sets up a port: by a protocol, by the device of its words, or as COM2's default."""
    return name in CPAVL_PORTS and (port.protocol is not None or port.cpavl is not None or name == "COM2")


def configure_port(
    path: Path,
    plc: str,
    name: str,
    given: PortIn,
    line: LineTiming,
    raw: Mapping[str, int],
    programmed: tuple[Device, Device] | None = None,
    *,
    com2_station: int,
) -> tuple[PortConfiguration, dict[str, int]]:
    """The meaning of a port's entry, and the registers that its friendly keys and their defaults add.

    ``raw`` are the PLC's other registers by their proper names, which win over defaults. A port
    without a protocol is as ``raw`` describes it: nothing is filled in. ``programmed`` are the devices of
    words and bits that the PLC's program gives them; ``com2_station`` is D8121 at power-on.
    """
    words, bits = cpavl.default_devices(name)
    if given.cpavl is not None:
        words, bits = given.cpavl.words or words, given.cpavl.bits or bits
    words, bits = programmed or (words, bits)
    explicit = _explicit(name, words, given, line)
    added = dict(explicit.values())
    if given.protocol is not None:
        for key in keys_of(given.protocol):
            if _is_com2_station(name, key):
                added.setdefault(register_of(name, words, key), com2_station)
            elif key in _DEFAULTS:
                added.setdefault(register_of(name, words, key), _DEFAULTS[key] // _UNITS.get(key, 1))
        added.setdefault(register_of(name, words, "format"), cpavl.format_word(line, eight_bit=False))
    added = {register: value for register, value in added.items() if register not in raw}
    settings = _read(name, words, {str(cpavl.COM2_STATION): com2_station, **added, **raw})
    return PortConfiguration(path, plc, name, given, line, words, bits, settings, explicit), added


def _read(name: str, words: Device, registers: Mapping[str, int]) -> cpavl.PortSettings | cpavl.BadSettings:
    memory = Memory()
    last = Device("D", words.address + cpavl.WORDS - 1)
    for register, value in registers.items():
        try:
            memory.set(parse_device(register), value)
        except ValueError:
            continue  # words behind the end of the memory, which the rules report
    if words != cpavl.RS_WORDS and (words.letter != "D" or last.address > FIRST_SPECIAL):
        memory, words = Memory(), Device("D", 0)
    return cpavl.read_settings(name, memory, words)


def _explicit(name: str, words: Device, given: PortIn, line: LineTiming) -> dict[str, tuple[str, int]]:
    """The registers that the given keys stand for, by key."""
    found: dict[str, tuple[str, int]] = {}
    for key in _WORDS:
        value = getattr(given, key)
        if value is not None:
            found[key] = (register_of(name, words, key), value // _UNITS.get(key, 1))
    if given.protocol is not None:
        found["protocol"] = (register_of(name, words, "protocol"), cpavl.PROTOCOL_CODES[given.protocol])
    own = [key for key in _FORMAT_KEYS if getattr(given, key) is not None]
    if own:
        word = cpavl.format_word(own_line(given, line), eight_bit=bool(given.eight_bit))
        found[own[0]] = (register_of(name, words, "format"), word)
    return found


def written_keys(
    config: PortConfiguration, registers: Mapping[str, int], raw: Mapping[str, int]
) -> dict[str, object]:
    """The keys with defaults that a port leaves open and that no raw register gives, as a file has them."""
    if config.given.protocol is None:
        return {}
    values = {key: registers[config.register(key)] for key in _WORDS if config.register(key) in registers}
    return {
        key: format_time(values[key] * _UNITS[key]) if key in _UNITS else values[key]
        for key in keys_of(config.given.protocol)
        if (key in _DEFAULTS or _is_com2_station(config.name, key))
        and getattr(config.given, key) is None
        and config.register(key) not in raw
    }
