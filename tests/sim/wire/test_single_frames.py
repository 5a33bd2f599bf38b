"""Faults of single frames: characters too few or too many, flipped bits, and what no check notices."""

from __future__ import annotations

import pytest

from bussim.plc.sources import Constant
from bussim.scenario import fault_kinds, model
from tests.sim.build import (
    CHAR,
    MS,
    SECOND,
    fault,
    link,
    plain_scan,
    run,
    started,
    takers,
)

TX, RX = fault_kinds.Direction.TX, fault_kinds.Direction.RX


# -- single frames ---------------------------------------------------------------------------------


@pytest.mark.parametrize("index", [0, 1, 5, 19, None])
@pytest.mark.parametrize("action", ["lose", "insert"])
def test_a_character_too_few_or_too_many_from_a_sender(action: str, index: int | None) -> None:
    kind: fault_kinds.FaultKind = fault_kinds.LoseChar("p1", TX, 2, index)
    if action == "insert":
        kind = fault_kinds.InsertChar("p1", TX, 2, index, 0x41)
    done = run(link(3, 1, retries=2, seconds=1, faults=[fault(kind, 0.5)]))
    whole = len(done.of("p1")[0].chars)
    odd = [frame for frame in done.of("p1") if len(frame.chars) != whole]
    change = -1 if action == "lose" else 1
    assert [len(frame.chars) - whole for frame in odd] == [change, change]
    assert all(frame.end - frame.start == len(frame.chars) * CHAR for frame in odd)
    if index is not None:
        left, right = odd[0].chars[:index], odd[0].chars[index + (change > 0) :]
        assert odd[0].chars.startswith(left)
        assert len(left) + len(right) == whole - (action == "lose")
        if action == "insert":
            assert odd[0].chars[index] == 0x41
    # Never a reply, but where the character too many stands before the header.
    failed = [(a.station, a.code) for a in done.record.attempts if a.code]
    assert failed == [(1, 4) for frame in odd if frame.chars[0] != 0x41]
    assert done.about("p0", 1) == (0, 0, 0)
    assert done.link.undetected == 0


