"""Single PLCs and short links, device by device over time, against what the manuals say of them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bussim.plc.memory import parse_device
from bussim.results.meters.watch import Watch, Watched
from bussim.scenario.loader import loads
from bussim.sim.runner import simulate
from tests.sim.build import MS, SECOND, Recorder


def watched(text: str, names: str) -> dict[str, Watched]:
    """The devices over a scenario's time, by name."""
    devices = [Watched(*name.split("."), width=16) for name in names.split()]
    scenario = loads(text)
    plcs = tuple(
        replace(plc, observed=tuple(each.device for each in devices if each.plc == plc.name))
        for plc in scenario.plcs
    )
    record, watch = Recorder(), Watch(devices)
    simulate(replace(scenario, plcs=plcs), record)
    for value in record.values:
        watch.take(value)
    assert all(parse_device(each.device, observed=True) for each in devices)
    return {each.name: each for each in devices}


MEMORY = """
schema: 1
name: what memory keeps
duration: 6 s
seed: 1
plcs:
  - name: p
    profile: fx2n
    scan: 5 ms
    inputs: {X0: {pulse: {width: 350 ms, at: 1 s}}}
    program: |
      LDP X0
      MOV K11 D10
      MOV K22 D300
      SET M10
      SET M1064
      SET S600
      SET S10
      LD X0
      OUT C0 K1
      OUT C100 K1
      OUT T250 K30
      LD M1064
      OUT Y0
      END
faults:
  - {at: 3 s, for: 1 s, FAULT: p}
"""


@pytest.mark.parametrize("kind", ["power_off", "stop"])
def test_general_devices_begin_anew_and_latched_ones_go_on(kind: str) -> None:
    names = "p.D10 p.M10 p.S10 p.CN0 p.C0 p.D300 p.M1064 p.S600 p.CN100 p.C100 p.TN250 p.Y0"
    seen = watched(MEMORY.replace("FAULT", kind), names)
    before = [seen[name].at(3 * SECOND - 1) for name in names.split()]
    assert before == [11, 1, 1, 1, 1, 22, 1, 1, 1, 1, 3, 1]
    back = seen["p.D10"].ticks[-1]  # the first END after RUN
    assert 4 * SECOND < back <= 4 * SECOND + 6 * MS
    after = [seen[name].at(back) for name in names.split()]
    assert after == [0, 0, 0, 0, 0, 22, 1, 1, 1, 1, 3, 1]
    assert seen["p.Y0"].between(2 * SECOND, back) == []  # on again at that END


LINK = """
schema: 1
name: three stations
duration: 10 s
seed: 1
buses: [{name: link, nn: true}]
plcs:
  - name: m
    profile: PROFILE
    scan: 4 ms
    ports: {COM3: {bus: link}}
    inputs: {X0: {times: [1 s]}, X3: {times: [2 s]}}
    program: |
      LD MASTER
      MOV K0 D8176
      MOV K2 D8177
      MOV K1 D8178
      MOV K3 D8179
      MOV K5 D8180
      LDI M8183
      MOV K1X000 K1M1000
      LDI M8184
      MOV K1M1064 K1Y014
      LD M1070
      OUT Y005
      END
  - name: s1
    profile: PROFILE
    scan: 5 ms
    ports: {COM3: {bus: link}}
    inputs: {X1: {times: [1 s]}}
    program: |
      LD M8038
      MOV K1 D8176
      LDI M8183
      MOV K1M1000 K1Y010
      LDI M8184
      MOV K1X000 K1M1064
      END
  - name: s2
    profile: PROFILE
    scan: 6 ms
    ports: {COM3: {bus: link}}
    program: |
      LD M8038
      MOV K2 D8176
      LD M8000
      MOV K12 D20
      END
faults:
  - {at: 6 s, for: 1 s, power_off: s1}
"""


def link(profile: str = "fx3u", master: str = "M8038") -> str:
    return LINK.replace("PROFILE", profile).replace("LD MASTER", f"LD {master}")


def test_a_returning_station_copies_latched_bits_although_it_asks_for_the_error_flag() -> None:
    """M8183 of the master is off after RUN: LDI M8183 lets the old M1000 through at the first END."""
    seen = watched(link(), "s1.Y10 s1.Y13 s1.M1000 s1.M8191 m.Y14 m.Y15")
    running = seen["s1.M8191"].between(6 * SECOND, 9 * SECOND)
    first_end = 7 * SECOND + 6 * MS
    assert seen["s1.Y10"].at(first_end) == seen["s1.Y13"].at(first_end) == 1
    assert [value for _, value in running] == [0, 1]
    assert running[0][0] <= first_end < running[1][0]
    assert seen["s1.Y10"].between(SECOND * 3 // 2, 10 * SECOND) == []  # it never went off in memory
    assert seen["m.Y15"].at(6 * SECOND) == 1
