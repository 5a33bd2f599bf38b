"""Programs that take several scans, inputs about as fast as the link: what is measured is what led there.

Where a change went is worked out anew from the observed devices, ENDs and frames, backwards from the output.
"""

from __future__ import annotations

import random
from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import pytest

from bussim import api
from bussim.exact.latency.bounds import bounds_of
from bussim.scenario.loader import from_data
from bussim.scenario.model import Scenario
from bussim.scenario.signals.paths import signal_paths
from bussim.trace.records import DeviceValueRecord, EndsRecord, FrameRecord, InputRecord
from bussim.units import TICKS_PER_MS as MS
from tests.exact.latency.test_bounds import Kept, sampled
from tests.selection import quick


def chain(first: str, last: str, more: int, load: str = "LD") -> str:
    """From one device to another by ``more`` rungs beside the last, in reverse order: a scan each."""
    between = [f"M{10 + n}" for n in range(more)]
    devices = [first, *between, last]
    rungs = [f"{load} {a}\nOUT {b}" for a, b in pairwise(devices)]
    return "\n".join(reversed(rungs))


@dataclass
class Case:
    """b.X0 to a.Y1 over M1064, with so many rungs more than one on each side."""

    source: int
    target: int
    inverts: bool
    given: Scenario


def case(seed: int) -> Case:
    generator = random.Random(seed)
    source, target = generator.choice([(s, t) for s in range(4) for t in range(4) if s + t])
    inverts = generator.random() < 0.3
    # With a station that is missing a link scan takes about 490 ms, without it about 60 ms.
    missing = generator.random() < 0.5
    scan = generator.choice((3, 8, 20))
    period = generator.uniform(0.7, 2.6) * (490 if missing else 70)
    number, others = generator.choice(((0, 1), (1, 0)))
    link = {"slaves": 2 if missing else 1, "mode": 2, "retries": 2, "timeout": "150 ms"}
    plcs: list[dict[str, Any]] = []
    own = 1000 + 64 * number
    for name, station, text in (
        ("b", number, chain("X0", f"M{own}", source)),
        ("a", others, chain(f"M{own}", "Y1", target, "LDI" if inverts else "LD")),
    ):
        mean = scan * generator.uniform(0.7, 1.3)
        plcs.append(
            {
                "name": name,
                "scan": {"mean": f"{mean:.3f} ms", "jitter": f"{0.1 * mean:.4f} ms"},
                "nn": {"bus": "link", "port": "COM4", "station": station, **({} if station else link)},
                "program": f"{text}\nEND\n",
            }
        )
    plcs[0]["inputs"] = {"X0": {"square": {"period": f"{period:.3f} ms", "at": "1 s"}}}
    seconds = 30 if missing else 10
    entry = {"from": "b.X0", "to": "a.Y1", "inverted": inverts and target % 2 == 0}
    given = from_data(
        {
            "schema": 1,
            "name": f"chain {seed}",
            "duration": f"{seconds} s",
            "seed": seed,
            "buses": [{"name": "link", "nn": True}],
            "plcs": plcs,
            "observe": [f"b.M{own}", f"a.M{own}"],
            "latency": [{"name": "x", **entry}, {"name": "half", "from": "b.X0", "to": f"a.M{own}"}],
        }
    )
    return Case(source, target, inverts, given)


def moves(kept: Kept, plc: str, device: str) -> list[DeviceValueRecord]:
    return [v for v in kept.of(DeviceValueRecord) if (v.plc, v.device) == (plc, device)]


def truth(kept: Kept, found: Case, target: str) -> dict[int, tuple[int, int]]:
    """Of each move of the target, by its END: the change of the wire that led to it, and its latency."""
    ends: dict[str, list[int]] = {}
    for record in kept.of(EndsRecord):
        ends.setdefault(record.plc, []).extend(record.ticks)
    shared = next(name for plc in found.given.plcs for name in plc.observed if name.startswith("M1"))
    there, copies = moves(kept, "b", shared), moves(kept, "a", shared)
    wire = [i for i in kept.of(InputRecord) if i.plc == "b"]
    frames = [f for f in kept.of(FrameRecord) if f.sender == "b" and f.kind == "data" and not f.cut]
    known = {}
    for move in moves(kept, "a", target):
        # The END that made the level visible to the target's program, so many scans before.
        tick = move.tick
        if target != shared:
            at = bisect_left(ends["a"], tick) - 1 - found.target
            tick = ends["a"][at] if at >= 0 else -1
        copy = next((c for c in reversed(copies) if c.tick <= tick), None)
        if copy is None:
            continue
        if target != shared:
            assert copy.tick == tick, "the copy must have moved just then"
        frame = frames[bisect_right([f.end for f in frames], copy.tick) - 1]
        sent = next((m for m in reversed(there) if m.tick <= frame.start), None)
        assert sent is not None
        assert sent.value == copy.value
        # The scan whose END showed it began one END before; its chain so many more.
        began = ends["b"][bisect_left(ends["b"], sent.tick) - 1 - found.source]
        change = wire[bisect_right([i.tick for i in wire], began) - 1]
        assert change.level == copy.value
        known[move.tick] = change.tick, move.tick - change.tick
    return known


