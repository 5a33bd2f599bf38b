"""Frames that overlap, in files: the levels are those of the run in every format.

The decoder of characters and frames is written here, from the format of the link's line and the layout of its
frames alone.
"""

from __future__ import annotations

import csv
from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

import bussim
from bussim.engines.contract import RxChar
from bussim.export.lanes import Lanes, microseconds
from bussim.export.selection import Selection, survey
from bussim.line.contention import Contention, line_lows
from bussim.scenario.loader import loads
from bussim.sim.wire.receiver import Receiver
from bussim.trace.file import Trace
from bussim.trace.levels import disputed_of, driver_of
from bussim.trace.records import FrameRecord
from tests.export.samples import LINK, exported
from tests.export.samples import trace as made_up
from tests.export.test_waveforms import crowds
from tests.export.waves import Lows, idle_before, merged, of_sr, of_vcd
from tests.selection import quick

#: A driver that is released late, two stations with one number, and one that jabbers; b is never polled and
#: hears all of it.
CROWD = """\
schema: 1
name: drivers that overlap
duration: 4 s
seed: 3
buses: [{name: link, nn: true, contention: CONTENTION}]
plcs:
  - {name: m, scan: 5 ms, nn: {bus: link, station: 0, slaves: 2, mode: 1, retries: 3, timeout: 50 ms}}
  - {name: a, scan: 5 ms, nn: {bus: link, station: 1}}
  - {name: c, scan: 7 ms, nn: {bus: link, station: 2}}
  - {name: d, scan: 9 ms, nn: {bus: link, station: 2}}
  - {name: b, scan: 5 ms, nn: {bus: link, station: 5}}
faults:
  - {at: 1 s, for: 1 s, late_release: {station: a, by: 1.2 ms}}
  - {at: 2 s, for: 300 ms, jabber: c}
  - {at: 2.5 s, late_release: {station: m, by: 3 ms}}
  - {at: 3 s, pause: {station: d, index: 3, by: 700 us}}
noise: [{bus: link, ber: 1.0e-4}]
"""
#: A driver that is released late for four seconds.
LATE = """\
schema: 1
name: late release
duration: 6 s
seed: 1
buses: [{name: link, nn: true}]
plcs:
  - {name: m, scan: 5 ms, nn: {bus: link, station: 0, slaves: 2, mode: 1, retries: 3, timeout: 50 ms}}
  - {name: a, scan: 5 ms, nn: {bus: link, station: 1}}
  - {name: b, scan: 5 ms, nn: {bus: link, station: 2}}
faults:
  - {at: 1 s, for: 4 s, late_release: {station: a, by: 1.2 ms}}
"""
BIT = 1e6 / 38400  # µs


class Character(NamedTuple):
    at: int  # first edge
    value: int
    good: bool


def characters(lows: Lows, width: float = BIT) -> Iterator[Character]:
    """A UART at 38400 7E1: it starts at a falling edge and samples in the middle of each bit.

    ``width`` is that of a bit in the unit of the intervals.
    """
    starts, ends = [low[0] for low in lows], [low[1] for low in lows]

    def level(us: float) -> int:
        place = bisect_right(starts, us) - 1
        return 0 if place >= 0 and us < ends[place] else 1

    ready = 0.0
    while (place := bisect_left(starts, ready)) < len(starts):
        edge = starts[place]
        bits = [level(edge + width * (number + 0.5)) for number in range(10)]
        if bits[0]:
            ready = edge + width / 2
            continue
        ready = edge + width * 9.5
        value = sum(bit << number for number, bit in enumerate(bits[1:8]))
        yield Character(edge, value, sum(bits[1:9]) % 2 == 0 and bits[9] == 1)


class Sound(NamedTuple):
    start: int
    chars: bytes


def sound(heard: list[Character]) -> Iterator[Sound]:
    """The frames whose layout, sum and characters are all right."""
    for place, char in enumerate(heard):
        # From a header on, no further apart than a character is long and a little more.
        chars = bytearray()
        for one in heard[place:]:
            if not one.good or one.at - char.at > BIT * 10 * (len(chars) + 0.5):
                break
            chars.append(one.value)
        if char.value == 2 and 3 in chars:
            chars = chars[: chars.index(3) + 3]
            summed = chars[1:-2]
        elif char.value == 5:
            chars = chars[:5]
            summed = chars[1:3]
        elif char.value == 1:
            chars = chars[:14]
            summed = chars[1:-2]
        else:
            continue
        if char.good and f"{sum(summed) & 0xFF:02X}".encode() == chars[-2:]:
            yield Sound(char.at, bytes(chars))


@pytest.fixture(scope="module")
def late() -> bussim.Result:
    return bussim.run(loads(LATE), trace=True)


