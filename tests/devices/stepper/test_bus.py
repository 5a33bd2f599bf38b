"""The stepper behind its slave engine: 35 ms, printed frames, a positioning run polled by a master."""

from __future__ import annotations

import pytest

from bussim.devices.stepper.map import Stepper
from bussim.devices.stepper.profile import STEPPER_PORT
from bussim.engines.modbus.adu import Mode
from bussim.engines.modbus.events import TransactionEnded
from bussim.engines.modbus.framing import Framing
from bussim.engines.modbus.master import MasterConfig
from bussim.engines.modbus.pdu import Request, write_coil, write_registers
from bussim.engines.modbus.polling import PollingMaster
from bussim.engines.modbus.polls import Poll, PollList
from bussim.engines.modbus.slave import Slave
from bussim.line.characters import CharFormat, LineTiming
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND
from tests.devices.ask import slave_config
from tests.engines.modbus.frames import EXCHANGES
from tests.engines.modbus.wire import RTU_LINE, Wire, receive_by_character

MS, S = TICKS_PER_MS, TICKS_PER_SECOND


@pytest.mark.parametrize("exchange", [e for e in EXCHANGES if e.what.startswith("stepper")])
def test_every_example_of_the_manual(exchange: object) -> None:
    slave = Slave(slave_config(STEPPER_PORT, Mode.RTU, RTU_LINE), {1: Stepper()})
    slave.start(0)
    _, end = receive_by_character(slave, exchange.request_chars, 0, RTU_LINE)
    slave.line_idle(end + slave.quiet)
    assert slave.due == end + 35 * MS
    assert slave.begin_transmit(slave.due).chars == exchange.response_chars


def test_no_ascii() -> None:
    with pytest.raises(ValueError, match="stepper does not speak Modbus ascii, only rtu"):
        slave_config(STEPPER_PORT, Mode.ASCII, RTU_LINE)


@pytest.mark.parametrize("baud", STEPPER_PORT.bauds)
def test_never_responds_before_35_ms(baud: int) -> None:
    line = LineTiming(baud, CharFormat(8, "N", 1))
    device = Stepper(baud=baud)
    wire = Wire(line, whole=True)
    polls = [
        Poll(1, Request(3, 0x16, 2)),
        Poll(1, write_coil(7, on=True)),
        Poll(1, Request(3, 60, 1)),
        Poll(1, Request(1, 0, 1)),
    ]
    master = PollingMaster(MasterConfig(Framing.rtu(line), 100 * MS), PollList(polls))
    slave = Slave(slave_config(STEPPER_PORT, Mode.RTU, line), {device.station: device})
    for engine in (slave, master):
        wire.add(engine)
        wire.handle(engine, engine.start(0))
    wire.run(2 * S)
    ended = [event for _, event in wire.events if isinstance(event, TransactionEnded)]
    assert len(ended) > 20
    assert {event.exception for event in ended} == {0, 1, 2}
    assert {event.answer_start - event.asked for event in ended} == {35 * MS}


def test_a_positioning_run_seen_by_a_polling_master() -> None:
    device = Stepper()
    wire = Wire(RTU_LINE, whole=False)
    polls = [
        Poll(1, write_registers(9, (20000, 0)), every=1000 * S),
        Poll(1, write_coil(7, on=True), every=1000 * S),
        Poll(1, Request(3, 0x16, 2), every=500 * MS),
        Poll(1, Request(3, 0x0C, 1), every=500 * MS),
    ]
    master = PollingMaster(MasterConfig(Framing.rtu(RTU_LINE), 100 * MS), PollList(polls))
    slave = Slave(slave_config(STEPPER_PORT, Mode.RTU, RTU_LINE), {1: device})
    for engine in (slave, master):
        wire.add(engine)
        wire.handle(engine, engine.start(0))
    wire.run(60 * S)
    ended = [event for _, event in wire.events if isinstance(event, TransactionEnded)]
    assert all(event.error is None for event in ended)
    positions = [
        e.response.values[0] | e.response.values[1] << 16 for e in ended if e.request == polls[2].request
    ]
    assert positions == sorted(positions)
    assert (positions[0], positions[-1]) == (positions[0], 20000)
    assert 0 < positions[0] < 200
    assert len(set(positions)) > 60
    arrived = [e.response.values[0] for e in ended if e.request == polls[3].request]
    assert arrived == sorted(arrived)
    assert arrived[-1] == 1


def test_the_old_address_responds_until_power_comes_back() -> None:
    device = Stepper()
    config = slave_config(STEPPER_PORT, Mode.RTU, RTU_LINE)

    def responds(slave: Slave, station: int) -> bool:
        slave.start(0)
        request = config.framing.encode(station, bytes.fromhex("03 00 00 00 01"))
        _, end = receive_by_character(slave, request.chars, 0, RTU_LINE)
        slave.line_idle(end + slave.quiet)
        responded = slave.due >= 0
        slave.stop(end)
        return responded

    slave = Slave(config, {device.station: device})
    for chars in (b"\x06\x00\x10\x00\x07", b"\x05\x00\x00\xff\x00"):  # 40017 = 7, save
        slave.start(0)
        _, end = receive_by_character(slave, config.framing.encode(1, chars).chars, 0, RTU_LINE)
        slave.line_idle(end + slave.quiet)
        slave.stop(end)
    assert responds(slave, 1)
    assert not responds(slave, 7)
    device.power_off(S)
    device.power_on(2 * S)
    slave = Slave(config, {device.station: device})
    assert responds(slave, 7)
    assert not responds(slave, 1)
