"""Latencies: never above their bound, near it on a quiet line, and the same from the frames themselves."""

from __future__ import annotations

import random
from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import pytest

from bussim import api
from bussim.exact.from_scenario import from_scenario
from bussim.exact.latency.bounds import bounds_of
from bussim.results.collector import Collector
from bussim.results.meters.latency_record import PARTS, LatencyRecord, Sample
from bussim.scenario.loader import from_data
from bussim.scenario.model import Scenario
from bussim.sim.runner import simulate
from bussim.trace.records import AttemptRecord, DeviceValueRecord, EndsRecord, FrameRecord, InputRecord
from bussim.units import TICKS_PER_MS as MS
from tests.selection import quick


def programs(stations: int, *, bits: bool) -> list[str]:
    """Each station sends its X0 and shows the others' on Y0, Y1…"""
    texts = []
    for own in range(stations):
        lines = ["LD X0", f"OUT M{1000 + 64 * own}"]
        for other in range(stations):
            if other != own and bits:
                lines += [f"LD M{1000 + 64 * other}", f"OUT Y{other:o}"]
        # Something that takes time.
        lines += [f"LD M8000\nADD D{200 + n} K1 D{200 + n}" for n in range(own % 3)]
        texts.append("\n".join([*lines, "END", ""]))
    return texts


