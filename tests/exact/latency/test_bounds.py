"""Latencies: never above their bound, near it on a quiet line, and the same from the frames themselves."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from bussim import api
from bussim.exact.from_scenario import from_scenario
from bussim.exact.latency.bounds import bounds_of
from bussim.results.meters.latency_record import PARTS, Sample
from bussim.scenario.loader import from_data
from bussim.scenario.model import Scenario
from bussim.trace.records import AttemptRecord
from bussim.units import TICKS_PER_MS as MS
from tests.exact.latency.simulated_latencies import Kept, programs, sampled, scenario
from tests.selection import quick


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
