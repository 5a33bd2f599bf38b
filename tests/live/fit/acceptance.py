"""How often estimates of simulated lines are right: every figure over as many seeds as are asked for.

    python -m tests.live.fit.acceptance [ROW ...] [--seeds N]

Prints, row by row, how many seeds cover each truth, and what the mean of the estimates is to it. The tests in
``test_acceptance`` ask for the same with a few seeds.
"""

from __future__ import annotations

import argparse
import copy
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import islice
from math import sqrt
from pathlib import Path
from statistics import fmean
from typing import Any, NamedTuple

import bussim
from bussim.commands.fit.command import scenario_of
from bussim.commands.fit.recording import fit
from bussim.commands.fit.scenario import bus_scenario
from bussim.line.characters import NN_LINE, CharFormat, LineTiming
from bussim.line.random_streams import Streams
from bussim.live.fit.link import LinkEstimate, LinkObserver
from bussim.live.fit.modbus import BusEstimate, BusObserver
from bussim.live.fit.statistics import Estimate
from bussim.live.recordings.frames import TraceFile
from bussim.live.recordings.source import LineSetup
from bussim.live.sniff.heard import LineProtocol
from bussim.live.sniff.listener import Listener
from bussim.live.sniff.reading import Settings
from bussim.results.collector import Collector
from bussim.scenario.loader import from_data
from bussim.trace.file import Trace
from bussim.trace.records import FrameRecord
from bussim.units import TICKS_PER_MS
from tests.live.fit.test_statistics import covers
from tests.undrawn import undrawn

RTU = LineTiming(19200, CharFormat(8, "E", 1))
#: Kinds of recordings of one run. The run's own folder is read without files.
SOURCES = ("run", "sr", "pcapng", "text")
BURSTS = {"burst": {"good": "300 ms", "bad": "10 ms", "ber_good": 0, "ber_bad": 0.01}}
#: Shares of the bits whose errors recordings without verdicts show, of 7E1 and of 8E1: all but the parity bit. What
#: follows a wrong stop bit is misread.
VISIBLE_NN, VISIBLE_RTU = 9 / 10, 10 / 11
INDEPENDENT = {"ber": 0.01 * 10 / 310}


class Known(NamedTuple):
    """An estimate, and what it is of."""

    name: str
    found: Estimate | None
    truth: float

    @property
    def covered(self) -> bool:
        """Whether the truth lies in the interval."""
        return self.found is not None and covers(self.found, self.truth)


class Asked(NamedTuple):
    """Something that is so, or not."""

    name: str
    so: bool


def link_data(seed: int, *noise: dict[str, Any]) -> dict[str, Any]:
    """A link with three slaves for 30 s."""
    nn = {"bus": "link", "port": "COM4"}
    master = {**nn, "station": 0, "slaves": 3, "mode": 0, "retries": 3, "timeout": "50 ms"}
    return {
        "schema": 1,
        "name": "a link",
        "duration": "30 s",
        "seed": seed,
        "buses": [{"name": "link", "nn": True}],
        "plcs": [
            {"name": "m", "nn": master},
            *({"name": f"s{k}", "nn": {**nn, "station": k}} for k in (1, 2, 3)),
        ],
        "noise": [{"bus": "link", **each} for each in noise],
    }


def bus_data(seed: int, seconds: int, *noise: dict[str, Any]) -> dict[str, Any]:
    """A master that polls two stations."""
    registers = [{"address": 0, "count": 20, "value": 7}]
    polls = [
        {"station": 1, "function": 3, "address": 0, "count": 10, "every": "100 ms", "retries": 2},
        {"station": 2, "function": 3, "address": 0, "count": 4, "every": "150 ms", "retries": 2},
    ]
    station = {"model": "map", "bus": "link", "registers": registers}
    return {
        "schema": 1,
        "name": "a bus",
        "duration": f"{seconds} s",
        "seed": seed,
        "buses": [{"name": "link", "baud": 19200, "format": "8E1"}],
        "plcs": [{"name": "idle"}],
        "devices": [
            {"name": "one", "station": 1, "delay": "4 ms", "jitter": "3 ms", **station},
            {"name": "two", "station": 2, "delay": "2 ms", "jitter": "1 ms", **station},
            {"name": "panel", "model": "hmi", "bus": "link", "timeout": "80 ms", "polls": polls},
        ],
        "noise": [{"bus": "link", **each} for each in noise],
    }


def traced(data: dict[str, Any]) -> Trace:
    """The trace of a run."""
    return bussim.run(from_data(data), trace=True, rows=False).open_trace()


def estimate(trace: Trace, protocol: LineProtocol, timing: LineTiming) -> LinkEstimate | BusEstimate | None:
    """The estimates of the bus ``link`` of a trace."""
    source = TraceFile(trace, trace.bus("link"))
    listener = Listener("link", timing, Collector(), protocol, decoders=(LinkObserver, BusObserver))
    for chunk in source.chunks(LineSetup(timing)):
        listener.chars(chunk.chars)
    end = source.end() or 0
    listener.close(end)
    decoder = listener.decoder
    if isinstance(decoder, LinkObserver):
        return decoder.estimate(1)
    assert isinstance(decoder, BusObserver)
    return decoder.estimate(1, end)


