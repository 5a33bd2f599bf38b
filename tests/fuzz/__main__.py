"""Mutated files for the readers: ``python -m tests.fuzz [NAME ...] [--inputs N] [--seconds S] [--seed N]``.

Without names every target has its inputs, as many targets at once as there are processors. An input that a
reader neither reads nor refuses in words is kept in ``tests/fuzz/corpus/NAME``: what is in there is tried first.
"""

from __future__ import annotations

import argparse
import faulthandler
import hashlib
import os
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from itertools import islice
from pathlib import Path
from random import Random
from typing import NamedTuple

from tests.fuzz.targets import TARGETS, Target, refused

CORPUS = Path(__file__).parent / "corpus"
#: Seconds after which an input is taken for one that never ends.
LONGEST = 60


class Outcome(NamedTuple):
    """How many inputs were tried, how many of them refused in words, and the fault that ended it."""

    name: str
    inputs: int
    refused: int
    seconds: float
    slowest: float
    fault: str | None

    def __str__(self) -> str:
        text = (
            f"{self.name:9} {self.inputs:9,} inputs, {self.refused:9,} of them refused, in {self.seconds:,.0f} s; "
            f"the slowest took {1000 * self.slowest:,.0f} ms"
        )
        return text if self.fault is None else f"{text}\n{self.fault}"


def fuzz(name: str, inputs: int, seconds: float, seed: int) -> Outcome:
    """Try what is in the corpus and then mutated inputs: so many, so long, or until the first fault."""
    target, folder = TARGETS[name], CORPUS / name
    begun, number, refusals, slowest, fault = time.monotonic(), 0, 0, 0.0, None
    for data in islice(_inputs(target, folder, Random(f"{name} {seed}")), inputs):
        before = time.monotonic()
        if before - begun > seconds:
            break
        number += 1
        trying = folder.with_name(f"{name}-{os.getpid()}.trying")  # is left where the process itself dies
        trying.write_bytes(data)
        faulthandler.dump_traceback_later(LONGEST, exit=True)
        try:
            refusals += refused(target, data)
        except Exception:  # whatever it is, it is what is looked for
            folder.mkdir(exist_ok=True)
            path = trying.rename(folder / hashlib.sha256(data).hexdigest()[:12])
            fault = f"{path}\n{traceback.format_exc()}"
            break
        finally:
            faulthandler.cancel_dump_traceback_later()
        slowest = max(slowest, time.monotonic() - before)
        trying.unlink()
    return Outcome(name, number, refusals, time.monotonic() - begun, slowest, fault)


def _inputs(target: Target, folder: Path, random: Random) -> Iterator[bytes]:
    seeds = target.seeds()
    yield from seeds
    yield from (path.read_bytes() for path in sorted(folder.glob("*")))
    while True:
        yield target.mutated(random, random.choice(seeds), seeds)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the targets and print what came of each; 1 where there is a fault."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=f"of {', '.join(TARGETS)}; none: each of them"
    )
    parser.add_argument(
        "--inputs", type=int, help="inputs of each (1,000,000 of named ones, else mostly 10,000)"
    )
    parser.add_argument("--seconds", type=float, default=3600.0, help="at most so long for each (3600)")
    parser.add_argument("--seed", type=int, default=1, help="other inputs (1)")
    given = parser.parse_args(arguments)
    if unknown := set(given.names) - set(TARGETS):
        parser.error(f"no target {', '.join(sorted(unknown))}; allowed are {', '.join(TARGETS)}")
    names = given.names or list(TARGETS)
    inputs = [given.inputs or (1_000_000 if given.names else TARGETS[name].inputs) for name in names]
    run = partial(fuzz, seconds=given.seconds, seed=given.seed)
    CORPUS.mkdir(exist_ok=True)
    faults = 0
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for outcome in pool.map(run, names, inputs):
            print(outcome, flush=True)  # noqa: T201 - it is a program
            faults += outcome.fault is not None
    return int(faults > 0)


if __name__ == "__main__":
    sys.exit(main())
