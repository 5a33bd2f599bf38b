"""Masters from other projects against served devices and PLC ports, over pseudo-terminals."""

from __future__ import annotations

import random
import sys
import time
from collections.abc import Iterator
from typing import Any

import pytest

from bussim.engines.modbus.adu import Mode
from bussim.scenario.loader import loads
from tests.live.exercises import be_refused, minimal_write_and_read_back, write_and_read_back
from tests.serve.serving import SLAVES, Serving

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
if sys.platform != "win32":
    from tests.live.peers import minimal_master, pymodbus_master

#: Nodes that are served together by the mode that they speak.
NODES = {Mode.RTU: ("v80", "oven"), Mode.ASCII: ("ascii", "plc.COM3")}


@pytest.fixture(params=list(Mode))
def mode(request: Any) -> Mode:
    found: Mode = request.param
    return found


@pytest.fixture
def served(mode: Mode) -> Iterator[Serving]:
    with Serving(SLAVES, *NODES[mode]) as serving:
        yield serving


@pytest.fixture
def client(served: Serving, mode: Mode) -> Iterator[Any]:
    master = pymodbus_master(served.device, mode)
    yield master
    master.close()


def rejected(serving: Serving) -> list[dict[str, int]]:
    totals = serving.totals()
    return [one.rejected for one in (*totals.devices, *totals.ports)]


def test_pymodbus_uses_every_function_and_reads_back_what_it_wrote(client: Any) -> None:
    write_and_read_back(client)
    assert client.read_discrete_inputs(0, count=8, device_id=1).bits == [False] * 8
    assert client.read_input_registers(9, count=1, device_id=1).registers == [0]


def test_pymodbus_is_refused_by_exceptions(client: Any) -> None:
    be_refused(client)


def test_minimalmodbus_uses_every_function_and_reads_back_what_it_wrote(served: Serving, mode: Mode) -> None:
    minimal_write_and_read_back(minimal_master(served.device, mode))


@pytest.mark.slow
def test_500_transactions_with_two_stations_of_one_wire_without_an_error(mode: Mode) -> None:
    """Each station hears the other one's requests and replies, and takes none for its own."""
    rng = random.Random(6)
    mirror: dict[tuple[int, int], int] = {}
    other = 2 if mode is Mode.RTU else 5
    with Serving(SLAVES, *NODES[mode]) as serving:
        master = pymodbus_master(serving.device, mode)
        try:
            for _ in range(250):
                key, value = (rng.choice((1, other)), rng.randrange(20)), rng.randrange(0x10000)
                mirror[key] = value
                assert not master.write_register(key[1], value, device_id=key[0]).isError()
                station, address = asked = rng.choice(list(mirror))
                response = master.read_holding_registers(address, count=1, device_id=station)
                assert response.registers == [mirror[asked]]
        finally:
            master.close()
    totals = serving.totals()
    counted = [one for one in (*totals.devices, *totals.ports) if one.requests]
    assert sum(one.answered for one in counted) == 500
    assert rejected(serving) == [{}] * 4
    (line,) = [bus for bus in totals.buses if bus.bus in serving.session.devices]
    assert line.collisions == 0
    assert serving.session.wires[0].counts.dropped == 0


def test_slaves_whose_master_is_outside_are_not_said_to_be_asked_by_nobody(
    client: Any, served: Serving
) -> None:
    assert client.read_coils(0, count=1, device_id=1).isError() is False
    (target,) = served.session.targets
    said = f"{target.bus} has no Modbus master"
    assert [text for text in loads(SLAVES).warnings if text.startswith(said)]
    assert not [text for text in served.session.scenario.warnings if text.startswith(said)]


def test_the_rest_of_the_scenario_goes_on_while_a_plc_is_served() -> None:
    """What a PLC of the simulation counts is read from outside; what is written lies in its memory."""
    text = SLAVES.replace("scan: 2 ms", "scan: 2 ms\n    sources: {D0: {counter: 10 ms}}")
    with Serving(text, "plc.COM3") as serving:
        master = pymodbus_master(serving.device, Mode.ASCII)
        try:
            before = master.read_holding_registers(0, count=1, device_id=5).registers[0]
            assert not master.write_register(100, 4711, device_id=5).isError()
            serving.wait_for(
                lambda: master.read_holding_registers(0, count=1, device_id=5).registers[0] > before + 5
            )
        finally:
            master.close()
        plc = serving.session.simulation.plcs["plc"]
        serving.wait_for(lambda: plc.read("D100") == 4711)
    assert not any("stopped" in text for text in serving.reported)


def test_a_broadcast_is_carried_out_by_all_and_gets_no_response(client: Any, mode: Mode) -> None:
    client.write_register(7, 99, device_id=0, no_response_expected=True)
    time.sleep(0.3)  # the master's pause after a broadcast
    for station in (1, 2 if mode is Mode.RTU else 5):
        assert client.read_holding_registers(7, count=1, device_id=station).registers == [99]
