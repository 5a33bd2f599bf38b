from __future__ import annotations

import json
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.results.meters.link import LinkRecord, ScanTimes
from bussim.results.meters.plain_data import from_plain, to_plain
from bussim.results.meters.timeline import MOST_CELLS, MOST_SPANS, Span, Spans, Timeline, time_on
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND

SCANS = st.lists(st.tuples(st.integers(1, 60 * TICKS_PER_SECOND), st.integers(1, 10**8)), max_size=200)


@given(SCANS)
def test_no_scan_is_lost_whatever_the_length(steps: list[tuple[int, int]]) -> None:
    timeline, start, scans = Timeline(), 0, []
    for pause, duration in steps:
        start += pause
        scans.append((start, duration))
    for first, last in pairwise([0, *sorted({len(scans) // 3, len(scans) // 2, len(scans)} - {0})]):
        timeline.add(*np.array(scans[first:last]).T)
    cells = timeline.cells
    assert len(cells) <= MOST_CELLS
    assert sum(cell.scans for cell in cells) == len(scans)
    starts = [cell.start for cell in cells]
    assert starts == sorted(starts)
    for number, cell in enumerate(cells):
        after = starts[number + 1] if number + 1 < len(cells) else start + 1
        inside = [duration for begin, duration in scans if cell.start <= begin < after]
        assert cell.scans == len(inside)
        assert cell.total == sum(inside)
        assert (cell.shortest, cell.longest) == (min(inside), max(inside))


@pytest.mark.slow
def test_ten_hours_fit() -> None:
    timeline = Timeline()
    numbers = np.arange(400_000)
    for part in np.split(numbers, 400):
        timeline.add(part * 90 * TICKS_PER_MS, 90 * TICKS_PER_MS + (part == 1234))
    assert MOST_CELLS // 2 < len(timeline.cells) <= MOST_CELLS
    assert max(cell.longest for cell in timeline.cells) == 90 * TICKS_PER_MS + 1


def test_spans_begin_and_end() -> None:
    spans = Spans()
    spans.on(2, 100)
    spans.on(2, 150)  # is on already
    spans.off(1, 160)  # was never on
    spans.off(2, 200)
    spans.on(1, 300)
    assert spans.all() == {1: [Span(300, None)], 2: [Span(100, 200)]}
    spans.all_off(400)
    assert spans.all() == {1: [Span(300, 400)], 2: [Span(100, 200)]}


def test_cells_and_spans_of_a_link_come_back() -> None:
    timeline, spans = Timeline(), Spans()
    numbers = np.arange(100)
    timeline.add(numbers * 9 * TICKS_PER_MS, 9 * TICKS_PER_MS + numbers)
    spans.on(2, 100)
    spans.off(2, 200)
    spans.on(7, 300)
    link = LinkRecord((), ScanTimes(), ScanTimes(), timeline=timeline.cells, in_error=spans.all())
    again = from_plain(LinkRecord, json.loads(json.dumps(to_plain(link))))
    assert (again.timeline, again.in_error) == (link.timeline, link.in_error)


def test_the_time_that_spans_were_on() -> None:
    spans = [Span(0, TICKS_PER_SECOND), Span(3 * TICKS_PER_SECOND, None)]
    assert time_on(spans, 10 * TICKS_PER_SECOND) == 8.0
    assert time_on([], 10) == 0.0


def test_too_many_spans_become_fewer_without_losing_any_time_in_error() -> None:
    spans, tick, times = Spans(), 0, []
    for number in range(20_000):
        tick += 50 * TICKS_PER_MS + number % 977
        spans.on(1 + number % 3, tick)
        times.append((1 + number % 3, tick, tick + 7_000))
        spans.off(1 + number % 3, tick + 7_000)
    kept = spans.all()
    assert sum(map(len, kept.values())) <= MOST_SPANS
    assert spans.joined_within > 0
    for station, start, end in times[::97]:
        assert any(s.start <= start and s.end is not None and end <= s.end for s in kept[station])
