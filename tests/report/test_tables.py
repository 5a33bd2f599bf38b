"""The report's tables, without a browser."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest

import bussim
from bussim.report import compare, settings, tables
from bussim.report.charts import MOST_BINS, MOST_POINTS, SCANS, histogram_chart, tail_chart
from bussim.report.latency import in_words, latency_part, overlays, parts_data
from bussim.report.nodes import node_tables
from bussim.report.parts import Charts
from bussim.report.runs import ExactDistribution, Source
from bussim.report.tables import stations, turnarounds_of
from bussim.results.meters.histogram import BIN_TICKS, Histogram
from bussim.results.run_record import RunRecord
from bussim.results.text.latency import counts_in_words
from bussim.trace.records import AttemptRecord
from bussim.wording import in_ms


@pytest.fixture(scope="module")
def source() -> Source:
    return Source("press", "runs/press", bussim.run("press_line", rows=False).record, "schema: 1\nseed: 7\n")


def changed(source: Source, **summary: Any) -> Source:
    record = source.record
    return replace(
        source,
        record=RunRecord({**record.summary, **summary}, record.duration, record.links, record.notes),
    )


def test_false_errors_a_year_are_no_powers_of_ten() -> None:
    times = {"mean_ms": 51.1, "worst_case_ms": 435.8, "one_dead_ms": 245.5, "two_dead_ms": None}
    spans = {"no_error_ms": {"min": 50.2, "max": 50.6}, "quantiles_ms": {"1e-3": 102.2}}
    noticed = {"detect_ms": {"mean": 205.2, "max": 241.2}, "ride_through_ms": {"silence": 104.4}}
    for rate, text in ((116.889, "120"), (0.04, "0.04"), (3456.0, "3,500"), (0.0, "0"), (None, "–")):
        figures = {**times, **spans, **noticed, "false_error_onsets_per_year": rate, "stations_dead": []}
        rows = dict(tables.exact_figures("link", ExactDistribution(figures)).rows)
        assert [cell.text for cell in rows["false station errors begin, a year"]] == [text]


def test_numbers_are_shown_to_their_digits() -> None:
    assert tables.number(1234567) == "1,234,567"
    assert tables.number(50.41, 3) == "50.410"
    assert tables.number(None, 3) == "–"
    assert tables.number(0.059384) == "0.059384"
    assert tables.pointer("a/b", "c~d") == "/a~1b/c~0d"


def test_only_the_settings_that_count_are_shown(source: Source) -> None:
    table = tables.settings(source, "link")
    assert table.head == ["register", "press1", "press2", "press3"]
    shown = {heading.split(":")[0]: [cell.text for cell in cells] for heading, cells in table.rows}
    assert shown["D8176"] == ["0", "1", "2"]
    assert shown["D8179"] == ["5", "–", "–"]
    assert shown["M8179"] == ["1", "1", "1"]


def test_the_setting_program_sets_what_the_scenario_has() -> None:
    plcs = bussim.run("press_line", rows=False).summary["plcs"]
    assert settings.mov_lines(plcs["press1"]["registers"]) == [
        "LD M8002",
        "MOV K0 D8176",
        "MOV K2 D8177",
        "MOV K2 D8178",
        "MOV K5 D8179",
        "MOV K5 D8180",
        "SET M8179",
    ]
    assert settings.mov_lines(plcs["press2"]["registers"]) == ["LD M8002", "MOV K1 D8176", "SET M8179"]
    assert settings.mov_lines({"D8176": 3, "M8179": 0})[-1] == "RST M8179"


def test_a_station_counts_the_time_of_its_flag(source: Source) -> None:
    table = stations(source, "link")
    first, second = (dict(zip(table.head, [name, *cells], strict=True)) for name, cells in table.rows)
    (span,) = source.record.links["link"].in_error[1]
    assert span.end is not None
    assert first["in error (s)"].text == f"{(span.end - span.start) / 72e6:.3f}"
    assert first["station"] == "1 (press2)"
    assert (first["failed 01"].text, first["station errors (link scans)"].text) == ("90", "15")
    assert (second["in error (s)"].text, second["station errors (link scans)"].text) == ("0.000", "0")


def test_turnarounds_are_those_of_replies_and_rare_quantiles_are_not_shown(source: Source) -> None:
    good = AttemptRecord("link", 0, 1, 1, 1, "ok", 0, 0)
    attempts = [good._replace(turnaround=21_600 + 72 * n) for n in range(200)]
    attempts.append(good._replace(outcome="damaged", code=4, turnaround=648_000))
    table = stations(replace(source, turnarounds=turnarounds_of(attempts)), "link")
    first = dict(zip(table.head[1:], table.rows[0][1], strict=True))
    assert first["replies"].text == "200"
    assert float(first["turnaround median (ms)"].text) == pytest.approx(0.399, abs=0.005)
    assert first["p99 (ms)"].text == "–"
    assert first["max (ms)"].text == "0.499"
    assert table.rows[1][1][0].text == "0"


def test_ports_and_devices_have_tables_of_named_figures() -> None:
    times = {"p50": 58.1, "p99": None, "max": 63.0}
    master = {
        "bus": "drives",
        "transactions": 300,
        "ok": 299,
        "other_errors": {"frame length": 1},
        "response_ms": times,
        "polls": {"vfd_status": {"transactions": 300, "ok": 299, "response_ms": times, "age_ms": None}},
    }
    free = {"bus": "belt", "sent": 2, "bytes": {"sent": 10, "received": 0}}
    drive = {"bus": "drives", "requests": 300, "state": {"running_step": 1}}
    summary = {"ports": {"main.COM3": master, "main.COM4": free}, "devices": {"drive": drive}, "buses": {}}
    found = {table.caption: table for table in node_tables(summary)}
    assert list(found) == [
        "Modbus masters",
        "Modbus slaves",
        "Free protocol",
        "Devices at the end of the run",
        "The polls of main.COM3",
    ]
    shown = {heading: [cell.text for cell in cells] for heading, cells in found["Modbus masters"].rows}
    assert shown["requests"] == ["300"]
    assert shown["frame length"] == ["1"]
    assert shown["response time, p99 (ms)"] == ["–"]
    assert "answered with own data" not in shown  # a folder of an earlier version does not have it
    polls = found["The polls of main.COM3"]
    assert polls.head == ["", "vfd_status"]
    paths = {cell.path for _, cells in polls.rows for cell in cells}
    assert "/ports/main.COM3/polls/vfd_status/response_ms/p50" in paths
    (state,) = found["Devices at the end of the run"].rows
    assert state == ("running_step", [tables.Cell("1", "/devices/drive/state/running_step")])


def test_a_code_is_no_quantity(source: Source) -> None:
    plcs = source.summary["plcs"]
    press1 = {**plcs["press1"], "registers": {**plcs["press1"]["registers"], "D8063": 7309}}
    table = tables.plcs(changed(source, plcs={**plcs, "press1": press1}))
    assert table.rows[0][1][-1].text == "7309"


def test_what_rounds_to_nothing_is_no_difference(source: Source) -> None:
    link = source.summary["links"]["link"]
    times = {**link["scan_time_ms"], "mean": link["scan_time_ms"]["mean"] - 1e-6}
    other = changed(source, links={"link": {**link, "scan_time_ms": times}})
    rows = dict(compare.link_table([source, other], "link").rows)
    mean = rows["link scan, mean (ms)"][1]
    assert (mean.differs, mean.title) == (False, "")


def test_a_comparison_shows_the_verdict_of_each_run(source: Source) -> None:
    table = compare.verdict_table([source, source])
    assert [heading for heading, _ in table.rows] == ["press", "press"]
    assert "station 1 (press2)" in table.rows[0][1][0].text.lower()


def test_what_differs_between_runs_is_marked(source: Source) -> None:
    other = bussim.run(bussim.load("press_line", ["plcs.press1.nn.retries=2"]), rows=False).record
    second = Source("fewer", "runs/fewer", other, "schema: 1\nseed: 7\nretries: 2\n")
    table = compare.link_table([source, second], "link")
    cells = dict(table.rows)
    assert [cell.differs for cell in cells["retries (D8179)"]] == [False, True]
    assert cells["retries (D8179)"][1].title == ""
    assert [cell.differs for cell in cells["timeout (ms)"]] == [False, False]
    first, longest = (run.record.summary["links"]["link"]["scan_time_ms"]["max"] for run in (source, second))
    assert cells["link scan, longest (ms)"][1].title == f"{100 * (longest - first) / first:+.1f} %"
    ((label, lines),) = compare.scenario_changes([source, second])
    assert label == "fewer"
    assert "+retries: 2" in lines


def test_a_run_without_the_link_has_dashes(source: Source) -> None:
    empty = changed(source, links={})
    cells = dict(compare.link_table([source, empty], "link").rows)
    assert cells["link scans"][1].text == "–"
    assert cells["failed attempts"][1].text == "–"


def test_charts_carry_the_counts_and_the_law(source: Source) -> None:
    histogram = source.record.links["link"].scan_times.histogram
    distribution = ExactDistribution({"valid": True}, x=[50.0, 50.5, 51.0], tail=[1.0, 0.25, 0.0])
    chart = histogram_chart({"press": histogram}, distribution, "t")
    (series,) = chart["series"]
    assert sum(count for _, count in series["bins"]) == series["count"] == histogram.count
    assert chart["law"] == [[50.0, 1.0], [50.5, 0.25], [51.0, 0.0]]
    points = tail_chart(histogram, None, "t")["counted"]
    assert all(0 < p < 1 for _, p in points)
    assert [p for _, p in points] == sorted((p for _, p in points), reverse=True)
    # After the bin of a scan time, those that took longer are left.
    number, count = min(histogram.bins.items())
    assert points[0] == [pytest.approx((number + 0.5) * 0.01), pytest.approx(1 - count / histogram.count)]


def test_a_histogram_is_a_table_too(source: Source) -> None:
    histogram = source.record.links["link"].scan_times.histogram
    table = tables.histogram_data(histogram, "link", SCANS)
    assert len(table.rows) <= 41
    assert sum(int(cells[0].text.replace(",", "")) for _, cells in table.rows) == histogram.count


def test_ports_of_two_runs_are_compared(source: Source) -> None:
    runs = [
        changed(
            source,
            ports={
                "a.COM3": {"transactions": 10, "ok": ok, "response_ms": {"p50": 44.0}, "errors": {"09": 1}}
            },
        )
        for ok in (10, 9)
    ]
    (table,) = compare.entry_tables(runs)
    cells = dict(table.rows)
    assert [(cell.text, cell.differs) for cell in cells["answered (ok)"]] == [("10", False), ("9", True)]
    assert [cell.text for cell in cells["response time, median (ms)"]] == ["44.000", "44.000"]
    assert [cell.text for cell in cells["port error 09 (no response in time; yy of D8063 = 7xyy)"]] == [
        "1",
        "1",
    ]
    assert cells["answered (ok)"][1].path == "/ports/a.COM3/ok"
    assert compare.entry_tables([source, source]) == []


@pytest.fixture(scope="module")
def words() -> Source:
    run = bussim.run(bussim.load("counter_preset", ["duration=10 s"]), rows=False)
    return Source("words", "runs/words", run.record, "schema: 1\n")


def test_bits_and_words_have_a_table_each(words: Source) -> None:
    part = latency_part(words, Charts())
    assert part is not None
    bits, ages, worst = part.tables
    ((name, cells),) = bits.rows
    entry = words.summary["latency"]["full-box"]
    assert name == "full-box"
    assert bits.head[1:6] == [
        "changes",
        "arrived",
        "never arrived",
        "too short to be seen",
        "under way at the end",
    ]
    shown = dict(zip(bits.head[1:], (cell.text for cell in cells), strict=True))
    assert shown["arrived"] == str(entry["delivered"])
    assert shown["longest"] == f"{entry['ms']['max']:.3f}"
    assert shown["p99"] == "–"
    ((name, cells),) = ages.rows
    shown = dict(zip(ages.head[1:], (cell.text for cell in cells), strict=True))
    assert name == "preset"
    assert "never arrived" not in shown
    assert shown["median"] == f"{words.summary['latency']['preset']['ms']['p50']:.3f}"
    assert worst.head[:3] == ["entry", "no error", "1 lost reply"]
    # Cases by their length, whatever their names say.
    for _, cells in worst.rows:
        values = [float(cell.text) for cell in cells]
        assert values == sorted(values)


def test_latencies_in_sentences(words: Source) -> None:
    full, preset = (list(in_words(name, entry)) for name, entry in words.summary["latency"].items())
    entry = words.summary["latency"]["preset"]
    assert full[0].startswith("full-box, packer.M1064 to line.Y0, rising edge: mean ")
    assert preset == [
        (
            f"preset, line.D0 to packer.D0, age of the word whenever it is read: median "
            f"{entry['ms']['p50']:.1f} ms, maximum {in_ms(entry['ms']['max'], most=True)}, {entry['max_at_s']:.2f} s "
            f"after the start ({counts_in_words(entry)})."
        ),
        (
            f"At worst preset is as old as {in_ms(entry['bound_ms']['no error'], most=True)} with no error, "
            f"{in_ms(entry['bound_ms']['1 lost reply'], most=True)} with 1 lost reply, "
            f"{in_ms(entry['bound_ms']['every retry spent'], most=True)} with every retry spent."
        ),
    ]
    nothing = {**words.summary["latency"]["full-box"], "delivered": 0, "lost": 2, "changes": 2}
    nothing |= {"ms": dict.fromkeys(nothing["ms"]), "bound_ms": {}}
    assert list(in_words("a", nothing)) == [
        "a, packer.M1064 to line.Y0, rising edge: nothing arrived (2 changes: 0 arrived, 2 never arrived)."
    ]


def test_a_latency_is_drawn_with_its_parts_and_bounds(words: Source) -> None:
    drawn = Charts()
    part = latency_part(words, drawn)
    assert part is not None
    assert [entry.heading for entry in part.entries] == [
        "full-box, packer.M1064 to line.Y0",
        "preset, line.D0 to packer.D0",
    ]
    histogram, parts = drawn.payload[2:]
    entry = words.summary["latency"]["preset"]
    record = words.record.latency["preset"]
    assert (histogram["time"], histogram["counted"]) == ("data age", "readings")
    assert sum(count for _, count in histogram["series"][0]["bins"]) == entry["delivered"]
    bound = entry["bound_ms"]["no error"]
    assert histogram["bounds"] == parts["bounds"] == [[bound, f"at worst with no error: {bound:.3f} ms"]]
    assert histogram["shown"] == (0.0, bound)
    assert part.entries[1].charts[0].caption.startswith("Beyond this axis: at worst ")
    assert parts["lanes"] == ["shortest", "mean", "longest"]
    for lane, whole in enumerate((entry["ms"]["min"], entry["ms"]["mean"], entry["ms"]["max"])):
        boxes = [box for box in parts["boxes"] if box[0] == lane]
        assert boxes[0][1] == 0
        assert all(left[2] == right[1] for left, right in pairwise(boxes))
        assert boxes[-1][2] == pytest.approx(whole, abs=1e-5)
    assert record.longest is not None
    longest = dict(parts_data("preset", record, words.summary).rows)["longest"]
    assert [cell.text for cell in longest[:-1]] == [f"{ticks / 72e3:.3f}" for ticks in record.longest.parts]


def test_a_run_without_latencies_has_no_part_of_them(source: Source) -> None:
    drawn = Charts()
    assert latency_part(source, drawn) is None
    assert overlays([source, source], drawn) == []
    assert compare.latency_tables([source, source]) == []


def test_latencies_of_two_runs_are_compared(words: Source) -> None:
    slower = bussim.run(
        bussim.load("counter_preset", ["duration=10 s", "plcs.line.scan.mean=20 ms"]), rows=False
    )
    other = Source("slower", "runs/slower", slower.record, "schema: 1\n")
    tables_ = {table.caption: dict(table.rows) for table in compare.latency_tables([words, other])}
    assert list(tables_) == ["full-box", "preset"]
    first, second = tables_["preset"]["at worst with no error (ms)"]
    assert float(second.text) > float(first.text)
    assert second.differs
    assert "never arrived" not in tables_["preset"]
    drawn = Charts()
    assert [chart.title for chart in overlays([words, other], drawn)] == [
        "full-box, all runs",
        "preset, all runs",
    ]
    assert [[series["label"] for series in chart["series"]] for chart in drawn.payload] == [
        ["words", "slower"]
    ] * 2


def test_a_few_far_scans_leave_the_usual_ones_the_first_view(source: Source) -> None:
    histogram = source.record.links["link"].scan_times.histogram
    chart = histogram_chart({"a": histogram}, None, "t")
    low, high = chart["usual"]
    inside = sum(count for place, count in histogram.bins.items() if low <= place / 100 <= high)
    assert 0.9 * histogram.count < inside < histogram.count
    assert high - low < 1
    longest = source.record.summary["links"]["link"]["scan_time_ms"]["max"]
    assert chart["beyond"] == (
        f"Not in this first view: {histogram.count - inside} of {histogram.count:,} link scans, "
        f"up to {longest:.3f} ms."
    )
    near = Histogram()
    near.add_all([BIN_TICKS * place for place in range(5000, 5030)])
    assert "usual" not in histogram_chart({"a": near}, None, "t")
    assert "usual" not in histogram_chart({"a": histogram}, None, "t", shown=(0.0, 60.0))


@pytest.mark.parametrize(
    ("first", "value", "change"),
    [
        (100.0, 102.0, "+2.0 %"),
        (100.0, 0.0, "-100.0 %"),
        (100.0, 100.00001, ""),
        (0, 7, "+7"),
        (5.0e-11, 1_617_833.9, "× 3.24e+16"),
        (2.0, 30.0, "× 15"),
        (2.0, None, None),
    ],
)
def test_a_change_is_told_in_a_unit_that_can_be_read(
    first: float, value: float | None, change: str | None
) -> None:
    assert compare._change(first, value) == change


def test_great_numbers_have_no_decimals() -> None:
    shown = [compare._short(value) for value in (1_617_833.931, 52.5, 0.0, 5.3e-11, 7)]
    assert shown == ["1,617,834", "52.500", "0.000", "5.3e-11", "7"]


def test_a_page_stays_small_whatever_the_runs_were() -> None:
    wide = Histogram()
    for number in range(1, 60_001):
        wide.add(number * BIN_TICKS)
    distribution = ExactDistribution(
        {"valid": True}, x=list(range(50_000)), tail=[1 - n / 50_000 for n in range(50_000)]
    )
    chart = histogram_chart({"a": wide}, distribution, "t")
    (series,) = chart["series"]
    assert len(series["bins"]) <= MOST_BINS
    assert sum(count for _, count in series["bins"]) == wide.count
    # A bar holds the samples within half its width of its centre.
    assert chart["bin_ms"] == pytest.approx(0.27)
    for bar, count in series["bins"][1:-1]:
        centre, half = round(bar * 27), 13
        assert count == sum(number in wide.bins for number in range(centre - half, centre + half + 1))
    tail = tail_chart(wide, distribution, "t")
    for points in (chart["law"], tail["law"], tail["counted"]):
        assert MOST_POINTS // 2 < len(points) <= MOST_POINTS
    assert chart["law"][-1][0] == 49_999
