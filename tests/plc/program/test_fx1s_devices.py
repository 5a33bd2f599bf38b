"""Devices of an FX1S, the smallest family: what lies beyond its ranges is refused, and said to be lacking."""

from __future__ import annotations

import pytest

from bussim.errors import ProgramError, ScenarioError
from bussim.plc.memory import Device, Family, Memory, device_ranges, latched_problem, parse_device
from bussim.plc.profiles import PROFILES
from bussim.plc.program.execution import ProgramRun
from bussim.plc.program.program import Program
from bussim.scenario.loader import loads
from bussim.units import TICKS_PER_MS

#: By the ends of the ranges that FX programming, chapter 4, gives: a line with {}, the last and the next.
ENDS = [
    ("LD {}", "X17", "X20"),
    ("OUT {}", "Y15", "Y16"),
    ("SET {}", "M511", "M512"),
    ("SET {}", "M511", "M1000"),
    ("SET {}", "S127", "S128"),
    ("OUT {} K1", "T63", "T64"),
    ("OUT {} K1", "T63", "T250"),
    ("OUT {} K1", "C31", "C32"),
    ("OUT {} K1", "C31", "C200"),
    ("LD {}", "C235", "C234"),
    ("MOV K1 {}", "D255", "D256"),
    ("MOV K1 {}", "D8255", "D5000"),
    ("CJ {}", "P62", "P64"),
]


def parsed(line: str, family: Family) -> Program:
    target = f"{line.split()[-1]}\n" if line.startswith("CJ") else ""
    begin = "" if line.startswith("LD") else "LD M8000\n"
    return Program.parse(f"{begin}{line}\nOUT Y0\n{target}END", "p", family=family)


@pytest.mark.parametrize(("line", "last", "beyond"), ENDS)
def test_each_range_ends_where_the_manual_says(line: str, last: str, beyond: str) -> None:
    assert parsed(line.format(last), Family.FX1S)
    assert parsed(line.format(beyond), Family.FX2N)
    with pytest.raises(ProgramError, match=f"{beyond}: an FX1S lacks it, allowed {beyond[0]}0–"):
        parsed(line.format(beyond), Family.FX1S)


@pytest.mark.parametrize(("timer", "unit"), [(0, 100), (31, 100), (32, 100), (62, 100), (63, 1)])
def test_its_last_timer_is_one_of_1_ms(timer: int, unit: int) -> None:
    """FX programming, 4.9: T0–T62 of 100 ms (T32–T62 of 10 ms under M8028, not simulated), T63 of 1 ms."""
    memory = Memory()
    text = f"LD M8000\nOUT T{timer} K3\nEND"
    run = ProgramRun(Program.parse(text, "p", family=Family.FX1S), memory)
    run.run(0)
    shown = []
    for ms in (0, unit, 2 * unit, 3 * unit):
        run.scan(ms * TICKS_PER_MS)
        shown.append((memory.word("T", timer), memory.get(Device("T", timer))))
    assert shown == [(0, 0), (1, 0), (2, 0), (3, 1)]


def test_what_reaches_past_an_end_is_refused_too() -> None:
    for line in ("DMOV K1 D255", "FMOV K0 D250 K10", "MOV K4M504 D0"):
        with pytest.raises(ProgramError, match="reaches past"):
            parsed(line, Family.FX1S)


def test_what_only_an_fx3u_has_is_no_matter_of_the_fx1s() -> None:
    with pytest.raises(ProgramError, match="M5000: only an FX3U has it"):
        parsed("SET M5000", Family.FX1S)
    with pytest.raises(ValueError, match="'D300', that an FX1S lacks; allowed D0–D255, D8000–D8255"):
        parse_device("D300", family=Family.FX1S)


