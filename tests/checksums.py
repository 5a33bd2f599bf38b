"""Checksums as their standards define them, reckoned without bussim."""

from __future__ import annotations


def crc_by_definition(data: bytes) -> int:
    """CRC-16 of Modbus, bit by bit: shift right, exclusive or with A001."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return crc
