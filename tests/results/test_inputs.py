"""inputs.csv: when the wires of driven inputs changed, beside values.csv, which has memory's image."""

from __future__ import annotations

from pathlib import Path

import pytest

import bussim
from bussim.scenario.loader import loads

SCENARIO = """\
schema: 1
name: inputs
duration: 2 s
buses: [{name: link, nn: true}]
plcs:
  - name: a
    scan: 10 ms
    phase: 5 ms
    inputs: {X0: {times: [123 ms, 1.101 s]}, X1: {pulse: {width: 2 ms, at: 501 ms}}}
observe: [a.X0, a.X1]
"""


@pytest.mark.parametrize("stored", [False, True])
def test_edges_are_when_the_wire_changed_and_values_when_the_plc_had_seen_it(
    tmp_path: Path, *, stored: bool
) -> None:
    result = bussim.run(loads(SCENARIO), out=tmp_path / "r" if stored else None)
    edges, values = result.inputs, result.values
    assert list(edges.columns) == ["time_s", "plc", "device", "level", "sampled_s", "seen"]
    rows = [tuple(row) for row in edges.itertuples(index=False)]
    assert rows == [
        (0.123, "a", "X0", 1, 0.125, True),
        (0.501, "a", "X1", 1, 0.505, False),
        (0.503, "a", "X1", 0, 0.505, True),
        (1.101, "a", "X0", 0, 1.105, True),
    ]
    assert [tuple(row) for row in values.itertuples(index=False)] == [
        (0.135, "a", "X0", 1),
        (1.115, "a", "X0", 0),
    ]
