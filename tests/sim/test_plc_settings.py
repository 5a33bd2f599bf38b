"""What programs set of link and ports, with the codes of each family, and what is warned of."""

from __future__ import annotations

import re

import pytest

import bussim
from bussim.scenario.loader import loads
from bussim.sim.runner import simulate
from tests.sim.build import SECOND, Recorder, registers_now, run
from tests.sim.plc_links import examine_text, link, watched

# -- link settings and codes of the families -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("profile", "master", "runs"),
    [
        ("fx3u", "M8038", True),
        ("fx3u", "M8002", False),
        ("fx2n", "M8002", False),
        ("{base: fx3u, link_at_step_0: false}", "M8002", True),
        ("pw10", "M8002", True),
        ("pw10", "M8038", True),
    ],
)
def test_where_a_program_sets_the_link(profile: str, master: str, runs: bool) -> None:
    text = link(profile, master)
    done = run(loads(text))
    assert (len(done.of("m")) > 100) is runs
    assert (len(done.of("s1")) > 100) is runs
    warnings = loads(text).warnings
    found = [text for text in warnings if "M8038" in text]
    assert len(found) == (not runs)
    assert not [text for text in warnings if "takes no part in N:N" in text]
    for warning in found:
        assert warning == (
            "m: MOV writes D8176, but not under M8038 as the contact of the program's first step: profile "
            f"{profile} does not take that over (assumed), and m takes no part in the link; "
            + "; ".join(f"also D{8175 + n} at line {n + 1} of the program" for n in range(2, 6))
        )


def test_settings_of_the_scenario_stay_where_a_program_may_not_set_them() -> None:
    keys = "nn: {bus: link, station: 0, slaves: 2, mode: 0, timeout: 50 ms}"
    text = link("fx3u", "M8002").replace("ports: {COM3: {bus: link}}", keys, 1)
    for _ in range(2):
        done = run(loads(text + "  - {at: 2 s, for: 1 s, stop: m}\n"))
        frames = done.of("m")
        assert {len(frame.chars) for frame in frames} == {22}  # mode 0, not 1
        assert frames[-1].start > 9 * SECOND
    (found,) = [text for text in loads(text).warnings if "M8038" in text]
    assert "profile fx3u does not take that over (assumed); also D8177 at line 3 of the program; " in found


def test_settings_outside_of_the_rung_under_m8038_are_not_taken_over() -> None:
    text = link("fx3u").replace(
        "MOV K1 D8178", "MPS\n      AND X7\n      MOV K9 D8177\n      MPP\n      MOV K2 D8179"
    )
    text = text.replace("MOV K3 D8179", "      LD M8002\n      MOV K1 D8178\n      MOV K3 D8179")
    scenario = loads(text + "  - {at: 2 s, for: 1 s, stop: m}\n")
    registers = scenario.plcs[0].registers
    assert {name: registers[name] for name in ("D8176", "D8177", "D8179")} == {
        "D8176": 0,
        "D8177": 2,
        "D8179": 2,
    }
    assert not {"D8178", "D8180"} & set(registers)
    (found,) = [text for text in scenario.warnings if "M8038" in text]
    assert found == (
        "m: MOV writes D8178, but not under M8038 as the contact of the program's first step: profile fx3u does "
        "not take that over (assumed); also D8179 at line 11 of the program; also D8180 at line 12 of the program"
    )
    done = run(scenario)
    frames = done.of("m")
    assert {len(frame.chars) for frame in frames} == {22}  # mode 0, not 1, before the stop and after it
    assert frames[-1].start > 9 * SECOND
    assert registers_now(done.simulation, "m")["D8175"] == 0


BAD = """
schema: 1
name: a bad parameter
duration: 1 s
seed: 1
buses: [{name: link, nn: true}]
plcs:
  - name: m
    profile: PROFILE
    scan: 5 ms
    registers: {M8179: 0, D8176: 0, D8177: 9, D8178: 1, D8179: 3, D8180: 5}
    ports: {COM3: {bus: link}, COM4: {bus: link}}
  - {name: s, profile: PROFILE, scan: 5 ms, registers: {D8176: 1}, ports: {COM3: {bus: link}}}
"""


@pytest.mark.parametrize(
    ("profile", "com4", "device", "code"),
    [
        ("fx3u", 0, "8063", 6308),
        ("fx3u", 1, "8438", 3808),
        ("fx2n", 1, "8063", 6308),
        ("{base: fx3u, error_codes: 7xyy}", 1, "8063", 7448),
        ("pw10", 0, "8063", 7348),
    ],
)
def test_a_refused_parameter_has_the_number_of_the_family(
    profile: str, com4: int, device: str, code: int
) -> None:
    scenario = loads(BAD.replace("PROFILE", profile).replace("M8179: 0", f"M8179: {com4}"))
    assert any(
        f"M{device} on, D{device} = {code}, and it sends nothing" in text for text in scenario.warnings
    )
    result = bussim.run(scenario, rows=False).summary
    registers = result["plcs"]["m"]["registers"]
    assert (registers["M8063"], registers["D8063"]) == (1, code)  # by the common name
    assert any(f"= {code} (bad parameters)" in item["text"] for item in result["verdict"])


