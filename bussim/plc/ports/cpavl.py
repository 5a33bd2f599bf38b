"""CPAVL's twenty words and bits: where a port's parameters lie and how its format word is read.

Source: PW10 board manual, sections 4 (words and bits), 6 (format word, protocol codes).
"""

from __future__ import annotations

from typing import Final

from bussim.line.characters import CharFormat, LineTiming
from bussim.plc.memory import Device

#: How many words and bits a port has.
WORDS: Final = 20
BITS: Final = 20
#: Places of the words that a scenario writes: format, own station number, request interval in 0.1 ms,
#: start and end character, protocol, timeout in 10 ms.
FORMAT, STATION, INTERVAL, START, END, PROTOCOL, TIMEOUT = 0, 1, 2, 4, 5, 6, 9

#: Word +6 by the scenario's name of the protocol; 0 is the port's default, on COM2 the HMI's.
PROTOCOL_CODES: Final[dict[str, int]] = {
    "hmi": 0x00,
    "modbus-rtu-slave": 0x02,
    "modbus-ascii-slave": 0x03,
    "free": 0x10,
    "modbus-rtu-master": 0x20,
    "modbus-ascii-master": 0x30,
}

#: Format word 0 and the word of a port that nobody has set up.
DEFAULT_LINE: Final = LineTiming(9600, CharFormat(8, "N", 1))

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
    """Rate and format of a format word, and whether it is 8-bit mode. Raises ValueError for a bad one."""
    if not word & ~_EIGHT_BIT:
        return DEFAULT_LINE, bool(word & _EIGHT_BIT)
    baud, parity = _BAUDS.get(word >> 4 & 0xF), _PARITIES.get(word >> 1 & 3)
    if baud is None or parity is None:
        raise ValueError(f"the format word {word:04X}H names no {'rate' if baud is None else 'parity'}")
    fmt = CharFormat(7 + (word & 1), parity, 1 + (word >> 3 & 1))
    return LineTiming(baud, fmt), bool(word & _EIGHT_BIT)


def default_places(port: str) -> tuple[Device, Device]:
    """Where a scenario keeps a port's words and bits if it does not say: COM2 D7900 and M2900, and so on."""
    offset = 20 * (int(port[3:]) - 2)
    return Device("D", 7900 + offset), Device("M", 2900 + offset)