def link_of(trace: Trace) -> LinkEstimate:
    """The estimates of a link."""
    found = estimate(trace, LineProtocol.NN, NN_LINE)
    assert isinstance(found, LinkEstimate)
    return found


def link(seed: int, *noise: dict[str, Any]) -> LinkEstimate:
    """The estimates of three slaves in 30 s."""
    return link_of(traced(link_data(seed, *noise)))


def bus(seed: int, seconds: int, *noise: dict[str, Any]) -> BusEstimate:
    """The estimates of two stations."""
    found = estimate(traced(bus_data(seed, seconds, *noise)), LineProtocol.RTU, RTU)
    assert isinstance(found, BusEstimate)
    return found


def recorded(data: dict[str, Any], kind: str) -> LinkEstimate | BusEstimate:
    """The estimates of a run by a recording of it."""
    from tests.live.recordings.test_own_runs import of_run

    with tempfile.TemporaryDirectory() as name:
        path, options = of_run(from_data(data), Path(name))[kind]
        protocol = LineProtocol.RTU if "devices" in data else LineProtocol.NN
        given: dict[str, Any] = {}
        if kind == "text":
            given["protocol"] = protocol
            if protocol is LineProtocol.RTU:
                given["parity"] = "E"
        if options[:1] == ("-b",):
            given["baud"] = int(options[1])
        found = fit(str(path), Settings(**given))
    either = found.link or found.ports
    assert either is not None
    return either


# -- rows: what is known of the line of one seed -----------------------------------------------------------


def link_intervals(kind: str, seed: int) -> Iterator[Known | Asked]:
    """Five figures of a link with bit errors and lost replies of one station."""
    data = link_data(seed, {"ber": 1e-4}, {"station": "s2", "reply_loss": 0.05})
    found = link_of(traced(data)) if kind == "run" else recorded(data, kind)
    assert isinstance(found, LinkEstimate)
    one, two, _ = found.stations
    blind = kind == "text"
    yield Known("ber", found.noise.ber, 1e-4 * (VISIBLE_NN if blind else 1))
    yield Known("loss", two.losses.loss, 0.05)
    yield Known("turnaround", one.turnaround, 0.4175 * TICKS_PER_MS)
    yield Known("gap", found.master_gap, 0.4175 * TICKS_PER_MS)
    yield Known("overhead", found.scan_overhead, 3.52 * TICKS_PER_MS)
    if blind:
        return  # what is wrong in a parity bit alone is sound, and asked for again
    yield Asked("a damaged reply is no lost one", one.losses.lost == 0)
    # Losses are counted: each request draws once whether its reply is lost. One before a repeat that is
    # damaged, of which there is one in 160, is taken for a damaged reply.
    draws = islice(Streams(seed).uniforms("noise", "reply_loss s2", "s2"), two.losses.trials)
    counted = 0 <= sum(draw < 0.05 for draw in draws) - two.losses.lost <= 2
    yield Asked("losses are those that were drawn", bool(two.losses.runs) or counted)
    yield Asked("nothing at the master's receiver", found.noise.master_receiver.repeats == 0)


def bus_intervals(kind: str, seed: int) -> Iterator[Known | Asked]:
    """Four figures of a bus with bit errors and lost replies of one station."""
    data = bus_data(seed, 30, {"ber": 2e-4}, {"station": "one", "reply_loss": 0.05})
    found = estimate(traced(data), LineProtocol.RTU, RTU) if kind == "run" else recorded(data, kind)
    assert isinstance(found, BusEstimate)
    delays = {each.station: each.delay for each in found.slaves}
    yield Known("ber", found.noise.ber, 2e-4 * (VISIBLE_RTU if kind in ("text", "pcapng") else 1))
    yield Known("loss", found.slaves[0].losses.loss, 0.05)
    yield Known("delay one", delays[1], 5.5 * TICKS_PER_MS)
    yield Known("delay two", delays[2], 2.5 * TICKS_PER_MS)


def in_bursts(seed: int) -> Iterator[Known | Asked]:
    """Bursts of 10 ms every 300 ms."""
    bursts = link(seed, BURSTS).noise.bursts
    yield Asked("seen", bursts.seen is True)
    states = bursts.states
    good = Known("good", states and states.good, 300 * TICKS_PER_MS)
    bad = Known("bad", states and states.bad, 10 * TICKS_PER_MS)
    yield from (good, bad, Asked("both times covered", good.covered and bad.covered))
    yield Known("ber_bad", states and states.ber_bad, 0.01)