@pytest.mark.parametrize("index", [2, 5, 19, 29])
@pytest.mark.parametrize("action", ["lose", "insert"])
@pytest.mark.parametrize("receiver", ["p0", "p2"])
def test_a_character_too_few_or_too_many_in_one_receiver(action: str, index: int, receiver: str) -> None:
    probe = run(link(3, 1, seconds=0.6))
    reply = next(frame for frame in probe.of("p1") if frame.start > SECOND // 2)
    # The next frame that the receiver hears is that reply.
    window = model.Window(reply.start - 1000)
    kind: fault_kinds.FaultKind = fault_kinds.LoseChar(receiver, RX, 1, index)
    if action == "insert":
        kind = fault_kinds.InsertChar(receiver, RX, 1, index, 0x41)
    done = run(link(3, 1, retries=2, seconds=1, faults=[model.Fault("rx", kind, window)]))
    assert all(frame.damaged_bits == () and frame.damaged_at == {} for frame in done.record.frames)
    (heard,) = [r[3] for r in done.record.refreshes if r[2] == reply.end]
    if receiver == "p0":
        assert done.codes == {(1, 4): 1}
        assert heard == (2,)
        # p2 heard a reply, and then the poll again: no reason to complain.
        assert done.about("p2", 1) == (0, 0, 0)
    else:
        assert done.codes == {}
        assert heard == (0,)
        assert done.about("p2", 1) == (1, 0x04, 0)


def test_a_character_before_the_header_is_no_corruption() -> None:
    # A second STX in front: the frame begins anew with the right one.
    done = run(link(3, 1, seconds=1, faults=[fault(fault_kinds.InsertChar("p1", TX, 3, 0, 2), 0.5)]))
    odd = [frame for frame in done.of("p1") if frame.chars[:2] == b"\x02\x02"]
    assert len(odd) == 3
    assert done.record.failures == []
    assert done.link.undetected == 0
    for frame in odd:
        assert {r[3] for r in done.record.refreshes if r[2] == frame.end} == {(0,), (2,)}


@pytest.mark.parametrize("count", [1, 2, 5, None])
def test_a_fault_of_single_frames_acts_as_often_as_it_says(count: int | None) -> None:
    kinds: list[fault_kinds.FaultKind] = [
        fault_kinds.FlipBits("p1", TX, (12,), count, "data"),
        fault_kinds.LoseChar("p1", TX, count),
        fault_kinds.InsertChar("p1", TX, count, 4, 0x41),
        fault_kinds.DropReply("p1", count),
    ]
    for kind in kinds:
        done = run(link(2, 0, retries=5, seconds=2, faults=[fault(kind, 0.5, 0.9)]))
        code = 1 if isinstance(kind, fault_kinds.DropReply) else 4
        if count is not None:
            assert done.codes == {(1, code): count}
        else:
            inside = [a for a in done.record.attempts if SECOND // 2 <= a.start < SECOND * 135 // 100]
            assert {a.code for a in inside} == {code}
        assert {a.code for a in done.record.attempts if a.start > 1.5 * SECOND} == {0}


def test_flips_touch_only_the_kind_of_frame_they_name() -> None:
    for kind in ("data", "poll", "parameters"):
        flip = fault(fault_kinds.FlipBits("p0", TX, (12,), None, kind))
        done = run(link(3, 0, retries=0, seconds=0.5, faults=[flip]))
        hit = {frame.kind for frame in done.record.frames if frame.damaged_bits}
        assert hit == {kind}
    flip = fault(fault_kinds.FlipBits("p0", TX, (12,), None))
    done = run(link(3, 0, retries=0, seconds=0.5, faults=[flip]))
    assert all(frame.damaged_bits == (12,) for frame in done.record.frames if frame.sender == "p0")


def test_bits_beyond_the_frame_belong_to_no_frame() -> None:
    done = run(
        link(2, 0, seconds=0.5, faults=[fault_kinds.FlipBits("p0", TX, (50, 219, 220, 5000), None, "poll")])
    )
    assert done.record.failures == []
    assert {frame.damaged_bits for frame in done.record.frames} == {()}


def test_the_same_bit_inverted_on_the_wire_and_in_the_receiver_is_right_again() -> None:
    faults = [
        fault_kinds.FlipBits("p1", TX, (12, 40), None, "data"),
        fault_kinds.FlipBits("p2", RX, (12, 40), None, "data"),
    ]
    others = {0: {"registers": {"D8177": 1}}}
    done = run(link(3, 0, retries=0, seconds=0.5, others=others, faults=faults))
    replies = done.of("p1")
    assert replies
    assert {a.code for a in done.record.attempts} == {4}
    assert all(frame.damaged_bits == (12, 40) for frame in replies)
    heard = {tick: plc_names for _, source, tick, plc_names in done.record.refreshes if source == 1}
    assert heard == {frame.end: (2,) for frame in replies}
    assert done.link.undetected == 0


# -- what is not noticed ---------------------------------------------------------------------------


def unnoticed() -> model.Scenario:
    """One frame of p1 is damaged so that neither parity nor sum shows it."""
    # D32 = 0x0003 is sent as 0 0 0 3. The two low bits of the last two digits: 0 → 3 and 3 → 0.
    # Two bits a character keep its parity, and the sum stays what it was.
    first_digit = 3 + 8  # header, station, counter, and 32 points in 8 characters
    third, fourth = 10 * (first_digit + 2), 10 * (first_digit + 3)
    bits = (third + 1, third + 2, fourth + 1, fourth + 2)
    others = {1: {"sources": {"D32": Constant(3)}, "phase": 0}}
    flip = fault(fault_kinds.FlipBits("p1", TX, bits, 1, "data"), 0.5)
    return link(3, 1, seconds=1, others=others, faults=[flip])


def test_a_pattern_that_parity_and_sum_both_miss_is_counted_once() -> None:
    done = run(unnoticed())
    (hit,) = [frame for frame in done.record.frames if frame.damaged_bits]
    assert hit.chars[11:15] == b"0003"
    assert done.link.undetected == 1  # one frame, whichever node took it
    assert [(note.tick, note.where) for note in done.notes("undetected")] == [
        (hit.end, "p0"),
        (hit.end, "p2"),
    ]
    assert done.record.failures == []
    assert all(done.about(f"p{n}", other) == (0, 0, 0) for n in range(3) for other in range(8))
    # A refresh by what no node sent is none.
    assert hit.end not in takers(done, 1)
    assert len(takers(done, 1)) == len(done.of("p1")) - 1


def test_a_pattern_that_parity_and_sum_both_miss_reaches_the_memory_until_the_next_refresh() -> None:
    hit = next(frame for frame in run(unnoticed()).record.frames if frame.damaged_bits)
    simulation, _ = started(unnoticed())
    for tick, value in (
        (hit.end - 1, 3),
        (hit.end + 10 * MS, 0x0030),  # an END has passed
        (hit.end + plain_scan(3, 1) + 10 * MS, 3),
    ):
        simulation.run(tick)
        for name in ("p0", "p2"):
            plc = simulation.plcs[name]
            plc.sync(tick)
            assert plc.read("D32") == value
    assert simulation.plcs["p1"].read("D32") == 3


def test_a_poll_of_another_station_is_undetected_too() -> None:
    # The two low bits of station and counter: 1 becomes 2 and 2 becomes 1. Where the sum stays and
    # the other digit is one, all nodes take it.
    flip = fault_kinds.FlipBits("p0", TX, (11, 12, 21, 22), None, "poll")
    done = run(link(3, 0, retries=0, seconds=1.5, faults=[flip]))
    undetected = 0
    for frame in done.of("p0", "poll"):
        sent = frame.chars[1:3]
        read = bytes(char ^ 3 for char in sent)
        undetected += sum(sent) == sum(read) and set(read) <= set(b"0123456789ABCDEF")
    assert done.link.undetected == undetected > 0
