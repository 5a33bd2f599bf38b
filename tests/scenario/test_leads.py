"""What leads from one device to another: what is warned of, what is not, and that "nothing" is never wrong."""

from __future__ import annotations

import random
from typing import Any

import numpy as np
import pytest

import bussim
from bussim.exact.latency.bounds import bounds_of
from bussim.plc.memory import Memory
from bussim.plc.program.program import Program
from bussim.plc.program.run import ProgramRun
from bussim.scenario.loader import from_data
from bussim.scenario.model import Scenario
from bussim.scenario.signals.paths import ways
from bussim.scenario.signals.program_signals import Key
from bussim.scenario.signals.reachability import Lead, Net, Question, Station
from bussim.units import TICKS_PER_MS

from ..plc.program.random_programs import Writer

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
            "name": "leads",
            "duration": f"{seconds} s",
            "buses": [{"name": "link", "nn": True}, *([{"name": "line"}] if serial else ())],
            "plcs": plcs,
            "latency": [{"name": "way", "from": start, "to": end}],
        }
    )


def warned(found: Scenario) -> list[str]:
    return [said for said in found.warnings if said.startswith(("nothing leads", "no age"))]


D500 = "D500 is in no shared block of mode 2 (a sends M1000 to M1063 and D0 to D7)"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"end": "b.Y7"}, "nothing in b writes Y7; did you mean b.Y4?"),
        (
            {"end": "b.Y7", "b": f"{SHOW}LD M8000\nALT Y7\n"},
            "what b has in Y7 does not come from X0; did you mean b.Y4?",
        ),
        ({"end": "a.Y0"}, "nothing in a makes Y0 of it"),
        ({"start": "a.X1"}, "the program of a does not read X1; did you mean a.X0 or a.M1000 as from?"),
        (
            {"start": "a.M8013"},
            (
                "M8013 is in no shared block of mode 2 (a sends M1000 to M1063 and D0 to D7), and the program of a "
                "does not read M8013; did you mean a.M1000 or a.X0 as from?"
            ),
        ),
        ({"start": "a.D500", "end": "b.D600"}, f"{D500}, and the program of a does not read D500"),
        ({"start": "a.D500", "end": "b.D600", "a": None}, f"{D500}, and a has no program"),
        (
            {"start": "a.D10", "end": "b.D10"},
            (
                "D10 is in no shared block of mode 2 (a sends M1000 to M1063 and D0 to D7); "
                "refresh mode 3 (D8178) would share it"
            ),
        ),
        (
            {"mode": 0},
            (
                "what X0 leads to in a is in no shared block of mode 0 (a sends no bits, D0 to D3); "
                "refresh mode 1 (D8178) would share it"
            ),
        ),
        (
            {"start": "a.M1000", "end": "b.M1000", "mode": 0},
            (
                "M1000 is in no shared block of mode 0 (a sends no bits, D0 to D3); "
                "refresh mode 1 (D8178) would share it"
            ),
        ),
        ({"a": "LD X0\nOUT M5\n"}, "what the program of a makes of X0 is in no shared block of mode 2"),
        (
            {"start": "a.D0", "end": "b.D3"},
            "the link takes D0 to D0, and nothing in b makes D3 of it; did you mean b.D0, or a.D3 as from?",
        ),
    ],
)
def test_what_nothing_connects_is_told_with_what_may_be_meant(given: dict[str, Any], said: str) -> None:
    found = scenario(**given)
    (only,) = warned(found)
    assert said in only
    (way,) = ways(found)
    assert way.finding.lead is Lead.NONE
    assert len(way.reasons) == 1
    assert not bounds_of(found)["way"].valid


@pytest.mark.parametrize(
    ("given", "lead"),
    [
        ({}, Lead.DIRECT),
        ({"start": "a.M1000"}, Lead.DIRECT),
        ({"b": "LD M1000\nOUT T0 K5\nLD T0\nOUT Y4\n"}, Lead.DIRECT),
        ({"b": "LD M1000\nOUT T0 K5\nLD> T0 K1\nOUT Y4\n"}, Lead.DIRECT),  # by its current value
        ({"start": "a.D0", "end": "b.TN0", "b": "LD M8000\nMOV D0 T0\n"}, Lead.DIRECT),
        ({"b": "LD M1000\nCJ P0\nLD M8000\nALT Y4\nP0\n"}, Lead.UNKNOWN),
        ({"b": "LD M1000\nCALL P0\nFEND\nP0\nLD M8000\nALT Y4\nSRET\n"}, Lead.UNKNOWN),
        ({"b": "LD M8000\nMOV K4M1000 Z0\nMOV K1 K1Y0Z0\n"}, Lead.UNKNOWN),
        ({"b": "LD M8000\nADD K1M1000 K-1 D5\nLD M8020\nOUT Y4\n"}, Lead.UNKNOWN),
        ({"b": "LD M1128\nOUT Y4\n", "c": RELAY}, Lead.ROUND),
        ({"end": "a.Y4", "a": f"{SEND}LD M1128\nOUT Y4\n", "c": RELAY}, Lead.ROUND),
        ({"b": "LD M5\nOUT Y4\n", "a": "LD X0\nOUT M0\n"}, Lead.NONE),
        ({"b": "LD M5\nOUT Y4\n", "c": RELAY}, Lead.NONE),
    ],
)
def test_ways_that_no_alarm_may_be_raised_about(given: dict[str, Any], lead: Lead) -> None:
    found = scenario(**given)
    assert ways(found)[0].finding.lead is lead
    assert bool(warned(found)) is (lead is Lead.NONE)


