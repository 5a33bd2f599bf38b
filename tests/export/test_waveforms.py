from __future__ import annotations

import random
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.errors import UsageError
from bussim.export.formats import export_trace
from bussim.export.lanes import Lanes, microseconds
from bussim.export.selection import Selection, survey
from bussim.line.protocols import BusProtocol
from bussim.trace.records import FrameRecord, TraceBus
from bussim.units import TICKS_PER_SECOND
from tests.export.samples import FEEDER, LINK, bits_of, exchanges, exported, frame, link_frames, trace
from tests.export.waves import clipped, idle_before, lows, of_sr, of_vcd


@st.composite
def crowds(draw: st.DrawFn) -> list[FrameRecord]:
    """Frames of three stations that may overlap, be damaged, be cut off or have another rate."""
    frames = []
    for name in LINK.nodes:
        now = draw(st.integers(0, 300_000))
        for _ in range(draw(st.integers(0, 3))):
            baud = draw(st.sampled_from([38400, 38400, 19200, 115200]))
            fmt = draw(st.sampled_from(["7E1", "7E1", "8N2"]))
            chars = draw(st.binary(min_size=1, max_size=6))
            one = frame(
                LINK, now, name, chars, baud=baud, fmt=fmt, ppm=draw(st.sampled_from([0.0, -313.7, 90.25]))
            )
            flips = draw(st.sets(st.integers(0, bits_of(one) - 1), max_size=3))
            if draw(st.booleans()):
                cut = draw(st.integers(1, one.end - one.start))
                one = one._replace(end=one.start + cut, cut=True)
            frames.append(one._replace(damaged_bits=tuple(sorted(flips))))
            now = one.end + draw(st.integers(0, 200_000))
    return sorted(frames, key=lambda each: each.end)


def lanes_of(frames: list[FrameRecord], start: int | None = None, stop: int | None = None) -> Lanes:
    selection = Selection(trace(*frames), None, start, stop)
    return Lanes(selection, survey(selection))


@given(frames=crowds().filter(bool))
def test_lanes_are_low_where_the_frames_pull_them_low(frames: list[FrameRecord]) -> None:
    lanes = lanes_of(frames)
    assert [lane.name for lane in lanes.lanes] == ["link", "press1", "press2", "press3"]
    found: dict[str, list[tuple[int, int]]] = {lane.name: [] for lane in lanes.lanes}
    since: dict[int, int] = {}
    last, idle = 0, idle_before(frames)
    for later, lane, level in lanes.changes():
        us = later - idle
        assert us >= last
        last = us
        assert (lane in since) is (level == 1), "a change that changes nothing"
        if level:
            found[lanes.lanes[lane].name].append((since.pop(lane), us))
        else:
            since[lane] = us
    assert not since
    assert found["link"] == lows(frames, damaged=True)
    for name in LINK.nodes:
        assert found[name] == lows([each for each in frames if each.sender == name], damaged=False)


@given(frames=crowds().filter(bool), ends=st.tuples(st.integers(0, 400_000), st.integers(1, 400_000)))
def test_a_window_shows_what_is_in_it(frames: list[FrameRecord], ends: tuple[int, int]) -> None:
    start, stop = ends[0], ends[0] + ends[1]
    if not any(each.end >= start and each.start < stop for each in frames):
        return
    lanes = lanes_of(frames, start, stop)
    idle = idle_before((each for each in frames if each.end >= start and each.start < stop), start)
    begin, end = microseconds(start), min(microseconds(stop), lanes.end - idle)
    levels, found = {}, []
    for later, lane, level in lanes.changes():
        us = later - idle
        assert begin <= us <= end
        if lane == 0 and level == 1:
            found.append((levels[0], us))
        levels[lane] = us
    assert found == clipped(lows(frames, damaged=True), begin, end)


def test_damage_in_one_receiver_is_a_lane_of_its_own() -> None:
    one = frame(LINK, 72_000, "press1", b"\x0511A2", damaged=(4, 21), damaged_at={"press3": (21, 33)})
    two = frame(LINK, 10 * one.end, "press3", b"\x05", damaged_at={"press3": (1,)})
    lanes = lanes_of([one, two])
    assert [lane.name for lane in lanes.lanes][-1] == "press3_rx"
    found, since = [], 0
    for us, lane, level in lanes.changes():
        if lane == 4:
            found += [(since, us)] if level else []
            since = us
    # Bit 21, inverted on the wire and in the receiver, is right once more; its own frame it does not hear.
    assert found == lows([one._replace(damaged_bits=(4, 33))], damaged=True)


