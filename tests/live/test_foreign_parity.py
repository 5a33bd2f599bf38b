"""Clients of other projects that are set to 8E1, which no pseudo-terminal has."""

from __future__ import annotations

import sys

import pytest
import serial

from bussim.line.characters import CharFormat
from bussim.live.served import ServedSlave
from tests.live.peers import PATIENCE, peer

FORMAT = CharFormat(8, "N", 1)
READ, RESPONSE = bytes.fromhex("010300000001840a"), bytes.fromhex("0103020000b844")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
def test_pyserial_opens_a_pseudo_terminal_with_parity_again_and_again() -> None:
    with ServedSlave(fmt=FORMAT) as served:
        for _ in range(3):
            with serial.Serial(served.device, 19200, parity="E", timeout=PATIENCE) as client:
                client.write(READ)
                assert client.read(7) == RESPONSE
        client = serial.Serial(served.device, 19200, parity="E", timeout=PATIENCE)
        assert peer("minimalmodbus").Instrument(client, 1).read_register(0) == 0
        client.close()


def test_pymodbus_and_minimalmodbus_with_parity_over_a_socket() -> None:
    with ServedSlave("listen://127.0.0.1:0", fmt=FORMAT) as served:
        client = peer("pymodbus.client").ModbusSerialClient(
            served.device, baudrate=19200, parity="E", timeout=PATIENCE, retries=0
        )
        assert client.connect()
        assert client.read_holding_registers(0, count=1, device_id=1).registers == [0]
        client.close()
        other = serial.serial_for_url(served.device, baudrate=19200, parity="E", timeout=PATIENCE)
        assert peer("minimalmodbus").Instrument(other, 1).read_register(0) == 0
        other.close()
