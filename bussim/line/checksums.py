"""The checks that Modbus frames carry: CRC-16 (RTU) and LRC (ASCII)."""

from fastcrc.crc16 import modbus as _crc16_modbus


def crc16(data: bytes) -> int:
    """CRC-16/MODBUS: polynomial 0xA001 (reflected), initial value 0xFFFF."""
    return _crc16_modbus(data)


def crc16_bytes(data: bytes) -> bytes:
    """The CRC as it goes on the wire, low byte first.

    The printed frames of the stepper and V80 manuals prove the order; the LX note's "high byte
    first" is a misprint.
    """
    return _crc16_modbus(data).to_bytes(2, "little")


def lrc(data: bytes) -> int:
    """Longitudinal redundancy check: the two's complement of the sum of all bytes, one byte."""
    return -sum(data) & 0xFF
