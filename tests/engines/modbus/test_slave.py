"""The slave: what it responds to, what it ignores, and when."""

from __future__ import annotations

import pytest

from bussim.engines.contract import EVENTS, OPEN, SERVE, TRANSMIT, Engine, RxChar, Transmit
from bussim.engines.modbus.adu import Adu, Mode, encode_adu
from bussim.engines.modbus.codes import PortError, Rejection
from bussim.engines.modbus.events import FrameRejected, RequestServed, SlaveEvent, StationRefused
from bussim.engines.modbus.framing import Framing
from bussim.engines.modbus.pdu import (
    Limits,
    Request,
    encode_request,
    encode_response,
    write_coil,
    write_coils,
    write_register,
    write_registers,
)
from bussim.engines.modbus.server import Space
from bussim.engines.modbus.slave import Slave, SlaveConfig
from bussim.engines.modbus.states import SLAVE, SlaveInput, SlaveState
from bussim.units import TICKS_PER_MS
from tests.engines.modbus.frames import ASCII_REQUEST, ASCII_RESPONSE, EXCHANGE_IDS, EXCHANGES, Exchange
from tests.engines.modbus.maps import PlainMap
from tests.engines.modbus.wire import ASCII_LINE, RTU_LINE, drain, receive_by_character

MS = TICKS_PER_MS
RTU = Framing.rtu(RTU_LINE)
LINES = {Mode.RTU: (RTU, RTU_LINE), Mode.ASCII: (Framing.ascii(), ASCII_LINE)}
both_modes = pytest.mark.parametrize("mode", list(Mode))


class Bench:
    """A running slave with plain maps."""

    def __init__(self, mode: Mode = Mode.RTU, stations: tuple[int, ...] = (1,), **config: object) -> None:
        self.framing, self.line = LINES[mode]
        self.maps = {station: PlainMap() for station in stations}
        self.slave = Slave(SlaveConfig(self.framing, **config), self.maps)
        self.slave.start(0)
        self.now = 10 * MS

    @property
    def map(self) -> PlainMap:
        return next(iter(self.maps.values()))

    def chars(self, request: Request | bytes, station: int = 1) -> bytes:
        pdu = request if isinstance(request, bytes) else encode_request(request)
        return encode_adu(self.framing.mode, station, pdu).chars

    def ask(self, request: Request | bytes, station: int = 1) -> list[SlaveEvent | Transmit]:
        _, self.now = receive_by_character(self.slave, self.chars(request, station), self.now, self.line)
        return self.silence()

    def silence(self) -> list[SlaveEvent | Transmit]:
        if self.framing.mode is Mode.RTU:
            self.now += self.framing.quiet
            self.slave.line_idle(self.now)
        return drain(self.slave)

    def response(self, request: Request | bytes, station: int = 1) -> bytes:
        """The PDU of its reply, b"" without one; the reply leaves at once."""
        sends = [item for item in self.ask(request, station) if isinstance(item, Transmit)]
        if not sends:
            return b""
        adu = self.slave.begin_transmit(max(self.now, sends[0].at), counter=sends[0].counter)
        self.now = max(self.now, sends[0].at) + self.line.characters(len(adu.chars))
        self.slave.transmit_done(self.now)
        assert adu.station == station
        return adu.pdu


def test_keeps_the_contract() -> None:
    engine: Engine[Adu, SlaveEvent] = Slave(SlaveConfig(RTU), {})
    assert engine.deadline() is None
    assert engine.on_deadline(0) == 0


def prepared(exchange: Exchange, bench: Bench) -> None:
    """Put into the map what the exchange reads."""
    request, response = exchange.request, exchange.response
    space = {1: Space.COILS, 3: Space.HOLDING}.get(request.function)
    if space is not None:
        items = bench.maps[exchange.station].items[space]
        items[request.address : request.address + request.quantity] = response.values


