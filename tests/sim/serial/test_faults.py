"""Every fault of a scenario file on a bus beside the link: at a PLC's port, whichever it is, and at a device."""

from __future__ import annotations

from collections import Counter
from math import comb, sqrt

import pytest

from bussim.scenario.loader import loads
from tests.sim.build import MS, SECOND, Done, run

#: A PLC that asks a map and another PLC in turn; neither takes part in N:N.
TEXT = """\
schema: 1
name: faults
duration: 6 s
buses:
  - {name: line, baud: 9600, format: 8N1, contention: CONTENTION}
plcs:
  - name: p1
    scan: 8 ms
    ports: {MASTER: {bus: line, protocol: modbus-rtu-master, timeout: 100 ms}}
    polls:
      - {name: map, port: MASTER, station: 1, function: 3, address: 0, count: 4, to: D400, every: 100 ms}
      - {name: plc, port: MASTER, station: 2, function: 3, address: 0, count: 4, to: D404, every: 100 ms}
  - name: p2
    scan: 5 ms
    ports: {COM3: {bus: line, protocol: modbus-rtu-slave, station: 2}}
devices:
  - {name: box, model: map, bus: line, station: 1, registers: [{address: 0, count: 4, value: 7}]}
"""
CHAR = 10 * SECOND // 9600
#: When the faults act: from 2 s to 4 s. What was asked before and has its response inside is left out.
AT = "at: 2 s, for: 2 s"
FROM, UNTIL = round(2.05 * SECOND), round(3.85 * SECOND)


def done(*faults: str, port: str = "COM3", noise: str = "", contention: str = "undefined") -> Done:
    text = TEXT.replace("MASTER", port).replace("CONTENTION", contention) + (
        f"noise: [{noise}]\n" if noise else ""
    )
    return run(loads(text + (f"faults: [{', '.join(faults)}]\n" if faults else "")))


def outcomes(found: Done, poll: str) -> Counter[str]:
    """What became of a poll while the fault lasted; before and after it, all must be well."""
    inside: Counter[str] = Counter()
    for record in found.record.transactions:
        if record.poll != poll or record.sent is None:
            continue
        if FROM < record.sent < UNTIL:
            inside[record.outcome] += 1
        elif record.sent < 1.8 * SECOND or record.sent > 4.2 * SECOND:
            assert record.outcome == "ok"
    assert sum(inside.values()) >= 7
    return inside


def test_without_faults_all_is_well() -> None:
    found = done()
    assert set(outcomes(found, "map")) == set(outcomes(found, "plc")) == {"ok"}


@pytest.mark.parametrize("port", ["COM2", "COM3", "COM4", "COM5", "COM6"])
def test_any_port_of_the_master_can_be_named(port: str) -> None:
    found = done(
        f"{{{AT}, flip_bits: {{station: p1.{port}, direction: rx, bits: [9], frame: response}}}}", port=port
    )
    # Bit 9 is the first character's stop bit: framing, 08.
    assert set(outcomes(found, "map")) == set(outcomes(found, "plc")) == {"framing"}
    assert set(found.totals.ports[0].errors) == {8}
    assert found.registers("p1")["D8063"] == 7008 + 100 * int(port[3])


