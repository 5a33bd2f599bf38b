"""PLC ports on buses beside the link: whole scans, shared scans, and what a slave shows of its memory."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import pytest

import bussim
from bussim.devices.free.scripted import Message
from bussim.devices.map.model import MapSettings
from bussim.line.characters import NN_LINE
from bussim.line.protocols import BusProtocol
from bussim.plc.memory import parse_device
from bussim.plc.ports.spec import FreeSpec, PollSpec
from bussim.plc.profiles import PROFILES, Reply
from bussim.plc.program.program import Program
from bussim.scenario import fault_kinds, model
from tests.sim.build import MS, SECOND, Done, fault, run, steady
from tests.sim.serial import FREE, MASTER, PLAIN, SLAVE, device, hmi, plc, poll, port, scripted, serial_bus

CHAR = PLAIN.characters(1)
SCAN = 8 * MS
#: The execution time that a transaction adds to each scan.
EXTRA = PROFILES["pw10"].transaction_time


def read(name: str = "r", to: str | None = "D400", **given: object) -> PollSpec:
    values = {"station": 1, "function": 3, "address": 0, "count": 2, **given}
    return PollSpec(name, "COM3", device=parse_device(to) if to else None, **values)  # type: ignore[arg-type]


def outcomes(done: Done) -> Counter[str]:
    return Counter(record.outcome for record in done.record.transactions)


# -- whole scans ------------------------------------------------------------------------------------


def test_a_transaction_costs_whole_scans() -> None:
    press = plc("press", port("COM3", MASTER), polls=[read()], phase=SCAN)
    done = run(serial_bus([device("drive", "map", settings=_ones())], [press], seconds=3))
    first, second = done.record.transactions[:2]
    # Executed in the scan from RUN to the first END, which sends it.
    assert first.sent == SCAN
    # 8 characters out, 3.5 of silence, 9 back, 3.5 of silence: 25 ms, taken over at the fourth END after.
    assert first.end == SCAN + round(24 * PLAIN.character)
    assert first.taken == SCAN + 4 * (SCAN + EXTRA)
    # The next instruction is executed in the scan that begins there (with nothing on the wire, without EXTRA).
    assert second.sent == first.taken + SCAN
    assert set(outcomes(done)) == {"ok"}


def _ones() -> MapSettings:
    from bussim.devices.map.map import Entry
    from bussim.devices.map.values import Fixed
    from bussim.engines.modbus.pdu import FUNCTIONS
    from bussim.engines.modbus.server import Space

    return MapSettings((Entry(Space.HOLDING, 0, Fixed(7), 10, writable=True),), FUNCTIONS)


def test_data_reach_memory_at_end_and_not_before() -> None:
    press = plc("press", port("COM3", MASTER), polls=[read(count=2)], phase=SCAN)
    scenario = serial_bus([device("drive", "map", settings=_ones())], [press], seconds=3)
    from tests.sim.build import started

    simulation, recorder = started(scenario)
    simulation.run(3 * SCAN)
    memory = simulation.plcs["press"].memory
    assert memory.word("D", 400) == 0
    simulation.run(SECOND)
    taken = recorder.transactions[0].taken
    assert memory.word("D", 400) == memory.word("D", 401) == 7
    assert memory.word("D", 402) == 0
    simulation, _ = started(scenario)
    simulation.run(taken)  # everything before that tick
    assert simulation.plcs["press"].memory.word("D", 400) == 0
    simulation.run(taken + 1)
    assert simulation.plcs["press"].memory.word("D", 400) == 7


def test_a_write_takes_its_data_at_the_end_that_sends_it() -> None:
    write = PollSpec("w", "COM3", 1, 6, 3, 1, parse_device("D10"))
    from bussim.plc.sources import Counter as Counting

    press = plc("press", port("COM3", MASTER), polls=[write], sources={"D10": Counting(MS)})
    done = run(serial_bus([device("drive", "map", settings=_ones())], [press], seconds=2))
    for frame in (f for f in done.record.frames if f.kind == "request"):
        assert int.from_bytes(frame.chars[4:6], "big") == frame.start // MS


def test_the_manuals_rs2_examples() -> None:
    # Section 2.2: MOV H0103 D103, MOV K10 D400, RS2 D103 H0004 D400 D500 K4.
    polls = [
        PollSpec("one", "COM3", 1, 3, 100, 4, parse_device("D4")),
        PollSpec("two", "COM3", 1, 3, 4, 10, parse_device("D500")),
    ]
    done = run(serial_bus([], [plc("press", port("COM3", MASTER), polls=polls)], seconds=2))
    sent = {f.chars.hex(" ").upper() for f in done.record.frames}
    assert sent == {"01 03 00 64 00 04 05 D6", "01 03 00 04 00 0A 84 0C"}


def test_two_ports_of_one_plc_share_its_scan() -> None:
    third = port("COM3", MASTER), port("COM5", MASTER, "other")
    polls = [read(), replace(read("s"), port="COM5", device=parse_device("D500"))]
    press = plc("press", *third, polls=polls, phase=SCAN)
    scenario = serial_bus([device("a", "map", settings=_ones())], [press], seconds=3)
    other = device("b", "map", settings=_ones(), bus="other")
    scenario = replace(
        scenario,
        buses=(*scenario.buses, model.Bus("other", BusProtocol.SERIAL, PLAIN)),
        devices=(*scenario.devices, other),
    )
    done = run(scenario)
    first = {r.poll: r for r in done.record.transactions[:2]}
    assert first["r"].sent == first["s"].sent == SCAN
    # With both under way a scan lasts longer by twice as much, and the third one ends late enough.
    assert first["r"].end <= SCAN + 3 * (SCAN + 2 * EXTRA) == first["r"].taken
    assert done.totals.plcs[0].scan_max == SCAN + 2 * EXTRA


# -- slaves -----------------------------------------------------------------------------------------


def test_an_hmi_reads_the_plc_of_com2() -> None:
    registers = {"D8121": 5, "D100": 1234, "M7": 1}
    press = plc("press", port("COM2", SLAVE), registers=registers)
    polls = (
        poll("word", 5, 3, 100),
        poll("bit", 5, 1, 7),
        poll("x", 5, 1, 0xF800),
        poll("write", 5, 5, 0xF800, values=(1,)),
    )
    done = run(serial_bus([hmi("panel", *polls)], [press], seconds=5))
    exceptions = {r.poll: r.exception for r in done.record.transactions}
    assert exceptions == {"word": 0, "bit": 0, "x": 0, "write": 2}
    responses = {f.chars[1]: f.chars for f in done.record.frames if f.sender == "press.COM2"}
    assert responses[3][3:5] == (1234).to_bytes(2, "big")
    counted = done.totals.ports[0]
    assert (counted.node, counted.station, counted.protocol) == ("press.COM2", 5, SLAVE)
    assert counted.requests == counted.answered
    assert set(counted.exceptions) == {2}


def test_one_plc_asks_another() -> None:
    asks = plc("asks", port("COM3", MASTER), polls=[read(station=2, address=30, count=1)])
    responses = plc("slave", port("COM4", SLAVE, station=2), registers={"D30": 99}, scan=5 * MS)
    done = run(serial_bus([], [asks, responses], seconds=3))
    assert set(outcomes(done)) == {"ok"}
    assert done.simulation.plcs["asks"].memory.word("D", 400) == 99


def test_stop_silences_and_run_begins_anew() -> None:
    press = plc("press", port("COM3", MASTER), polls=[read()])
    stop = fault(fault_kinds.Stop("press"), 1, 1)
    done = run(serial_bus([device("drive", "map", settings=_ones())], [press], seconds=4, faults=[stop]))
    starts = [f.start / SECOND for f in done.record.frames if f.kind == "request"]
    assert not any(1 < at < 2 for at in starts)
    assert max(starts) > 3.8
    off = fault(fault_kinds.PowerOff("press"), 1, 1)
    done = run(serial_bus([device("drive", "map", settings=_ones())], [press], seconds=4, faults=[off]))
    assert done.simulation.plcs["press"].memory.word("D", 400) == 7


def test_a_dead_device_costs_timeouts_and_sets_the_ports_error() -> None:
    press = plc("press", port("COM3", MASTER, timeout=5), polls=[read(retries=2, every=SECOND)])
    done = run(serial_bus([], [press], seconds=5))
    assert outcomes(done) == {"no response in time": 15}
    assert [r.attempt for r in done.record.transactions[:4]] == [1, 2, 3, 1]
    assert {turn.attempts for turn in done.record.turns} == {3}
    plc_totals = done.totals.plcs[0]
    assert (plc_totals.registers["D8063"], plc_totals.registers["M8063"]) == (7309, 1)
    assert done.totals.ports[0].errors == {9: 15}


# -- free protocol ----------------------------------------------------------------------------------


def test_the_manuals_free_protocol_example_sends_01_to_05() -> None:
    registers = {"D200": 0x0201, "D201": 0x0403, "D202": 0x0005}
    spec = FreeSpec("say", "COM3", parse_device("D200"), 5, every=SECOND)
    press = plc("press", port("COM3", FREE), polls=[spec], registers=registers)
    done = run(serial_bus([], [press], seconds=3))
    assert {r.data for r in done.record.said} == {bytes((1, 2, 3, 4, 5))}
    assert {f.chars for f in done.record.frames} == {bytes((1, 2, 3, 4, 5))}


def test_a_barcode_reader_with_an_end_character() -> None:
    reader = scripted("reader", Message(b"4006381333931\r", at=500 * MS, every=SECOND))
    spec = FreeSpec("scan", "COM5", device=parse_device("D300"), count=20)
    press = plc("press", port("COM5", FREE, end=0x0D), polls=[spec])
    done = run(serial_bus([reader], [press], seconds=4))
    got = [r for r in done.record.said if r.direction == "received"]
    assert [(r.node, r.poll, r.data, r.ended) for r in got] == 4 * [
        ("press.COM5", "scan", b"4006381333931", "end character")
    ]
    memory = done.simulation.plcs["press"].memory
    words = [memory.word("D", 300 + n) for n in range(7)]
    assert b"".join(word.to_bytes(2, "little") for word in words)[:13] == b"4006381333931"


# -- with the link ----------------------------------------------------------------------------------


def _link_and_port(*, reply: Reply, busy: bool, seconds: float = 20) -> Done:
    profile = steady(reply=reply)
    master = {"D8177": 1, "D8178": 0, "D8179": 3, "D8180": 5, "M8179": 1}
    link = model.LinkAttachment("link", "COM4")
    ports = [port("COM3", MASTER)] if busy else []
    polls = [read(every=0)] if busy else []
    plcs = [
        plc("p0", registers={**master, "D8176": 0}, link=link, profile=profile),
        plc(
            "p1",
            *ports,
            polls=polls,
            registers={"D8176": 1, "M8179": 1},
            link=link,
            profile=profile,
            jitter=MS,
        ),
    ]
    devices = [device("drive", "map", settings=_ones())] if busy else []
    scenario = serial_bus(devices, plcs, seconds=seconds)
    return run(
        replace(scenario, buses=(model.Bus("link", BusProtocol.NN, NN_LINE), *scenario.buses)), traced=False
    )


@pytest.mark.slow
def test_a_busy_port_is_seen_in_the_link_only_where_replies_wait_for_end() -> None:
    quiet, busy = (_link_and_port(reply=Reply.INTERRUPT, busy=busy) for busy in (False, True))
    assert quiet.durations == busy.durations
    quiet, busy = (_link_and_port(reply=Reply.END, busy=busy) for busy in (False, True))
    assert quiet.durations != busy.durations
    # Replies are whole PLC scans apart: a scan that is longer by EXTRA while a transaction runs may bring
    # the next reply an END earlier or later.
    scans = [done.totals.plcs[1].scan_mean for done in (quiet, busy)]
    assert scans[0] < scans[1] < scans[0] + EXTRA  # type: ignore[operator]


def test_polled_data_travel_over_the_link() -> None:
    link = model.LinkAttachment("link", "COM4")
    master = {"D8176": 0, "D8177": 1, "D8178": 1, "D8180": 5, "M8179": 1}
    # D32 is the first word of station 1's own block.
    ports = [port("COM3", MASTER)]
    plcs = [
        plc("p0", registers=master, link=link),
        plc(
            "p1",
            *ports,
            polls=[read(to="D32", count=1)],
            registers={"D8176": 1, "M8179": 1},
            link=link,
        ),
    ]
    scenario = serial_bus([device("drive", "map", settings=_ones())], plcs, seconds=2)
    done = run(replace(scenario, buses=(model.Bus("link", BusProtocol.NN, NN_LINE), *scenario.buses)))
    simulation = done.simulation
    simulation.plcs["p0"].sync(simulation.now)
    assert simulation.plcs["p0"].memory.word("D", 32) == 7


@pytest.mark.parametrize("seed", range(4))
def test_the_same_seed_gives_the_same_run(seed: int) -> None:
    press = plc("press", port("COM3", MASTER), polls=[read(), read("q", "D500", address=3)], jitter=2 * MS)
    noise = model.Noise("n", model.Target("bus"), model.BitErrors(3e-4))
    scenario = serial_bus(
        [device("drive", "map", settings=_ones())], [press], seconds=5, seed=seed, noise=[noise]
    )
    one, other = run(scenario), run(scenario, traced=False)
    assert one.record.transactions == other.record.transactions
    assert one.totals == other.totals


@pytest.mark.parametrize("program", [None, "LD M8000\nRS2 D100 K0 D300 K52 K3\nEND\n"])
def test_ends_during_an_unbroken_reception_show_it_and_take_longer(program: str | None) -> None:
    # 52 characters at 9600 8N1 take 54.2 ms: five ENDs of scans of 10 ms and 1 ms for the reception.
    profile = replace(PROFILES["pw10"], transaction_time=MS)
    reader = scripted("reader", Message(b"AB" * 26, at=105 * MS))
    spec = FreeSpec("hear", "COM3", device=parse_device("D300"), count=52)
    press = plc("press", port("COM3", FREE), scan=10 * MS, phase=10 * MS, profile=profile)
    press = replace(press, polls=() if program else (spec,), observed=("M2924", "M2923"))
    if program:
        press = replace(press, program=Program.parse(program, "a.il"))
    seen = bussim.run(serial_bus([reader], [press], seconds=1)).values
    receiving = seen[seen["device"] == "M2924"].set_index("value")["time_s"]
    assert 0.055 <= receiving[0] - receiving[1] < 0.056  # beside what the instructions take


def test_a_response_that_was_refused_is_no_mismatched_one() -> None:
    # The response to the request before is under way when the next one leaves, and is damaged by it.
    polls = [read("a", count=4, retries=1), read("b", address=4, count=4, to="D410", retries=1)]
    slow = device("drive", "map", settings=_ones(), delay=50 * MS, jitter=15 * MS)
    press = plc("press", port("COM3", MASTER, timeout=6, interval=10), polls=polls, scan=3 * MS)
    done = bussim.run(serial_bus([slow], [press], seconds=30))
    rows = done.transactions
    assert "framing" in set(rows["outcome"])
    assert rows["mismatched"].sum() == done.summary["ports"]["press.COM3"]["mismatched_responses"]
