"""Shapes of a timeline."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bussim.report.scene import (
    ACTING,
    DAMAGE,
    DRIVEN,
    END,
    FLAG,
    HEARD_DAMAGE,
    LEVEL,
    LOST,
    MOST_DEVICES,
    TROUBLE,
    Box,
    scene_of,
)
from bussim.report.trace_window import TraceWindow
from bussim.results.meters.timeline import Span
from bussim.trace.records import DeviceValueRecord, FrameRecord, InputRecord, NoteRecord, TransactionRecord
from tests.report.samples import NAMES, eight_folder, longest


def frame(**changes: object) -> FrameRecord:
    plain = FrameRecord("link", 1000, 2000, "a", "data", 0, 3, bytes(10), (), {}, collided=False, cut=False)
    return plain._replace(**changes)


def scene(**changes: object) -> tuple[list[str], list[Box]]:
    drawn = scene_of(replace(TraceWindow("link", 0, 10_000, ("a", "b"), {0: "a", 1: "b"}), **changes))  # type: ignore[arg-type]
    return list(drawn.lanes), list(drawn.boxes)


def test_eight_stations_have_a_lane_each_in_cable_order() -> None:
    drawn = scene_of(longest(eight_folder()))
    stations = [f"{number} {name}" for number, name in enumerate(NAMES)]
    assert drawn.lanes[:2] == ["link scans", "attempts"]
    assert list(drawn.lanes[2:10]) == stations


def test_every_frame_is_a_box_of_its_sender_at_its_time() -> None:
    window = longest(eight_folder())
    drawn = scene_of(window)
    boxes = [box for box in drawn.boxes if box.kind in ("data", "poll", "parameters")]
    assert len(boxes) == len(window.frames)
    for box, sent in zip(boxes, window.frames, strict=True):
        assert (box.start, box.end, box.kind) == (sent.start, sent.end, sent.kind)
        assert drawn.lanes[box.lane].endswith(sent.sender)


def test_ends_of_a_plc_are_marked_in_the_lane_of_each_of_its_ports() -> None:
    window = TraceWindow("link", 0, 10_000, ("a", "b.COM3"), ends={"a": [5, 9_999, 10_000], "b": [7]})
    drawn = scene_of(window)
    marked = [(drawn.lanes[mark.lane], mark.tick) for mark in drawn.marks if mark.kind == END]
    assert marked == [("a", 5), ("a", 9_999), ("b.COM3", 7)]


@pytest.mark.parametrize(("bit", "char"), [(0, 1), (9, 1), (10, 2), (57, 6), (99, 10)])
def test_a_damaged_bit_marks_its_character(bit: int, char: int) -> None:
    _, boxes = scene(frames=[frame(damaged_bits=(bit,))])
    (damage,) = [box for box in boxes if box.kind == DAMAGE]
    assert (damage.start, damage.end) == (1000 + 100 * (char - 1), 1000 + 100 * char)
    assert f"character {char} of 10" in damage.text


def test_characters_are_as_long_as_their_format_says() -> None:
    # 8N2 has eleven bits: bit 10 is still in the first character, bit 11 in the second.
    _, boxes = scene(frames=[frame(damaged_bits=(10, 11), format="8N2")])
    assert [box.text.split(" of")[0] for box in boxes if box.kind == DAMAGE] == ["character 1", "character 2"]


def test_what_one_receiver_alone_receives_damaged_is_in_its_own_lane() -> None:
    lanes, boxes = scene(frames=[frame(damaged_at={"b": (5,), "elsewhere": (1,)})])
    (heard,) = [box for box in boxes if box.kind == HEARD_DAMAGE]
    assert lanes[heard.lane] == "1 b"
    assert "b receives" in heard.text


def test_frames_that_collided_or_were_cut_off_are_marked_as_a_whole() -> None:
    for fault, word in (("collided", "collided"), ("cut", "cut off")):
        _, boxes = scene(frames=[frame(**{fault: True})])
        sent, damage = boxes
        assert (sent.kind, damage.kind) == ("data", LOST)
        assert (damage.start, damage.end) == (1000, 2000)
        assert word in damage.text


def test_a_device_keeps_its_value_until_it_changes() -> None:
    values = [
        DeviceValueRecord(-500, "a", "D0", 7),
        DeviceValueRecord(4000, "a", "D0", 8),
        DeviceValueRecord(-100, "b", "M5", 1),
    ]
    lanes, boxes = scene(values=values)
    levels = [(lanes[b.lane], b.start, b.end, b.label) for b in boxes if b.kind == LEVEL]
    assert levels == [("a D0", -500, 4000, "7"), ("a D0", 4000, 10_000, "8")]


def test_of_many_devices_the_busiest_are_shown() -> None:
    values = [
        DeviceValueRecord(100 * at, "a", f"D{number}", at)
        for number in range(MOST_DEVICES + 3)
        for at in range(number + 1)
    ]
    drawn = scene_of(TraceWindow("link", 0, 10_000, ("a",), values=values))
    shown = [lane for lane in drawn.lanes if lane.startswith("a D")]
    assert shown == [f"a D{number}" for number in range(3, MOST_DEVICES + 3)]
    assert drawn.left_out == 3


def test_what_many_stations_say_at_one_instant_is_one_mark() -> None:
    notes = [NoteRecord(50, "station_error", who, "station 0: code 14", {"station": 0}) for who in ("a", "b")]
    drawn = scene_of(TraceWindow("link", 0, 10_000, ("a", "b"), notes=notes))
    (mark,) = drawn.marks
    assert (mark.kind, mark.text) == (TROUBLE, "a, b: station 0: code 14")


def test_faults_and_error_flags_have_lanes_of_their_own() -> None:
    lanes, boxes = scene(
        faults=[("b without supply", Span(2000, None)), ("2 replies dropped", Span(50, 50))],
        flags={1: [Span(-100, 3000)], 2: [Span(20_000, 30_000)]},
        flag_names={1: "M505", 2: "M506"},
    )
    shown = {lanes[box.lane]: (box.kind, box.start, box.end, box.text) for box in boxes}
    assert shown["fault"] == (ACTING, 2000, 10_000, "b without supply")
    assert shown["M505"] == (FLAG, -100, 3000, "M505 is on: station 1 (b) is in error")
    assert len(boxes) == 2


def test_modbus_attempts_have_function_address_and_outcome() -> None:
    asked = TransactionRecord(
        "link", "a", "read", 2, 1, 3, 22, 4, 100, 200, None, None, 5000, 5100,
        "no response in time", 9, 0, None, mismatched=False, chars=8,
    )  # fmt: skip
    lanes, boxes = scene(transactions=[asked, asked._replace(outcome="ok", sent=6000, end=7000)])
    failed, good = boxes
    assert lanes[failed.lane] == "attempts"
    assert failed.label == "attempt 2: no response in time"
    assert "function 3 at station 1, address 22, quantity 4" in failed.text
    assert (good.kind, good.start, good.end) == ("good", 6000, 7000)


def test_the_lane_of_a_driven_input_is_its_wire() -> None:
    """Memory's image, a scan later, shows only what the level was before the wire's first change."""
    values = [
        DeviceValueRecord(-50, "a", "X0", 1),
        DeviceValueRecord(2_500, "a", "X0", 0),
        DeviceValueRecord(2_500, "a", "Y0", 0),
        DeviceValueRecord(6_500, "a", "X0", 1),
    ]
    inputs = [
        InputRecord(1_800, "a", "X0", 0, 2_000, True, 2_500),
        InputRecord(5_700, "a", "X0", 1, 6_000, True, 6_500),
    ]
    lanes, boxes = scene(values=values, inputs=inputs)
    levels = [(lanes[b.lane], b.start, b.end, b.label) for b in boxes if b.kind == LEVEL]
    assert levels == [
        ("a X0 (wire)", -50, 1_800, "1"),
        ("a X0 (wire)", 1_800, 5_700, "0"),
        ("a X0 (wire)", 5_700, 10_000, "1"),
        ("a Y0", 2_500, 10_000, "0"),
    ]


def test_a_pause_and_a_driver_that_is_still_on_are_shown() -> None:
    # Ten characters of 10 bits at 38400: 18,750 ticks each; a pause of 30,000 ticks after the fourth.
    sent = frame(end=217_500 + 1000, pauses=((3, 30_000),), released=240_000, damaged_bits=(39, 40))
    _, boxes = scene(frames=[sent], end=300_000)
    shown = [(box.start, box.end) for box in boxes if box.kind == "data"]
    assert shown == [(1000, 218_500)]
    assert [(box.start, box.end) for box in boxes if box.kind == DRIVEN] == [
        (218_500, 240_000),
        (76_000, 106_000),
    ]
    assert [(box.start, box.end) for box in boxes if box.kind == DAMAGE] == [
        (57_250, 76_000),
        (106_000, 124_750),
    ]
    (text,) = {box.text for box in boxes if box.kind == "data"}
    assert "pause of 0.417 ms after character 4" in text
