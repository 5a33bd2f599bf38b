"""Random inputs: whose rng they have."""

from __future__ import annotations

import bussim
from bussim.scenario.loader import loads
from bussim.scenario.yaml.dump import dumps

SCENARIO = """\
schema: 1
name: inputs
duration: 10 s
seed: {seed}
buses: [{{name: link, nn: true}}]
plcs:
  - name: a
    scan: 10 ms
    inputs: {{X0: {{random: {own}}}, X1: {{random: {own}}}}}
"""


def edges(seed: int, own: str) -> list[list[float]]:
    """When X0 and X1 change."""
    scenario = loads(SCENARIO.format(seed=seed, own=own))
    assert loads(dumps(scenario)) == scenario
    found = bussim.run(scenario).inputs
    return [found[found["device"] == device]["time_s"].tolist() for device in ("X0", "X1")]


def test_without_a_seed_each_input_has_a_stream_of_the_scenarios_seed() -> None:
    one, other = edges(1, "{on: 500 ms, off: 500 ms}"), edges(2, "{on: 500 ms, off: 500 ms}")
    assert one == edges(1, "{on: 500 ms, off: 500 ms}")
    assert one != other
    assert one[0] != one[1]


def test_a_seed_of_its_own_alone_makes_its_course() -> None:
    one = edges(1, "{on: 500 ms, off: 500 ms, seed: 3}")
    assert one == edges(2, "{on: 500 ms, off: 500 ms, seed: 3}")
    assert one[0] == one[1]
    assert one != edges(1, "{on: 500 ms, off: 500 ms, seed: 4}")
