from __future__ import annotations

import random
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.errors import UsageError
from bussim.export import formats
from bussim.export.formats import FORMATS
from bussim.export.selection import Selection, in_order, survey
from bussim.units import TICKS_PER_SECOND
from tests.export.samples import FEEDER, LINK, exported, frame, link_frames, trace


@given(starts=st.lists(st.integers(0, 50), min_size=1, max_size=40), choose=st.randoms(use_true_random=False))
def test_frames_come_by_their_starts_however_late_they_are_recorded(
    starts: list[int], choose: random.Random
) -> None:
    frames = [frame(LINK, start, "press1", bytes((number,))) for number, start in enumerate(starts)]
    choose.shuffle(frames)
    lateness = survey(Selection(trace(*frames))).lateness
    found = list(in_order(frames, lateness))
    assert found == sorted(frames, key=lambda each: each.start)  # a stable sort: ties as recorded


def test_a_well_ordered_trace_is_not_held_back() -> None:
    frames = iter(link_frames(10))
    ordered = in_order(frames, 0)
    first = next(ordered)
    assert first.counter == 0
    assert len(list(frames)) == 8  # one was given, one more had been read


def test_the_survey_finds_the_protocol_of_each_node() -> None:
    frames = [
        frame(FEEDER, 100, "press1.COM3", b"\x01", damaged_at={"feeder1": (3,)}),
        frame(LINK, 50, "unknown", b"\x05"),
        frame(FEEDER, 20_000, "feeder1", b"\x01", protocol="free"),
    ]
    found = survey(Selection(trace(*frames, buses=(LINK, FEEDER))))
    assert (found.frames, found.lateness) == (3, 50)
    assert found.end == frames[2].end
    assert found.buses["link"].nodes == ["press1", "press2", "press3", "unknown"]
    assert found.buses["feeder"].protocols == ["modbus-rtu", "free"]
    assert found.buses["feeder"].receivers == ["feeder1"]
    assert found.buses["feeder"].stations == {"feeder1": 17}
    assert found.buses["feeder"].timing.baud == 9600


def test_an_unknown_bus_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(UsageError, match=r"the trace has no bus 'feder'; did you mean feeder\?"):
        Selection(trace(buses=(LINK, FEEDER)), "feder")


@pytest.mark.parametrize(
    ("bus", "window", "expected"),
    [
        (None, (None, None), "the trace has no frame; there is nothing to export"),
        ("feeder", (None, None), "the trace has no frame on the bus 'feeder'; there is nothing to export"),
    ],
)
def test_an_empty_trace_is_refused(
    bus: str | None, window: tuple[int | None, int | None], expected: str
) -> None:
    with pytest.raises(UsageError) as error:
        survey(Selection(trace(buses=(LINK, FEEDER)), bus, *window))
    assert str(error.value) == expected


def test_an_empty_window_is_refused_with_what_there_is() -> None:
    one = frame(LINK, TICKS_PER_SECOND, "press1", b"\x0511A2")
    selection = Selection(trace(one), None, 2 * TICKS_PER_SECOND, 3 * TICKS_PER_SECOND)
    with pytest.raises(UsageError) as error:
        survey(selection)
    assert str(error.value) == (
        "the trace has no frame from 2 s to 3 s; its frames are between 1.000 s and 1.001 s"
    )


@pytest.mark.parametrize("change", [{"baud": 0}, {"format": "9X7"}, {"ppm": -1e6}])
def test_a_rate_that_no_uart_has_is_refused(change: dict[str, object]) -> None:
    one = frame(LINK, 0, "press1", b"\x05")._replace(**change)  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="the trace is damaged"):
        survey(Selection(trace(one)))


@pytest.mark.parametrize("to", FORMATS)
def test_every_format_writes_a_file_of_its_own(tmp_path: Path, to: str) -> None:
    done = exported(trace(*link_frames(20)), tmp_path / f"a{FORMATS[to].ending}", to)
    others = [other for other in FORMATS if other != to]
    for other in others:
        again = exported(trace(*link_frames(20)), tmp_path / f"b{FORMATS[other].ending}", other)
        assert again.read_bytes() != done.read_bytes()


def test_every_writer_has_its_line_in_the_table() -> None:
    for module in Path(formats.__file__).parent.glob("*.py"):
        for writer in re.findall(r"^def (write_\w+)", module.read_text(encoding="utf-8"), re.MULTILINE):
            assert hasattr(formats, writer), f"{module.name}: {writer} is no format's"