def sized(seed: int) -> Iterator[Known | Asked]:
    """Yearly errors by the scenario that is fitted to bursts, against those by their line: for two settings."""
    data = link_data(seed, BURSTS)
    with tempfile.TemporaryDirectory() as name, undrawn():
        bussim.run(from_data(data), out=Path(name) / "run", trace=True)
        fitted = fit(str(Path(name) / "run"))
    made = dict(scenario_of(fitted, None, name="fitted", seed=1, longest=0, warnings={}).source)
    for retries in (3, 6):
        both = []
        for each in (data, copy.deepcopy(made)):
            each["plcs"][0]["nn"]["retries"] = retries
            # Slaves that did not hear the master's first frames are written as off until then.
            solved = bussim.exact(from_data(each), ignore_faults=True, refresh=False)
            both.append(solved.links["link"].errors_per_year or 0.0)
        yield Asked(f"with {retries} retries no less than a tenth", both[1] >= both[0] / 10)
        yield Known(f"with {retries} retries", Estimate(both[1], both[0] / 10, both[0] * 10, 1), both[0])


def independent(seed: int) -> Iterator[Known | Asked]:
    """Independent errors of the same mean."""
    yield Asked("taken for bursts", link(seed, INDEPENDENT).noise.bursts.seen is True)


def masters_receiver(seed: int) -> Iterator[Known | Asked]:
    """Bit errors at the master's receiver alone."""
    trace = traced(link_data(seed, {"station": "m", "direction": "rx", "ber": 1e-4}))
    found = link_of(trace).noise
    receiver = found.master_receiver
    hit = (bool(each.damaged_at) for each in trace.of(FrameRecord) if each.station and each.kind == "data")
    yield Asked("repeats are damaged replies", receiver.repeats == sum(hit))
    yield Known("ber", receiver.ber, 1e-4)
    unheard = receiver.unheard is not None and receiver.unheard.value == 0
    yield Asked("none unheard", unheard)
    yield Asked("none on the bus", found.ber is not None and found.ber.value == 0 and found.ber.low == 0)
    yield Asked("of no sender", found.senders == {})


def damage_once(seed: int) -> Iterator[Known | Asked]:
    """The scenario that is written fails as often as the recording, within three standard errors of both."""
    found = bus(seed, 40, {"ber": 3e-4}, {"station": "one", "reply_loss": 0.08})
    yield Asked("timeout and pause", found.timeout == 85 * TICKS_PER_MS)
    unheard = found.noise.master_receiver.unheard
    yield Asked("none unheard", unheard is not None and unheard.value == 0)
    yield Asked("retries", {poll.retries for poll in found.polls} == {2})
    data = bus_scenario(
        replace(found, recording="a line"),
        "link",
        name="fitted",
        duration=40_000 * TICKS_PER_MS,
        seed=100 + seed,
    )
    again = estimate(traced(data), LineProtocol.RTU, RTU)
    assert isinstance(again, BusEstimate)
    shares = [(each.behaviour.failed, each.behaviour.attempts) for each in (found, again)]
    rates = [failed / attempts for failed, attempts in shares]
    spread = sqrt(
        sum(rate * (1 - rate) / attempts for rate, (_, attempts) in zip(rates, shares, strict=True))
    )
    yield Asked("fails as often", abs(rates[0] - rates[1]) <= 3 * spread)


def right(found: Known | Asked) -> bool:
    """Whether the interval covers the truth, or what was asked is so."""
    return found.covered if isinstance(found, Known) else found.so


ROWS: dict[str, tuple[Callable[[int], Iterator[Known | Asked]], int]] = {
    "bursts": (in_bursts, 100),
    "sized": (sized, 100),
    "independent": (independent, 100),
    "master": (masters_receiver, 100),
    "once": (damage_once, 50),
    **{f"link {kind}": (partial(link_intervals, kind), 200) for kind in SOURCES},
    **{f"bus {kind}": (partial(bus_intervals, kind), 200) for kind in SOURCES},
}


def tally(row: str, seeds: range) -> None:
    """Print a row."""
    covered: dict[str, int] = {}
    estimates: dict[str, list[float]] = {}
    missed: dict[str, list[int]] = {}
    for seed in seeds:
        for each in ROWS[row][0](seed):
            covered[each.name] = covered.get(each.name, 0) + right(each)
            if not right(each):
                missed.setdefault(each.name, []).append(seed)
            if isinstance(each, Known) and each.found is not None:
                estimates.setdefault(each.name, []).append(each.found.value / each.truth)
    print(f"{row}: {len(seeds)} seeds")
    for name, count in covered.items():
        mean = f"  mean of estimates {fmean(estimates[name]):.4f} of the truth" if name in estimates else ""
        print(f"  {name:<36} {count:>4}{mean}  not: {missed.get(name, [])[:20]}", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rows", nargs="*", metavar="ROW", help=", ".join(ROWS))
    parser.add_argument("--seeds", type=int, metavar="N", help="seeds of each row (100 to 200)")
    arguments = parser.parse_args()
    for row in arguments.rows or ROWS:
        tally(row, range(arguments.seeds or ROWS[row][1]))
    sys.exit()