@pytest.mark.parametrize(
    ("fault", "box", "other"),
    [
        # What strikes one slave leaves the other's polls alone.
        ("power_off: box", "no response in time", "ok"),
        ("power_off: p2", "ok", "no response in time"),
        ("stop: p2", "ok", "no response in time"),
        ("drop_reply: box", "no response in time", "ok"),
        ("drop_reply: p2.COM3", "ok", "no response in time"),
        ("wrong_format: {station: p2.COM3, baud: 19200}", "ok", "no response in time"),
        ("cable_cut: {bus: line, after: p1.COM3}", "no response in time", "no response in time"),
        ("cable_cut: {bus: line, after: p2.COM3}", "no response in time", "ok"),
        ("clock_ppm: {station: box, ppm: 80000}", "no response in time", "ok"),
        # Characters: 01 03 08, 4 × 00 07, CRC.
        ("lose_char: {station: box, direction: tx, index: 5}", "frame length", "ok"),
        ("lose_char: {station: p1.COM3, direction: tx, index: 5}", "no response in time", "no response in time"),
        ("lose_char: {station: box, direction: rx, index: 5}", "no response in time", "ok"),
        ("insert_char: {station: box, direction: tx, index: 5, value: 9}", "frame length", "ok"),
        ("insert_char: {station: p2.COM3, direction: rx, index: 5, value: 9}", "ok", "no response in time"),
        # Bit 41 is the first data bit of the fifth character, bit 9 the first stop bit.
        ("flip_bits: {station: box, direction: tx, bits: [41]}", "CRC or LRC", "ok"),
        ("flip_bits: {station: box, direction: tx, bits: [9]}", "framing", "ok"),
        ("flip_bits: {station: box, direction: tx, bits: [41], frame: response}", "CRC or LRC", "ok"),
        ("flip_bits: {station: box, direction: tx, bits: [41], frame: request}", "ok", "ok"),
        ("flip_bits: {station: box, direction: rx, bits: [41], frame: request}", "no response in time", "ok"),
        ("flip_bits: {station: p1.COM3, direction: tx, bits: [41], frame: response}", "ok", "ok"),
        ("flip_bits: {station: p1.COM3, direction: rx, bits: [41], frame: response}", "CRC or LRC", "CRC or LRC"),
    ],
)  # fmt: skip
def test_what_a_fault_does_to_whom(fault: str, box: str, other: str) -> None:
    found = done(f"{{{AT}, {fault}}}")
    assert (set(outcomes(found, "map")), set(outcomes(found, "plc"))) == ({box}, {other})


@pytest.mark.parametrize(
    "fault",
    [
        "drop_reply: box",
        "lose_char: {station: box, direction: tx, index: 5}",
        "insert_char: {station: box, direction: tx, index: 5, value: 9}",
        "flip_bits: {station: box, direction: tx, bits: [41]}",
    ],
)
def test_a_count_is_kept(fault: str) -> None:
    found = done(f"{{at: 2 s, count: 3, {fault}}}")
    bad = [record for record in found.record.transactions if record.outcome != "ok"]
    assert [record.poll for record in bad] == ["map"] * 3


@pytest.mark.parametrize(("station", "poll"), [("box", "map"), ("p2.COM3", "plc")])
def test_slow_replies(station: str, poll: str) -> None:
    found = done(f"{{{AT}, slow: {{station: {station}, extra: 40 ms}}}}")
    assert set(outcomes(found, "map")) == set(outcomes(found, "plc")) == {"ok"}
    waits: dict[tuple[str, bool], list[int]] = {}
    for record in found.record.transactions:
        assert record.answer_start is not None
        assert record.asked is not None
        inside = FROM < (record.sent or 0) < UNTIL
        if inside or not 1.8 * SECOND < (record.sent or 0) < 4.2 * SECOND:
            waits.setdefault((record.poll, inside), []).append(record.answer_start - record.asked)
    # The map responds after its silence of 3.5 characters, the PLC at its END: a scan of 5.2 ms at most.
    silence, scan = round(3.5 * CHAR), round(5.2 * MS)
    for name in ("map", "plc"):
        most = silence if name == "map" else silence + scan
        extra = 40 * MS if name == poll else 0
        assert min(waits[name, False]) >= silence
        assert max(waits[name, False]) <= most
        assert min(waits[name, True]) >= silence + extra
        assert max(waits[name, True]) <= most + extra


def test_a_slave_that_jabbers_disturbs_every_station() -> None:
    found = done(f"{{{AT}, jabber: box}}")
    for poll in ("map", "plc"):
        assert "ok" not in outcomes(found, poll)
    assert found.totals.buses[0].collisions > 0


