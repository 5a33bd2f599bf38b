"""Whether random scenarios leave the same when done in stretches and one by one: as many as are asked for.

    python -m tests.sim.acceptance [KIND ...] [--seeds N] [--first N]

Each seed is one scenario of each kind, every fourth with a trace; a difference ends it with exit code 1. The
tests ask for the same with a few seeds.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

from bussim.scenario import model
from tests.sim import chance, ladders
from tests.sim.serial import test_transactions as transactions
from tests.sim.serial import test_turns as turns
from tests.sim.test_rest import compare, timed

#: The random scenarios of each kind by their seeds.
KINDS: dict[str, Callable[[int], model.Scenario]] = {
    "links": lambda seed: chance.scenario(seed, 0.5),
    "programs": ladders.scenario,
    "ports": ladders.with_ports,
    "transactions": transactions.scenario,
    "turns": turns.scenario,
    "latencies": timed,
}


def main() -> int:
    """Compare what was asked for; 1 if any scenario differed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"of {', '.join(KINDS)}; none: all")
    parser.add_argument("--seeds", type=int, default=1667)
    parser.add_argument("--first", type=int, default=1)
    given = parser.parse_args()
    if unknown := sorted(set(given.kinds) - KINDS.keys()):
        parser.error(f"there are no {', '.join(unknown)}")
    different = []
    for kind in given.kinds or KINDS:
        begun = time.monotonic()
        for seed in range(given.first, given.first + given.seeds):
            try:
                compare(KINDS[kind](seed), traced=seed % 4 == 0)
            except Exception as error:  # whatever one of both ways raises is a difference
                different.append((kind, seed))
                print(f"{kind} {seed}: {type(error).__name__}: {str(error)[:300]}", flush=True)
        print(f"{kind}: {given.seeds} compared in {time.monotonic() - begun:.0f} s", flush=True)
    print(f"{len(different)} different: {different}" if different else "none different")
    return bool(different)


if __name__ == "__main__":
    raise SystemExit(main())
