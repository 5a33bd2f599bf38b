"""Links that are wired or set up wrongly: numbers given twice, cut cables, refused parameters."""

from __future__ import annotations

import pytest

from bussim.line.contention import Contention
from bussim.plc.profiles import PROFILES
from bussim.plc.sources import Constant
from bussim.scenario import fault_kinds, model
from tests.sim.build import (
    CHAR,
    MS,
    SECOND,
    TURNAROUND,
    Done,
    fault,
    link,
    plain_scan,
    plc,
    registers_now,
    run,
    started,
    steady,
)

NOTHING = (0, 0, 0)


# -- numbers given twice ---------------------------------------------------------------------------


def test_two_equal_stations_with_equal_data_show_only_as_collisions() -> None:
    done = run(link(3, 2, seconds=1, more=[plc(1, name="twin")]))
    assert done.link.collisions == len(done.of("p1"))
    assert done.record.failures == []
    assert all(done.about(f"p{n}", other) == NOTHING for n in range(3) for other in range(8))
    assert set(done.durations) == {plain_scan(3, 2)}


def test_two_equal_stations_with_unequal_data_are_damage() -> None:
    twin = plc(1, name="twin", sources={"D32": Constant(0x1234)})
    others = {1: {"sources": {"D32": Constant(0x4321)}}}
    done = run(link(3, 2, seconds=2, retries=1, others=others, more=[twin]))
    assert done.about("p0", 1)[1:] == (0x04, 1)
    assert done.about("p2", 1)[1:] == (0x04, 1)
    assert done.about("p0", 2) == NOTHING
    # Neither of the two sees anything wrong with its own number.
    assert done.about("p1", 1) == done.about("twin", 1) == NOTHING


def test_two_masters_in_lockstep_look_healthy_and_out_of_step_they_do_not() -> None:
    settings = {"D8177": 2, "D8178": 2, "D8179": 3, "D8180": 5}
    others = {0: {"phase": 4 * MS}}
    lockstep = run(
        link(3, 2, seconds=1, others=others, more=[plc(0, name="twin", registers=settings, phase=4 * MS)])
    )
    assert lockstep.link.collisions >= len(lockstep.of("p0")) + len(lockstep.of("p0", "poll"))
    assert lockstep.record.failures == []
    assert all(lockstep.about("p1", other) == NOTHING for other in range(8))

    def apart(phase: int, contention: Contention = Contention.UNDEFINED) -> Done:
        twin = plc(0, name="twin", registers=settings, phase=phase * MS)
        return run(link(3, 2, seconds=1, others=others, more=[twin], contention=contention))

    # One millisecond apart: no parameter frame arrives whole, so no slave ever takes part.
    overlapped = apart(5)
    assert {code for _, code in overlapped.codes} == {4}
    assert overlapped.of("p1") == []
    assert overlapped.link.healthy_at is None
    # Six: the slaves notice that two talk at once, until the masters have fallen into step.
    noticed = apart(10)
    assert noticed.about("p1", 0) == noticed.about("p2", 0) == (1, 0x14, 0)
    # Thirty-six: where a 0 wins slaves reply to each other's polls for good.
    crossed = apart(40, Contention.ZERO_WINS)
    assert {code for _, code in crossed.codes} >= {1, 2}
    assert all(done.link.collisions for done in (overlapped, noticed, crossed))


# -- the cable -------------------------------------------------------------------------------------


def test_a_cut_cable_parts_the_stations() -> None:
    # p2's reply is 30 ms late; the cable breaks while it is due, between p1 and p2.
    probe = run(link(4, 0, seconds=0.2, faults=[fault_kinds.Slow("p2", 30 * MS)]))
    poll = next(f for f in probe.of("p0", "poll") if f.station == 2 and f.start > 100 * MS)
    cut = poll.end + 10 * MS
    faults = [
        model.Fault("slow", fault_kinds.Slow("p2", 30 * MS)),
        model.Fault("cut", fault_kinds.CableCut("link", "p1"), model.Window(cut, SECOND)),
    ]
    simulation, record = started(link(4, 0, retries=1, seconds=3, faults=faults))
    simulation.run(cut + 900 * MS)
    # p2's pending reply reaches p3, which still waits for it, and no other station.
    reply = next(frame for frame in record.frames if frame.sender == "p2" and frame.start > cut)
    assert reply.start == poll.end + TURNAROUND + 30 * MS
    assert [r[3] for r in record.refreshes if r[2] == reply.end] == [(3,)]
    # On the master's side: p2 and p3 are silent.
    master, near = registers_now(simulation, "p0"), registers_now(simulation, "p1")
    for station, code, found in ((2, 0x01, master), (3, 0x01, master), (2, 0x21, near), (3, 0x21, near)):
        assert (found[f"D{8211 + station}"], found[f"M{8183 + station}"]) == (code, 1)
    assert (near["D8203"], near["M8191"], master["M8184"]) == (0, 1, 0)
    # Beyond the cut: nothing but the master's silence.
    for far in ("p2", "p3"):
        found = registers_now(simulation, far)
        assert (found["D8203"], found["D8211"], found["M8183"], found["M8191"]) == (1, 0x11, 1, 0)
        assert not any(found[f"D{n}"] for n in range(8204, 8211))
    simulation.run(3 * SECOND)
    for name in simulation.plcs:
        found = registers_now(simulation, name)
        assert not any(found[f"M{n}"] for n in range(8183, 8191))
        assert found["M8191"] == 1


