"""Devices of an FX1S, the smallest family: what lies beyond its ranges is refused, and said to be lacking."""

from __future__ import annotations

import pytest

from bussim.errors import ProgramError, ScenarioError
from bussim.plc.memory import Family, device_ranges, latched_problem, parse_device
from bussim.plc.profiles import PROFILES
from bussim.plc.program.program import Program
from bussim.scenario.loader import loads

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
