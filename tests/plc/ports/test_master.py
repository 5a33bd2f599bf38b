"""A port as Modbus master: whole scans, RS2 and poll lists, results and flags in memory."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bussim.engines.modbus.codes import PortError
from bussim.engines.modbus.events import CycleEnded
from bussim.engines.modbus.framing import Framing
from bussim.engines.modbus.pdu import Response, encode_response
from bussim.engines.modbus.server import Space
from bussim.engines.modbus.slave import Slave, SlaveConfig
from bussim.plc.memory import Device
from bussim.plc.ports.cpavl import COMMUNICATION_ERROR, RUNNING, TIMED_OUT
from bussim.plc.ports.events import TransactionTaken, TurnEnded
from bussim.plc.ports.rs2 import Drive, Rs2
from bussim.plc.ports.spec import PollSpec
from bussim.plc.profiles import PROFILES
from tests.engines.modbus.maps import PlainMap
from tests.plc.ports.bench import ASCII_LINE, LINE, MS, PHASE, SCAN, Bench

RTU = Framing.rtu(LINE)
D = {number: Device("D", number) for number in (103, 200, 201, 202, 400, 500, 8250)}


def poll(
    function: int = 3, address: int = 0, count: int = 2, device: str = "D500", **more: object
) -> PollSpec:
    fields = {"name": "poll", "port": "COM4", "station": 1} | more
    target = Device(device[0], int(device[1:])) if device else None
    return PollSpec(function=function, address=address, count=count, device=target, **fields)


def with_slave(bench: Bench, delay: int = 2 * MS, stations: tuple[int, ...] = (1,)) -> PlainMap:
    plain = PlainMap()
    bench.add(Slave(SlaveConfig(RTU, delay=delay), dict.fromkeys(stations, plain)))
    return plain


# -- what goes on the wire ---------------------------------------------------------------------------


def test_the_manuals_example_of_rs2() -> None:
    """Section 5: S = H0103, m = 0064, D = 4."""

    def program(bench: Bench, now: int) -> None:
        operands = Rs2(D[200], D[201], D[202], D[500], 4)
        bench.program_ports.rs2("X1", operands, now, driven=True)

    registers = {"D200": 0x0103, "D201": 0x0064, "D202": 4}
    bench = Bench("COM4", "modbus-rtu-master", program=program, registers=registers)
    bench.run(PHASE + 1)
    assert bench.requests() == [(PHASE, bytes.fromhex("01 03 00 64 00 04 05 D6"))]


def test_the_manuals_program_of_section_6_2_2() -> None:
    """MOV H0103 D103, MOV K10 D400, RS2 D103 H0004 D400 D500 K4."""
    values = list(range(100, 110))

    def program(bench: Bench, now: int) -> None:
        bench.plc.memory.set_word("D", 103, 0x0103)
        bench.plc.memory.set_word("D", 400, 10)
        bench.program_ports.rs2(0, Rs2(D[103], 4, D[400], D[500], 4), now, driven=True)

    bench = Bench("COM4", "modbus-rtu-master", program=program)
    plain = with_slave(bench)
    plain.items[Space.HOLDING][4:14] = values
    bench.run(200 * MS)
    assert bench.requests()[0] == (PHASE, bytes.fromhex("01 03 00 04 00 0A 84 0C"))
    assert [bench.plc.memory.word("D", 500 + number) for number in range(10)] == values
    assert bench.outcomes()
    assert set(bench.outcomes()) == {None}


def test_ascii() -> None:
    bench = Bench("COM5", "modbus-ascii-master", [poll(3, 0x6B, 3, station=6, port="COM5")], line=ASCII_LINE)
    bench.run(PHASE + 1)
    assert bench.requests() == [(PHASE, b":0603006B000389\r\n")]


# -- time: whole scans, tick for tick ----------------------------------------------------------------

REQUEST, REPLY = LINE.characters(8), LINE.characters(9)  # a read of two registers


def decided(sent: int, delay: int = 2 * MS) -> int:
    """When the master's port knows the response: the slave's silence and its delay run at the same time."""
    return sent + LINE.characters(8) + max(RTU.quiet, delay) + REPLY + RTU.quiet


def test_a_transaction_costs_whole_scans() -> None:
    bench = Bench("COM4", "modbus-rtu-master", [poll()])
    with_slave(bench)
    bench.run(400 * MS)
    # Executed in the scan that begins with RUN: the request leaves at the first END.
    sent, took = PHASE, decided(PHASE)
    assert 34 * MS < took < 36 * MS
    taken = 40 * MS  # the first END at or after it
    for item, (start, _) in zip(bench.of(TransactionTaken), bench.requests(), strict=False):
        assert (start, item.ended.sent, item.ended.end, item.taken) == (sent, sent, decided(sent), taken)
        assert (item.poll, item.attempt, item.ended.error) == ("poll", 1, None)
        # The next one is executed in the scan that begins with that END, and leaves at its end.
        sent, taken = taken + SCAN, taken + SCAN + 30 * MS
    turns = bench.of(TurnEnded)
    assert [(turn.start, turn.end, turn.late) for turn in turns[:2]] == [
        (0, 40 * MS, 0),
        (40 * MS, 80 * MS, 0),
    ]
    assert [cycle.duration for cycle in bench.of(CycleEnded)[:2]] == [40 * MS, 40 * MS]
    # Only these ENDs had to be served: the one of a request, and the one of its response.
    assert bench.ends[:4] == [10 * MS, 40 * MS, 50 * MS, 80 * MS]


def test_a_response_decided_at_an_end_is_taken_over_there() -> None:
    delay = SCAN * 3 - (REQUEST + REPLY + RTU.quiet)
    bench = Bench("COM4", "modbus-rtu-master", [poll()])
    with_slave(bench, delay)
    bench.run(50 * MS)
    assert bench.of(TransactionTaken)[0].ended.end == bench.of(TransactionTaken)[0].taken == 40 * MS


def test_a_response_a_tick_after_an_end_waits_for_the_next() -> None:
    delay = SCAN * 3 - (REQUEST + REPLY + RTU.quiet) + 1
    bench = Bench("COM4", "modbus-rtu-master", [poll()])
    with_slave(bench, delay)
    bench.run(60 * MS)
    assert bench.of(TransactionTaken)[0].ended.end == 40 * MS + 1
    assert bench.of(TransactionTaken)[0].taken == 50 * MS


def test_the_interval_counts_from_the_decision_to_an_end() -> None:
    # 200 × 0.1 ms after about 35 ms: over at 55 ms, so the request leaves at the END at 60 ms.
    bench = Bench("COM4", "modbus-rtu-master", [poll()], w2=200)
    with_slave(bench)
    bench.run(200 * MS)
    assert [start for start, _ in bench.requests()[:3]] == [10 * MS, 60 * MS, 110 * MS]
    assert bench.ends[:4] == [10 * MS, 40 * MS, 60 * MS, 90 * MS]


def test_a_period_is_seen_by_the_first_scan_that_begins_when_it_is_due() -> None:
    bench = Bench("COM4", "modbus-rtu-master", [poll(every=95 * MS, at=35 * MS)])
    with_slave(bench)
    bench.run(400 * MS)
    # Due at 35, 130, 225, 320: seen by the scans from 40, 130, 230, 320 on, which end at 50, 140, 240, 330.
    assert [start for start, _ in bench.requests()] == [50 * MS, 140 * MS, 240 * MS, 330 * MS]
    assert [turn.late for turn in bench.of(TurnEnded)] == [5 * MS, 0, 5 * MS, 0]


def test_times_limits_the_turns_and_stop_begins_the_list_anew() -> None:
    bench = Bench("COM4", "modbus-rtu-master", [poll(times=2, at=20 * MS)])
    with_slave(bench)
    bench.run(500 * MS)
    assert len(bench.requests()) == 2
    assert bench.plc.wanted_end(500 * MS) is None
    assert not bench.of(CycleEnded)
    bench.stop_plc()
    bench.run(600 * MS)
    bench.run_plc()
    bench.run(1000 * MS)
    assert [start for start, _ in bench.requests()] == [630 * MS, 670 * MS]


def test_retries_are_driven_again_in_the_next_scan() -> None:
    bench = Bench("COM4", "modbus-rtu-master", [poll(retries=2, every=2000 * MS)], w9=3)
    bench.run(1000 * MS)
    # Sent at 10, decided after the request's 8.3 ms and 30 ms, taken over at 50; executed again until 60.
    assert [start for start, _ in bench.requests()] == [10 * MS, 60 * MS, 110 * MS]
    taken = bench.of(TransactionTaken)
    assert [(item.attempt, item.taken, item.ended.end) for item in taken] == [
        (number + 1, start + 40 * MS, start + REQUEST + 30 * MS)
        for number, start in enumerate((10 * MS, 60 * MS, 110 * MS))
    ]
    assert bench.of(TurnEnded) == [TurnEnded("poll", 0, 150 * MS, 3, PortError.TIMEOUT, 0)]


def test_several_polls_take_turns() -> None:
    polls = [poll(name=name, address=address) for address, name in enumerate("abc")]
    bench = Bench("COM4", "modbus-rtu-master", polls)
    with_slave(bench)
    bench.run(300 * MS)
    assert [turn.poll for turn in bench.of(TurnEnded)][:6] == list("abcabc")
    assert [(cycle.number, cycle.duration) for cycle in bench.of(CycleEnded)] == [
        (0, 120 * MS),
        (1, 120 * MS),
    ]


def test_a_broadcast_waits_its_turnaround_and_no_response() -> None:
    profile = replace(PROFILES["pw10"], transaction_time=0, broadcast_turnaround=123 * MS)
    bench = Bench("COM4", "modbus-rtu-master", [poll(6, 7, 1, station=0, values=(99,))], profile=profile)
    plain = with_slave(bench)
    bench.run(200 * MS)
    first = bench.of(TransactionTaken)[0]
    assert (first.ended.error, first.ended.end) == (None, PHASE + REQUEST + 123 * MS)
    assert first.taken == 150 * MS
    assert plain.items[Space.HOLDING][7] == 99


def test_each_active_transaction_makes_the_scans_longer() -> None:
    bench = Bench("COM4", "modbus-rtu-master", [poll(every=500 * MS)], profile=PROFILES["pw10"])
    with_slave(bench)
    longer = SCAN + MS // 5
    # The request leaves at the first END; the three scans until its response is taken over are longer.
    bench.run(300 * MS)
    assert bench.of(TransactionTaken)[0].taken == PHASE + 3 * longer
    cycle = bench.plc.cycle
    assert cycle.next_end(PHASE + 3 * longer + 1, 300 * MS) == PHASE + 3 * longer + SCAN
    bench.plc.cycle.count_up_to(300 * MS)
    assert bench.plc.cycle.longest == longer


# -- values ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("whole", [True, False])
def test_a_write_takes_the_devices_at_the_end_when_it_leaves(*, whole: bool) -> None:
    def program(bench: Bench, now: int) -> None:
        bench.plc.memory.set_word("D", 500, now // MS)

    bench = Bench(
        "COM4", "modbus-rtu-master", [poll(6, 3, 1)], program=program, whole=whole, registers={"D500": 77}
    )
    plain = with_slave(bench)
    bench.run(45 * MS)
    assert plain.items[Space.HOLDING][3] == 10
    bench.run(90 * MS)
    assert plain.items[Space.HOLDING][3] == 50


@pytest.mark.parametrize(
    ("function", "device", "values", "written", "memory"),
    [
        (6, "D500", (0x1234,), [0x1234], {"D500": 0x1234}),
        (6, "D500", (-2,), [0xFFFE], {"D500": 0xFFFE}),
        (16, "D500", (1, 2, 3), [1, 2, 3], {"D500": 1, "D502": 3}),
        (16, "", (1, 2, 3), [1, 2, 3], {}),
        (5, "M20", (1,), [1], {"M20": 1}),
        (5, "D500", (1,), [1], {"D500": 1}),
        (5, "", (1,), [1], {}),
        (15, "M20", (1, 0, 1), [1, 0, 1], {"M20": 1, "M21": 0, "M22": 1}),
        (15, "S20", (1, 0, 1), [1, 0, 1], {"S20": 1, "S22": 1}),
        (15, "D500", (1, 0, 1) + (0,) * 13 + (1, 1), [1, 0, 1] + [0] * 13 + [1, 1], {"D500": 5, "D501": 3}),
        (15, "", (1, 0, 1), [1, 0, 1], {}),
    ],
)
def test_written_values(
    function: int, device: str, values: tuple[int, ...], written: list[int], memory: dict[str, int]
) -> None:
    spec = poll(function, 9, len(values), device, values=values)
    bench = Bench("COM4", "modbus-rtu-master", [spec])
    plain = with_slave(bench)
    bench.run(200 * MS)
    assert bench.outcomes()[0] is None
    space = Space.COILS if function in (5, 15) else Space.HOLDING
    assert plain.items[space][9 : 9 + len(values)] == written
    assert {name: bench.plc.read(name) for name in memory} == memory


@pytest.mark.parametrize(
    ("function", "device", "items", "memory"),
    [
        (3, "D500", [7, 0xFFFF], {"D500": 7, "D501": 0xFFFF}),
        (4, "D500", [7, 8], {"D500": 7, "D501": 8}),
        (1, "M20", [1, 0, 1], {"M20": 1, "M21": 0, "M22": 1}),
        (2, "Y4", [1, 0, 1], {"Y4": 1, "Y5": 0, "Y6": 1}),
        (1, "D500", [1, 1] + [0] * 14 + [0, 1], {"D500": 3, "D501": 2}),
        (3, "", [7, 8], {"D0": 0}),
    ],
)
def test_read_values(function: int, device: str, items: list[int], memory: dict[str, int]) -> None:
    bench = Bench(
        "COM4",
        "modbus-rtu-master",
        [poll(function, 9, len(items), device)],
        registers={"M21": 1, "D501": 0xFFFF},
    )
    plain = with_slave(bench)
    space = {1: Space.COILS, 2: Space.INPUTS, 3: Space.HOLDING, 4: Space.INPUT_REGISTERS}[function]
    plain.items[space][9 : 9 + len(items)] = items
    bench.run(200 * MS)
    assert bench.outcomes()[0] is None
    assert {name: bench.plc.read(name) for name in memory} == memory


def test_results_show_in_the_shared_block_from_that_end_on() -> None:
    bench = Bench(
        "COM3",
        "modbus-rtu-master",
        [poll(3, 9, 1, "D1", port="COM3")],
        linked=True,
        registers={"M8179": 1, "D8178": 1, "D8177": 1},
    )
    plain = with_slave(bench)
    plain.items[Space.HOLDING][9] = 0x4321
    scan = 11 * MS  # N:N makes it longer
    taken = PHASE + 3 * scan
    bench.run(taken - 1)
    before = bench.plc.image_at(taken - 1)
    assert before[6:8] == b"\0\0"
    bench.run(taken + 1)
    assert bench.plc.image_at(taken)[6:8] == b"\x43\x21"
    assert bench.plc.image_at(taken + 5)[6:8] == b"\x43\x21"


# -- flags -----------------------------------------------------------------------------------------


def test_flags_of_an_outcome_stay_until_the_next() -> None:
    bench = Bench("COM4", "modbus-rtu-master", [poll(every=200 * MS)], w9=3)
    assert bench.bit(RUNNING) == 1  # executed in the scan that begins with RUN
    bench.run(45 * MS)
    assert (bench.bit(RUNNING), bench.bit(COMMUNICATION_ERROR), bench.bit(TIMED_OUT)) == (1, 0, 0)
    assert bench.port_registers.active
    bench.run(55 * MS)
    assert (bench.bit(RUNNING), bench.bit(COMMUNICATION_ERROR), bench.bit(TIMED_OUT)) == (0, 1, 1)
    assert not bench.port_registers.active
    assert (bench.plc.read("M8063"), bench.plc.read("D8063")) == (1, 7409)
    bench.run(195 * MS)
    with_slave(bench)
    bench.run(239 * MS)
    assert (bench.bit(COMMUNICATION_ERROR), bench.plc.read("M8063")) == (1, 1)
    bench.run(300 * MS)
    assert (bench.bit(RUNNING), bench.bit(COMMUNICATION_ERROR), bench.bit(TIMED_OUT)) == (0, 0, 0)
    # The next good transaction puts M8063 off; D8063 keeps the last code.
    assert (bench.plc.read("M8063"), bench.plc.read("D8063")) == (0, 7409)


def test_stop_forgets_the_transaction() -> None:
    bench = Bench("COM4", "modbus-rtu-master", [poll()])
    with_slave(bench)
    bench.run(30 * MS)
    bench.stop_plc()
    assert (bench.bit(RUNNING), bench.port_registers.active, bench.port_registers.engine) == (0, False, None)
    bench.run(100 * MS)
    assert not bench.of(TransactionTaken)
    bench.run_plc()
    bench.run(145 * MS)
    assert [item.taken for item in bench.of(TransactionTaken)] == [140 * MS]


def test_a_power_cycle_leaves_no_port_with_the_old_memory() -> None:
    bench = Bench("COM4", "modbus-rtu-master", [poll()])
    plain = with_slave(bench)
    plain.items[Space.HOLDING][0] = 5
    bench.run(45 * MS)
    old = bench.plc.memory
    bench.stop_plc()
    bench.plc.power_off(bench.wire.now)
    bench.plc.power_on()
    assert bench.plc.read("D500") == 5  # latched
    plain.items[Space.HOLDING][0] = 6
    bench.run_plc()
    bench.run(100 * MS)
    assert bench.plc.memory is not old
    assert (bench.plc.read("D500"), old.word("D", 500)) == (6, 5)


# -- several instructions --------------------------------------------------------------------------


def test_one_instruction_of_a_port_is_driven_at_a_time() -> None:
    """The one that has the port keeps it while its contact is on; the other has it in the next scan."""
    found: list[tuple[int, Drive, Drive]] = []

    def program(bench: Bench, now: int) -> None:
        one, other = Rs2(D[200], 0, D[202], D[500], 4), Rs2(D[201], 0, D[202], D[500], 4)
        ports = bench.program_ports
        first = ports.rs2("one", one, now, driven=now < 60 * MS)
        found.append((now // MS, first, ports.rs2("other", other, now, driven=True)))

    registers = {"D200": 0x0103, "D201": 0x0203, "D202": 1}
    bench = Bench("COM4", "modbus-rtu-master", program=program, registers=registers)
    with_slave(bench, stations=(1, 2))
    bench.run(140 * MS)
    assert [(start // MS, chars[0]) for start, chars in bench.requests()] == [
        (10, 1),
        (50, 1),
        (90, 2),
        (130, 2),
    ]
    assert [when for when, _, other in found if other is Drive.BUSY] == [10, 20, 30, 40, 50]
    assert [first for _, first, _ in found] == [Drive.RUNNING] * 5 + [Drive.OFF] * 9


def test_an_instruction_that_goes_off_before_its_request_left_asks_nothing() -> None:
    def program(bench: Bench, now: int) -> None:
        on = now <= 10 * MS or now == 40 * MS + SCAN
        bench.program_ports.rs2("one", Rs2(D[200], 0, D[202], D[500], 4), now, driven=on)

    registers = {"D200": 0x0103, "D202": 1}
    # With an interval of 20 ms the second request could leave at 60 ms; it goes off at that very END.
    bench = Bench("COM4", "modbus-rtu-master", program=program, registers=registers, w2=200)
    with_slave(bench)
    bench.run(59 * MS)
    assert bench.bit(RUNNING) == 1
    bench.run(300 * MS)
    assert len(bench.requests()) == 1
    assert len(bench.of(TransactionTaken)) == 1  # the first one's contact went off while it ran
    assert bench.bit(RUNNING) == 0


@pytest.mark.parametrize("port", [0, 1, 3, 7, Device("D", 300)])
def test_rs2_is_refused_where_there_is_no_port_for_it(port: int | Device) -> None:
    bench = Bench("COM4", "modbus-rtu-master")
    assert bench.program_ports.rs2(0, Rs2(D[200], 0, D[202], D[500], port), 5, driven=True) is Drive.REFUSED
    bench = Bench("COM4", "modbus-rtu-slave")
    assert bench.program_ports.rs2(0, Rs2(D[200], 0, D[202], D[500], 4), 5, driven=True) is Drive.REFUSED
    bench = Bench("COM2", "hmi")
    assert bench.program_ports.rs2(0, Rs2(D[200], 0, D[202], D[500], 2), 5, driven=True) is Drive.REFUSED


def test_operands_may_be_registers_and_n_a_number() -> None:
    def program(bench: Bench, now: int) -> None:
        operands = Rs2(D[200], D[201], D[202], 500, Device("D", 203))
        bench.program_ports.rs2("one", operands, now, driven=True)

    registers = {"D200": 0x0103, "D201": 0x20, "D202": 1, "D203": 4}
    bench = Bench("COM4", "modbus-rtu-master", program=program, registers=registers)
    plain = with_slave(bench)
    plain.items[Space.HOLDING][0x20] = 1234
    bench.run(60 * MS)
    assert bench.plc.read("D500") == 1234


def test_a_response_to_another_request_is_taken_as_on_a_real_wire() -> None:
    """RTU carries no transaction number: the port takes a late response for its own."""
    bench = Bench("COM4", "modbus-rtu-master", [poll(3, 0, 1)], w9=3)
    bench.run(61 * MS)
    assert len(bench.requests()) == 2
    late = RTU.encode(1, encode_response(Response(3, 77, 1, (42,)))).chars
    bench.wire.receive(late, 70 * MS)
    bench.run(100 * MS)
    assert bench.outcomes() == [PortError.TIMEOUT, None]
    assert bench.plc.read("D500") == 42