def test_a_driver_that_stays_on_receives_nothing_and_damages_what_begins_meanwhile() -> None:
    # From the reply of the box on: the request to the PLC, and its own next one.
    found = done(f"{{{AT}, late_release: {{station: box, by: 150 ms}}}}")
    assert set(outcomes(found, "plc")) == set(outcomes(found, "map")) == {"ok", "no response in time"}
    collided = {frame.start for frame in found.record.frames if frame.collided}
    assert {record.sent for record in found.record.transactions if record.outcome != "ok"} == collided
    assert found.totals.buses[0].collisions == len(collided)


def test_a_driver_that_stays_on_receives_nothing_and_damages_nothing_where_a_0_wins() -> None:
    # Its idle level loses against every 0, but it receives nothing while it drives: each second request.
    found = done(f"{{{AT}, late_release: {{station: box, by: 150 ms}}}}", contention="zero_wins")
    assert set(outcomes(found, "plc")) == {"ok"}
    mine = outcomes(found, "map")
    assert set(mine) == {"ok", "no response in time"}


def test_a_board_error_has_its_code_and_its_port() -> None:
    found = done("{at: 2 s, for: 10 s, board_error: {plc: p1, port: COM5, code: 43}}")
    registers = found.registers("p1")
    assert (registers["D8063"], registers["M8063"]) == (7543, 1)
    assert found.registers("p2")["M8063"] == 0
    over = done("{at: 2 s, for: 1 s, board_error: {plc: p1, port: COM5, code: 43}}").registers("p1")
    assert (over["D8063"], over["M8063"]) == (7543, 0)


def test_a_device_that_is_switched_on_late() -> None:
    found = done("{power_on: {box: 3 s}}")
    good = [record for record in found.record.transactions if record.poll == "map" and record.outcome == "ok"]
    assert 3 * SECOND < good[0].asked < 3.3 * SECOND  # type: ignore[operator] # it was sent
    assert all(r.outcome == "ok" for r in found.record.transactions if r.poll == "plc")


@pytest.mark.parametrize(
    "noise",
    [
        "{bus: line, ber: 0.01, at: 2 s, for: 2 s}",
        "{bus: line, station: p1.COM3, ber: 0.01, at: 2 s, for: 2 s}",
        "{bus: line, station: box, direction: tx, ber: 0.01, at: 2 s, for: 2 s}",
        "{bus: line, station: box, reply_loss: 0.5, at: 2 s, for: 2 s}",
        "{bus: line, impulse: {every: 5 ms, width: 2 ms, ber: 0.5}, at: 2 s, for: 2 s}",
        "{bus: line, burst: {good: 100 ms, bad: 100 ms, ber_good: 0, ber_bad: 0.2}, at: 2 s, for: 2 s}",
    ],
)
def test_noise_acts_on_it_and_only_in_its_window(noise: str) -> None:
    found = outcomes(done(noise=noise), "map")
    assert set(found) - {"ok"}


@pytest.mark.slow
def test_noise_at_one_node_hits_as_many_responses_as_theory_says() -> None:
    # In the receiver of the master: 13 characters of 10 bits, of which the last stop bit may go unseen.
    text = TEXT.replace("MASTER", "COM3").replace("CONTENTION", "undefined")
    text = text.replace("6 s", "120 s").replace("every: 100 ms", "every: 50 ms")
    ber = 2e-3
    found = run(loads(text + f"noise: [{{bus: line, station: p1.COM3, ber: {ber}}}]\n"), traced=False)
    outcome = Counter(record.outcome for record in found.record.transactions)
    total = sum(outcome.values())
    good = (1 - ber) ** 130
    bound = 4 * sqrt(total * good * (1 - good))
    # Two errors or more that the CRC-16 misses are below 2^-16 of what is damaged: none is to be expected.
    assert total * good - bound - 1 <= outcome["ok"] <= total * (1 - ber) ** 129 + bound
    assert comb(130, 2) * ber**2 / 2**16 * total < 0.01