def test_the_link_has_other_devices_there() -> None:
    text = "LD M8184\nOUT Y0\nLD M505\nMOV D8212 D10\nMOV D212 D11\nEND"
    found = [problem.message for problem in Program.parse(text, "p", family=Family.FX1S).warnings]
    assert found == [
        "M8184 does nothing on an FX1S, whose N:N link has M505 in its place",
        "D8212 does nothing on an FX1S, whose N:N link has D212 in its place",
    ]
    for family in (Family.FX2N, Family.FX3U):
        assert not Program.parse(text, "p", family=family).warnings


def test_instructions_that_it_lacks_are_named_once() -> None:
    text = "LD M8000\nFMOV K1 D0 K3\nFMOVP K1 D0 K3\nDXCH D20 D22\nMOV K1 D9\nEND"
    found = [str(problem) for problem in Program.parse(text, "p", family=Family.FX1S).warnings]
    lacks = "(assumed), which is simulated as if it were there"
    assert found[0] == f"p:2:1: an FX1S lacks FMOV {lacks}"
    assert [text for text in found if "lacks" in text][1:] == [
        f"p:3:1: an FX1S lacks FMOVP {lacks}",
        f"p:4:1: an FX1S lacks DXCH {lacks}",
    ]
    assert not Program.parse(text, "p", family=Family.FX2N).warnings


BOARDS = """
schema: 1
name: x
duration: 1 s
buses: [{name: link, nn: true}, {name: line, baud: 9600}]
plcs:
  - name: p
    profile: FAMILY
    scan: 5 ms
    nn: {bus: link, port: LINK, station: 0, slaves: 1}
    ports: {PORT: {bus: line, protocol: modbus-rtu-slave, station: 1}}
  - {name: q, scan: 5 ms, nn: {bus: link, port: COM4, station: 1}}
"""


@pytest.mark.parametrize(
    ("family", "link", "port", "lacks"),
    [
        ("fx1s", "COM3", "COM4", ["COM4"]),
        ("fx2n", "COM4", "COM5", ["COM4", "COM5"]),
        ("fx3u", "COM3", "COM4", []),
        ("fx3u", "COM4", "COM5", ["COM5"]),
        ("pw10", "COM4", "COM6", []),
    ],
)
def test_ports_that_a_family_lacks_are_named(family: str, link: str, port: str, lacks: list[str]) -> None:
    text = BOARDS.replace("FAMILY", family).replace("LINK", link).replace("PORT", port)
    found = [str(warning) for warning in loads(text).warnings if "as if it were there" in str(warning)]
    assert [warning.rpartition(", not ")[2].split(",")[0] for warning in found] == lacks


SCENARIO = """
schema: 1
name: x
duration: 100 ms
plcs:
  - name: p
    profile: fx1s
    inputs: {X17: {times: [1 ms]}}
    registers: {D255: 1}
    program: |
      LD X17
      OUT Y15
      END
"""


def test_a_scenario_is_held_to_the_ranges_wherever_it_names_devices() -> None:
    assert loads(SCENARIO)
    for right, wrong in (("X17: {", "X20: {"), ("D255", "D256"), ("LD X17", "LD X20")):
        with pytest.raises(ScenarioError, match="an FX1S lacks"):
            loads(SCENARIO.replace(right, wrong))


def test_what_is_latched_lies_in_the_ranges() -> None:
    for profile in PROFILES.values():
        assert not [kept for kept in profile.latched if latched_problem(kept, profile.family)]
    for base, kept, says in (
        ("fx2n", "S0-S4095", "is S0-S4095, allowed S0–S999"),
        ("fx2n", "M7679-M7680", "is M7679-M7680, allowed M0–M3071"),
        ("fx2n", "R0-R9", "is R0-R9, allowed no R: only an FX3U has it"),
        ("fx3u", "M7679-M7680", "is M7679-M7680, allowed M0–M7679"),
        ("fx1s", "D200-D300", "is D200-D300, allowed D0–D255"),
    ):
        with pytest.raises(ScenarioError, match=says):
            loads(SCENARIO.replace("profile: fx1s", f"profile: {{base: {base}, latched: [{kept}]}}"))
    assert latched_problem(device_ranges("D0-7999")[0], Family.FX2N) is None
