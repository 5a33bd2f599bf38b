"""Ten simulated recordings with known parameters: fit finds them back."""

from __future__ import annotations

import random
from functools import cache
from typing import Any

import pytest

import bussim
from bussim.engines.nn.frames import encode_poll
from bussim.line.characters import NN_LINE
from bussim.live.fit.link import LinkEstimate, LinkObserver
from bussim.live.recordings.frames import TraceFile
from bussim.live.recordings.source import LineSetup
from bussim.live.sniff.decoder import Line
from bussim.live.sniff.heard import Heard, LineProtocol
from bussim.live.sniff.listener import Listener
from bussim.live.sniff.modbus import ModbusDecoder
from bussim.results.collector import Collector
from bussim.scenario.loader import from_data
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND, parse_time
from tests.live.fit.test_statistics import covers
from tests.selection import quick

SEEDS = range(10)
#: Two-sided 95 % intervals, twenty of them: fewer than this many miss, but once in 10^4.
MOST_MISSES = 5


@cache
def parameters(seed: int) -> dict[str, Any]:
    """Parameters of one line, drawn once."""
    rng = random.Random(f"fit {seed}")
    return {
        "turnaround": [(round(rng.uniform(0.3, 3), 3), round(rng.uniform(0.02, 0.2), 3)) for _ in range(2)],
        "loss": [round(rng.uniform(0.005, 0.08), 4) for _ in range(2)],
        "ber": rng.choice([0, 2e-6, 2e-5]),
        "gap": round(rng.uniform(0.2, 1), 4),
        "overhead": round(rng.uniform(1, 6), 3),
        "mode": rng.randrange(3),
        "retries": rng.randrange(4),
    }


def scenario(seed: int) -> dict[str, Any]:
    known = parameters(seed)
    nn = {"bus": "link", "port": "COM4"}
    noise: list[dict[str, Any]] = [
        {"bus": "link", "station": f"s{k + 1}", "reply_loss": known["loss"][k]} for k in range(2)
    ]
    if known["ber"]:
        noise.append({"bus": "link", "ber": known["ber"]})
    slaves = [
        {
            "name": f"s{k + 1}",
            "scan": "5 ms",
            "profile": {
                "base": "pw10",
                "turnaround": {
                    "mean": f"{known['turnaround'][k][0]} ms",
                    "jitter": f"{known['turnaround'][k][1]} ms",
                },
            },
            "nn": {**nn, "station": k + 1},
        }
        for k in range(2)
    ]
    master = {
        "name": "m",
        "profile": {
            "base": "pw10",
            "master_gap": f"{known['gap']} ms",
            "scan_overhead": f"{known['overhead']} ms",
        },
        "nn": {
            **nn,
            "station": 0,
            "slaves": 2,
            "mode": known["mode"],
            "retries": known["retries"],
            "timeout": "60 ms",
        },
    }
    return {
        "schema": 1,
        "name": f"recording {seed}",
        "duration": "45 s",
        "seed": seed,
        "buses": [{"name": "link", "nn": True}],
        "plcs": [master, *slaves],
        "noise": noise,
        "faults": [{"at": "10 s", "for": "2 s", "power_off": "s1"}],
    }


@cache
def fitted(seed: int) -> LinkEstimate:
    result = bussim.run(from_data(scenario(seed)), trace=True, rows=False)
    listener = Listener("link", NN_LINE, Collector(), LineProtocol.NN, decoders=(LinkObserver, ModbusDecoder))
    trace = result.open_trace()
    for chunk in TraceFile(trace, trace.bus("link")).chunks(LineSetup(NN_LINE)):
        listener.chars(chunk.chars)
    listener.close()
    assert isinstance(listener.decoder, LinkObserver)
    found = listener.decoder.estimate()
    assert found is not None
    return found


def test_a_station_whose_poll_ends_the_recording_has_nothing_estimated() -> None:
    observer = LinkObserver(Line("link", NN_LINE.baud, str(NN_LINE.format), 0, 0), Collector())
    poll = encode_poll(1, 0)
    observer.heard(Heard(LineProtocol.NN, 0, 1000, poll.chars, poll))
    found = observer.estimate()
    assert found is not None
    assert [(each.station, each.polls, each.turnaround, each.losses.loss) for each in found.stations] == [
        (1, 0, None, None)
    ]


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_turnaround_gap_and_overhead_are_found(seed: int) -> None:
    known, found = parameters(seed), fitted(seed)
    for (mean, jitter), station in zip(known["turnaround"], found.stations, strict=True):
        assert station.turnaround is not None
        assert station.distribution is not None
        assert station.turnaround.value == pytest.approx(mean * TICKS_PER_MS, rel=0.02)
        assert station.distribution.mean == pytest.approx(mean * TICKS_PER_MS, rel=0.02)
        assert station.distribution.jitter == pytest.approx(jitter * TICKS_PER_MS, rel=0.05)
        assert station.distribution.values == ()
    assert found.master_gap is not None
    assert found.scan_overhead is not None
    assert found.master_gap.value == parse_time(f"{known['gap']} ms")
    assert found.scan_overhead.value == parse_time(f"{known['overhead']} ms")


@pytest.mark.parametrize("seed", quick(2, SEEDS))
def test_settings_and_the_outage_are_found(seed: int) -> None:
    known, found = parameters(seed), fitted(seed)
    assert found.settings_received
    assert found.settings == (2, known["mode"], known["retries"], 6)
    (outage,) = (o for o in found.stations[0].losses.outages if o.start > TICKS_PER_SECOND)
    scan = TICKS_PER_SECOND  # none takes longer here
    assert 10 * TICKS_PER_SECOND - scan <= outage.start <= 10 * TICKS_PER_SECOND + scan
    assert outage.end is not None
    assert 12 * TICKS_PER_SECOND - scan <= outage.end <= 12 * TICKS_PER_SECOND + scan


@pytest.mark.parametrize(("seeds", "most"), quick(1, [(SEEDS[:2], 2), (SEEDS, MOST_MISSES)]))
def test_loss_lies_within_its_interval(seeds: range, most: int) -> None:
    """Of twenty 95 % intervals one misses on the average; of four more than two, five times in 10^4."""
    misses = 0
    for seed in seeds:
        for loss, station in zip(parameters(seed)["loss"], fitted(seed).stations, strict=True):
            found = station.losses.loss
            assert found is not None
            misses += not covers(found, loss)
            assert found.value == pytest.approx(loss, abs=0.02)
    assert misses <= most


@pytest.mark.slow
def test_the_bit_error_rate_lies_within_its_interval() -> None:
    misses = 0
    for seed in SEEDS:
        ber = fitted(seed).noise.ber
        assert ber is not None
        misses += not covers(ber, parameters(seed)["ber"])
    assert misses <= MOST_MISSES - 1
