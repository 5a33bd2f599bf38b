"""The example of the PW10 manual (section 7.6): a master and one slave, mode 2, 5 retries, 50 ms, COM4."""

from __future__ import annotations

import pytest

from bussim.plc.memory import Device
from bussim.plc.sources import Counter, Source, Toggle
from bussim.scenario import model
from bussim.sim.runner import Simulation
from tests.sim.build import (
    GAP,
    MS,
    PARAMETERS,
    POLL,
    SECOND,
    TURNAROUND,
    data,
    link,
    plain_scan,
    registers_now,
    started,
    steady,
)

MASTER_PHASE, SLAVE_PHASE = 1 * MS, 4 * MS
#: PLC scans of 10 and 7 ms, ten per cent longer under the link.
MASTER_SCAN, SLAVE_SCAN = 11 * MS, 7 * MS * 11 // 10
#: Link scans, from one data frame's start to the next one's.
SCAN = plain_scan(2, 2)
FIRST = MASTER_PHASE + GAP + PARAMETERS + GAP


def sources(bit: int, word: int) -> dict[str, Source]:
    """Something of its own for each of 64 points and 8 words."""
    toggles: dict[str, Source] = {f"M{bit + n}": Toggle((3 * n + 17) * MS) for n in range(64)}
    return toggles | {f"D{word + n}": Counter((n + 2) * MS) for n in range(8)}


def scenario() -> model.Scenario:
    others = {
        0: {"scan": model.Scan(10 * MS), "phase": MASTER_PHASE, "sources": sources(1000, 0)},
        1: {"scan": model.Scan(7 * MS), "phase": SLAVE_PHASE, "sources": sources(1064, 32)},
    }
    return link(2, 2, seconds=3, retries=5, units=5, others=others)


def sent(number: int, station: int) -> int:
    """When a station's data frame of a link scan begins."""
    start = FIRST + number * SCAN
    return start if station == 0 else start + data(2) + GAP + POLL + TURNAROUND


def latest_end(station: int, tick: int) -> int | None:
    phase, scan = ((MASTER_PHASE, MASTER_SCAN), (SLAVE_PHASE, SLAVE_SCAN))[station]
    return None if tick < phase else phase + (tick - phase) // scan * scan


def copy_at(source: int, tick: int) -> int | None:
    """The END of a source whose values the other station shows at a tick; None: nothing yet."""
    end = latest_end(1 - source, tick)
    if end is None:
        return None
    number = (end - data(2) - sent(0, source)) // SCAN
    return latest_end(source, sent(number, source)) if number >= 0 else None


@pytest.mark.parametrize(("reader", "bit", "word"), [("p0", 1064, 32), ("p1", 1000, 0)])
def test_every_device_arrives_where_and_when_it_should(reader: str, bit: int, word: int) -> None:
    simulation, _ = started(scenario())
    source = 1 if reader == "p0" else 0
    drives = sources(bit, word)
    plc = simulation.plcs[reader]
    seen = set()
    # Every 3.1 ms: each scan, frame and END is met in all its phases.
    for now in range(0, 2 * SECOND, 31 * MS // 10):
        simulation.run(now)
        plc.sync(now)
        at = copy_at(source, now)
        seen.add(at)
        for name, drive in drives.items():
            assert plc.read(name) == (0 if at is None else drive.value(at)), (name, now)
    assert None in seen
    assert len(seen) > 30


def test_a_value_is_never_older_than_a_link_scan_and_two_plc_scans() -> None:
    simulation, _ = started(scenario())
    plc = simulation.plcs["p1"]
    for now in range(SECOND, 2 * SECOND, 7 * MS):
        simulation.run(now)
        plc.sync(now)
        written = plc.read("D0") * 2 * MS  # counts 2 ms
        assert now - written <= MASTER_SCAN + SCAN + data(2) + SLAVE_SCAN + 2 * MS


def test_nothing_else_changes() -> None:
    simulation, _ = started(scenario())
    simulation.run(3 * SECOND)
    simulation.totals()
    for plc in simulation.plcs.values():
        changed = {f"M{n}" for n in range(3072) if plc.memory.get(Device("M", n))}
        assert changed <= {f"M{n}" for n in range(1000, 1128)}
        words = {n for n in range(8000) if plc.memory.word("D", n)}
        assert words <= {*range(8), *range(32, 40)}
        assert words >= {*range(8), *range(32, 40)}


def own(simulation: Simulation, name: str) -> tuple[int, ...]:
    found = registers_now(simulation, name)
    return tuple(found[key] for key in ("D8173", "D8174", "D8175", "D8176", "M8179", "M8191"))


def test_the_registers_of_the_example() -> None:
    simulation, _ = started(scenario())
    simulation.run(SECOND)
    assert own(simulation, "p0") == (0, 1, 2, 0, 1, 1)
    assert own(simulation, "p1") == (1, 1, 2, 1, 1, 1)
    found = registers_now(simulation, "p0")
    assert (found["D8177"], found["D8178"], found["D8179"], found["D8180"]) == (1, 2, 5, 5)
    assert found["D8201"] == found["D8202"] == 34


AREAS = [(0, 0, 4), (1, 32, 4), (2, 64, 8), (3, 64, 16), (4, 64, 32)]


@pytest.mark.parametrize(
    ("profile", "spacing", "mode", "points", "words"),
    [*(("pw10", 32, *area) for area in AREAS), *(("fx2n", 10, *area) for area in AREAS[:3])],
)
def test_the_areas_of_every_mode_and_family(
    profile: str, spacing: int, mode: int, points: int, words: int
) -> None:
    stations = 4
    others = {
        station: {
            # Each with a value of its own, and where there is room one more than the block holds.
            "sources": {
                **{
                    f"D{spacing * station + n}": Counter((station + 2 * n + 3) * MS)
                    for n in range(min(words + 1, spacing))
                },
                **{
                    f"M{1000 + 64 * station + n}": Toggle((station + n + 5) * MS)
                    for n in range(min(points + 1, 64))
                },
            }
        }
        for station in range(stations)
    }
    simulation, record = started(link(stations, mode, seconds=2, profile=steady(profile), others=others))
    simulation.run(SECOND)
    images = {
        frame.station: bytes.fromhex(frame.chars[3:-3].decode())
        for frame in record.frames
        if frame.kind == "data"
    }
    simulation.run(simulation.now + 10 * MS)  # every PLC has had an END since
    newest = {
        frame.station: bytes.fromhex(frame.chars[3:-3].decode())
        for frame in record.frames
        if frame.kind == "data"
    }
    for name, plc in simulation.plcs.items():
        plc.sync(simulation.now)
        for station in range(stations):
            if name == f"p{station}":
                continue
            found = bytearray()
            for first in range(0, points, 8):
                bits = [plc.read(f"M{1000 + 64 * station + first + n}") for n in range(8)]
                found.append(sum(bit << n for n, bit in enumerate(bits)))
            for number in range(words):
                found += plc.read(f"D{spacing * station + number}").to_bytes(2, "big")
            assert bytes(found) in (images[station], newest[station])
            # Nothing beyond the block's end.
            if words < spacing:
                assert plc.read(f"D{spacing * station + words}") == 0
            if points < 64:
                assert plc.read(f"M{1000 + 64 * station + points}") == 0