def scenario(seed: int, *, noisy: bool = False, quiet: bool = False, seconds: float = 12.0) -> Scenario:
    """A random link whose stations pass their inputs on to each other.

    ``noisy``: replies are lost, of all stations or of some, a few or most. ``quiet``: nothing varies but
    phases, which random steps of the inputs run through.
    """
    generator = random.Random(seed)
    stations = generator.randint(2, 4 if quiet else 8)
    mode = generator.choice((1, 2)) if quiet else generator.choice((0, 1, 1, 2, 2, 3, 4))
    timeouts = (50, 60, 100) if noisy or quiet else (60, 100, 150)
    settings = {
        "slaves": stations - 1,
        "mode": mode,
        "retries": generator.choice((0, 0, 1, 2, 3, 10)),
        "timeout": f"{max(generator.choice(timeouts), 80 if mode == 4 else 50)} ms",
    }
    profile = {
        "base": "pw10",
        "reply": "interrupt" if quiet else generator.choice(("interrupt", "interrupt", "end")),
        "absent_station": generator.choice(("full", "full", "probe")),
    }
    # The shorter the scans, the nearer a latency comes to what the link alone makes of it.
    longest = generator.choice((0.6, 3, 18))
    seconds *= 0.4 if longest < 1 else 1  # tiny ones cost the most to simulate
    plcs: list[dict[str, Any]] = []
    for number, text in enumerate(programs(stations, bits=mode > 0)):
        mean = generator.uniform(0.5, 1) * longest
        every = generator.uniform(400, 600) * (1 if noisy or quiet else 2)
        plcs.append(
            {
                "name": f"p{number}",
                "profile": profile,
                "scan": {
                    "mean": f"{mean:.3f} ms",
                    "jitter": f"{0.0 if quiet else mean * generator.uniform(0, 0.3):.4f} ms",
                },
                "nn": {"bus": "link", "port": "COM4", "station": number, **(settings if not number else {})},
                "program": text,
                "inputs": {"X0": {"square": f"{every:.3f} ms"}},
            }
        )
    pairs = [(a, b) for a in range(stations) for b in range(stations) if a != b]
    chosen = generator.sample(pairs, min(5, len(pairs)))
    latency = [{"name": f"l{a}{b}", "from": f"p{a}.X0", "to": f"p{b}.Y{a}"} for a, b in chosen if mode > 0]
    a, b = chosen[0]
    latency.append({"name": "word", "from": f"p{a}.D{32 * a}", "to": f"p{b}.D{32 * a}"})
    latency.append({"name": "home", "from": "p0.X0", "to": "p0.M1000", "edge": "rising"})
    noise: list[dict[str, Any]] = []
    if noisy:
        those = generator.choice(([], range(1, stations), generator.sample(range(1, stations), 1)))
        losses = (0.05, 0.2, 0.5, 0.7)
        noise = [
            {"bus": "link", "station": f"p{n}", "reply_loss": generator.choice(losses)} for n in those
        ] or [{"bus": "link", "reply_loss": generator.choice(losses[:3])}]
    return from_data(
        {
            "schema": 1,
            "name": f"random {seed}",
            "duration": f"{seconds} s",
            "seed": seed,
            "buses": [{"name": "link", "nn": True}],
            "plcs": plcs,
            "noise": noise,
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


@dataclass
class Errors:
    """What went wrong on a link while a change was under way, in the words of :mod:`bussim.exact.latency.bounds`."""

    begins: list[int]
    ends: list[int]
    flags: list[tuple[int, int]]
    vain: dict[int, list[int]]  # ends of the exchanges without a reply of a station, and how many attempts

    @classmethod
    def of(cls, kept: Kept, given: Scenario) -> Errors:
        model = from_scenario(given, bound_end=True)["link"]
        found, since = cls([], [], [], {}), dict[int, int]()
        for attempt in kept.of(AttemptRecord):
            station = attempt.station
            if not model.station(station).alive:
                continue  # one that never replies belongs to the link
            if not attempt.code:
                if station in since:
                    found.flags.append((since.pop(station), attempt.end))
                continue
            found.begins.append(attempt.start - model.gap)
            found.ends.append(attempt.end)
            if attempt.number == model.attempts_at(flagged=station in since):
                since.setdefault(station, attempt.end)
                found.vain.setdefault(station, []).extend([attempt.end] * attempt.number)
        found.flags += [(begin, given.duration) for begin in since.values()]
        return found

    def lost(self, begin: int, end: int) -> int:
        return bisect_left(self.begins, end) - bisect_right(self.ends, begin)

    def flagged(self, at: int) -> bool:
        return any(begin <= at < end for begin, end in self.flags)

    def in_vain(self, station: int, begin: int, end: int) -> int:
        """Attempts in exchanges without a reply of a station that ended in a window."""
        ends = self.vain.get(station, [])
        return bisect_right(ends, end) - bisect_right(ends, begin)


def windows(samples: list[Sample], given: Scenario, *, word: bool) -> Iterator[tuple[Sample, int, int]]:
    """Samples with their windows, from when the link has formed to when what is lost is no longer known."""
    for sample in samples:
        begin, end = (sample.at - sample.total, sample.at) if word else (sample.at, sample.at + sample.total)
        if begin >= 1500 * MS and end <= given.duration - 500 * MS:
            yield sample, begin, end


@pytest.mark.parametrize("seed", quick(1, (1, 0, 2, 3, 4, 5, 6, 7)))
def test_without_errors_no_latency_is_longer_than_its_bound(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = scenario(seed, seconds=9.0)
    samples, _ = sampled(monkeypatch, given)
    bounds = bounds_of(given)
    assert samples.keys() == bounds.keys()
    for name, bound in bounds.items():
        if not bound.valid:
            assert "late replies" in bound.reason
            continue
        after = list(windows(samples[name], given, word=bound.word))
        assert after
        for sample, _, _ in after:
            assert sample.total <= bound.no_error
            for part, ticks in zip(PARTS, sample.parts, strict=True):
                assert 0 <= ticks <= getattr(bound, part), (name, part)


def evaluate_goals(monkeypatch: pytest.MonkeyPatch, given: Scenario) -> dict[str, float]:
    """No latency is longer than the case that its errors fall into; how near each case came."""
    samples, kept = sampled(monkeypatch, given)
    errors, worst = Errors.of(kept, given), dict[str, float]()
    for name, bound in bounds_of(given).items():
        if not bound.valid:
            assert "late replies" in bound.reason
            continue
        source = next(int(entry.source_plc[1:]) for entry in given.latency if entry.name == name)
        for sample, begin, end in windows(samples[name], given, word=bound.word):
            lost, cases = errors.lost(begin, end), dict[str, int]()
            if lost == 0 and not errors.flagged(begin):
                cases["no error"] = bound.no_error
            elif bound.link_scan:
                cases[f"{lost} lost"] = bound.lost(lost)
            if errors.in_vain(source, begin, end) <= bound.attempts:
                cases["every retry"] = bound.every_retry
            for case, most in cases.items():
                assert sample.total <= most, (name, case, sample)
                worst[case] = max(worst.get(case, 0.0), sample.total / most)
    return worst


@pytest.mark.parametrize("seed", quick(2, (100, 102, 101, *range(103, 112))))
def test_with_lost_replies_none_is_longer_than_the_bound_for_so_many(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    worst = evaluate_goals(monkeypatch, scenario(seed, noisy=True))
    assert worst["every retry"] > 0.1


def tiny(
    name: str, losses: dict[int, int] | None = None, *, retries: int = 0, slaves: int = 3, **more: Any
) -> Scenario:
    """Two PLCs with scans of a millisecond, and two others: what delays is the link.

    Every 1.5 s stations lose so many replies in a row (``losses``), and inputs change at that moment.
    """
    moments = [f"{1500.3 * n + 2000:.1f} ms" for n in range(0 if losses is None else 6)]
    plcs = [
        {
            "name": f"p{number}",
            "profile": {"base": "pw10", **more},
            "scan": "1 ms" if number in (0, 3) else "5 ms",
            "nn": {
                "bus": "link",
                "port": "COM4",
                "station": number,
                **(
                    {"slaves": slaves, "mode": 1, "retries": retries, "timeout": "50 ms"}
                    if not number
                    else {}
                ),
            },
            "inputs": {"X0": {"times": moments} if moments else {"square": "213.7 ms"}},
            **({"program": text} if number in (0, 3) else {}),
        }
        for number, text in enumerate(programs(4, bits=True))
    ]
    return from_data(
        {
            "schema": 1,
            "name": name,
            "duration": "11 s" if moments else "24 s",
            "buses": [{"name": "link", "nn": True}],
            "plcs": plcs,
            "noise": [{"bus": "link", "station": "p1", "reply_loss": 0.5}] if losses is None else [],
            "faults": [
                {"drop_reply": f"p{station}", "count": count, "at": moment}
                for station, count in (losses or {}).items()
                for moment in moments
            ],
            "latency": [
                {"name": "there", "from": "p3.X0", "to": "p0.Y3"},
                {"name": "back", "from": "p0.X0", "to": "p3.Y0"},
            ],
        }
    )


@pytest.mark.slow
def test_a_flag_that_is_still_on_costs_a_parameter_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    """p1 has spent its only attempt before the change: no reply is lost in the window, and yet it takes longer."""
    given = tiny("one noisy station")
    worst, bound = evaluate_goals(monkeypatch, given), bounds_of(given)["there"]
    assert worst["no error"] > 0.95
    assert worst["0 lost"] * bound.lost(0) > bound.no_error
    assert worst["1 lost"] > 0.8


@pytest.mark.slow
def test_a_station_that_never_replies_belongs_to_the_link(monkeypatch: pytest.MonkeyPatch) -> None:
    worst = evaluate_goals(monkeypatch, tiny("one absent, one noisy station", slaves=4))
    assert worst["no error"] > 0.9
    assert worst["1 lost"] > 0.7


@pytest.mark.parametrize(
    ("retries", "policy", "counts"),
    # Two scans in which all others spend all attempts; the source all of one, all but one of the next.
    quick(1, [(0, "full", (2, 2, 1)), (1, "full", (4, 4, 3)), (2, "full", (6, 6, 5))]),
)
def test_every_retry_spent_comes_near_its_bound(
    retries: int, policy: str, counts: tuple[int, int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    losses = dict(zip((1, 2, 3), counts, strict=True))
    worst = evaluate_goals(monkeypatch, tiny("all lost", losses, retries=retries, absent_station=policy))
    assert 0.9 < worst["every retry"] <= 1


@pytest.mark.slow
@pytest.mark.parametrize("seed", [3, 5, 8])
def test_on_a_quiet_line_the_longest_comes_near_the_bound(seed: int) -> None:
    """Random phases: the periods of the inputs, scans and link have nothing in common."""
    given = scenario(seed, quiet=True, seconds=150.0)
    summary = api.run(given, rows=False).summary["latency"]
    for name, bound in bounds_of(given).items():
        longest = summary[name]["ms"]["max"]
        assert 0.8 * bound.no_error / MS <= longest <= bound.no_error / MS, name
        for part, found in summary[name]["parts_ms"].items():
            most = getattr(bound, part) / MS
            assert 0.8 * most <= found["max"] <= most + 1e-6, (name, part)


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
