"""Latencies: never above their bound, near it on a quiet line, and the same from the frames themselves."""

from __future__ import annotations

import random
from bisect import bisect_left, bisect_right
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import pytest

from bussim import api
from bussim.exact.latency import bounds_of
from bussim.results.collector import Collector
from bussim.results.latency import PARTS, LatencyRecord, Sample
from bussim.scenario.loader import from_data
from bussim.scenario.model import Scenario
from bussim.sim.runner import simulate
from bussim.trace import AttemptRecord, DeviceValueRecord, EndsRecord, FrameRecord, InputRecord
from bussim.units import TICKS_PER_MS as MS


def programs(luck: random.Random, stations: int) -> list[str]:
    """Each station sends its X0 and shows the others' on Y0, Y1…"""
    texts = []
    for own in range(stations):
        lines = ["LD X0", f"OUT M{1000 + 64 * own}"]
        for other in range(stations):
            if other != own:
                lines += [f"LD M{1000 + 64 * other}", f"OUT Y{other:o}"]
        # Something that takes time.
        lines += [f"LD M8000\nADD D{200 + n} K1 D{200 + n}" for n in range(luck.randrange(6))]
        texts.append("\n".join([*lines, "END", ""]))
    return texts


def scenario(seed: int, *, loss: float = 0.0, jitter: bool = True, seconds: float = 20.0) -> Scenario:
    """A random link whose stations pass their inputs on to each other."""
    luck = random.Random(seed)
    stations = luck.randint(2, 5)
    settings = {
        "slaves": stations - 1,
        "mode": luck.choice((1, 2)),  # both bits and words
        "retries": luck.randint(0, 4),
        "timeout": f"{luck.choice((50, 60, 100))} ms",
    }
    reply = luck.choice(("interrupt", "interrupt", "end"))
    plcs: list[dict[str, Any]] = []
    for number, text in enumerate(programs(luck, stations)):
        mean = luck.uniform(1, 20)
        plcs.append(
            {
                "name": f"p{number}",
                "profile": {"base": "pw10", "reply": reply},
                "scan": {
                    "mean": f"{mean:.3f} ms",
                    "jitter": f"{mean * luck.uniform(0, 0.3):.4f} ms" if jitter else "0 ms",
                },
                "nn": {"bus": "link", "port": "COM4", "station": number, **(settings if not number else {})},
                "program": text,
                "inputs": {"X0": {"pulse": {"width": "617 ms", "every": "1171.3 ms", "at": "1 s"}}},
            }
        )
    pairs = [(a, b) for a in range(stations) for b in range(stations) if a != b]
    chosen = luck.sample(pairs, min(4, len(pairs)))
    latency = [{"name": f"l{a}{b}", "from": f"p{a}.X0", "to": f"p{b}.Y{a}"} for a, b in chosen]
    a, b = chosen[0]
    latency.append({"name": "word", "from": f"p{a}.D{32 * a}", "to": f"p{b}.D{32 * a}"})
    latency.append({"name": "home", "from": "p0.X0", "to": "p0.M1000", "edge": "rising"})
    return from_data(
        {
            "schema": 1,
            "name": f"random {seed}",
            "duration": f"{seconds} s",
            "seed": seed,
            "buses": [{"name": "link", "nn": True}],
            "plcs": plcs,
            "noise": [{"bus": "link", "reply_loss": loss}] if loss else [],
            "latency": latency,
        }
    )


@dataclass
class Kept:
    """Rows that keep everything."""

    records: list[Any] = field(default_factory=list)

    def take(self, record: Any) -> None:
        self.records.append(record)

    def of(self, kind: type) -> list[Any]:
        return [record for record in self.records if type(record) is kind]


def sampled(monkeypatch: pytest.MonkeyPatch, given: Scenario) -> tuple[dict[str, list[Sample]], Kept]:
    """Every latency of a run by entry, and all of its records."""
    samples: dict[str, list[Sample]] = {}
    add = LatencyRecord.add

    def keep(self: LatencyRecord, sample: Sample) -> None:
        samples.setdefault(f"{self.source} to {self.target}", []).append(sample)
        add(self, sample)

    monkeypatch.setattr(LatencyRecord, "add", keep)
    kept = Kept()
    specs, _ = api._latency(given)
    collector = Collector(traced=True, rows=kept, latency=specs)
    collector.run(simulate(given, collector), scenario=given.name, seed=given.seed)
    names = {f"{s.source_plc}.{s.source} to {s.target_plc}.{s.target}": s.name for s in specs}
    return {names[way]: found for way, found in samples.items()}, kept


