"""Speed of the exact solver. Prints figures and asserts nothing: ``python -m tests.benchmarks.bench_exact``.

The ratio to simulating is against a bare SimPy loop of the same exchanges in the same process (one
re-armed event an exchange, one random draw), the least that any simulation of the link could take.
"""

from __future__ import annotations

import resource
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from random import Random

import simpy

from bussim.engines.nn.frames import data_chars
from bussim.exact.link import LineNoise, LinkModel, NoiseSource, Station, frame_ticks
from bussim.exact.metrics import Request, figures_of, tail_curve
from bussim.exact.scan.memoryless import scan_distribution
from bussim.exact.sizing.goals import Goals
from bussim.exact.sizing.grid import evaluate
from bussim.exact.sizing.size import size
from bussim.plc.profiles import PROFILES

MS = 72_000
ATTEMPTS, TIMEOUTS = range(1, 12), range(50 * MS, 2_251 * MS, 10 * MS)


def link(slaves: int, mode: int, ber: float) -> LinkModel:
    """A link of the pw10 profile, 3 retries, 100 ms."""
    profile, reply = PROFILES["pw10"], frame_ticks(data_chars(mode))
    stations = tuple(
        Station(k, f"p{k}", profile.turnaround, reply, scan=10 * MS) for k in range(1, slaves + 1)
    )
    return LinkModel(
        bus="link",
        master="p0",
        stations=stations,
        mode=mode,
        retries=3,
        attempts=4,
        timeout=100 * MS,
        gap=profile.master_gap,
        overhead=profile.scan_overhead,
        data=reply,
        noise=LineNoise((NoiseSource("bus", None, ber),)),
    )


def best(action: Callable[[], object], times: int) -> float:
    """The shortest of so many runs, in seconds of this process on the processor."""
    action()
    found = []
    for _ in range(times):
        begin = time.process_time()
        action()
        found.append(time.process_time() - begin)
    return min(found)


def bare_simpy(exchanges: int) -> float:
    """Seconds for a bare SimPy loop of so many exchanges."""
    env, rng = simpy.Environment(), Random(1)

    def loop() -> simpy.events.ProcessGenerator:
        for _ in range(exchanges):
            yield env.timeout(int(30_060 + 7_200 * rng.random()))

    env.process(loop())
    begin = time.process_time()
    env.run()
    return time.process_time() - begin


def distribution_and_quantiles(model: LinkModel) -> list[float]:
    """One distribution and three quantiles."""
    distribution = scan_distribution(model)
    return [distribution.quantile(q) for q in (1e-3, 1e-6, 1e-9)]


def shown(model: LinkModel, step: int) -> None:
    """What a page shows of a link with 9 retries; each step has another timeout, as nothing is known of it."""
    figures = figures_of(model.with_setting(10, (100 + 10 * step) * MS, 9), Request(refresh=False))
    assert figures.distribution is not None
    tail_curve(figures.distribution, 1e-10, 1_200)


def family() -> tuple[int, float]:
    """Settings and seconds of 11 × 221 settings × 5 modes × 7 slave counts × 4 bit error rates."""
    settings = 0
    begin = time.process_time()
    for mode, slaves, ber in product(range(5), range(1, 8), (1e-7, 1e-6, 1e-5, 1e-4)):
        grid = evaluate(link(slaves, mode, ber), ATTEMPTS, TIMEOUTS, details=False)
        settings += grid.mean.size
    return settings, time.process_time() - begin


def main() -> None:
    """Print all figures."""
    say = sys.stdout.write
    for ber in (1e-6, 1e-5, 1e-4):
        model = link(7, 2, ber)
        seconds = best(lambda model=model: distribution_and_quantiles(model), 30)  # type: ignore[misc]
        say(f"distribution and 3 quantiles, 8 stations, mode 2, BER {ber:g}: {1e3 * seconds:.2f} ms\n")
        seconds = best(lambda model=model: evaluate(model, ATTEMPTS, TIMEOUTS), 3)  # type: ignore[misc]
        say(f"2,431 settings, all figures, BER {ber:g}: {seconds:.3f} s\n")
    bursts = replace(
        link(7, 2, 0.0),
        noise=LineNoise((NoiseSource("bus", None, 0.0, 1e-2, 0),), ((720e6, 1.44e6),)),
    )
    say(f"2,431 settings with bursts: {best(lambda: evaluate(bursts, ATTEMPTS, TIMEOUTS), 2):.2f} s\n")
    for name, model in (("bursts", bursts), ("BER 1e-3", link(7, 2, 1e-3))):
        moves = iter(range(1000))
        seconds = best(lambda model=model, moves=moves: shown(model, next(moves)), 5)  # type: ignore[misc]
        say(f"figures and curve of another timeout, 8 stations, 9 retries, {name}: {1e3 * seconds:.0f} ms\n")
    stays = iter(range(1_440_000, 10_000_000, 1_000))  # nothing is known of any of them
    seconds = best(
        lambda: size(
            replace(bursts, noise=LineNoise(bursts.noise.sources, ((720e6, next(stays)),))), Goals()
        ),
        1,
    )
    say(f"a recommendation with bursts: {seconds:.2f} s\n")
    say(f"all figures of one setting: {best(lambda: figures_of(link(7, 2, 1e-5)), 3):.3f} s\n")
    say(
        f"the same without refreshes: {best(lambda: figures_of(link(7, 2, 1e-5), Request(refresh=False)), 3):.4f} s\n"
    )
    say(f"a recommendation: {best(lambda: size(link(7, 2, 1e-5), Goals()), 3):.3f} s\n")
    settings, seconds = family()
    say(f"family of {settings:,} settings: {seconds:.2f} s, {1e6 * seconds / settings:.1f} µs each\n")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    say(f"peak memory: {peak:.0f} MB\n")
    scans = 100_000
    seconds = bare_simpy(7 * scans // 10) * 10
    law = best(lambda: distribution_and_quantiles(link(7, 2, 1e-5)), 30)
    say(f"1e5 scans of 7 exchanges in a bare SimPy loop: {seconds:.1f} s, {seconds / law:,.0f} laws\n")


if __name__ == "__main__":
    main()
