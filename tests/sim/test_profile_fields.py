"""What a profile assumes of ports and programs: each field, set in a scenario file, changes what happens."""

from __future__ import annotations

import pytest

from bussim.scenario.loader import loads
from tests.sim.build import MS, SECOND, Done, run

#: A master that asks a register map all the time, and a slave on COM2 that a panel asks.
TEXT = """\
schema: 1
name: fields
duration: 2 s
buses:
  - {name: line, baud: 9600, format: 8N1}
  - {name: panel, baud: 9600, format: 8N1}
plcs:
  - name: p1
    profile: PROFILE
    scan: 8 ms
    phase: 3 ms
    ports:
      COM2: {bus: panel, protocol: modbus-rtu-slave}
      COM3: {bus: line, protocol: modbus-rtu-master, timeout: 30 ms}
    polls:
      - {name: ask, port: COM3, station: 1, function: 3, address: 0, count: 2, to: D400}
devices:
  - {name: map, model: map, bus: line, station: 1, delay: 5 ms, registers: [{address: 0, count: 30, value: 7}]}
  - {name: screen, model: hmi, bus: panel, polls: [{station: 1, function: 3, address: 0, every: 100 ms}]}
"""
ASK = "station: 1, function: 3, address: 0, count: 2, to: D400"
CHAR = 10 * SECOND // 9600


def done(profile: str = "", *changes: tuple[str, str]) -> Done:
    text = TEXT.replace("PROFILE", f"{{base: pw10{profile and ', '}{profile}}}")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return run(loads(text))


def outcomes(found: Done, master: str) -> set[str]:
    return {record.outcome for record in found.record.transactions if record.master == master}


@pytest.mark.parametrize(("field", "extra"), [("", 0.2), ("transaction_time: 1.5 ms", 1.5)])
def test_transaction_time(field: str, extra: float) -> None:
    found = done(field, ("      COM2: {bus: panel, protocol: modbus-rtu-slave}\n", ""))
    assert found.totals.plcs[0].scan_max == round((8 + extra) * MS)


@pytest.mark.parametrize(("field", "pause"), [("", 100), ("broadcast_turnaround: 137 ms", 137)])
def test_broadcast_turnaround(field: str, pause: int) -> None:
    polls = (
        "station: 1, function: 3, address: 0, count: 2, to: D400",
        "station: 0, function: 6, address: 0, values: [1]",
    )
    sent = [r for r in done(field, (ASK, polls[1])).record.transactions if r.master == "p1.COM3"]
    assert {r.end - r.asked for r in sent if r.asked is not None} == {pause * MS}


@pytest.mark.parametrize(("field", "characters"), [("", 3.5), ("rtu_gaps: {end: 6}", 6)])
def test_the_silence_that_ends_a_frame(field: str, characters: float) -> None:
    found = [r for r in done(field).record.transactions if r.master == "p1.COM3"]
    assert {r.end - r.answer_end for r in found if r.answer_end} == {round(characters * CHAR)}


@pytest.mark.parametrize(
    ("field", "silence"),
    [
        ("", 1.75 * MS),
        ("rtu_gaps: {fast_character: 1 ms}", 3.5 * MS),
        ("rtu_gaps: {fast_character: none}", 3.5 * 10 * SECOND / 115200),
    ],
)
def test_the_silence_above_19200_bps(field: str, silence: float) -> None:
    fast = done(field, ("{name: line, baud: 9600", "{name: line, baud: 115200"))
    found = [r for r in fast.record.transactions if r.master == "p1.COM3"]
    assert {r.end - r.answer_end for r in found if r.answer_end} == {round(silence)}


LOST = "faults: [{at: 0 s, for: 2 s, lose_char: {station: p1.COM3, direction: rx, index: 1}}]\n"


@pytest.mark.parametrize(
    ("protocol", "field", "outcome", "characters"),
    [
        # The lost second character is a silence of one inside the frame, which may or may not cut it there.
        ("rtu", "", "CRC or LRC", 9),
        ("rtu", "rtu_gaps: {inner: 0.9}", "frame length", 9),
        ("ascii", "", "frame length", 19),
        ("ascii", "ascii_gap: 1 ms", "frame length", 1),
    ],
)
def test_the_silence_inside_a_frame(protocol: str, field: str, outcome: str, characters: int) -> None:
    found = done(
        field,
        ("modbus-rtu-master", f"modbus-{protocol}-master"),
        ("model: map, bus", f"model: map, mode: {protocol}, bus"),
        ("devices:\n", LOST + "devices:\n"),
    )
    assert outcomes(found, "p1.COM3") == {outcome}
    heard = next(record for record in found.record.transactions if record.master == "p1.COM3")
    assert heard.answer_start is not None
    assert heard.answer_end is not None
    assert heard.answer_end - heard.answer_start == characters * CHAR