def test_a_cable_cut_in_the_middle_of_a_frame() -> None:
    probe = run(link(4, 2, seconds=0.3))
    frame = next(f for f in probe.of("p0") if f.start > 100 * MS)
    middle = frame.start + 20 * CHAR + 700
    faults = [model.Fault("cut", fault_kinds.CableCut("link", "p1"), model.Window(middle, 5 * CHAR))]
    done = run(link(4, 2, seconds=0.3, faults=faults))
    # p1 heard it whole; p2 and p3 missed five characters in the middle.
    assert done.about("p1", 0) == NOTHING
    assert done.about("p2", 0) == done.about("p3", 0) == (1, 0x14, 0)
    assert [r[3] for r in done.record.refreshes if r[2] == frame.end] == [(1,)]
    assert done.record.failures == []


# -- parameters ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("station", "registers"),
    [
        (0, {"D8177": 0}),
        (0, {"D8177": 8}),
        (0, {"D8178": 5}),
        (0, {"D8179": 11}),
        (0, {"D8180": 4}),
        (0, {"D8180": 226}),
        (1, {"D8176": 8}),
    ],
)
@pytest.mark.parametrize(("port", "code"), [("COM3", 7348), ("COM4", 7448)])
def test_bad_parameters_are_7348_or_7448_and_no_traffic(
    station: int, registers: dict[str, int], port: str, code: int
) -> None:
    bad = {
        "link": model.LinkAttachment("link", port),
        "registers": {**registers, "M8179": int(port == "COM4")},
    }
    done = run(link(2, 0, seconds=1, retries=0, others={station: bad}))
    found = done.registers(f"p{station}")
    assert (found["M8063"], found["D8063"], found["M8191"]) == (1, code, 0)
    assert not [frame for frame in done.record.frames if frame.sender == f"p{station}"]
    other = done.registers(f"p{1 - station}")
    assert (other["M8063"], other["D8063"]) == (0, 0)
    (warning,) = done.totals.warnings
    name, value = next(iter(registers.items()))
    assert f"p{station}" in warning
    assert str(code) in warning
    assert f"{name} is {value}" in warning
    if station == 0:
        assert done.record.frames == []
        assert (done.link.slaves, done.link.attempts, done.link.polls) == (None, None, 0)
    else:
        assert done.about("p0", 1)[1:] == (0x01, 1)


@pytest.mark.parametrize("family", ["fx1s", "fx2n"])
def test_a_family_without_the_masters_mode_takes_no_part(family: str) -> None:
    done = run(link(3, 3, seconds=1, retries=0, others={1: {"profile": PROFILES[family]}}))
    found = done.registers("p1")
    number = {"fx3u": 3808}.get(family, 6308)  # COM4 is an FX3U's second channel
    assert (found["M8063"], found["D8063"], found["M8191"]) == (1, number, 0)
    assert done.of("p1") == []
    assert done.about("p0", 1)[1:] == (0x01, 1)
    assert done.about("p0", 2) == NOTHING
    assert any("mode 3" in warning and "p1" in warning for warning in done.totals.warnings)


def test_a_board_error_shows_in_m8063_and_d8063_and_nowhere_else() -> None:
    done = run(link(2, 0, seconds=1, faults=[fault(fault_kinds.BoardError("p1", "COM3", 6), 0.5)]))
    found = done.registers("p1")
    assert (found["M8063"], found["D8063"]) == (1, 7306)
    assert done.record.failures == []


def test_families_on_one_link_keep_the_blocks_at_their_own_addresses() -> None:
    others = {
        0: {"sources": {"D0": Constant(11)}},
        1: {"profile": steady("fx2n"), "sources": {"D10": Constant(22)}},
        2: {"profile": steady("fx1s"), "sources": {"D23": Constant(33)}},
    }
    done = run(link(3, 0, seconds=0.5, others=others))
    plcs = done.simulation.plcs
    assert [plcs["p0"].read(name) for name in ("D0", "D32", "D67")] == [11, 22, 33]
    assert [plcs["p1"].read(name) for name in ("D0", "D10", "D23")] == [11, 22, 33]
    assert [plcs["p2"].read(name) for name in ("D0", "D10", "D23")] == [11, 22, 33]
    found = done.registers("p2")
    assert (found["M8191"], found["D8201"]) == (1, (plain_scan(3, 0) + MS // 2) // MS)
    assert (plcs["p2"].read("M503"), plcs["p2"].read("D201")) == (1, found["D8201"])
