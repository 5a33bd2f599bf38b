"""What export writes, read by the readers of recordings: the same characters at the same times."""

from __future__ import annotations

from pathlib import Path

import pytest

from bussim.engines.modbus.adu import Mode
from bussim.live.recordings.open import Kind, kind_of, open_recording
from bussim.live.recordings.source import LineSetup
from bussim.trace.records import FrameRecord, TraceBus
from bussim.units import TICKS_PER_MS
from tests.export.samples import FEEDER, LINK, PUMPS, exchanges, exported, link_frames, timing, trace

CASES = [
    (LINK, link_frames(60)),
    (FEEDER, [each for one in exchanges(20, bus=FEEDER) for each in one.frames]),
    (PUMPS, [each for one in exchanges(20, bus=PUMPS, mode=Mode.ASCII) for each in one.frames]),
]


@pytest.mark.parametrize("to", ["pcapng", "sr"])
@pytest.mark.parametrize(("bus", "frames"), CASES, ids=["nn", "rtu", "ascii"])
def test_a_recording_of_the_export_has_its_characters(
    tmp_path: Path, to: str, bus: TraceBus, frames: list[FrameRecord]
) -> None:
    path = exported(trace(*frames, buses=(bus,)), tmp_path / f"a.{to}", to)
    kind = kind_of(path)
    assert kind is (Kind.SIGROK if to == "sr" else Kind.PACKETS)
    own = timing(bus.baud, bus.format)
    source = open_recording(path, channels=(bus.name,))
    read = [char for chunk in source.chunks(LineSetup(own, False, (bus.name,))) for char in chunk.chars]
    sent = [
        (value, each.start + own.characters(index))
        for each in frames
        for index, value in enumerate(each.chars)
    ]
    assert [char.value for char, _, _ in read] == [value for value, _ in sent]
    assert all(char.parity_ok and char.stop_ok for char, _, _ in read)
    # pcapng has nanoseconds, a session microseconds, both from the run's start.
    allowed = 1 if to == "pcapng" else 36
    assert all(abs(start - at) <= allowed for (_, start, _), (_, at) in zip(read, sent, strict=True))


@pytest.mark.parametrize("start", [None, 5 * TICKS_PER_MS])
def test_a_frame_that_begins_with_the_window_is_read_whole(tmp_path: Path, start: int | None) -> None:
    frames = link_frames(40)
    moved = (start or 0) - frames[0].start
    frames = [each._replace(start=each.start + moved, end=each.end + moved) for each in frames]
    own = timing(LINK.baud, LINK.format)
    for to in ("sr", "pcapng"):
        path = exported(trace(*frames, buses=(LINK,)), tmp_path / f"a.{to}", to, start=start)
        chunks = open_recording(path, channels=(LINK.name,)).chunks(LineSetup(own, False, (LINK.name,)))
        assert bytes(char.value for chunk in chunks for char, _, _ in chunk.chars) == b"".join(
            each.chars for each in frames
        )
    vcd = exported(trace(*frames, buses=(LINK,)), tmp_path / "a.vcd", "vcd", start=start).read_text()
    since = 1_000 * (start or 0) // TICKS_PER_MS
    first = next(int(line[1:]) for line in vcd.splitlines() if line.startswith("#") and line != f"#{since}")
    assert first == since + round(40 * 1e6 / LINK.baud)  # four characters of ten bits
