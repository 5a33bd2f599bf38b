"""A short link as a scenario's text, and devices of PLCs over time."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bussim.errors import Problem, ScenarioError
from bussim.plc.memory import parse_device
from bussim.results.meters.watch import Watch, Watched
from bussim.scenario.loader import loads
from bussim.sim.runner import simulate
from tests.sim.build import Recorder


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


def examine_text(text: str) -> list[Problem]:
    """The mistakes of a scenario."""
    with pytest.raises(ScenarioError) as caught:
        loads(text)
    return list(caught.value.problems)


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
