"""Which devices a signal reaches: what is warned of, what is not, and that "nothing" is never wrong."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import bussim
from bussim.exact.latency.bounds import bounds_of
from bussim.plc.memory import Device, Memory
from bussim.plc.program.execution import ProgramRun
from bussim.plc.program.program import Program
from bussim.scenario.loader import from_data
from bussim.scenario.model import Scenario
from bussim.scenario.signals.network import Network, Reachability
from bussim.scenario.signals.paths import signal_paths
from bussim.units import TICKS_PER_MS
from tests.plc.program.random_programs import Writer

SEND, SHOW, RELAY = "LD X0\nOUT M1000\n", "LD M1000\nOUT Y4\n", "LD M1000\nOUT M1128\n"

PORTS = {
    "a": {"bus": "line", "protocol": "modbus-rtu-master"},
    "b": {"bus": "line", "protocol": "modbus-rtu-slave", "station": 2},
}


def scenario(
    start: str = "a.X0",
    end: str = "b.Y4",
    *,
    a: str | None = SEND,
    b: str | None = SHOW,
    c: str | None = None,
    mode: int = 2,
    seconds: int = 2,
    serial: str = "",
) -> Scenario:
    """A master a, a slave b, and with a program a slave c; ``serial`` are those with a port on another bus."""
    programs = {"a": a, "b": b} | ({"c": c} if c is not None else {})
    plcs: list[dict[str, Any]] = []
    for number, (name, text) in enumerate(programs.items()):
        nn: dict[str, Any] = {"bus": "link", "port": "COM4", "station": number}
        nn |= {} if number else {"slaves": len(programs) - 1, "mode": mode, "timeout": "50 ms"}
        plcs.append(
            {"name": name, "nn": nn}
            | ({"program": f"{text}END\n"} if text is not None else {})
            | ({"inputs": {"X0": {"square": "700 ms"}}} if name == "a" else {})
            | ({"ports": {"COM3": PORTS[name]}} if name in serial else {})
        )
    return from_data(
        {
            "schema": 1,
            "name": "reachability",
            "duration": f"{seconds} s",
            "buses": [{"name": "link", "nn": True}, *([{"name": "line"}] if serial else ())],
            "plcs": plcs,
            "latency": [{"name": "path", "from": start, "to": end}],
        }
    )


def warned(found: Scenario) -> list[str]:
    return [said for said in found.warnings if said.startswith(("nothing leads", "no age"))]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"end": "b.Y7"}, "nothing leads from a.X0 to b.Y7: no program does, and in refresh mode 2 a shares"),
        ({"end": "b.Y7", "b": f"{SHOW}LD M8000\nALT Y7\n"}, "a shares M1000 to M1063 and D0 to D7"),
        ({"end": "a.Y0"}, "nothing leads from a.X0 to a.Y0"),
        ({"start": "a.X1"}, "nothing leads from a.X1 to b.Y4"),
        ({"start": "a.M8013"}, "nothing leads from a.M8013 to b.Y4"),
        ({"start": "a.D500", "end": "b.D600"}, "nothing leads from a.D500 to b.D600"),
        ({"start": "a.D500", "end": "b.D600", "a": None}, "nothing leads from a.D500 to b.D600"),
        ({"start": "a.D10", "end": "b.D10"}, "in refresh mode 2 a shares M1000 to M1063 and D0 to D7"),
        ({"mode": 0}, "in refresh mode 0 a shares D0 to D3"),
        ({"start": "a.M1000", "end": "b.M1000", "mode": 0}, "in refresh mode 0 a shares D0 to D3"),
        ({"a": "LD X0\nOUT M5\n"}, "nothing leads from a.X0 to b.Y4"),
        ({"start": "a.D0", "end": "b.D3"}, "nothing leads from a.D0 to b.D3"),
    ],
)
def test_what_nothing_connects_is_reported(given: dict[str, Any], said: str) -> None:
    found = scenario(**given)
    assert any(said in warning for warning in warned(found))
    (path,) = signal_paths(found)
    assert path.reachability is Reachability.NONE
    assert path.unmeasured in warned(found)
    assert bounds_of(found)["path"].reason == path.unmeasured


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, Reachability.DIRECT),
        ({"start": "a.M1000"}, Reachability.DIRECT),
        ({"b": "LD M1000\nOUT T0 K5\nLD T0\nOUT Y4\n"}, Reachability.DIRECT),
        # By its current value.
        ({"b": "LD M1000\nOUT T0 K5\nLD> T0 K1\nOUT Y4\n"}, Reachability.DIRECT),
        ({"start": "a.D0", "end": "b.TN0", "b": "LD M8000\nMOV D0 T0\n"}, Reachability.DIRECT),
        ({"b": "LD M1000\nMC N0 M5\nLD M8000\nOUT Y4\nMCR N0\n"}, Reachability.UNKNOWN),
        ({"b": "LD M1000\nMPS\nAND X1\nOUT Y1\nMPP\nAND X2\nOUT Y4\n"}, Reachability.DIRECT),
        ({"b": "LD M1000\nCJ P0\nLD M8000\nALT Y4\nP0\n"}, Reachability.UNKNOWN),
        ({"b": "LD M1000\nCALL P0\nFEND\nP0\nLD M8000\nALT Y4\nSRET\n"}, Reachability.UNKNOWN),
        ({"b": "LD M8000\nMOV K4M1000 Z0\nMOV K1 K1Y0Z0\n"}, Reachability.UNKNOWN),
        ({"b": "LD M8000\nADD K1M1000 K-1 D5\nLD M8020\nOUT Y4\n"}, Reachability.UNKNOWN),
        ({"b": "LD M8183\nOUT Y4\n", "a": "LD X0\nMOV K0 D8179\n"}, Reachability.UNKNOWN),
        ({"b": "LD M1128\nOUT Y4\n", "c": RELAY}, Reachability.DIRECT),
        ({"end": "a.Y4", "a": f"{SEND}LD M1128\nOUT Y4\n", "c": RELAY}, Reachability.DIRECT),
        ({"b": "LD M5\nOUT Y4\n", "a": "LD X0\nOUT M0\n"}, Reachability.NONE),
        ({"b": "LD M5\nOUT Y4\n", "c": RELAY}, Reachability.NONE),
    ],
)
def test_paths_that_no_alarm_may_be_raised_about(given: dict[str, Any], expected: Reachability) -> None:
    found = scenario(**given)
    assert signal_paths(found)[0].reachability is expected
    assert bool(warned(found)) is (expected is Reachability.NONE)


def test_a_program_is_searched_for_m8024_once_however_long_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    found = scenario(a=SEND + "LD X1\nOUT Y0\n" * 20)
    searched: list[Program] = []
    plain = Program.turns_bmov.fget
    assert plain is not None
    monkeypatch.setattr(Program, "turns_bmov", property(lambda it: searched.append(it) or plain(it)))
    Network(found.plcs)
    assert searched == [plc.program for plc in found.plcs]


def test_ports_may_carry_what_the_link_does_not() -> None:
    assert signal_paths(scenario(end="b.Y7"))[0].reachability is Reachability.NONE
    for serial in ("ab", "b"):
        given = scenario(end="b.Y7", serial=serial)
        assert signal_paths(given)[0].reachability is Reachability.UNKNOWN
        assert not warned(given)


def test_a_signal_over_a_third_station_arrives_and_has_no_bound() -> None:
    found = scenario(b="LD M1128\nOUT Y4\n", c=RELAY, seconds=20)
    entry = bussim.run(found, rows=False).summary["latency"]["path"]
    assert entry["way"] == "direct"
    assert entry["way_reasons"] == []
    assert entry["delivered"] > 50
    assert entry["bound_reasons"] == ["another station writes M1128 (b)"]


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({"end": "b.D300", "b": "LD M8000\nMOV D0 D300\n"}, None),
        ({"end": "b.D301", "b": "LD M8000\nDMOV D0 D300\n", "start": "a.D1"}, None),
        ({"end": "b.D301", "b": "LD M8000\nBMOV D0 D301 K2\n"}, "BMOV D0 D301 K2 at line 2 is no plain"),
        ({"end": "b.D300", "b": "LD M8000\nMOV D0 D9\nMOV D9 D300\n"}, None),
        ({"end": "b.D0", "start": "a.D500", "a": "LD M8000\nMOV D500 D0\n"}, None),
        ({"end": "b.D0", "a": "LD X0\nINC D0\n"}, None),
        ({"end": "b.D300", "b": "LD M1\nMOV D0 D300\n"}, "M1 (b) must let it through"),
        ({"end": "b.D300", "b": "LD M8000\nMOVP D0 D300\n"}, "MOVP D0 D300 at line 2 is no plain"),
        ({"end": "b.D300", "b": "LD M8000\nADD D0 K1 D300\n"}, "ADD D0 K1 D300 at line 2 is no plain"),
        ({"end": "b.D300", "b": "LD M8000\nMOV D9 D300\nMOV D0 D9\n"}, "it takes more than one scan"),
        ({"end": "b.D300", "b": "LD M8000\nMOV D0 D300\nLD M1\nMOV K5 D300\n"}, "MOV K5 D300 at line 4 writes D300 too (b)"),
        ({"end": "b.D300", "b": "LD X1\nCJ P0\nLD M8000\nMOV D0 D300\nP0\n"}, "CJ P0 at line 2 is no plain"),
        ({"end": "b.D0", "start": "a.D500", "a": "LD X0\nMOV D500 D0\n"}, "X0 (a) must let it through"),
        (
            {"end": "b.D0", "start": "a.D500", "a": "LD M8000\nMOV D500 D0\nINC D500\n"},
            "it takes more than one scan",
        ),
    ],
)  # fmt: skip
def test_the_age_of_a_copy_is_known_where_every_scan_makes_it(given: dict[str, Any], why: str | None) -> None:
    found = scenario(**{"start": "a.D0", **given})
    entry = bussim.run(found, rows=False).summary["latency"]["path"]
    said = warned(found)
    if why is None:
        assert not said
        assert entry["way_reasons"] == []
        assert entry["reads"] == entry["delivered"] > 100
        assert entry["ms"]["max"] <= entry["bound_ms"]["no error"]
    else:
        assert len(said) == 1
        assert why in said[0]
        assert why in entry["way_reasons"][0]
        assert entry["reads"] == entry["delivered"] == 0
        assert "bound_ms" not in entry


# -- "nothing" is never wrong --------------------------------------------------------------------------


def states(program: Program, seed: int, point: int | None) -> list[dict[str, np.ndarray[Any, Any]]]:
    """All devices after each scan; ``point``: the input whose level is turned round in every second one."""
    rng, memory, now, found = random.Random(seed), Memory(), 0, []
    run = ProgramRun(program, memory)
    run.run(0)
    for number in range(12):
        for at in range(8):
            memory.bits("X")[at] = rng.getrandbits(1) ^ (at == point and number % 2)
        run.scan(now)
        now += rng.choice((1, 5, 30, 100)) * TICKS_PER_MS
        found.append(
            {letter: np.array(memory.bits(letter)) for letter in "YMSTC"}
            | {letter.lower(): np.array(memory.words(letter)) for letter in "DTCVZ"}
        )
    return found


def simple(seed: int) -> str:
    """A random program without jumps and index registers, which leave it open."""
    writer = Writer(seed)
    writer.index = lambda: ""  # type: ignore[method-assign] # no register shifts an address
    for _ in range(8):
        writer.rung()
    return "\n".join([*writer.lines, "END"])


@pytest.mark.slow
@pytest.mark.parametrize("bare", [False, True])
def test_what_an_input_moves_is_never_called_unconnected(bare: bool) -> None:
    """Two runs of a random program that differ in one input alone: it leads to all that differs."""
    moved = unmoved = 0
    for seed in range(60):
        program = Program.parse(simple(seed) if bare else Writer(seed).program(), "random")
        point = seed % 8
        differ = {
            Device(letter.upper() + "N" * (letter in "tc"), int(at))
            for one, other in zip(states(program, seed, None), states(program, seed, point), strict=True)
            for letter, devices in one.items()
            for at in np.flatnonzero(devices != other[letter])
        }
        (plc,) = scenario(a=None, b=None).plcs[:1]
        network, start = Network((replace(plc, link=None, program=program),)), Device("X", point)
        (plc,) = network.plcs
        for device in differ:
            assert network.reachability(plc, start, plc, device) is not Reachability.NONE, (
                device,
                program.text,
            )
        moved += len(differ)
        unmoved += network.reachability(plc, start, plc, Device("Y", 0o77)) is Reachability.NONE
    assert moved > 30
    assert not bare or unmoved > 10  # jumps and index registers leave it unknown
