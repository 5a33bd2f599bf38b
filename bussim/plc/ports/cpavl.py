"""CPAVL's twenty words and bits: where a port's parameters lie and what they mean.

Source: PW10 board manual, sections 4 (ports), 5 (words and bits), 6 (format word, protocol codes).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from bussim.engines.modbus.adu import FIRST_STATION, LAST_STATION
from bussim.engines.modbus.codes import PortError
from bussim.line.characters import CharFormat, LineTiming
from bussim.plc.errors import shown_at
from bussim.plc.memory import Device, Memory, parse_device
from bussim.units import TICKS_PER_MS
from bussim.words.language import say

#: How many words and bits a port has.
WORDS: Final = 20
BITS: Final = 20
#: Words: format, own station number, request interval in 0.1 ms (Modbus master), start and end
#: character (free protocol), protocol, timeout in 10 ms.
FORMAT, STATION, INTERVAL, START, END, PROTOCOL, TIMEOUT = 0, 1, 2, 4, 5, 6, 9
#: Words that show the free protocol's state: bytes left to send, bytes received.
TO_SEND, RECEIVED = 2, 3
#: Bits: waiting to send, send request, reception complete, receiving (free protocol), timeout.
WAITING, SEND_REQUEST, COMPLETE, RECEIVING, TIMED_OUT = 1, 2, 3, 4, 9
#: Bits of a Modbus master: instruction running, communication error.
RUNNING, COMMUNICATION_ERROR = 2, 3

#: Word +6 by the scenario's name of the protocol; 0 is the port's default, on COM2 the HMI's.
PROTOCOL_CODES: Final[dict[str, int]] = {
    "hmi": 0x00,
    "modbus-rtu-slave": 0x02,
    "modbus-ascii-slave": 0x03,
    "free": 0x10,
    "modbus-rtu-master": 0x20,
    "modbus-ascii-master": 0x30,
}
_PROTOCOLS: Final = {code: name for name, code in PROTOCOL_CODES.items() if code}
_BOARD_PROTOCOLS: Final = frozenset(_PROTOCOLS.values())

#: What each port can do beside N:N and programming (section 4's table).
PORT_PROTOCOLS: Final[dict[str, frozenset[str]]] = {
    "COM1": frozenset(),
    "COM2": _BOARD_PROTOCOLS | {"hmi"},
    "COM3": _BOARD_PROTOCOLS,
    "COM4": _BOARD_PROTOCOLS,
    "COM5": _BOARD_PROTOCOLS,
    "COM6": _BOARD_PROTOCOLS,
}

#: The own station number of COM2 as a slave lies in D8121 (LX slave note), not in its word +1.
COM2_STATION: Final = Device("D", 8121)

#: RS has its parameters and flags in special devices that lie as those of CPAVL do (FX communication manual,
#: RS): the format's bits 8 and 9 say whether D8124 and D8125 frame the data, M8161 is the 8-bit mode.
RS_WORDS: Final = Device("D", 8120)
RS_BITS: Final = Device("M", 8120)
_RS_START, _RS_END, _RS_EIGHT_BIT = 0x100, 0x200, Device("M", 8161)

#: Format word 0: the word of a port that is not set up.
DEFAULT_LINE: Final = LineTiming(9600, CharFormat(8, "N", 1))
#: Interval and timeout that 0 in their words means; their units.
DEFAULT_INTERVAL: Final = 5 * TICKS_PER_MS
DEFAULT_TIMEOUT: Final = 10
INTERVAL_UNIT: Final = TICKS_PER_MS // 10
TIMEOUT_UNIT: Final = 10 * TICKS_PER_MS

_BAUD_CODES: Final = {4800: 7, 9600: 8, 19200: 9, 38400: 10, 57600: 11, 115200: 12}
_BAUDS: Final = {code: baud for baud, code in _BAUD_CODES.items()}
_PARITY_CODES: Final = {"N": 0, "O": 1, "E": 3}
_PARITIES: Final = {code: parity for parity, code in _PARITY_CODES.items()}
_EIGHT_BIT: Final = 0x8000


def format_word(timing: LineTiming, *, eight_bit: bool) -> int:
    """The format word of a rate and character format; ``eight_bit``: one byte a word (free protocol)."""
    fmt = timing.format
    word = int(fmt.data_bits == 8) | _PARITY_CODES[fmt.parity] << 1 | (fmt.stop_bits - 1) << 3
    return word | _BAUD_CODES[timing.baud] << 4 | (_EIGHT_BIT if eight_bit else 0)


def decode_format(word: int) -> tuple[LineTiming, bool]:
    """Rate and format of a format word, and whether it is 8-bit mode. Raises ValueError for a bad one.

    The manual's table prints the two modes of b15 the other way round; its examples H0081 (16-bit)
    and H8081 (8-bit) are right. The reserved bits b8–b14 mean nothing.
    """
    if not word & ~_EIGHT_BIT:
        return DEFAULT_LINE, bool(word & _EIGHT_BIT)
    baud, parity = _BAUDS.get(word >> 4 & 0xF), _PARITIES.get(word >> 1 & 3)
    if baud is None or parity is None:
        raise ValueError(say("port_no_rate" if baud is None else "port_no_parity", word=f"{word:04X}"))
    fmt = CharFormat(7 + (word & 1), parity, 1 + (word >> 3 & 1))
    return LineTiming(baud, fmt), bool(word & _EIGHT_BIT)


def default_devices(port: str) -> tuple[Device, Device]:
    """Where a scenario keeps a port's words and bits if it does not say: COM2 D7900 and M2900, and so on."""
    offset = 20 * (int(port[3:]) - 2)
    return Device("D", 7900 + offset), Device("M", 2900 + offset)