def test_ports_may_carry_what_the_link_does_not() -> None:
    assert ways(scenario(end="b.Y7"))[0].finding.lead is Lead.NONE
    both = scenario(end="b.Y7", serial="ab")
    assert ways(both)[0].finding.lead is Lead.UNKNOWN
    assert not warned(both)
    # One port alone joins nobody.
    assert ways(scenario(end="a.Y7", serial="b"))[0].finding.lead is Lead.NONE


def test_a_signal_over_a_third_station_arrives_and_has_no_bound() -> None:
    found = scenario(b="LD M1128\nOUT Y4\n", c=RELAY, seconds=20)
    entry = bussim.run(found, rows=False).summary["latency"]["way"]
    assert entry["way"] == "over other stations"
    assert entry["way_reasons"] == []
    assert entry["delivered"] > 50
    assert entry["bound_reasons"] == ["X0 of a leads to Y4 of b over other stations only"]


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ({"end": "b.D300", "b": "LD M8000\nMOV D0 D300\n"}, None),
        ({"end": "b.D301", "b": "LD M8000\nBMOV D0 D301 K2\n"}, None),
        ({"end": "b.D300", "b": "LD M8000\nMOV D0 D9\nMOV D9 D300\n"}, None),
        ({"end": "b.D0", "start": "a.D500", "a": "LD M8000\nMOV D500 D0\n"}, None),
        ({"end": "b.D0", "a": "LD X0\nINC D0\n"}, None),
        ({"end": "b.D300", "b": "LD M1\nMOV D0 D300\n"}, "M1 must let it through at line 2 (b)"),
        ({"end": "b.D300", "b": "LD M8000\nMOVP D0 D300\n"}, "MOVP at line 2 acts once for each change"),
        ({"end": "b.D300", "b": "LD M8000\nADD D0 K1 D300\n"}, "ADD at line 2 makes another value of it"),
        ({"end": "b.D300", "b": "LD M8000\nMOV D9 D300\nMOV D0 D9\n"}, "line 2 stands in front of what it reads"),
        ({"end": "b.D300", "b": "LD M8000\nMOV D0 D300\nLD M1\nMOV K5 D300\n"}, "more than line 2 may write D300"),
        ({"end": "b.D300", "b": "LD X1\nCJ P0\nLD M8000\nMOV D0 D300\nP0\n"}, "its program has jumps"),
        ({"end": "b.D0", "start": "a.D500", "a": "LD X0\nMOV D500 D0\n"}, "X0 must let it through at line 2 (a)"),
        (
            {"end": "b.D0", "start": "a.D500", "a": "LD M8000\nMOV D500 D0\nINC D500\n"},
            "line 2 stands in front of what it reads",
        ),
    ],
)  # fmt: skip
def test_the_age_of_a_copy_is_told_where_every_scan_makes_it(given: dict[str, Any], why: str | None) -> None:
    found = scenario(**{"start": "a.D0", **given})
    entry = bussim.run(found, rows=False).summary["latency"]["way"]
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
    luck, memory, now, found = random.Random(seed), Memory(), 0, []
    run = ProgramRun(program, memory)
    run.run(0)
    for number in range(12):
        for at in range(8):
            memory.bits("X")[at] = luck.getrandbits(1) ^ (at == point and number % 2)
        run.scan(now)
        now += luck.choice((1, 5, 30, 100)) * TICKS_PER_MS
        found.append(
            {letter: np.array(memory.bits(letter)) for letter in "YMSTC"}
            | {letter.lower(): np.array(memory.words(letter)) for letter in "DTCVZ"}
        )
    return found


def simple(seed: int) -> str:
    """A random program without jumps and index registers, which make the answer vague."""
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
            Key(letter.upper(), int(at), letter.islower())
            for one, other in zip(states(program, seed, None), states(program, seed, point), strict=True)
            for letter, devices in one.items()
            for at in np.flatnonzero(devices != other[letter])
        }
        net = Net((Station("a", None, 32, (0,), program, frozenset()),))
        for key in differ:
            asked = Question(net, 0, Key("X", point, word=False), 0, key)
            assert asked.answer().lead is not Lead.NONE, f"X{point} to {key} of\n{program.text}"
        moved += len(differ)
        free = Question(net, 0, Key("X", point, word=False), 0, Key("Y", 0o77, word=False))
        unmoved += free.answer().lead is Lead.NONE
    assert moved > 30
    assert unmoved > (10 if bare else 0)
