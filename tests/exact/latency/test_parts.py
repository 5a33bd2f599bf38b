"""The parts of a bound, and the age of a word."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from itertools import pairwise

import pytest

from bussim import api
from bussim.exact.latency.bounds import bounds_of
from bussim.scenario.loader import from_data
from bussim.trace.records import DeviceValueRecord, EndsRecord, FrameRecord, InputRecord
from bussim.units import TICKS_PER_MS as MS
from tests.exact.latency.simulated_latencies import sampled, scenario
from tests.selection import quick


@pytest.mark.parametrize("seed", quick(1, (102, 1, 3, 105)))
def test_the_parts_are_those_of_the_frames_and_ends_in_the_trace(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Told anew from the trace: which END, which frame, which reception, which output."""
    given = scenario(seed, noisy=seed > 100)
    samples, kept = sampled(monkeypatch, given)
    ends: dict[str, list[int]] = {}
    for record in kept.of(EndsRecord):
        ends.setdefault(record.plc, []).extend(record.ticks)
    values, inputs, frames = kept.of(DeviceValueRecord), kept.of(InputRecord), kept.of(FrameRecord)
    checked, bounds = 0, bounds_of(given)
    for entry in given.latency:
        if entry.name in ("word", "home") or not bounds[entry.name].valid:
            continue
        sent = [f for f in frames if f.sender == entry.source_plc and f.kind == "data" and not f.cut]
        outputs = [v for v in values if (v.plc, v.device) == (entry.target_plc, entry.target)]
        changes = {i.tick: i for i in inputs if i.plc == entry.source_plc and i.device == entry.source}
        for sample in samples[entry.name]:
            change = changes[sample.at]
            own, others = ends[entry.source_plc], ends[entry.target_plc]
            # Sampled at the first END after the change, out at the one after that.
            out = own[bisect_left(own, sample.at) + 1]
            frame = next(f for f in sent if f.start >= out)
            visible = others[bisect_left(others, frame.end)]
            done = next(v.tick for v in outputs if v.tick > visible and v.value == change.level)
            times = (sample.at, out, frame.start, frame.end, visible, done)
            assert sample.parts == tuple(b - a for a, b in pairwise(times))
            assert sum(sample.parts) == done - sample.at
            checked += 1
    assert checked > 30


@pytest.mark.parametrize("seed", quick(1, (104, 3)))
def test_every_change_is_accounted_for(seed: int) -> None:
    given = scenario(seed, noisy=seed > 100)
    for entry in api.run(given, rows=False).summary["latency"].values():
        if entry["edge"] is None:
            assert entry["delivered"] > 100
            continue
        assert entry["changes"] == sum(entry[key] for key in ("delivered", "lost", "unseen", "open"))
        assert entry["delivered"] + entry["lost"] > 10


def test_the_age_of_a_word_is_that_of_its_value(monkeypatch: pytest.MonkeyPatch) -> None:
    """A word that counts its own scans: the age is what its value says."""
    given = from_data(
        {
            "schema": 1,
            "name": "age",
            "duration": "10 s",
            "buses": [{"name": "link", "nn": True}],
            "plcs": [
                {
                    "name": "a",
                    "scan": "7 ms",
                    "nn": {
                        "bus": "link",
                        "port": "COM4",
                        "station": 0,
                        "slaves": 1,
                        "mode": 2,
                        "timeout": "50 ms",
                    },
                    "program": "LD M8000\nINC D0\nEND\n",
                },
                {"name": "b", "scan": "9 ms", "nn": {"bus": "link", "port": "COM4", "station": 1}},
            ],
            "latency": [{"name": "age", "from": "a.D0", "to": "b.D0"}],
        }
    )
    found, kept = sampled(monkeypatch, given)
    left: dict[int, int] = {}  # value of a's D0 → the END that left it
    seen: list[tuple[int, int]] = []  # changes of b's D0
    for value in kept.of(DeviceValueRecord):
        if value.plc == "a":
            left[value.value] = value.tick
        else:
            seen.append((value.tick, value.value))
    ticks = [tick for tick, _ in seen]
    checked = 0
    for sample in found["age"]:
        at = bisect_right(ticks, sample.at) - 1
        if at >= 0 and seen[at][1] in left:
            assert sample.total == sample.at - left[seen[at][1]]
            checked += 1
    assert checked > 900


@pytest.mark.parametrize("reply", ["interrupt", "end"])
def test_without_programs_from_the_write_to_the_read(reply: str) -> None:
    """From the END that leaves a shared device changed to the END at which the other has it."""
    given = from_data(
        {
            "schema": 1,
            "name": "no programs",
            "duration": "30 s",
            "buses": [{"name": "link", "nn": True}],
            "plcs": [
                {
                    "name": f"p{station}",
                    "profile": {"base": "pw10", "reply": reply},
                    "scan": f"{scan} ms",
                    "nn": {"bus": "link", "port": "COM4", "station": station, **settings},
                    "sources": {f"M{1000 + 64 * station}": {"toggle": "317.3 ms"}},
                }
                for station, scan, settings in (
                    (0, 7.3, {"slaves": 2, "mode": 2, "timeout": "60 ms"}),
                    (1, 11.9, {}),
                    (2, 3.1, {}),
                )
            ],
            "latency": [
                {"name": "down", "from": "p0.M1000", "to": "p2.M1000"},
                {"name": "across", "from": "p1.M1064", "to": "p2.M1064", "edge": "rising"},
                {"name": "up", "from": "p2.M1128", "to": "p0.M1128"},
            ],
        }
    )
    summary = api.run(given, rows=False).summary["latency"]
    for name, bound in bounds_of(given).items():
        found, times = summary[name]["parts_ms"], summary[name]["ms"]
        assert bound.valid
        assert (found["scan"]["max"], found["output"]["max"]) == (0, 0)
        assert summary[name]["delivered"] >= summary[name]["changes"] - 1 > 40
        # A reply at END starts at an END of its own PLC: the phases of such a station stay together.
        if reply == "interrupt":
            assert times["max"] >= 0.8 * bound.no_error / MS
        assert times["max"] <= bound.no_error / MS