@dataclass(frozen=True, slots=True)
class PortSettings:
    """What a port's words say. Times in ticks.

    ``protocol`` is a name of :data:`PROTOCOL_CODES`, None where the port does nothing. ``start`` and
    ``end`` are characters, 0 for none.
    """

    timing: LineTiming
    eight_bit: bool
    protocol: str | None
    station: int
    interval: int
    start: int
    end: int
    timeout: int


@dataclass(frozen=True, slots=True)
class BadSettings:
    """Why a port refuses its words: the yy that it raises, and a sentence."""

    error: PortError
    text: str


def refusal(node: str, reason: str, code: int) -> str:
    """What a port does that refuses its words, as a sentence; ``code`` is what D8063 or D8438 shows."""
    device = shown_at(code)
    return say("port_refuses", node=node, reason=reason, device=device, code=code)


def read_settings(port: str, memory: Memory, words: Device) -> PortSettings | BadSettings:
    """The settings of a port from its words, or why it stays silent.

    A slave's station outside 1–247: 0. An unknown protocol or one that the port lacks, an impossible
    format word, 7 data bits under RTU: 6, a value that the PLC cannot take (assumed; the manual's
    table has nothing nearer, and says of 7 data bits only that communication fails). So does RS
    without a format (assumed).
    """
    values = [memory.word(words.letter, words.address + number) for number in range(TIMEOUT + 1)]
    word, with_rs = values[FORMAT], words == RS_WORDS
    if with_rs and not word:
        return BadSettings(PortError.DATA, say("port_no_format", port=port))
    if with_rs:
        values[PROTOCOL] = PROTOCOL_CODES["free"]
        values[START] *= bool(word & _RS_START)
        values[END] *= bool(word & _RS_END)
    code = values[PROTOCOL]
    protocol = _PROTOCOLS.get(code) if code else ("hmi" if port == "COM2" else None)
    if (code and protocol is None) or (protocol is not None and protocol not in PORT_PROTOCOLS[port]):
        return BadSettings(PortError.DATA, say("port_lacks", port=port, code=f"{code:02X}"))
    station = memory.get(COM2_STATION) if port == "COM2" else values[STATION]
    if protocol is not None and protocol.endswith("-slave") and not FIRST_STATION <= station <= LAST_STATION:
        allowed = f"{FIRST_STATION}..{LAST_STATION}"
        text = say("port_number", port=port, number=station, allowed=allowed)
        return BadSettings(PortError.STATION, text)
    try:
        timing, eight_bit = decode_format(word)
    except ValueError as bad:
        return BadSettings(PortError.DATA, say("port_of", port=port, why=bad.args[0]))
    if protocol is not None and protocol.startswith("modbus-rtu") and timing.format.data_bits != 8:
        return BadSettings(PortError.DATA, say("port_seven_bits", port=port))
    return PortSettings(
        timing=timing,
        eight_bit=bool(memory.get(_RS_EIGHT_BIT)) if with_rs else eight_bit,
        protocol=protocol,
        station=station,
        interval=values[INTERVAL] * INTERVAL_UNIT or DEFAULT_INTERVAL,
        start=values[START] & 0xFF,
        end=values[END] & 0xFF,
        timeout=(values[TIMEOUT] or DEFAULT_TIMEOUT) * TIMEOUT_UNIT,
    )


def configured(
    port: str, words: Device, registers: Mapping[str, int], com2_station: int
) -> PortSettings | BadSettings:
    """The settings of a port from a scenario's registers, by name; ``com2_station`` is D8121's default."""
    memory = Memory()
    memory.set(COM2_STATION, com2_station)
    for name, value in registers.items():
        memory.set(parse_device(name), value)
    return read_settings(port, memory, words)