@pytest.mark.parametrize("to", quick(1, ["vcd", "sr"]))
def test_a_reader_of_the_waveform_misses_the_frames_that_the_run_counts(
    late: bussim.Result, tmp_path: Path, to: str
) -> None:
    trace, link = late.open_trace(), late.summary["links"]["link"]
    path = exported(trace, tmp_path / f"a.{to}", to)
    lanes = of_sr(path)[0] if to == "sr" else of_vcd(path)[0]
    heard = {frame.start: frame.chars for frame in sound(list(characters(lanes["link"])))}
    frames = sorted(trace.of(FrameRecord), key=lambda each: each.start)
    missed = [frame for frame in frames if heard.pop((frame.start + 36) // 72, b"") != frame.chars]
    assert not heard
    # The polls that begin while the driver of a is still on, as the run counts them: each costs an attempt.
    assert [frame for frame in frames if frame.collided] == missed
    assert {frame.kind for frame in missed} == {"poll"}
    assert len(missed) == link["collisions"] == link["failed_attempts"]["2"]["01"] > 40
    assert link["undetected_frames"] == 0


def test_a_table_has_what_the_waveform_has(late: bussim.Result, tmp_path: Path) -> None:
    trace = late.open_trace()
    read = list(characters(of_vcd(exported(trace, tmp_path / "a.vcd", "vcd"))[0]["link"]))
    with exported(trace, tmp_path / "a.csv", "csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert bytes(char.value for char in read) == bytes.fromhex("".join(row["heard"] for row in rows))
    assert sum(int(row["wrong_characters"]) for row in rows) == sum(not char.good for char in read) > 20
    collided = [row for row in rows if row["collided"] == "1"]
    assert all(row["heard"] != row["bytes"] for row in collided)


@pytest.mark.parametrize("contention", quick(1, ["zero_wins", "undefined"]))
def test_a_station_of_the_run_hears_what_the_file_has(
    monkeypatch: pytest.MonkeyPatch, contention: str
) -> None:
    heard: list[Character] = []
    receive = Receiver._receive

    def spy(self: Receiver, rx: RxChar, start: int, end: int, now: int) -> None:
        if self._port.name == "b":
            heard.append(Character(start, rx.value, rx.parity_ok and rx.stop_ok))
        receive(self, rx, start, end, now)

    monkeypatch.setattr(Receiver, "_receive", spy)
    result = bussim.run(loads(CROWD.replace("CONTENTION", contention)), trace=True)
    trace: Trace = result.open_trace()
    assert result.summary["links"]["link"]["collisions"] > 60
    # To the tick: at a microsecond's resolution an edge or a sample may fall on either side.
    frames = list(trace.of(FrameRecord))
    drivers = [driver_of(frame, frame.damaged_bits) for frame in frames]
    disputed = disputed_of(trace.header, "link")
    read = {char.at: char for char in characters(merged(line_lows(drivers, disputed)), 1875)}
    assert len(heard) > 2000
    assert sum(not char.good for char in heard) > 200
    heard = [char for char in heard if char.at < frames[-1].end]  # what the run's end cuts off is in no trace
    assert [read.get(char.at) for char in heard] == heard


@st.composite
def overlapping(draw: st.DrawFn) -> list[FrameRecord]:
    """Frames that overlap, some of whose drivers stay on after them, and some of which pause."""
    found = draw(crowds().filter(bool))
    for place, one in enumerate(found):
        behind = min((f.start for f in found if f.sender == one.sender and f.start >= one.end), default=10**9)
        released = min(behind, one.end + draw(st.integers(1, 200_000)))
        if draw(st.booleans()) and released > one.end:
            found[place] = one._replace(released=released)
        elif len(one.chars) > 1 and one.end + 5000 < behind:
            found[place] = one._replace(pauses=((0, 5000),), end=one.end + 5000)
    return sorted(found, key=lambda each: each.end)


@given(frames=overlapping())
def test_the_lane_of_a_bus_is_its_level_to_the_microsecond(frames: list[FrameRecord]) -> None:
    bus = LINK._replace(contention=Contention.UNDEFINED)
    selection = Selection(made_up(*frames, buses=(bus,)))
    lanes = Lanes(selection, survey(selection))
    drivers = [driver_of(each, each.damaged_bits) for each in frames]
    level = merged(line_lows(drivers, disputed_of(selection.trace.header, "link")))
    found, since, idle = [], 0, idle_before(frames)
    for later, lane, now in lanes.changes():
        us = later - idle
        if lane == 0 and now:
            found.append((since, us))
        elif lane == 0:
            since = us
    assert found == merged((microseconds(first), microseconds(last)) for first, last in level)


@pytest.mark.slow
def test_two_windows_of_a_file_have_the_levels_of_the_whole(tmp_path: Path) -> None:
    trace = bussim.run(loads(CROWD.replace("CONTENTION", "undefined")), trace=True).open_trace()
    whole = of_vcd(exported(trace, tmp_path / "whole.vcd", "vcd"))[0]
    for number, (start, stop) in enumerate([(1_000, 1_300), (2_040, 2_045), (2_600, 3_100)]):
        path = exported(trace, tmp_path / f"{number}.vcd", "vcd", start=start * 72_000, stop=stop * 72_000)
        for lane, lows in of_vcd(path)[0].items():
            begin, end = start * 1000, stop * 1000
            inside = [(max(a, begin), min(b, end)) for a, b in whole[lane] if max(a, begin) < min(b, end)]
            assert lows == inside
