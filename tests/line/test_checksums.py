"""CRC-16 and LRC against their definitions."""

from __future__ import annotations

import random

from bussim.line.checksums import crc16, crc16_bytes, lrc
from tests.checksums import crc_by_definition


def test_crc_is_the_shift_register_of_the_standard() -> None:
    rng = random.Random(1)
    for _ in range(500):
        data = rng.randbytes(rng.randrange(0, 260))
        assert crc16(data) == crc_by_definition(data)


def test_crc_check_value_and_order_on_the_wire() -> None:
    assert crc16(b"123456789") == 0x4B37  # the catalogue's check value of CRC-16/MODBUS
    assert crc16_bytes(bytes.fromhex("01 03 00 64 00 04")) == bytes.fromhex("05 D6")
    assert crc16(bytes.fromhex("01 03 00 64 00 04 05 D6")) == 0  # a frame with its own CRC behind it


def test_lrc_makes_the_sum_zero() -> None:
    assert lrc(bytes.fromhex("06 03 00 6B 00 03")) == 0x89
    rng = random.Random(2)
    for _ in range(500):
        data = rng.randbytes(rng.randrange(1, 260))
        assert (sum(data) + lrc(data)) % 256 == 0
