"""What masters of other projects ask of a slave of a V80's registers as station 1."""

from __future__ import annotations

from typing import Any

import pytest


def write_and_read_back(client: Any) -> None:
    """Every function of pymodbus, at least the written items read back."""
    assert client.write_coil(3, True, device_id=1).isError() is False
    assert client.write_coils(10, [True, False, True, True] * 5, device_id=1).isError() is False
    assert client.write_register(5, 65535, device_id=1).isError() is False
    assert client.write_registers(20, list(range(100, 223)), device_id=1).isError() is False
    assert client.read_coils(3, count=1, device_id=1).bits[0] is True
    assert client.read_coils(10, count=20, device_id=1).bits[:20] == [True, False, True, True] * 5
    assert client.read_holding_registers(5, count=1, device_id=1).registers == [65535]
    assert client.read_holding_registers(20, count=123, device_id=1).registers == list(range(100, 223))


def be_refused(client: Any) -> None:
    """Exceptions for what is not there, is too much, or is no function; then a response again."""
    assert client.read_holding_registers(9999, count=1, device_id=1).exception_code == 2
    assert client.read_coils(0, count=1025, device_id=1).exception_code == 3
    assert client.mask_write_register(address=1, device_id=1).exception_code == 1
    assert client.read_holding_registers(0, count=1, device_id=1).registers == [0]


def minimal_write_and_read_back(station: Any) -> None:
    """Every function of minimalmodbus. Closes its port."""
    try:
        station.write_bit(3, 1)
        station.write_bits(10, [1, 0, 1, 1] * 4)
        station.write_register(5, 1234, functioncode=6)
        station.write_registers(20, [7, 8, 9])
        station.write_long(40, -5, signed=True)
        station.write_float(50, 1.5)
        station.write_string(60, "press", 4)
        assert station.read_bit(3, functioncode=1) == 1
        assert station.read_bits(10, 16, functioncode=1) == [1, 0, 1, 1] * 4
        assert station.read_bit(3, functioncode=2) == 0
        assert station.read_register(5) == 1234
        assert station.read_register(5, functioncode=4) == 0
        assert station.read_registers(20, 3) == [7, 8, 9]
        assert station.read_long(40, signed=True) == -5
        assert station.read_float(50) == 1.5
        assert station.read_string(60, 4).startswith("press")
        with pytest.raises(Exception, match="illegal data address"):
            station.read_register(10000)
    finally:
        station.serial.close()
