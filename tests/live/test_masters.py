"""Masters of other projects against a served slave, over a pseudo-terminal."""

from __future__ import annotations

import random
import sys
import time
from collections.abc import Iterator
from typing import Any

import pytest

from bussim.devices.v80.map import V80
from bussim.engines.modbus.adu import Mode
from bussim.engines.modbus.server import Space
from bussim.line.characters import CharFormat
from bussim.live.served import ServedSlave
from tests.live.exercises import be_refused, minimal_write_and_read_back, write_and_read_back
from tests.live.peers import minimal_master, pymodbus_master

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")

F8N1 = CharFormat(8, "N", 1)


@pytest.fixture(params=list(Mode))
def served(request: Any) -> Iterator[ServedSlave]:
    with ServedSlave(mode=request.param, fmt=F8N1, maps={1: V80(), 17: V80()}) as slave:
        yield slave


def test_pymodbus_uses_every_function_and_reads_back_what_it_wrote(served: ServedSlave) -> None:
    client = pymodbus_master(served.device, served.mode)
    try:
        v80 = served.maps[1]
        assert isinstance(v80, V80)
        v80.set(Space.INPUTS, 4, 1)
        v80.set(Space.INPUT_REGISTERS, 9, 4711)
        write_and_read_back(client)
        assert client.read_discrete_inputs(0, count=8, device_id=1).bits == [i == 4 for i in range(8)]
        assert client.read_input_registers(9, count=1, device_id=1).registers == [4711]
        assert client.read_holding_registers(20, count=1, device_id=17).registers == [0]
    finally:
        client.close()


def test_pymodbus_is_refused_by_exceptions(served: ServedSlave) -> None:
    client = pymodbus_master(served.device, served.mode)
    try:
        be_refused(client)
    finally:
        client.close()


def test_minimalmodbus_uses_every_function_and_reads_back_what_it_wrote(served: ServedSlave) -> None:
    minimal_write_and_read_back(minimal_master(served.device, served.mode))


@pytest.mark.slow
def test_500_transactions_without_an_error(served: ServedSlave) -> None:
    rng = random.Random(6)
    client = pymodbus_master(served.device, served.mode)
    mirror: dict[int, int] = {}
    try:
        for _ in range(250):
            address, value = rng.randrange(1000), rng.randrange(0x10000)
            mirror[address] = value
            assert not client.write_register(address, value, device_id=1).isError()
            asked = rng.choice(list(mirror))
            assert client.read_holding_registers(asked, count=1, device_id=1).registers == [mirror[asked]]
    finally:
        client.close()
    assert len(served.requests) == 500
    assert served.rejected == {}
    assert served.wire.counts.losses == served.wire.counts.dropped == 0


def test_broadcast_is_carried_out_by_all_and_gets_no_response(served: ServedSlave) -> None:
    client = pymodbus_master(served.device, served.mode)
    try:
        client.write_register(7, 99, device_id=0, no_response_expected=True)
        if served.mode is Mode.RTU:
            time.sleep(0.05)  # the master's pause after a broadcast
        for station in (1, 17):
            assert client.read_holding_registers(7, count=1, device_id=station).registers == [99]
    finally:
        client.close()
