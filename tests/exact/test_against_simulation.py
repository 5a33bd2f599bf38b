"""The distribution against the simulation, which shares no code with it: distributions and counts of errors.

Scans of a link with bursts or remembered flags are correlated, so only every so many are compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bussim.exact.from_scenario import from_scenario
from bussim.exact.refresh import gap_distributions
from bussim.exact.solve import Solved
from bussim.scenario.loader import from_data
from bussim.sim.runner import simulate
from bussim.trace.records import Outcome, Record, RunTotals, ScanRecord
from tests.exact.bounds import KOLMOGOROV, SIGMAS, kolmogorov, off_by
from tests.selection import quick_names
from tests.sinks import OneByOne


class Heard(OneByOne):
    """A sink that keeps scan times and gaps."""

    traced = False

    def __init__(self) -> None:
        self.scans: list[int] = []
        self.gaps: dict[tuple[int, int], list[int]] = {}
        self._last: dict[tuple[int, int], int] = {}

    def take(self, record: Record) -> None:
        if isinstance(record, ScanRecord):
            self.scans.append(record.duration)

    def failed(self, bus: str, tick: int, station: int, code: int, *, garbled: bool = False) -> None: ...

    def switched(self, bus: str, position: int, tick: int, fresh: int | None) -> None: ...

    def irregular(self, bus: str, node: str, tick: int, what: str) -> None: ...

    def exchanged(self, bus: str, node: str, peer: str, start: int, outcome: Outcome) -> None: ...

    def refreshed(self, bus: str, source: int, tick: int, heard: Sequence[int] | None) -> None:
        del bus
        for receiver in range(8) if heard is None else heard:
            if receiver != source:
                if (source, receiver) in self._last:
                    self.gaps.setdefault((source, receiver), []).append(tick - self._last[source, receiver])
                self._last[source, receiver] = tick


def scenario(
    stations: int = 3, profile: object = "pw10", duration: str = "150 s", timeout: str = "50 ms", **more: Any
) -> dict[str, Any]:
    nn = {
        "mode": more.pop("mode", 2),
        "retries": more.pop("retries", 2),
        "timeout": timeout,
        "slaves": stations - 1,
    }
    plcs = [
        {
            "name": f"p{k}",
            "profile": profile,
            "scan": "8 ms",
            "nn": {"bus": "link", "port": "COM4", "station": k, **(nn if k == 0 else {})},
        }
        for k in range(stations)
    ]
    return {
        "schema": 1,
        "name": "link",
        "duration": duration,
        "seed": 20,
        "buses": [{"name": "link", "nn": True}],
        "plcs": plcs,
        **more,
    }


def run(data: dict[str, Any]) -> tuple[Heard, RunTotals]:
    heard = Heard()
    return heard, simulate(from_data(data), heard)


PROBE = {"base": "pw10", "absent_station": "probe"}
EXACTLY = {"base": "pw10", "attempts": "retries"}


def burst(good: str, bad: str, ber: float) -> dict[str, Any]:
    return {"bus": "link", "burst": {"good": good, "bad": bad, "ber_good": 0, "ber_bad": ber}}


CASES: dict[str, dict[str, Any]] = {
    "no noise": scenario(8),
    "bit errors, mode 0": scenario(4, mode=0, noise=[{"bus": "link", "ber": 3e-4}]),
    "bit errors, mode 2": scenario(3, noise=[{"bus": "link", "ber": 2e-4}]),
    "bit errors, mode 4": scenario(
        2, mode=4, timeout="60 ms", noise=[{"bus": "link", "ber": 2e-4}], retries=1
    ),
    "replies lost": scenario(3, retries=1, noise=[{"bus": "link", "reply_loss": 0.1}]),
    "one station's replies lost": scenario(3, noise=[{"bus": "link", "station": "p1", "reply_loss": 0.4}]),
    "exactly D8179 attempts": scenario(3, EXACTLY, noise=[{"bus": "link", "reply_loss": 0.2}]),
    "probed stations": scenario(3, PROBE, retries=1, noise=[{"bus": "link", "reply_loss": 0.3}]),
    "the master's receiver": scenario(3, noise=[{"bus": "link", "station": "p0", "ber": 5e-4}]),
    "a slave's receiver": scenario(3, noise=[{"bus": "link", "station": "p2", "ber": 8e-4}]),
    "a slave's sender": scenario(3, noise=[{"bus": "link", "station": "p2", "direction": "tx", "ber": 5e-4}]),
    "short bursts": scenario(3, noise=[burst("500 ms", "20 ms", 1e-2)], duration="300 s"),
    "long bursts": scenario(3, noise=[burst("2 s", "200 ms", 3e-3)], duration="300 s"),
    "a dead station": scenario(3, noise=[{"bus": "link", "ber": 2e-4}], faults=[{"power_off": "p1"}]),
    "a dead station, probed": scenario(
        3, PROBE, noise=[{"bus": "link", "ber": 3e-4}], faults=[{"power_off": "p1"}]
    ),
    "a slow station": scenario(
        3,
        noise=[{"bus": "link", "ber": 2e-4}],
        faults=[{"at": "0 s", "slow": {"station": "p2", "extra": "9 ms"}}],
    ),
    "a fast clock": scenario(
        3,
        noise=[{"bus": "link", "ber": 2e-4}],
        faults=[{"at": "0 s", "clock_ppm": {"station": "p1", "ppm": 10_000}}],
        duration="60 s",
    ),
    "a station that is never polled": scenario(
        3,
        noise=[{"bus": "link", "ber": 1e-4}, {"bus": "link", "station": "p2", "ber": 3e-4}],
        duration="150 s",
    ),
    "measured turnarounds": scenario(
        3,
        {"base": "pw10", "turnaround": {"values": ["0.3 ms", "1 ms", "2.5 ms"], "weights": [5, 3, 1]}},
        noise=[{"bus": "link", "ber": 2e-4}],
    ),
}
CASES["a station that is never polled"]["plcs"][0]["nn"]["slaves"] = 1


def _thinned(data: dict[str, Any]) -> int:
    text = str(data)
    return 40 if "'2 s'" in text else 20 if "burst" in text else 3


@pytest.mark.parametrize("name", quick_names(("replies lost",), CASES))
def test_simulation_and_law_agree(name: str) -> None:
    data = CASES[name]
    model = from_scenario(from_data(data))["link"]
    assert model.valid, model.reasons
    solved = Solved(model)
    heard, totals = run(data)
    scans = heard.scans[3:]  # without the start-up
    assert kolmogorov(solved.distribution, scans[:: _thinned(data)]) < KOLMOGOROV
    assert totals.links[0].collisions == 0
    # Bursts and remembered flags put errors together, by at most so much.
    overdispersion = 12.0 if "burst" in str(data) else 2.0 if "probe" in str(data) else 1.0
    for station, fails in zip(model.stations, solved.fails, strict=True):
        if station.alive:
            errors = totals.links[0].station_errors[station.number]
            assert off_by(errors, len(scans), fails.error, overdispersion) < SIGMAS
    for (source, receiver), gap in gap_distributions(solved).items():
        sample = heard.gaps[source, receiver][3:]
        assert kolmogorov(gap.distribution, sample[:: _thinned(data)]) < KOLMOGOROV, (source, receiver)


#: Links that are reported without a distribution, with what a distribution that ignored the reason would get wrong.
WITHOUT_LAW: dict[str, dict[str, Any]] = {
    "replies at END": scenario(3, {"base": "pw10", "reply": "end"}, duration="60 s"),
    "late replies": scenario(
        3, faults=[{"at": "0 s", "slow": {"station": "p1", "extra": "40 ms"}}], duration="60 s"
    ),
    "impulses": scenario(
        3,
        noise=[{"bus": "link", "impulse": {"every": "20 ms", "width": "50 us", "ber": 0.5}}],
        duration="60 s",
    ),
    "a station that leaves": scenario(
        3, faults=[{"at": "10 s", "for": "50 s", "power_off": "p1"}], duration="61 s"
    ),
    "two stations with one number": scenario(3, duration="60 s"),
}
WITHOUT_LAW["two stations with one number"]["plcs"][2]["nn"]["station"] = 1


@pytest.mark.slow
@pytest.mark.parametrize("name", WITHOUT_LAW)
def test_where_there_is_no_law_the_simulation_differs(name: str) -> None:
    data = WITHOUT_LAW[name]
    model = from_scenario(from_data(data))["link"]
    assert not model.valid
    ignoring = replace(
        model,
        obstacles=(),
        timeout=max(model.timeout, model.least_timeout()),
    )
    heard, _ = run(data)
    scans = np.array(heard.scans[3:])
    assert kolmogorov(Solved(ignoring).distribution, scans[::3].tolist()) > 2 * KOLMOGOROV