@pytest.mark.parametrize("seed", quick(4, (0, 1, 4, 6, 2, 3, 5, *range(7, 24))))
def test_every_latency_is_that_of_the_change_which_led_to_the_move(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = case(seed)
    samples, kept = sampled(monkeypatch, found.given)
    shared = next(entry.target for entry in found.given.latency if entry.name == "half")
    bounds = bounds_of(found.given)
    for name, target in (("x", "Y1"), ("half", shared)):
        true = truth(kept, found, target)
        assert bounds[name].valid
        for sample in samples[name]:
            assert all(part >= 0 for part in sample.parts)
            end = sample.at + sample.total
            assert (sample.at, sample.total) == true[end], (name, end)
            if sample.at > 1500 * MS:
                assert sample.total <= bounds[name].no_error
        # What is left out is little: the first moves, and what fell between two frames.
        assert len(samples[name]) >= 0.9 * len(true) - 2 > 0, name


def extra_scans(given: Scenario) -> dict[str, tuple[int, int]]:
    return {path.entry.name: path.scans for path in signal_paths(given)}


@pytest.mark.parametrize("seed", range(24))
def test_the_scans_are_those_of_the_chains(seed: int) -> None:
    found = case(seed)
    found_scans = extra_scans(found.given)
    assert found_scans["x"] == (found.source, found.target)
    assert found_scans["half"] == (found.source, 0)


@pytest.mark.slow
def test_an_input_a_little_slower_than_the_link_scan() -> None:
    """Three rungs in reverse order, 560 ms a period at a link scan of 493 ms: it once gave up to 3744 ms."""
    given = from_data(
        {
            "schema": 1,
            "name": "stale",
            "duration": "60 s",
            "seed": 3,
            "buses": [{"name": "link", "nn": True}],
            "plcs": [
                {
                    "name": "a",
                    "scan": "3 ms",
                    "nn": {
                        "bus": "link",
                        "port": "COM4",
                        "station": 0,
                        "slaves": 2,
                        "mode": 2,
                        "retries": 2,
                        "timeout": "150 ms",
                    },
                    "program": "LD M1064\nOUT Y1\nEND\n",
                },
                {
                    "name": "b",
                    "scan": {"mean": "20 ms", "jitter": "2 ms"},
                    "nn": {"bus": "link", "port": "COM4", "station": 1},
                    "program": f"{chain('X0', 'M1064', 2)}\nEND\n",
                    "inputs": {"X0": {"square": {"period": "560 ms", "at": "1 s"}}},
                },
            ],
            "latency": [{"name": "x", "from": "b.X0", "to": "a.Y1"}],
        }
    )
    result = api.run(given)
    found = result.summary["latency"]["x"]
    values = result.values
    assert found["delivered"] == (values["device"] == "Y1").sum() == 28
    assert found["changes"] == sum(found[key] for key in ("delivered", "lost", "unseen", "open"))
    assert 300 < found["ms"]["min"] <= found["ms"]["max"] < 400


@pytest.mark.parametrize(
    ("program", "scans"),
    [
        # Two paths: not plain, so that none is counted.
        ("LD X0\nOR M11\nOUT Y0\nLD M10\nOUT M11\nLD X0\nOUT M10", (0, 0)),
        ("LD M10\nOUT Y0\nLD X0\nOUT M10", (1, 0)),
        # A latch is not plain.
        ("LD X0\nSET Y0\nLDI M10\nRST Y0\nLD X0\nOUT M10", (0, 0)),
        # No path at all.
        ("LD M10\nOUT Y1\nLD X0\nOUT M10\nLD X1\nOUT Y0", (0, 0)),
    ],
)
def test_scans_within_one_plc(program: str, scans: tuple[int, int]) -> None:
    given = from_data(
        {
            "schema": 1,
            "name": "home",
            "duration": "2 s",
            "plcs": [
                {
                    "name": "a",
                    "scan": "10 ms",
                    "program": f"{program}\nEND\n",
                    "inputs": {"X0": {"square": "333 ms"}},
                }
            ],
            "latency": [{"name": "x", "from": "a.X0", "to": "a.Y0"}],
        }
    )
    assert extra_scans(given)["x"] == scans
