"""Modbus peers that nobody here wrote, on the ends of pseudo-terminals."""

from __future__ import annotations

import os
from typing import Any

import pytest

from bussim.engines.modbus.adu import Mode

#: Seconds: nothing here takes so long unless something is broken.
PATIENCE = 10.0


def peer(name: str) -> Any:
    """A module that CI must have, and others may lack."""
    if os.environ.get("CI"):
        return __import__(name, fromlist=["*"])
    return pytest.importorskip(name)


def pymodbus_master(device: str, mode: Mode, **settings: Any) -> Any:
    """A connected synchronous pymodbus client on 8N1: a pseudo-terminal has no parity."""
    client = peer("pymodbus.client").ModbusSerialClient(
        device,
        framer=peer("pymodbus").FramerType(mode.value),
        baudrate=115200,
        bytesize=8,
        parity="N",
        timeout=PATIENCE,
        retries=0,
        **settings,
    )
    assert client.connect()
    return client


def minimal_master(device: str, mode: Mode, station: int = 1) -> Any:
    """A minimalmodbus instrument on 8N1."""
    minimalmodbus = peer("minimalmodbus")
    instrument = minimalmodbus.Instrument(device, station, mode=mode.value)
    instrument.serial.baudrate = 115200
    instrument.serial.timeout = PATIENCE
    instrument.clear_buffers_before_each_transaction = True
    return instrument
