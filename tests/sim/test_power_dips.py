"""What a power dip does to shared devices: which each station shows and sends, and for how long they are old."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import replace
from functools import cache

import pytest

import bussim
from bussim.results.collector import Collector
from bussim.results.meters.timeline import Span
from bussim.results.meters.watch import Watch, Watched
from bussim.scenario import fault_kinds
from bussim.scenario.loader import load, loads
from bussim.scenario.model import Scenario
from bussim.sim.runner import simulate
from bussim.trace.records import FrameRecord
from tests.sim import chance
from tests.sim.build import MS, SECOND, Done, Recorder, fault, run

#: The built-in scenario's dips: when each begins and ends.
DIPS = {0.2: (5 * SECOND, 26 * SECOND // 5), 1: (10 * SECOND, 11 * SECOND), 5: (20 * SECOND, 25 * SECOND)}


@cache
def dips() -> tuple[Done, dict[str, Watched], dict[tuple[str, str], list[Span]]]:
    """The built-in scenario: its trace, its observed devices over time, the spans of old data by pair."""
    scenario = load("power_dips")
    done = run(scenario)
    watch = Watch([Watched(plc.name, name, 16) for plc in scenario.plcs for name in plc.observed])
    for record in done.record.values:
        watch.take(record)
    return done, {each.name: each for each in watch.watched}, stale_of(scenario)


def stale_of(scenario: Scenario) -> dict[tuple[str, str], list[Span]]:
    collector = Collector()
    links = collector.links(simulate(scenario, collector))
    return {pair: refresh.stale for link in links.values() for pair, refresh in link.refresh.items()}


def first_end(watched: dict[str, Watched], again: int) -> int:
    """The press's first END after a dip, at which the first of its devices changes after the return."""
    press = [each.ticks for each in watched.values() if each.plc == "press"]
    return min(tick for ticks in press for tick in ticks[bisect_right(ticks, again) :][:1])


def received(done: Done, source: int, receiver: int, since: int) -> int:
    """When a station first received another's block after a tick."""
    return next(
        tick
        for _, sender, tick, heard in done.record.refreshes
        if sender == source and tick > since and (heard is None or receiver in heard)
    )


def word_of(frame: FrameRecord) -> int:
    """The first word of a frame of mode 1, behind the 32 points."""
    return int(frame.chars[11:15], 16)


def points_of(frame: FrameRecord) -> int:
    """The 32 points of a frame of mode 1, the lowest in bit 0."""
    return int.from_bytes(bytes.fromhex(frame.chars[3:11].decode()), "little")


