"""Times in a wrong unit: which are reported, with what is meant, and that nothing usual is."""

from __future__ import annotations

import pytest

from bussim.scenario.builtin import names, path
from bussim.scenario.loader import examine, loads
from bussim.scenario.rules.plausible import FAR, RANGES
from bussim.units import format_time, parse_time
from tests.guide.pages import EVERY, blocks, page, quoted, read, table
from tests.scenario.yaml.test_beginners import LINE

MORE = LINE.replace(
    "# end", "noise:\n  - {bus: link, burst: {good: 10 s, bad: 20 ms, ber_good: 0, ber_bad: 0.01}}\n"
).replace("scan: 5 ms,", "scan: 5 ms, phase: 2 ms, sources: {D1: {counter: 100 ms}, M1: {toggle: 1 s}},") + (
    "  - {bus: link, impulse: {every: 20 ms, width: 50 us, ber: 0.5}}\n"
    "faults:\n  - {slow: {station: feeder, extra: 3 ms}}\n  - {late_release: {station: feeder, by: 100 us}}\n"
)


def odd(text: str) -> list[str]:
    """What is said of times that are not usual."""
    return [warning for warning in loads(text).warnings if "usually" in warning]


def test_the_sample_is_usual() -> None:
    assert odd(MORE) == []


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        (
            "scan: 6 ms",
            "scan: 6 s",
            "plcs.feeder.scan is 6 s, but a PLC's scan is usually 100 us to 200 ms; did you mean 6 ms?",
        ),
        (
            "{mean: 10 ms, jitter: 2 ms}",
            "{mean: 10 s, jitter: 2 ms}",
            "plcs.main.scan.mean is 10 s, but a PLC's scan is usually 100 us to 200 ms; did you mean 10 ms?",
        ),
        (
            "phase: 2 ms",
            "phase: 5 s",
            "plcs.labeler.phase is 5 s, but a PLC's phase is usually at most 200 ms; did you mean 5 ms?",
        ),
        (
            "profile: pw10",
            "profile: {base: pw10, turnaround: {mean: 3 s}}",
            "plcs.main.profile.turnaround.mean is 3 s, but a time of a profile is usually at most 200 ms; did you mean 3 ms?",
        ),
        (
            "timeout: 100 ms",
            "timeout: 100 s",
            "plcs.main.ports.COM3.timeout is 100 s, but the timeout of a Modbus master is usually 10 ms to 5 s; did you mean 100 ms?",
        ),
        (
            "every: 100 ms",
            "every: 100 us",
            "plcs.main.polls.vfd_status.every is 100 us, but the period of a poll is usually 5 ms to 1 min; did you mean 100 ms?",
        ),
        (
            "every: 250 ms",
            "every: 250 min",
            "devices.panel.polls.0.every is 250 min, but the period of a poll is usually 5 ms to 1 min; did you mean 250 ms?",
        ),
        (
            "delay: 5 ms",
            "delay: 6 s",
            "devices.vfd1.delay is 6 s, but the delay of a reply is usually at most 500 ms; did you mean 6 ms?",
        ),
        (
            "duration: 60 s",
            "duration: 60 ms",
            "duration is 60 ms, but a run is usually 1 s to 1 d; did you mean 60 s?",
        ),
        (
            "counter: 100 ms",
            "counter: 100 us",
            "plcs.labeler.sources.D1.counter is 100 us, but the period of a counter is usually 5 ms to 1 min; did you mean 100 ms?",
        ),
        (
            "bad: 20 ms",
            "bad: 20 s",
            "noise.0.burst.bad is 20 s, but a burst is usually 10 us to 1 s; did you mean 20 ms?",
        ),
        (
            "extra: 3 ms",
            "extra: 20 s",
            "faults.0.slow.extra is 20 s, but the delay of a slow station is usually at most 1 s; did you mean 20 ms?",
        ),
        (
            "by: 100 us",
            "by: 200 ms",
            "faults.1.late_release.by is 200 ms, but the late release of a driver is usually at most 10 ms; did you mean 200 us?",
        ),
    ],
)
def test_the_unit_that_is_meant_is_offered(right: str, wrong: str, said: str) -> None:
    assert right in MORE
    assert odd(MORE.replace(right, wrong, 1)) == [said]


@pytest.mark.parametrize("row", RANGES, ids=["-".join(row[:2]) for row in RANGES])
def test_ten_times_beyond_a_range_is_still_possible(row: tuple[str, str, str, str, str]) -> None:
    low, high = (parse_time(bound) for bound in row[3:])
    assert 0 <= low < high
    if row[:2] != ("polls", "every"):
        return
    for ticks, count in ((low // FAR, 0), (low // FAR - 1, 1), (high * FAR, 0), (high * FAR + 1, 1)):
        assert len(odd(MORE.replace("every: 100 ms", f"every: {format_time(ticks)}", 1))) == count


def test_where_no_unit_fits_none_is_offered() -> None:
    assert odd(MORE.replace("by: 100 us", "by: 9e7 us", 1)) == [
        "faults.1.late_release.by is 9e7 us, but the late release of a driver is usually at most 10 ms"
    ]


@pytest.mark.parametrize("name", names())
def test_no_built_in_scenario_is_odd(name: str) -> None:
    assert [warning for warning in examine(path(name)).warnings if "usually" in warning.message] == []


@pytest.mark.parametrize("text", [block for each in EVERY for block in blocks(read(each), "yaml")])
def test_no_example_is_odd(text: str) -> None:
    from bussim.scenario.rules.plausible import check_plausible
    from bussim.scenario.yaml.parser import read as read_yaml
    from bussim.scenario.yaml.source_map import Report

    _, source_map, _ = read_yaml(text, "example")
    report = Report(source_map)
    check_plausible(report)
    assert report.warnings == []


def test_the_guide_has_the_ranges() -> None:
    shown = [[quoted(cell) for cell in row] for row in table(page("scenario"), "time | usually")]
    for section, key, _, low, high in RANGES:
        assert [section if key == "*" else key, low, high] in [
            [name, *low, *high] for keys, low, high in shown for name in keys
        ]