@pytest.mark.parametrize(("field", "outcome"), [("", "no response in time"), ("begun_holds: true", "ok")])
def test_begun_holds(field: str, outcome: str) -> None:
    # 45 characters take 46.9 ms: the response begins before the timeout of 30 ms and ends behind it. The
    # interval keeps the next request out of its way.
    late = done(
        field, ("count: 2, to", "count: 20, to"), ("timeout: 30 ms}", "timeout: 30 ms, interval: 50 ms}")
    )
    assert outcomes(late, "p1.COM3") == {outcome}


@pytest.mark.parametrize(("backlog", "ignored"), [(0, True), (1, False)])
def test_slave_backlog(backlog: int, *, ignored: bool) -> None:
    # The panel gives up and asks again before the PLC's scan of 90 ms has come to its END.
    found = done(
        f"slave_backlog: {backlog}",
        ("scan: 8 ms", "scan: 90 ms"),
        ("phase: 3 ms", "phase: 80 ms"),
        ("every: 100 ms", "every: 200 ms, retries: 1"),
        ("model: hmi, bus: panel,", "model: hmi, bus: panel, timeout: 20 ms,"),
    )
    port = next(port for port in found.totals.ports if port.node == "p1.COM2")
    assert port.requests > 10
    assert ("busy with another request" in port.rejected) is ignored


@pytest.mark.parametrize(("number", "responds"), [(1, True), (2, False)])
def test_com2_station(number: int, *, responds: bool) -> None:
    found = done(f"com2_station: {number}")
    assert (outcomes(found, "screen") == {"ok"}) is responds
    assert next(port for port in found.totals.ports if port.node == "p1.COM2").station == number


FREE = (
    ("modbus-rtu-master, timeout: 30 ms", "free, start: 2, end: 3, timeout: 30 ms"),
    (
        "      - {name: ask, port: COM3, " + ASK + "}\n",
        "      - {name: ask, port: COM3, to: D400, count: 20}\n",
    ),
    (
        "{name: map, model: map, bus: line, station: 1, delay: 5 ms, registers: [{address: 0, count: 30, value: 7}]}",
        '{name: reader, model: free, bus: line, says: [{text: "\\x02AB\\x03", every: 300 ms, at: 200 ms}]}',
    ),
)


@pytest.mark.parametrize(("field", "data"), [("", b"AB"), ("free_keeps_frame: true", b"\x02AB\x03")])
def test_free_keeps_frame(field: str, data: bytes) -> None:
    found = [record for record in done(field, *FREE).record.said if record.direction == "received"]
    assert {(record.data, record.ended) for record in found} == {(data, "end character")}


@pytest.mark.parametrize(
    ("field", "ends"),
    [("", {"end character"}), ("free_awaits_first: true", {"end character", "timeout"})],
)
def test_free_awaits_first(field: str, ends: set[str]) -> None:
    found = [record for record in done(field, *FREE).record.said if record.direction == "received"]
    assert {record.ended for record in found} == ends


@pytest.mark.parametrize(
    ("field", "microseconds"),
    [
        # LD and MOV: 0.08 + 1.52 µs, and 0.08 µs for END as for every basic instruction.
        ("", None),
        ("instruction_times: {move: 500 us}", 500 - 1.52),
        ("instruction_times: {others: {MOV: 300 us}}", 300 - 1.52),
        ("instruction_times: {move: 500 us, others: {MOV: 300 us}}", 300 - 1.52),
    ],
)
def test_instruction_times(field: str, microseconds: float | None) -> None:
    program = (
        "    polls:\n      - {name: ask, port: COM3, " + ASK + "}\n",
        "    program: |\n      LD M8000\n      MOV K5 D10\n      END\n",
    )
    others = "transaction_time: 0 s"  # they would count in some scans only
    plain = done(others, program).totals.plcs[0].scan_mean
    mean = done(f"{others}{field and ', '}{field}", program).totals.plcs[0].scan_mean
    assert plain is not None
    assert mean is not None
    assert mean - plain == pytest.approx((microseconds or 0) * 72, abs=1.01)