# -- ports ---------------------------------------------------------------------------------------------------

SLAVE = """
schema: 1
name: a PLC slave port is asked badly
duration: 3 s
seed: 1
buses: [{name: b, baud: 9600, format: 8N1}]
plcs:
  - name: p
    scan: 5 ms
    ports: {COM4: {bus: b, protocol: modbus-rtu-slave, station: 1}}
devices:
  - name: pc
    model: hmi
    bus: b
    timeout: 200 ms
    polls:
      - {name: bad-address, station: 1, function: 3, address: 0x2040, count: 1, at: 500 ms, times: 1}
      - {name: bad-function, station: 1, function: 4, address: 0, count: 1, at: 1 s, times: 1}
      - {name: crc, station: 1, function: 3, address: 0, count: 1, at: 1500 ms, times: 1}
      - {name: good, station: 1, function: 3, address: 0, count: 1, at: 2 s, times: 1}
faults:
  - {at: 1400 ms, for: 300 ms, flip_bits: {station: pc, bits: [15]}}
"""


TWO_RS2 = """
schema: 1
name: two RS2 driven at once on one port
duration: 1 s
seed: 1
buses: [{name: b, baud: 9600, format: 8N1}]
plcs:
  - name: p
    scan: 5 ms
    ports: {COM4: {bus: b}}
    registers: {D300: 0x0103, D301: 1}
    program: |
      LD M8002
      CPAVL D0 M0 K4
      MOV H81 D0
      MOV H20 D6
      LD M8000
      RS2 D300 H0 D301 D500 K4
      RS2 D300 H1 D301 D501 K4
      END
devices:
  - {name: v, model: map, bus: b, station: 1, registers: [{address: 0, value: 11}, {address: 1, value: 22}]}
faults: []
"""


def test_d8063_of_a_slave_port_that_is_asked_badly() -> None:
    seen = watched(SLAVE, "p.D8063 p.M8063")
    assert seen["p.D8063"].values == [7402, 7404, 7403]
    assert seen["p.M8063"].values == [1, 0]  # until the good request
    assert seen["p.M8063"].ticks[1] > 2 * SECOND
    quiet = SLAVE.replace("name: p\n", "name: p\n    profile: {base: pw10, slave_errors: false}\n")
    assert watched(quiet, "p.D8063 p.M8063")["p.D8063"].values == []


@pytest.mark.parametrize("power", [False, True])
def test_two_rs2_on_one_port_are_warned_of_once_with_their_lines_and_number(*, power: bool) -> None:
    fault = "faults: [{at: 500 ms, for: 100 ms, power_off: p}]" if power else "faults: []"
    scenario = loads(TWO_RS2.replace("faults: []", fault))
    record = Recorder()
    totals = simulate(scenario, record)
    (warning,) = totals.warnings
    found = re.fullmatch(
        r"p's program met an error in the scan up to 0\.00\d s: two RS or RS2 are driven on COM4 at once: that at line 6 "
        r"of the program keeps it \(assumed\), that at line 7 is refused; (\d+) times in all",
        warning,
    )
    assert found
    # Every scan but the first, in which the port is not set up yet, up to the one after the last END.
    ends = sum(map(len, record.all_ends.values()))
    assert 0 <= ends - int(found[1]) <= 2 * (1 + power)
    assert [note.kind for note in record.notes if note.where == "p"].count("program_error") == 1


def test_the_first_rs2_keeps_the_port_and_the_timeout_has_its_default() -> None:
    seen = watched(TWO_RS2, "p.D500 p.D501 p.D9")
    assert [each.values for each in seen.values()] == [[11], [], [10]]


CLOCK_PROGRAM = """
schema: 1
name: clock
duration: 1 s
plcs:
  - name: p
    registers: {D8018: 26}
    comments: {D8014: minute, Y0: horn, M8034: all off}
    program: |
      LD X0
      MOV K30 D8014
      MOV K31 D8014
      OUT Y0
      LD X1
      OUT Y0
      LD X2
      OUT M8034
      END
"""


def test_warnings_of_a_program_have_the_comments_and_the_clock_is_named_once() -> None:
    texts = loads(CLOCK_PROGRAM).warnings
    assert sum("D8014 (minute) is part of the clock" in text for text in texts) == 1
    assert any("Y0 (horn) is driven at line" in text for text in texts)
    assert any("M8034 (all off), which switches all outputs off, is not" in text for text in texts)


@pytest.mark.parametrize("year", [2026, 100])
def test_a_year_has_two_digits_and_the_day_of_the_week_is_computed(year: int) -> None:
    [problem] = examine_text(CLOCK_PROGRAM.replace("26}", f"{year}}}"))
    assert f"p: D8018 is {year}, allowed 0..99, the year without its century" in problem.message
    texts = loads(CLOCK_PROGRAM.replace("26}", "26, D8019: 5}")).warnings
    assert any("D8019, the day of the week, follows from D8013 to D8018" in text for text in texts)
