"""Modbus frames as characters on the wire (ADUs), RTU and ASCII: the only module that knows the layout.

=====  ============================================================  ===================
mode   layout                                                        characters
=====  ============================================================  ===================
RTU    station, PDU, CRC-16 low byte first                           3 + PDU, at most 256
ASCII  ``:``, then station, PDU and LRC as hexadecimal text, CR, LF  7 + 2 × PDU, at most 513
=====  ============================================================  ===================

(Modbus over serial line, section 2.5; V80 manual, figures 1-1 and 1-2.)
"""

from binascii import hexlify
from enum import StrEnum
from functools import lru_cache
from typing import Final, NamedTuple

from bussim.engines.modbus.codes import Rejection
from bussim.engines.modbus.pdu import MAX_PDU
from bussim.line.checksums import crc16, crc16_bytes, lrc

BROADCAST: Final = 0
#: Stations that a device may have.
FIRST_STATION: Final = 1
LAST_STATION: Final = 247
#: Numbers above the last station are reserved (Modbus over serial line, section 2.2), but devices have them.
LAST_RESERVED: Final = 255

#: Shortest and longest RTU frame.
RTU_MIN: Final = 4
RTU_MAX: Final = MAX_PDU + 3

COLON: Final = ord(":")
CR: Final = 0x0D
LF: Final = 0x0A
ASCII_MAX: Final = 2 * MAX_PDU + 7
HEX_DIGITS: Final = frozenset(b"0123456789ABCDEF")


class Mode(StrEnum):
    """The two transmission modes of the serial line."""

    RTU = "rtu"
    ASCII = "ascii"


class Adu(NamedTuple):
    """One valid frame."""

    station: int
    pdu: bytes
    chars: bytes


class Damage(NamedTuple):
    """Characters that were received and are no frame, now over. ``reason`` is what went wrong first.

    ``head`` is what seems to be its station and function, None where that is unknown.
    """

    reason: Rejection
    chars: bytes
    start: int
    end: int
    head: bytes | None


@lru_cache(maxsize=1024)
def encode_adu(mode: Mode, station: int, pdu: bytes) -> Adu:
    """The frame that carries a PDU to or from a station (0–255)."""
    body = bytes((station,)) + pdu
    if mode is Mode.RTU:
        return Adu(station, pdu, body + crc16_bytes(body))
    return Adu(station, pdu, b":%b%02X\r\n" % (hexlify(body).upper(), lrc(body)))


def adu_chars(mode: Mode, pdu_size: int) -> int:
    """Characters of the frame that carries a PDU of so many bytes."""
    return pdu_size + 3 if mode is Mode.RTU else 2 * pdu_size + 7


def decode_rtu(chars: bytes) -> Adu | Rejection:
    """The RTU frame that these characters, silence to silence, are."""
    if not RTU_MIN <= len(chars) <= RTU_MAX:
        return Rejection.OVERFLOW if len(chars) > RTU_MAX else Rejection.LENGTH
    if crc16(chars):  # with its own CRC behind it, low byte first, a frame's CRC is 0
        return Rejection.CHECK
    return Adu(chars[0], chars[1:-2], chars)


def decode_ascii(chars: bytes) -> Adu | Rejection:
    """The ASCII frame that these characters, colon to LF, are. Upper-case digits only."""
    if len(chars) > ASCII_MAX:
        return Rejection.OVERFLOW
    text = chars[1:-2]
    if chars[:1] != b":" or chars[-2:] != b"\r\n":
        return Rejection.UNFINISHED
    if not HEX_DIGITS.issuperset(text):
        return Rejection.NOT_HEX
    if len(text) % 2 or len(text) < 6:
        return Rejection.LENGTH
    body = bytes.fromhex(text.decode("ascii"))
    if lrc(body):  # the sum of a frame and its LRC is 0
        return Rejection.CHECK
    return Adu(body[0], body[1:-1], chars)
