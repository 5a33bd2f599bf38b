"""Scenarios with latencies, simulated."""

from __future__ import annotations

import random
from dataclasses import dataclass, field
from typing import Any

import pytest

from bussim import api
from bussim.results.collector import Collector
from bussim.results.meters.latency_record import LatencyRecord, Sample
from bussim.scenario.loader import from_data
from bussim.scenario.model import Scenario
from bussim.sim.runner import simulate


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