@pytest.mark.parametrize("lasting", DIPS)
def test_what_the_press_has_after_a_dip(lasting: float) -> None:
    done, seen, _ = dips()
    begin, again = DIPS[lasting]
    back, fresh = first_end(seen, again), received(done, 0, 1, again)
    assert again < back <= again + 2 * 12 * MS
    assert back < fresh
    for tick in (back, fresh - 1):
        # Latched: the release and its own fault as they were, also where the line says otherwise by now.
        assert seen["press.M1000"].at(tick) == seen["press.Y10"].at(tick) == 1
        assert seen["press.M1065"].at(tick) == 1
        # General: 0, but for what its own program has counted since.
        assert seen["press.D0"].at(tick) == 0
        assert seen["press.D32"].at(tick) <= (tick - again) // (100 * MS) + 1
        # What waits for the link stays off.
        assert seen["press.M8191"].at(tick) == seen["press.Y11"].at(tick) == 0
    assert seen["press.D300"].at(back) - seen["press.D300"].at(begin) in (0, 1)
    # At the first END at or after the next frame it has what the line says now.
    taken = seen["press.D0"].ticks[bisect_right(seen["press.D0"].ticks, back)]
    assert 0 <= taken - fresh <= 14 * MS
    released = int(lasting != 1)  # the line has taken the release away in the second dip
    assert (seen["press.M1000"].at(taken), seen["press.D0"].at(taken)) == (released, 7)
    assert seen["press.Y11"].at(again + SECOND // 2) == released


@pytest.mark.parametrize("lasting", DIPS)
def test_what_the_others_see_of_it(lasting: float) -> None:
    done, seen, _ = dips()
    begin, again = DIPS[lasting]
    fresh = received(done, 1, 0, again)
    assert received(done, 1, 2, again) == fresh
    for name in ("line.M1064", "line.M1065", "line.D32", "feeder.M1065", "line.Y1"):
        # All of the old block, to the end; nothing in the memory says that it is old …
        assert seen[name].between(begin + 100 * MS, fresh) == [], name
        assert seen[name].at(fresh - 1), name
    # … but the error flag, after four attempts in vain and until the next reply. Three last 50 ms each; the first
    # may have ended with a reply that the dip cut short.
    on, off = (tick for tick, _ in seen["line.M8184"].between(begin, again + SECOND))
    assert begin + 3 * 50 * MS < on <= begin + 4 * 50 * MS + 60 * MS
    assert fresh <= off <= fresh + 10 * MS
    # The flag's level is read in the scan that begins then.
    (gone, _), (back, _) = seen["line.Y0"].between(begin, again + SECOND)
    assert 0 < gone - on <= 10 * MS
    assert off <= back <= off + 10 * MS
    assert seen["line.D32"].at(fresh + 20 * MS) <= 3  # its words have begun anew


@pytest.mark.parametrize("lasting", DIPS)
def test_what_it_sends_after_a_dip(lasting: float) -> None:
    done, seen, _ = dips()
    _, again = DIPS[lasting]
    frame = next(frame for frame in done.of("press") if frame.start > again)
    assert frame.start > first_end(seen, again)
    # X0, which is on, and the fault that was set before; words that its program has counted since.
    assert points_of(frame) == 0b11
    assert word_of(frame) <= 2


def test_where_nothing_is_latched_it_has_nothing_until_it_has_heard_the_others() -> None:
    scenario = load("power_dips", ["plcs.press.profile={base: pw10, latched: [S0-S1]}"])
    done = run(scenario)
    watch = Watch([Watched("press", name, 16) for name in scenario.plcs[1].observed])
    for record in done.record.values:
        watch.take(record)
    seen = {each.name: each for each in watch.watched}
    for _, again in DIPS.values():
        back, fresh = first_end(seen, again), received(done, 0, 1, again)
        for tick in (back, fresh - 1):
            for name in ("M1000", "M1065", "Y10", "D0"):
                assert seen[f"press.{name}"].at(tick) == 0, name
            assert seen["press.D300"].at(tick) <= (tick - again) // (100 * MS) + 1
        # Nor does it send its fault: X0 alone.
        assert points_of(next(frame for frame in done.of("press") if frame.start > again)) == 1


def test_for_how_long_which_station_worked_on_old_data() -> None:
    done, _, stale = dips()
    names = ["line", "press", "feeder"]
    for source in range(3):
        for receiver in range(3):
            if source == receiver:
                continue
            expected = []
            for begin, again in DIPS.values():
                if 1 not in (source, receiver):
                    continue
                # A source away: from the beginning on. A receiver away: it works when it is back.
                since = begin if source == 1 else again
                expected.append(Span(since, received(done, source, receiver, again)))
            assert stale[names[source], names[receiver]] == expected


@pytest.mark.slow
def test_the_summary_names_the_longest() -> None:
    import bussim

    summary = bussim.run("power_dips", rows=False).summary
    link = summary["links"]["link"]
    _, _, stale = dips()
    for (source, receiver), spans in stale.items():
        lasted = [span.end - span.start for span in spans if span.end is not None]
        right = {"total": sum(lasted) / MS, "longest": max(lasted) / MS} if lasted else None
        assert link["stale_ms"].get(f"{source}->{receiver}") == (right and pytest.approx(right, abs=1e-6))
    assert "stale_ms" not in bussim.run("two_stations", rows=False).summary["links"]["link"]


LATE = """
schema: 1
name: a slave that is polled before its first END
duration: 3 s
seed: 1
buses: [{name: link, nn: true}]
plcs:
  - {name: m, scan: 5 ms, nn: {bus: link, station: 0, slaves: 1, mode: 1, timeout: 50 ms}}
  - name: s
    scan: 600 ms
    phase: 600 ms
    nn: {bus: link, station: 1}
    inputs: {X0: {times: [100 ms, 1.6 s]}}
    program: |
      LD   X0
      OUT  M1064
      LD   M8000
      MOV  K9 D32
      END
faults:
  - {at: 1.5 s, for: 200 ms, power_off: s}
"""


def test_a_slave_sends_its_block_of_before_until_its_first_end() -> None:
    """M1064 as it was before the dip, though X0 is off by now, and D32, which is general, as 0."""
    done = run(loads(LATE))
    end = 17 * SECOND // 10 + 600 * MS  # its first END
    sent = [frame for frame in done.of("s") if frame.start > 16 * SECOND // 10]
    before = [frame for frame in sent if frame.start < end]
    assert len(before) > 10
    assert {(points_of(frame), word_of(frame)) for frame in before} == {(1, 0)}
    assert {(points_of(frame), word_of(frame)) for frame in sent[len(before) :]} == {(0, 9)}
    # The master takes it for new; it is not, and counts as old until the first frame with the END's image.
    fresh = next(frame.end for frame in sent if frame.start >= end)
    assert stale_of(loads(LATE))["s", "m"] == [Span(3 * SECOND // 2, fresh)]


def _away(scenario: Scenario, name: str) -> list[tuple[int, int]]:
    """When a PLC is in STOP or without supply, joined, from the scenario's faults."""
    spans = sorted(
        (each.window.at, each.window.until or scenario.duration)
        for each in scenario.faults
        if isinstance(each.kind, fault_kinds.Stop | fault_kinds.PowerOff) and each.kind.node == name
    )
    joined: list[tuple[int, int]] = []
    for at, until in spans:
        if joined and at <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(until, joined[-1][1]))
        else:
            joined.append((at, until))
    return joined


@pytest.mark.parametrize("seed", range(12))
def test_old_data_as_the_trace_has_them(seed: int) -> None:
    """Random links with stations away: every pair's old data, second by second, from frames and faults."""
    given = chance.scenario(seed, 0.4)
    names = [plc.name for plc in given.plcs]
    away = [
        fault(kind(names[(seed + number) % len(names)]), 0.1 + 0.21 * number, 0.05 + 0.13 * number)
        for number, kind in enumerate([fault_kinds.PowerOff, fault_kinds.Stop, fault_kinds.PowerOff] * 2)
    ]
    scenario = replace(given, duration=3 * SECOND // 2, faults=(*given.faults, *away))
    record = Recorder()
    simulate(scenario, record)
    stale = stale_of(scenario)
    fresh = {}  # by position: (RUN, from when on blocks are new)
    for _, position, tick, at in record.switches:
        fresh.setdefault(position, []).append((tick, at))
    for source, name in enumerate(names):
        for receiver, other in enumerate(names):
            if source == receiver or (name, other) not in stale:
                continue
            ticks = [
                tick
                for _, sender, tick, heard in record.refreshes
                if sender == source and (heard is None or receiver in heard)
            ]
            for number in range(300):
                now = number * scenario.duration // 300
                working = not any(at <= now < until for at, until in _away(scenario, other))
                last = ticks[bisect_right(ticks, now) - 1] if ticks and ticks[0] <= now else None
                begun = [at for plc in (name, other) for at, _ in _away(scenario, plc) if at <= now]
                old = False
                if working and last is not None and begun:
                    came = [at for tick, at in fresh[source] if at is not None and tick <= now]
                    good = [t for t in ticks if t <= now and t > max(begun) and t >= max(came)]
                    good = [t for t in good if not _within(t, _away(scenario, name))]
                    old = not good
                shown = any(
                    span.start <= now and (span.end is None or now < span.end) for span in stale[name, other]
                )
                assert shown is old, (name, other, now / SECOND)


def _within(tick: int, spans: list[tuple[int, int]]) -> bool:
    return any(at < tick <= until for at, until in spans)


COUNTED = """
schema: 1
name: counted
duration: 300 ms
plcs:
  - name: p
    scan: 5 ms
    program: |
      LD M8002
      INC D300
      END
observe: [p.D300]
faults: [{at: 0 s, for: 100 ms, FAULT: p}]
"""


@pytest.mark.parametrize("kind", ["power_off", "stop"])
def test_what_is_away_from_the_beginning_carries_no_scan_out_before(kind: str) -> None:
    """D300 is latched: it counts every RUN, of which there is one, 100 ms on."""
    done = run(loads(COUNTED.replace("FAULT", kind)))
    assert [each.value for each in done.record.values] == [1]
    assert 100 * MS < done.record.values[0].tick < 110 * MS
    assert [(note.tick, note.kind) for note in done.record.notes if "run" in note.kind] == [
        (0, "left_run"),
        (100 * MS, "in_run"),
    ]


def test_a_station_that_never_has_a_supply_keeps_its_number() -> None:
    scenario = load("two_stations")
    late = [
        replace(plc, power_on=plc.power_on + 999 * SECOND * (n == 1)) for n, plc in enumerate(scenario.plcs)
    ]
    run_of = bussim.run(replace(scenario, plcs=tuple(late), duration=2 * SECOND))
    assert run_of.summary["plcs"][late[1].name]["registers"]["D8176"] == 1
    assert "same_number" not in str(run_of.summary["verdict"])
    assert f"Station 1 ({late[1].name})" in str(run_of.summary["verdict"])