@pytest.mark.parametrize("to", ["vcd", "sr"])
def test_files_hold_the_waveform_of_every_bus(tmp_path: Path, to: str) -> None:
    chance = random.Random(3)
    link = link_frames(60, damage=0.3)
    rtu = [each for one in exchanges(12, bus=FEEDER) for each in one.frames]
    noisy = [each._replace(damaged_bits=(chance.randrange(bits_of(each)),)) for each in rtu[::3]]
    frames = sorted(link + rtu[1::3] + rtu[2::3] + noisy, key=lambda each: each.end)
    path = exported(trace(*frames, buses=(LINK, FEEDER)), tmp_path / f"a.{to}", to)
    if to == "vcd":
        found, begin, end = of_vcd(path)
        assert begin == 0
    else:
        found, end = of_sr(path)
    assert set(found) == {
        "link", "link/press1", "link/press2", "link/press3", "feeder", "feeder/press1.COM3", "feeder/feeder1",
    }  # fmt: skip
    for bus in (LINK, FEEDER):
        mine = [each for each in frames if each.bus == bus.name]
        assert found[bus.name] == lows(mine, damaged=True)
        for node in bus.nodes:
            sent = [each for each in mine if each.sender == node]
            assert found[f"{bus.name}/{node}"] == lows(sent, damaged=False)
    assert end > microseconds(frames[-1].end)


def test_a_session_counts_from_the_window_and_a_vcd_from_the_run(tmp_path: Path) -> None:
    frames = link_frames(200)
    start, stop = frames[50].start - 7_200, frames[60].start
    inside = [each for each in frames if each.end >= start and each.start < stop]
    offset, last = microseconds(start), microseconds(stop)
    wave = clipped(lows(inside, damaged=True), offset, last)
    choices = {"start": start, "stop": stop}
    session = exported(trace(*frames), tmp_path / "a.sr", "sr", **choices)
    found, count = of_sr(session)
    assert count == last - offset
    assert found["link"] == [(first - offset, end - offset) for first, end in wave]
    dump, begin, end = of_vcd(exported(trace(*frames), tmp_path / "a.vcd", "vcd", **choices))
    assert (dump["link"], begin, end) == (wave, offset, last)


def test_a_long_idle_time_takes_many_chunks_and_little_room(tmp_path: Path) -> None:
    frames = [frame(LINK, start * TICKS_PER_SECOND, "press1", b"\x0511A2") for start in (1, 31)]
    path = exported(trace(*frames), tmp_path / "a.sr", "sr")
    found, count = of_sr(path)
    assert count > 30_000_000
    assert found["link"] == lows(frames, damaged=True)
    assert path.stat().st_size < 500_000


def test_a_session_of_hours_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    frames = [frame(LINK, start * TICKS_PER_SECOND, "press1", b"\x0511A2") for start in (0, 3600)]
    with pytest.raises(UsageError, match=r"the window is 3,600 s long.*--from and --to-time"):
        export_trace(trace(*frames), tmp_path / "a.sr", "sr")
    assert not list(tmp_path.iterdir())
    exported(trace(*frames), tmp_path / "a.vcd", "vcd")


def test_more_than_sixty_four_lanes_are_refused(tmp_path: Path) -> None:
    nodes = tuple(f"node{number}" for number in range(64))
    bus = TraceBus("wide", BusProtocol.SERIAL, 9600, "8N1", nodes, {})
    frames = [frame(bus, 0, "node1", b"\x01")]
    with pytest.raises(UsageError, match="there are 65 lanes; a sigrok session may have 64"):
        export_trace(trace(*frames, buses=(bus,)), tmp_path / "a.sr", "sr")


def test_names_that_the_formats_cannot_hold_are_replaced_and_stay_apart(tmp_path: Path) -> None:
    bus = TraceBus("the line", BusProtocol.SERIAL, 9600, "8N1", ("a b", "a,b", "a=b:c", "日本"), {})
    frames = [frame(bus, 72, "a b", b"\x01"), frame(bus, 100_000, "a,b", b"\x02")]
    path = exported(trace(*frames, buses=(bus,)), tmp_path / "a.vcd", "vcd")
    found, _, _ = of_vcd(path)
    assert list(found) == ["the_line", "a_b", "a_b-2", "a_b_c", "日本"]
    assert found["a_b"] == lows(frames[:1], damaged=False)
    assert found["a_b-2"] == lows(frames[1:], damaged=False)


@pytest.mark.parametrize("to", ["vcd", "sr", "pcapng", "perfetto", "csv"])
def test_the_same_trace_gives_the_same_bytes(tmp_path: Path, to: str) -> None:
    frames = link_frames(50, damage=0.2)
    one = exported(trace(*frames), tmp_path / "one", to).read_bytes()
    assert exported(trace(*frames), tmp_path / "two", to).read_bytes() == one
