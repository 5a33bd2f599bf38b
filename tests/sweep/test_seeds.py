from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from bussim.sweep.plan import run_seed
from bussim.sweep.vary import grid, parse_axes

AXES = parse_axes(["a.b=0:9:1", "c=1e-6:1e-3:log10"])
POINTS = grid(AXES, 1)


def test_every_run_has_a_seed_of_its_own() -> None:
    seeds = {
        run_seed(base, AXES, point, repeat, common_random_numbers=False)
        for base in (0, 1)
        for point in POINTS
        for repeat in range(1, 11)
    }
    assert len(seeds) == 2 * 100 * 10
    assert all(0 <= seed < 2**48 for seed in seeds)
    # Spread evenly: the mean of 2000 uniform numbers, within five standard deviations.
    mean = sum(seeds) / len(seeds) / 2**48
    assert abs(mean - 0.5) < 5 * (1 / 12 / len(seeds)) ** 0.5


def test_a_seed_does_not_depend_on_the_rest_of_the_sweep() -> None:
    coarse, turned = parse_axes(["a.b=4", "c=0.001,7"]), parse_axes(["c=1e-3", "a.b=4.0"])
    wanted = run_seed(5, AXES, POINTS[4 * 10 + 9], 2, common_random_numbers=False)
    assert [value.text for value in POINTS[49]] == ["4", "0.001"]
    assert run_seed(5, coarse, grid(coarse, 1)[0], 2, common_random_numbers=False) == wanted
    assert run_seed(5, turned, grid(turned, 1)[0], 2, common_random_numbers=False) == wanted


def test_common_random_numbers_leaves_out_the_point_and_nothing_else() -> None:
    def seeds(base: int, repeat: int) -> set[int]:
        return {run_seed(base, AXES, point, repeat, common_random_numbers=True) for point in POINTS}

    assert len(seeds(1, 1)) == 1
    assert len(seeds(1, 1) | seeds(1, 2) | seeds(2, 1)) == 3


def test_seeds_are_the_same_in_any_process() -> None:
    code = (
        "from tests.sweep.test_seeds import *\n"
        "print([run_seed(3, AXES, point, 1, common_random_numbers=False) for point in POINTS])"
    )
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        cwd=root,
        env={"PYTHONPATH": str(root), "PYTHONHASHSEED": "77"},
    )
    assert done.stdout.strip() == str(
        [run_seed(3, AXES, point, 1, common_random_numbers=False) for point in POINTS]
    )
