"""What an entry of a PLC's ``ports`` means: CPAVL's words, and what they make of the port.

As with ``nn``, the friendly keys are another way to write registers of the PLC: what is judged and
built is read back from the registers, whoever gave them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bussim.engines.modbus.adu import Mode
from bussim.line.characters import LineTiming
from bussim.plc.memory import Device
from bussim.plc.ports import cpavl
from bussim.scenario.places import Path
from bussim.scenario.schema import CPAVL_TIMEOUT_UNIT, INTERVAL_UNIT, PortIn
from bussim.units import TICKS_PER_MS

if TYPE_CHECKING:
    from bussim.scenario.device_schema import DeviceIn

HMI, FREE = "hmi", "free"
MASTERS = {"modbus-rtu-master": Mode.RTU, "modbus-ascii-master": Mode.ASCII}
SLAVES = {"modbus-rtu-slave": Mode.RTU, "modbus-ascii-slave": Mode.ASCII}
MODES = {**MASTERS, **SLAVES}
#: Ports that CPAVL can set up.
CPAVL_PORTS = ("COM2", "COM3", "COM4", "COM5", "COM6")
#: COM2's own station number as a Modbus slave (LX slave note).
COM2_STATION = "D8121"

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
_UNITS = {"interval": INTERVAL_UNIT, "timeout": CPAVL_TIMEOUT_UNIT}
_DEFAULTS = {"interval": 5 * TICKS_PER_MS, "timeout": 100 * TICKS_PER_MS, "start": 0, "end": 0}
_NAMES = {code: name for name, code in cpavl.PROTOCOL_CODES.items() if code}


def keys_of(protocol: str | None) -> tuple[str, ...]:
    """The keys that a port of this protocol has; all of them if that is not known."""
    return _KEYS.get(protocol or "", (*_WORDS, *_FORMAT_KEYS))


@dataclass(frozen=True, slots=True)
class PortSeat:
    """One port of a PLC beside its link port, as its words describe it.

    ``protocol`` is None for a port that does nothing: word +6 is 0 (not on COM2) or no protocol's
    code. ``timing`` is None where the format word names no rate or parity. ``station`` is a slave's
    own number, 0…65535. ``explicit`` are the registers that friendly keys stand for, each with its key.
    """

    path: Path
    plc: str
    name: str
    given: PortIn
    words: Device
    bits: Device
    protocol: str | None
    code: int
    timing: LineTiming | None
    eight_bit: bool
    station: int | None
    timeout: int
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
    def mode(self) -> Mode | None:
        """RTU or ASCII; None for what is not Modbus."""
        return MODES.get(self.protocol or "")

    @property
    def is_master(self) -> bool:
        """Whether it asks others."""
        return self.protocol in MASTERS

    @property
    def is_slave(self) -> bool:
        """Whether others can ask it."""
        return self.protocol in SLAVES

    def register(self, key: str) -> str:
        """The register that a key stands for."""
        return register_of(self.name, self.words, key)


def register_of(port: str, words: Device, key: str) -> str:
    """The register that a key of a port stands for."""
    if key == "station" and port == "COM2":
        return COM2_STATION
    offset = cpavl.FORMAT if key in _FORMAT_KEYS else _WORDS.get(key, cpavl.PROTOCOL)
    return f"D{words.address + offset}"


def own_line(given: PortIn | DeviceIn, line: LineTiming) -> LineTiming:
    """Rate and format of a node that may have its own instead of its bus's."""
    return LineTiming(given.baud or line.baud, given.format or line.format)


def is_set_up(name: str, port: PortIn) -> bool:
    """Whether an entry sets up a port: by a protocol, by the place of its words, or as COM2's default."""
    return name in CPAVL_PORTS and (port.protocol is not None or port.cpavl is not None or name == "COM2")


def seat_port(
    path: Path, plc: str, name: str, given: PortIn, line: LineTiming, raw: Mapping[str, int]
) -> tuple[PortSeat, dict[str, int]]:
    """The meaning of a port's entry, and the registers that its friendly keys and their defaults add.

    ``raw`` are the PLC's other registers by their proper names, which win over defaults. A port
    without a protocol is as ``raw`` describes it: nothing is filled in.
    """
    words, bits = cpavl.default_places(name)
    if given.cpavl is not None:
        words, bits = given.cpavl.words or words, given.cpavl.bits or bits
    code = raw.get(register_of(name, words, "protocol"), 0) & 0xFFFF
    protocol = given.protocol or (HMI if name == "COM2" and not code else _NAMES.get(code))
    explicit = _explicit(name, words, given, line)
    added = {register: value for register, value in explicit.values() if register not in raw}
    if given.protocol is not None:
        for key in keys_of(protocol):
            if key in _DEFAULTS:
                added.setdefault(register_of(name, words, key), _DEFAULTS[key] // _UNITS.get(key, 1))
        word = cpavl.format_word(line, eight_bit=False)
        added.setdefault(register_of(name, words, "format"), word)
    registers = {**added, **raw}

    def value(key: str) -> int:
        return registers.get(register_of(name, words, key), 0) & 0xFFFF

    try:
        timing, eight_bit = cpavl.decode_format(value("format"))
    except ValueError:
        timing, eight_bit = None, False
    seat = PortSeat(
        path=path,
        plc=plc,
        name=name,
        given=given,
        words=words,
        bits=bits,
        protocol=protocol,
        code=value("protocol"),
        timing=timing,
        eight_bit=eight_bit,
        station=value("station") if protocol in SLAVES else None,
        timeout=(value("timeout") or _DEFAULTS["timeout"] // CPAVL_TIMEOUT_UNIT) * CPAVL_TIMEOUT_UNIT,
        explicit=explicit,
    )
    return seat, {register: value for register, value in added.items() if register not in raw}


def _explicit(name: str, words: Device, given: PortIn, line: LineTiming) -> dict[str, tuple[str, int]]:
    """The registers that the given keys stand for, by key."""
    found: dict[str, tuple[str, int]] = {}
    for key in _WORDS:
        value = getattr(given, key)
        if value is not None:
            found[key] = (register_of(name, words, key), value // _UNITS.get(key, 1))
    if given.protocol is not None:
        found["protocol"] = (
            register_of(name, words, "protocol"),
            cpavl.PROTOCOL_CODES[given.protocol],
        )
    own = [key for key in _FORMAT_KEYS if getattr(given, key) is not None]
    if own:
        word = cpavl.format_word(own_line(given, line), eight_bit=bool(given.eight_bit))
        found[own[0]] = (register_of(name, words, "format"), word)
    return found


def written_keys(seat: PortSeat, registers: Mapping[str, int], raw: Mapping[str, int]) -> dict[str, int]:
    """The keys with defaults that a port leaves open and that no raw register gives, with their values."""
    if seat.given.protocol is None:
        return {}
    return {
        key: registers[seat.register(key)] * _UNITS.get(key, 1)
        for key in keys_of(seat.protocol)
        if key in _DEFAULTS and getattr(seat.given, key) is None and seat.register(key) not in raw
    }
