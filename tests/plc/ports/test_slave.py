"""A port as Modbus slave: requests are served at END, over the PLC's own devices."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bussim.devices.lx.map import LxMap
from bussim.engines.modbus.codes import PortError
from bussim.engines.modbus.events import RequestServed
from bussim.engines.modbus.framing import Framing
from bussim.engines.modbus.master import Master, MasterConfig
from bussim.engines.modbus.pdu import Request, write_register
from bussim.engines.modbus.polling import PollingMaster
from bussim.engines.modbus.polls import Poll, PollList
from bussim.engines.modbus.slave import Slave
from bussim.line.random_streams import Streams
from bussim.plc.memory import Device
from bussim.plc.plc import Plc
from bussim.plc.ports.cpavl import default_devices
from bussim.plc.ports.port_registers import PortRegisters
from bussim.plc.ports.spec import PortSpec
from bussim.plc.profiles import PROFILES
from bussim.plc.sources import Counter
from tests.plc.ports.bench import ASCII_LINE, LINE, MS, PHASE, SCAN, Bench

RTU = Framing.rtu(LINE)


def receives(bench: Bench, chars: bytes, at: int) -> int:
    """A request; returns the tick at which the port knows it."""
    bench.wire.receive(chars, at)
    return at + bench.wire.timing.characters(len(chars)) + RTU.quiet


def test_a_request_waits_for_the_end_and_is_served_there() -> None:
    bench = Bench("COM3", "modbus-rtu-slave", registers={"D7": 0x1234})
    known = receives(bench, RTU.encode(1, bytes.fromhex("03 00 07 00 01")).chars, 12 * MS)
    assert 23 * MS < known < 25 * MS
    bench.run(200 * MS)
    response = RTU.encode(1, bytes.fromhex("03 02 12 34")).chars
    assert bench.requests() == [(30 * MS, response)]
    assert bench.ends[0] == 30 * MS
    assert not bench.port_registers.active


def test_the_scan_is_longer_until_the_reply_has_left() -> None:
    bench = Bench("COM3", "modbus-rtu-slave", profile=PROFILES["pw10"])
    receives(bench, RTU.encode(1, bytes.fromhex("03 00 07 00 01")).chars, 12 * MS)
    bench.run(200 * MS)
    longer = SCAN + MS // 5
    # The reply's 7 characters take 7.3 ms from 30 ms on: one scan.
    cycle = bench.plc.cycle
    assert bench.ends == [30 * MS, 30 * MS + longer]
    cycle.count_up_to(200 * MS)
    assert (cycle.longest, cycle.total - cycle.count * SCAN) == (longer, MS // 5)


def test_it_responds_with_what_its_sources_wrote_at_that_end() -> None:
    bench = Bench("COM3", "modbus-rtu-slave", sources={"D7": Counter(MS)})
    receives(bench, RTU.encode(1, bytes.fromhex("03 00 07 00 01")).chars, 12 * MS)
    bench.run(200 * MS)
    assert bench.requests()[0][1] == RTU.encode(1, bytes.fromhex("03 02 00 1E")).chars


def test_a_write_shows_in_the_shared_block_at_once_and_stays() -> None:
    bench = Bench("COM3", "modbus-rtu-slave", linked=True, registers={"M8179": 1, "D8178": 1, "D8177": 1})
    receives(bench, RTU.encode(1, bytes.fromhex("06 00 01 43 21")).chars, 1 * MS)
    bench.run(20 * MS)
    assert bench.plc.image_at(20 * MS)[6:8] == b"\0\0"
    bench.run(21 * MS + 1)  # N:N makes the scan 11 ms
    assert bench.plc.image_at(21 * MS)[6:8] == b"\x43\x21"
    bench.plc.sync(25 * MS)
    assert bench.plc.image_at(25 * MS)[6:8] == b"\x43\x21"
    assert bench.plc.read("D1") == 0x4321


@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("mode", ["rtu", "ascii"])
def test_a_master_reads_and_writes_the_plcs_devices(mode: str, *, whole: bool) -> None:
    line = LINE if mode == "rtu" else ASCII_LINE
    bench = Bench("COM2", f"modbus-{mode}-slave", line=line, whole=whole, registers={"D8121": 9, "D100": 55})
    framing = RTU if mode == "rtu" else Framing.ascii()
    polls = [Poll(9, Request(3, 100, 1)), Poll(9, write_register(101, 66)), Poll(9, Request(3, 9000, 1))]
    master = PollingMaster(MasterConfig(framing, 200 * MS), PollList(polls))
    bench.add(master)
    bench.run(2000 * MS)
    ended = [item for engine, item in bench.wire.events if engine is master and hasattr(item, "response")]
    assert len(ended) > 10
    assert [(item.error, item.response and item.response.values) for item in ended[:3]] == [
        (None, (55,)),
        (None, (66,)),
        (PortError.ADDRESS, None),
    ]
    assert bench.plc.read("D101") == 66
    # Every reply begins at an END (of 10 ms scans); each refused address is a port error.
    assert {start % SCAN for start, _ in bench.requests()} == {PHASE % SCAN}
    assert set(bench.errors()) == {7202}
    served = [item for engine, item in bench.wire.events if isinstance(item, RequestServed)]
    assert {item.exception for item in served} == {0, 2}


OF_ONE = RTU.encode(1, bytes.fromhex("03 00 00 00 01")).chars
DAMAGED = OF_ONE[:-1] + bytes([OF_ONE[-1] ^ 1])


@pytest.mark.parametrize(
    ("chars", "expected"),
    [
        (RTU.encode(1, bytes.fromhex("03 20 40 00 01")).chars, [7302]),  # no such register
        (RTU.encode(1, bytes.fromhex("04 00 00 00 01")).chars, [7304]),  # no such function
        (DAMAGED, [7303]),
        (OF_ONE[:3], [7301]),
        (bytes(300), [7307]),
        (RTU.encode(1, bytes.fromhex("03 00 00 00 7E")).chars, []),  # exception 03: 6 is a master's
        (RTU.encode(2, bytes.fromhex("03 20 40 00 01")).chars, []),  # another station's
        (OF_ONE, []),
    ],
)
def test_a_slave_port_raises_errors_of_damaged_and_refused_requests(
    chars: bytes, expected: list[int]
) -> None:
    for profile in (PROFILES["pw10"], replace(PROFILES["pw10"], slave_errors=False)):
        bench = Bench("COM3", "modbus-rtu-slave", profile=profile)
        receives(bench, chars, 1 * MS)
        bench.run(800 * MS)
        bench.collect()
        found = expected if profile.slave_errors else []
        assert bench.errors() == found
        assert bench.plc.read("M8063") == len(found)
        receives(bench, OF_ONE, 801 * MS)
        bench.run(900 * MS)
        # A request that is served ends it; the number stays.
        assert (bench.plc.read("M8063"), bench.plc.read("D8063")) == (0, *(found or [0]))


def test_a_broadcast_is_carried_out_at_end_without_a_response() -> None:
    bench = Bench("COM3", "modbus-rtu-slave")
    receives(bench, RTU.encode(0, bytes.fromhex("06 00 01 43 21")).chars, 1 * MS)
    bench.run(19 * MS)
    assert bench.plc.read("D1") == 0
    bench.run(100 * MS)
    assert (bench.plc.read("D1"), bench.requests(), bench.port_registers.active) == (0x4321, [], False)


def test_stop_forgets_a_request() -> None:
    bench = Bench("COM3", "modbus-rtu-slave")
    receives(bench, RTU.encode(1, bytes.fromhex("06 00 01 43 21")).chars, 12 * MS)
    bench.run(29 * MS)
    bench.stop_plc()
    bench.run(50 * MS)
    bench.run_plc()
    bench.run(200 * MS)
    assert (bench.requests(), bench.plc.read("D1")) == ([], 0)


def test_two_ports_share_the_plcs_scan_and_memory() -> None:
    devices = {port: default_devices(port) for port in ("COM3", "COM5")}
    registers = {}
    for words, _ in devices.values():
        registers |= {f"D{words.address + 1}": 3, f"D{words.address + 6}": 2}
    plc = Plc(
        "press",
        PROFILES["pw10"],
        scan_mean=SCAN,
        scan_jitter=0,
        phase=PHASE,
        registers=registers,
        sources={},
        linked=False,
        streams=Streams(1),
        ports=[PortSpec(port, port, *device) for port, device in devices.items()],
        maps=LxMap,
    )
    plc.power_on()
    plc.run(0, traced=False)
    assert plc.longest_scan() == sum(plc.scan_under_link()) + 2 * PROFILES["pw10"].transaction_time
    for name, port_registers in plc.port_registers.items():
        engine = port_registers.engine
        engine.start(0)
        address = 1 if name == "COM3" else 2
        chars = RTU.encode(3, bytes((6, 0, address, 0, 9)))
        engine.receive_frame(chars, 0, 8 * MS)
        engine.line_idle(9 * MS)
    assert plc.wanted_end(9 * MS) == PHASE
    plc.end(PHASE)
    assert (plc.read("D1"), plc.read("D2")) == (9, 9)
    assert plc.cycle.next_end(PHASE + 1, PHASE) == PHASE + SCAN + 2 * PROFILES["pw10"].transaction_time


def test_misuse() -> None:
    with pytest.raises(ValueError, match="20 words from D8250"):
        PortRegisters(
            PortSpec("COM3", "b", Device("D", 8250), default_devices("COM3")[1]), [], PROFILES["pw10"]
        )
    with pytest.raises(ValueError, match="20 bits from M3060"):
        PortRegisters(
            PortSpec("COM3", "b", default_devices("COM3")[0], Device("M", 3060)), [], PROFILES["pw10"]
        )


def test_cpavl_moves_the_words_and_bits_from_the_next_run_on() -> None:
    bench = Bench("COM3", "modbus-rtu-slave")
    assert bench.program_ports.cpavl(Device("D", 300), Device("M", 0), 3)
    assert not bench.program_ports.cpavl(Device("D", 0), Device("M", 0), 4)
    assert not bench.program_ports.cpavl(Device("D", 8250), Device("M", 0), 3)
    assert isinstance(bench.port_registers.engine, Slave)
    bench.plc.memory.set_word("D", 306, 0x20)
    bench.stop_plc()
    bench.run_plc()
    assert isinstance(bench.port_registers.engine, Master)