@pytest.mark.parametrize("seed", range(12))
def test_without_errors_no_latency_is_longer_than_its_bound(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = scenario(seed)
    samples, _ = sampled(monkeypatch, given)
    bounds = bounds_of(given)
    assert samples.keys() == bounds.keys()
    for name, bound in bounds.items():
        if not bound.valid:
            assert "late replies" in bound.reasons[0]
            continue
        after = [sample for sample in samples[name] if sample.at >= 1000 * MS]
        assert after
        for sample in after:
            assert sample.total <= bound.no_error
            for part, ticks in zip(PARTS, sample.parts, strict=True):
                assert 0 <= ticks <= getattr(bound, part), (name, part)


@pytest.mark.parametrize("seed", range(100, 112))
def test_with_lost_replies_none_is_longer_than_the_bound_for_so_many(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = scenario(seed, loss=random.Random(seed).choice((0.02, 0.1, 0.25)))
    samples, kept = sampled(monkeypatch, given)
    failed = sorted(attempt.start for attempt in kept.of(AttemptRecord) if attempt.code)
    worst: dict[int, float] = {}
    for name, bound in bounds_of(given).items():
        if not bound.valid:
            continue  # replies at END that may come after the timeout
        for sample in samples[name]:
            if sample.at < 1000 * MS:
                continue
            if bound.word:
                begin, end = sample.at - sample.total, sample.at
            else:
                begin, end = sample.at, sample.at + sample.total
            if end > given.duration - 500 * MS:
                continue  # whether the attempt under way fails nobody will know
            # An attempt that began a poll's time before the change was out may still run.
            lost = bisect_right(failed, end) - bisect_left(failed, begin - bound.silent)
            assert sample.total <= bound.lost(lost), (name, lost)
            worst[lost] = max(worst.get(lost, 0.0), sample.total / bound.lost(lost))
    assert max(worst) >= 1


@pytest.mark.parametrize("seed", [3, 5, 8])
def test_on_a_quiet_line_the_longest_comes_near_the_bound(seed: int) -> None:
    """Random phases: the periods of the inputs, scans and link have nothing in common."""
    given = scenario(seed, jitter=False, seconds=300.0)
    summary = api.run(given, rows=False).summary["latency"]
    for name, bound in bounds_of(given).items():
        if name == "home":
            continue
        longest = summary[name]["ms"]["max"]
        assert 0.8 * bound.no_error / MS <= longest <= bound.no_error / MS, name


@pytest.mark.parametrize("seed", [1, 2, 102, 105])
def test_the_parts_are_those_of_the_frames_and_ends_in_the_trace(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Told anew from the trace: which END, which frame, which reception, which output."""
    given = scenario(seed, loss=0.1 if seed > 100 else 0.0)
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
    assert checked > 50


@pytest.mark.parametrize("seed", [4, 104])
def test_every_change_is_accounted_for(seed: int) -> None:
    given = scenario(seed, loss=0.3 if seed > 100 else 0.0)
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
            "duration": "3 min",
            "buses": [{"name": "link", "nn": True}],
            "plcs": [
                {
                    "name": f"p{station}",
                    "profile": {"base": "pw10", "reply": reply},
                    "scan": f"{scan} ms",
                    "nn": {"bus": "link", "port": "COM4", "station": station, **settings},
                    "sources": {f"M{1000 + 64 * station}": {"toggle": "617.3 ms"}},
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
        assert summary[name]["delivered"] >= summary[name]["changes"] - 1 > 100
        # A reply at END starts at an END of its own PLC: the phases of such a station stay together.
        if reply == "interrupt":
            assert times["max"] >= 0.8 * bound.no_error / MS
        assert times["max"] <= bound.no_error / MS