@pytest.mark.parametrize("exchange", EXCHANGES, ids=EXCHANGE_IDS)
@both_modes
@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("before", ["nothing", "junk", "another station", "half a frame"])
def test_every_printed_exchange(exchange: Exchange, mode: Mode, before: str, *, whole: bool) -> None:
    bench = Bench(mode, (exchange.station,))
    prepared(exchange, bench)
    slave, asked = bench.slave, bench.chars(exchange.request, exchange.station)
    noise = {
        "nothing": b"",
        "junk": b"\x00\xff:\x13",
        "another station": bench.chars(exchange.request, exchange.station + 1),
        "half a frame": asked[: len(asked) // 2],
    }[before]
    if noise:
        _, bench.now = receive_by_character(slave, noise, bench.now, bench.line)
        assert not any(isinstance(item, Transmit | RequestServed) for item in bench.silence())
    start = bench.now
    end = start + bench.line.characters(len(asked))
    if whole:
        hints = slave.receive_frame(
            encode_adu(mode, exchange.station, encode_request(exchange.request)), start, end
        )
    else:
        hints, _ = receive_by_character(slave, asked, start, bench.line)
    bench.now = end
    if mode is Mode.RTU:
        assert hints & OPEN
        bench.now = end + bench.framing.quiet
        hints = slave.line_idle(bench.now)
    assert hints & TRANSMIT
    items = drain(slave)
    served = [item for item in items if isinstance(item, RequestServed)]
    assert served == [
        RequestServed(
            bench.now,
            1,
            exchange.station,
            start,
            end,
            exchange.request.function,
            exchange.request,
            0,
            broadcast=False,
        )
    ]
    assert items[-1] == Transmit(bench.now, reply=True, counter=1)
    reply = slave.begin_transmit(bench.now, counter=1)
    assert reply == encode_adu(mode, exchange.station, encode_response(exchange.response))
    if mode is Mode.RTU:
        assert reply.chars == exchange.response_chars
    assert slave.transmit_done(bench.now + 1) == 0
    assert slave.state is SlaveState.LISTENING


def test_ascii_example_of_the_v80() -> None:
    bench = Bench(Mode.ASCII, (6,))
    bench.map.items[Space.HOLDING][107:110] = [0x63] * 3
    receive_by_character(bench.slave, ASCII_REQUEST, 0, ASCII_LINE)
    assert bench.slave.begin_transmit(1).chars == ASCII_RESPONSE


# -- exceptions ------------------------------------------------------------------------------------


@both_modes
@pytest.mark.parametrize("function", [0, 7, 8, 11, 0x11, 0x14, 0x16, 0x17, 0x2B, 0x7F])
def test_01_function_that_no_device_has(mode: Mode, function: int) -> None:
    assert Bench(mode).response(bytes((function, 0, 0, 0, 1))) == bytes((function | 0x80, 1))


@pytest.mark.parametrize("function", [1, 2, 3, 4, 5, 6, 15, 16])
def test_01_function_that_this_map_lacks(function: int) -> None:
    bench = Bench()
    bench.map.functions = bench.map.functions - {function}
    requests = {
        5: write_coil(0, on=True),
        6: write_register(0, 0),
        15: write_coils(0, (1,)),
        16: write_registers(0, (1,)),
    }
    request = requests.get(function, Request(function, 0, 1))
    assert bench.response(request) == bytes((function | 0x80, 1))
    assert bench.map.calls == []


@pytest.mark.parametrize(
    "request_",
    [
        Request(3, 199, 2),
        Request(1, 200, 1),
        Request(4, 0xFFFF, 2),  # beyond what an address can be
        write_register(200, 1),
        write_registers(199, (1, 2)),
        write_coils(200, (1,)),
    ],
)
def test_02_beyond_the_map(request_: Request) -> None:
    assert Bench().response(request_) == bytes((request_.function | 0x80, 2))


@pytest.mark.parametrize(
    "pdu",
    [
        "03 00 00 00 00",
        "03 00 00 00 7E",  # 126 registers
        "04 00 00 00 7E",
        "01 00 00 07 D1",  # 2001 coils
        "02 00 00 07 D1",
        "05 00 00 00 01",
        "05 00 00 FF 01",
        "0F 00 00 00 00 00",
        "10 00 00 00 00 00",
        "10 00 00 00 02 02 00 01",
        "0F 00 00 00 09 01 FF",
    ],
)
def test_03_quantity_or_value(pdu: str) -> None:
    bench = Bench()
    asked = bytes.fromhex(pdu)
    assert bench.response(asked) == bytes((asked[0] | 0x80, 3))
    assert bench.map.calls == []


def test_limits_are_the_devices_own() -> None:
    bench = Bench()
    bench.map.limits = Limits(read_coils=10, write_registers=3)
    assert bench.response(Request(1, 0, 10))[0] == 1
    assert bench.response(Request(1, 0, 11)) == b"\x81\x03"
    assert bench.response(write_registers(0, (1, 2, 3)))[0] == 16
    assert bench.response(write_registers(0, (1, 2, 3, 4))) == b"\x90\x03"


def test_quantity_is_checked_before_address() -> None:
    assert Bench().response(Request(3, 5000, 126)) == b"\x83\x03"


@both_modes
@pytest.mark.parametrize(
    "pdu", ["10 00 00 00 01 02 00", "10 00 00 00 01 02 00 07 00", "0F 00 00 00 08 02 FF"]
)
def test_a_byte_count_that_disagrees_with_the_length_is_exception_03(mode: Mode, pdu: str) -> None:
    bench = Bench(mode)
    items = bench.ask(bytes.fromhex(pdu))
    assert [type(item) for item in items] == [RequestServed, Transmit]
    assert items[0].exception == 3


# -- silence ---------------------------------------------------------------------------------------


@both_modes
@pytest.mark.parametrize("pdu", ["83 02", "03 00 00 00", "03 00 00 00 01 00", "10 00 00 00 01"])
def test_sound_frames_that_are_no_requests_are_ignored(mode: Mode, pdu: str) -> None:
    bench = Bench(mode)
    items = bench.ask(bytes.fromhex(pdu))
    assert [type(item) for item in items] == [FrameRejected]
    assert items[0].reason is Rejection.MALFORMED


@both_modes
def test_damaged_frames_are_ignored(mode: Mode) -> None:
    bench = Bench(mode)
    chars = bytearray(bench.chars(write_register(0, 7)))
    chars[-4 if mode is Mode.RTU else -6] ^= 1
    _, bench.now = receive_by_character(bench.slave, bytes(chars), bench.now, bench.line)
    items = bench.silence()
    assert [item.reason for item in items] == [Rejection.CHECK]
    assert bench.map.calls == []


def test_rtu_frames_of_others_cost_no_watching() -> None:
    bench = Bench()
    foreign = encode_adu(Mode.RTU, 2, encode_request(Request(3, 0, 1)))
    end = RTU_LINE.characters(8)
    assert bench.slave.receive_frame(foreign, 0, end) == 0
    # The next frame shows its end, and is understood.
    mine = encode_adu(Mode.RTU, 1, encode_request(Request(3, 0, 1)))
    start = end + RTU.quiet
    assert bench.slave.receive_frame(mine, start, start + end) & OPEN
    assert bench.slave.line_idle(start + end + RTU.quiet) & TRANSMIT


def test_rtu_frames_of_others_without_a_silence_between_are_damage() -> None:
    bench = Bench()
    foreign = encode_adu(Mode.RTU, 2, encode_request(Request(3, 0, 1)))
    end = RTU_LINE.characters(8)
    assert bench.slave.receive_frame(foreign, 0, end) == 0
    assert bench.slave.receive_frame(foreign, end, 2 * end) == OPEN
    assert bench.slave.line_idle(2 * end + RTU.quiet) == EVENTS
    assert [item.reason for item in drain(bench.slave)] == [Rejection.CHECK]


def test_stopped_it_receives_nothing() -> None:
    bench = Bench()
    bench.slave.stop(bench.now)
    assert bench.ask(write_register(0, 1)) == []
    assert bench.slave.receive_frame(encode_adu(Mode.RTU, 1, b"\x03"), 0, 1) == 0
    bench.slave.start(bench.now)
    assert bench.response(write_register(0, 1)) != b""


@pytest.mark.parametrize("station", [0, 248, 255])
def test_0_impossible_own_station(station: int) -> None:
    slave = Slave(SlaveConfig(RTU), {station: PlainMap()})
    assert slave.start(5) == EVENTS
    assert drain(slave) == [StationRefused(5, station, PortError.STATION)]
    assert slave.state is SlaveState.REFUSING
    assert slave.receive(RxChar(1), 0, 1) == 0


# -- broadcast -------------------------------------------------------------------------------------


@both_modes
@pytest.mark.parametrize(
    "request_",
    [write_coil(3, on=True), write_register(3, 7), write_coils(3, (1, 1)), write_registers(3, (7, 8))],
)
def test_broadcast_is_carried_out_by_all_and_gets_no_response(mode: Mode, request_: Request) -> None:
    bench = Bench(mode, (1, 5))
    items = bench.ask(request_, station=0)
    assert [(type(item), item.station, item.broadcast) for item in items] == [
        (RequestServed, 1, True),
        (RequestServed, 5, True),
    ]
    space = Space.COILS if request_.function in (5, 15) else Space.HOLDING
    assert all(plain.items[space][3] for plain in bench.maps.values())
    assert bench.slave.state is SlaveState.LISTENING


@both_modes
@pytest.mark.parametrize("request_", [Request(1, 0, 1), Request(3, 0, 1), bytes((8, 0, 0, 0, 0))])
def test_broadcast_reads_and_unknown_functions_are_ignored(mode: Mode, request_: Request | bytes) -> None:
    bench = Bench(mode)
    items = bench.ask(request_, station=0)
    assert [type(item) for item in items] == [FrameRejected]
    assert bench.map.calls == []


# -- time ------------------------------------------------------------------------------------------


@both_modes
def test_delay_counts_from_the_requests_last_stop_bit(mode: Mode) -> None:
    bench = Bench(mode, delay=35 * MS)
    _, end = receive_by_character(bench.slave, bench.chars(Request(3, 0, 1)), bench.now, bench.line)
    bench.now = end
    assert bench.silence()[-1] == Transmit(end + 35 * MS, reply=True, counter=1)


def test_a_delay_shorter_than_the_silence_changes_nothing() -> None:
    bench = Bench(delay=1)
    assert bench.ask(Request(3, 0, 1))[-1] == Transmit(bench.now, reply=True, counter=1)


@both_modes
def test_a_driven_slave_serves_on_command(mode: Mode) -> None:
    bench = Bench(mode, driven=True)
    assert bench.ask(write_register(3, 7)) == []
    assert bench.slave.waiting
    assert bench.slave.reply is None
    assert bench.map.calls == []
    end = bench.now + 8 * MS
    assert bench.slave.serve(end) & TRANSMIT
    assert bench.slave.reply is not None
    assert bench.map.calls == [("write", Space.HOLDING, 3, end)]
    assert drain(bench.slave)[-1] == Transmit(end, reply=True, counter=1)
    assert not bench.slave.waiting
    assert bench.slave.serve(end + 1) == 0


@pytest.mark.parametrize("whole", [True, False])
@both_modes
def test_a_driven_slave_says_that_a_request_waits(mode: Mode, *, whole: bool) -> None:
    bench = Bench(mode, driven=True)
    slave, chars = bench.slave, bench.chars(write_register(3, 7))
    frame = encode_adu(mode, 1, encode_request(write_register(3, 7)))
    assert frame.chars == chars
    end = bench.line.characters(len(chars))
    hints = (
        slave.receive_frame(frame, 0, end) if whole else receive_by_character(slave, chars, 0, bench.line)[0]
    )
    if mode is Mode.RTU:
        assert not hints & SERVE
        hints = slave.line_idle(end + slave.quiet)
    assert hints & SERVE


def test_a_driven_slave_serves_broadcasts_too() -> None:
    bench = Bench(driven=True)
    bench.ask(write_register(3, 7), station=0)
    assert bench.slave.serve(bench.now) == EVENTS
    assert bench.map.items[Space.HOLDING][3] == 7
    assert bench.slave.state is SlaveState.LISTENING


def test_a_request_that_comes_while_another_is_served_is_lost() -> None:
    bench = Bench(delay=35 * MS)
    bench.ask(Request(3, 0, 1))
    items = bench.ask(write_register(3, 7))
    assert [item.reason for item in items] == [Rejection.BUSY]
    assert bench.map.items[Space.HOLDING][3] == 0


def test_a_backlog_keeps_it() -> None:
    bench = Bench(delay=35 * MS, backlog=1)
    first = bench.ask(Request(3, 0, 1))[-1]
    assert isinstance(first, Transmit)
    assert bench.ask(write_register(3, 7)) == []
    assert [item.reason for item in bench.ask(Request(3, 0, 1))] == [Rejection.BUSY]
    bench.slave.begin_transmit(first.at, counter=first.counter)
    done = first.at + RTU_LINE.characters(7)
    assert bench.slave.transmit_done(done) & TRANSMIT
    second = drain(bench.slave)[-1]
    assert second.counter == 2
    assert second.at >= done
    assert bench.map.items[Space.HOLDING][3] == 7


def test_a_reply_that_is_given_up() -> None:
    bench = Bench()
    bench.ask(Request(3, 0, 1))
    bench.slave.give_up_reply(bench.now)
    assert bench.slave.state is SlaveState.LISTENING
    with pytest.raises(RuntimeError, match="the slave is listening: no reply is due"):
        bench.slave.begin_transmit(bench.now)
    assert bench.response(Request(3, 0, 1)) == b"\x03\x02\x00\x00"


def test_two_stations_behind_one_port() -> None:
    bench = Bench(stations=(3, 7))
    bench.response(write_register(0, 9), station=7)
    assert bench.response(Request(3, 0, 1), station=3) == b"\x03\x02\x00\x00"
    assert bench.response(Request(3, 0, 1), station=7) == b"\x03\x02\x00\x09"
    assert bench.response(Request(3, 0, 1), station=5) == b""


def test_table_of_states_is_closed() -> None:
    assert set(SLAVE.values()) == set(SlaveState)
    assert {state for state, _ in SLAVE} == set(SlaveState)
    for state in SlaveState:
        assert SLAVE[state, SlaveInput.STOP] is SlaveState.STOPPED
