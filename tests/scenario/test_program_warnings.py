"""What is said of programs and inputs that are possible, and odd."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from bussim.scenario.loader import load, loads
from bussim.scenario.yaml.dump import dumps
from tests.scenario.program_files import MASTER, SLAVE, TEXT, folder, problems, shown, warnings

# -- files that are none, names that are not quite right ------------------------------------------------


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda path: path.mkdir(), "which is a folder; expected a file of text"),
        (os.mkfifo, "which is a pipe; expected a file of text"),
        (lambda path: path.symlink_to(path), "a symbolic link that leads back to itself"),
        (lambda path: path.symlink_to("gone.il"), "a symbolic link to gone.il, which does not exist"),
        (lambda path: path.with_name("pressA.il").write_text("END\n"), "did you mean pressA.il?"),
        (lambda path: path.write_bytes(b"LD X0\n; \xff\xff\n"), "no UTF-8 text (line 2 has the byte 0xFF); save it as UTF-8"),
    ],
)  # fmt: skip
def test_a_program_that_is_no_file_to_be_read(
    tmp_path: Path, make: Callable[[Path], object], says: str
) -> None:
    make(tmp_path / "pressa.il")
    (found,) = problems(tmp_path, TEXT.replace("program: one.il", "program: pressa.il"))
    assert "program is pressa.il, " in found
    assert says in found


def test_small_letters_name_devices_everywhere_and_results_have_capitals(tmp_path: Path) -> None:
    text = (
        TEXT.replace("{X0: {square", "{x000: {square")
        .replace("one.M1064", "one.m1064")
        .replace("two.X0", "two.x0")
        .replace("program: two.il", "program: two.il\n    registers: {d400: 7}")
    )
    found = load(folder(tmp_path, text))
    two = found.plcs[1]
    assert list(two.inputs) == ["X0"]
    assert two.registers["D400"] == 7
    assert found.latency[0].name == "two.X0 to one.M1064"
    dumped = dumps(found)
    assert "x0" not in dumped.replace("name: two.x0", "")
    assert "d400" not in dumped
    assert loads(dumped) == found


def test_an_input_that_is_given_twice_is_reported_as_it_was_written(tmp_path: Path) -> None:
    text = TEXT.replace("{X0: {square: 500 ms}}", "{X000: {square: 500 ms}, x0: {square: 1 s}}")
    (found,) = shown(problems(tmp_path, text), tmp_path)
    assert found == "x.yaml:13:38: inputs.x0 is the same device as X000"


@pytest.mark.parametrize(
    ("given", "range_"),
    [
        ("{random: {on: 1 us, off: 1 s}}", "inputs.X0.random.on is 1 us, allowed 10 us..10 y"),
        ("{square: 15 us}", "inputs.X0.square is 15 us, allowed 20 us..10 y"),
        ("{pulse: {width: 9 us}}", "inputs.X0.pulse.width is 9 us, allowed 10 us..10 y"),
        ("{random: {on: 1 s, off: 1 s, seed: -1}}", "inputs.X0.random.seed is -1, allowed 0.."),
    ],
)
def test_levels_that_no_input_lets_through(tmp_path: Path, given: str, range_: str) -> None:
    (found,) = problems(tmp_path, TEXT.replace("{square: 500 ms}", given))
    assert range_ in found


@pytest.mark.parametrize(
    ("given", "seen"),
    [
        (
            "{square: 100 us}",
            "X0 of two stays on and off for 50 us, but is read once a scan, every 10 ms",
        ),
        ("{random: {on: 1 s, off: 900 us}}", "X0 of two stays on or off for a mean of 900 us"),
        ("{pulse: {width: 20 us, every: 1 s}}", "X0 of two stays on for 20 us"),
        ("{pulse: {width: 1 ms, every: 1 s}}", None),
        ("{times: [1 s, 1.000001 s]}", None),
    ],
)
def test_levels_far_shorter_than_a_scan_are_warned_of(tmp_path: Path, given: str, seen: str | None) -> None:
    found = warnings(tmp_path, TEXT.replace("{square: 500 ms}", given))
    assert len(found) == (seen is not None)
    assert all(seen is not None and seen in text for text in found)


def test_a_name_does_not_begin_with_a_dash_and_is_warned_of_where_a_bus_has_it(tmp_path: Path) -> None:
    (found,) = problems(tmp_path, TEXT.replace("name: one", "name: -one").replace("one.M", "two.M"))
    assert "name is '-one', not a name" in found
    assert found.endswith("with at least one letter, and no - at the beginning")
    (found,) = warnings(tmp_path, TEXT.replace("name: one", "name: link").replace("one.M", "link.M"))
    assert "link is the name of a bus as well" in found


def test_a_bmov_that_is_turned_round_writes_what_it_seems_to_read(tmp_path: Path) -> None:
    program = SLAVE.replace("END", "LDI M8183\nBMOV D0 D40 K4\nEND")
    assert warnings(tmp_path, **{"two.il": program}) == []
    (found,) = warnings(tmp_path, **{"two.il": program.replace("BMOV", "SET M8024\nBMOV")})
    assert found.startswith("two.il:8:1: two: BMOV writes D0 to D3, in the shared block of station 0 (one)")


def test_latencies_that_nothing_brings_about(tmp_path: Path) -> None:
    text = TEXT.replace("    inputs: {X0: {square: 500 ms}}\n", "")
    assert shown(warnings(tmp_path, text), tmp_path) == [
        "x.yaml:15:12: nothing drives two.X0: it has no entry in the inputs of the PLC two"
    ]


def test_special_bits_that_the_scenario_sets_and_that_change_nothing(tmp_path: Path) -> None:
    text = TEXT.replace(
        "name: two\n",
        "name: two\n    registers: {M8034: 1, M8033: 0, M8160: 1, M8161: 1, M08024: 1}\n",
    )
    swapped = SLAVE.replace("END", "XCHP D40 D41\nEND")
    of_rs2 = "RS2 has that of the format word which CPAVL takes"
    assert shown(warnings(tmp_path, text, **{"two.il": swapped}), tmp_path) == [
        f"x.yaml:{where}: two: M{bit}, {what}: it changes nothing, and nothing drives it"
        for where, bit, what in (
            ("11:17", 8034, "which switches all outputs off, is not simulated"),
            ("11:37", 8160, "which makes XCH swap bytes, is not simulated"),
            ("11:47", 8161, f"the 8-bit mode of RS ({of_rs2}), is for RS, which no program of the PLC has"),
        )
    ]


def test_the_age_of_a_current_value(tmp_path: Path) -> None:
    text = TEXT.replace("from: two.X0, to: one.M1064, edge: rising", "from: two.CN200, to: one.Z0")
    found = load(folder(tmp_path, text))
    assert (found.latency[0].source, found.latency[0].target) == ("CN200", "Z0")
    assert "CN200" in found.plcs[1].observed
    mixed = text.replace("two.CN200", "two.C200")
    assert shown(problems(tmp_path, mixed), tmp_path) == [
        "x.yaml:16:26: to is one.Z0: two.C200 is a bit and one.Z0 is a word, but a latency has two of a kind"
    ]


def test_a_programs_own_warnings_are_the_scenarios(tmp_path: Path) -> None:
    program = SLAVE.replace("END", "LD X1\nOUT M1064\nEND")
    found = load(folder(tmp_path, **{"two.il": program}))
    assert found.warnings == (
        "two: M1064 is driven at line 5 of the program too; the last one executed wins",
    )


@pytest.mark.parametrize(
    ("entry", "program", "warned"),
    [
        (
            "from: one.M1000, to: two.M1001",
            "",
            "nothing leads from one.M1000 to two.M1001: no program does, and in refresh mode 2 one shares M1000 to",
        ),
        ("from: one.M1000, to: two.M1000", "", None),
        ("from: one.D0, to: two.D3", "", "nothing leads from one.D0 to two.D3: no program does"),
        (
            "from: one.D0, to: two.D3",
            "LD M8000\nMOV D0 D3\n",
            "no age is measured from one.D0 to two.D3: MOV D0 D3 at line",
        ),
        ("from: one.M1000, to: two.M1001", "LD M1000\nOUT M1001\n", None),
        ("from: one.M1000, to: two.Y1", "LD M1000\nOUT Y1\n", None),
        ("from: one.M1000, to: two.M1001", "LD M8000\nMOV K1 K1M1000Z0\n", None),
    ],
)
def test_devices_of_one_block_must_be_the_same(
    entry: str, program: str, warned: str | None, tmp_path: Path
) -> None:
    """The link takes each device to its like; only a program makes one of another."""
    text = TEXT.replace("from: two.X0, to: one.M1064, edge: rising", entry)
    found = [
        said
        for said in warnings(tmp_path, text, two__il=SLAVE.replace("END", f"{program}END"))
        if "x.yaml:16" in said
    ]
    assert any(warned in said for said in found) if warned else not found


def test_settings_after_the_first_scan_are_not_called_none(tmp_path: Path) -> None:
    text, late = TEXT.partition("latency:")[0], SLAVE.replace("LD M8002", "LD X7")
    (found,) = [text for text in warnings(tmp_path, text, two__il=late) if "takes no part in N:N" in text]
    assert (
        "(no nn, and none of M8179, D8176 to D8180 set in the first scan) and COM4 has no protocol" in found
    )


# -- shared bits without their station's error flag ------------------------------------------------------

UNGUARDED = "without its error flag M8184: while that station is away the bit stays what it was"


@pytest.mark.parametrize(
    ("rungs", "line"),
    [
        ("LD M1064\nOUT Y0", 7),
        ("LD X0\nAND M1095\nOUT Y0", 8),
        ("LDP M1070\nSET Y0", 7),
        ("LD X0\nMOV K1M1062 D0", 8),
        ("LD= K2M1064 K3\nOUT Y0", 7),
        ("LD M1064\nCJ P0\nP0", 7),
        ("LDI M8183\nAND M1064\nOUT Y0", 8),  # another station's
        ("LD M8184\nOUT Y1\nLD M1064\nOUT Y0", 9),  # in another rung
        ("LD M1064\nANI M8184\nOUT Y0", None),
        ("LDI M8184\nMOV K1M1064 D0", None),
        ("LDI M8184\nMPS\nAND M1064\nOUT Y0\nMPP\nAND M1065\nOUT Y1", None),
        ("LDI M8184\nMC N0 M50\nLD M1064\nOUT Y0\nMCR N0", None),
        ("LD M8184\nOR M1064\nOUT Y0", None),
        ("LD M1096\nOUT Y0", None),  # no bit of mode 1
        ("LD M1000\nOUT Y0", None),  # its own
        ("LD X0\nOUT M1000", None),
        ("LD M8184\nAND M1064\nOUT Y0", 8),  # acts only while the station is away
        ("LD M8184\nMOV K1M1064 D0", 8),
        ("LDP M8184\nAND M1064\nOUT Y0", 8),
        ("LDI M8184\nOR M1064\nOUT Y0", 8),
        ("LD M8184\nINV\nAND M1064\nOUT Y0", None),
        ("LD M8184\nCJ P0\nLD M1064\nOUT Y0\nP0", None),  # guarded by its jump
        ("LD M8184\nCJ P63\nLD M1064\nOUT Y0", None),
        ("LDI M8184\nCJ P0\nLD M1064\nOUT Y0\nP0", 9),
        ("LD M8184\nCJ P0\nLD X0\nOUT Y1\nP0\nLD M1064\nOUT Y0", 12),
        ("LDI M8184\nMC N0 M50\nLD X0\nOUT Y1\nMCR N0\nLD M1064\nOUT Y0", 12),
        ("LD X0\nMC N0 M50\nLD M8184\nCJ P0\nMCR N0\nLD M1064\nOUT Y0\nP0", 12),
        ("LD M8000\nMOV D32 D100", 8),
        ("LD> D35 K5\nOUT Y0", 7),
        ("LDI M8184\nMOV D32 D100", None),
        ("LD M8184\nMOV D32 D100", 8),
        ("LD M8000\nMOV D36 D100", None),  # no word of mode 1
        # A relay that follows the flag guards as well, where one OUT alone sets it in every scan.
        ("LDI M8184\nOUT M60\nLD M1064\nAND M60\nOUT Y0", None),
        ("LD M8184\nOUT M60\nLD M1064\nANI M60\nOUT Y0", None),
        ("LDI M8184\nAND X0\nOUT M60\nLD M60\nMOV D32 D100", None),
        ("LD M8184\nOR X0\nOUT M60\nLDI M60\nOUT M61\nLD M61\nMOV D32 D100", None),
        ("LDI M8184\nOUT M60\nLD M1064\nANI M60\nOUT Y0", 9),
        ("LD M8184\nAND X0\nOUT M60\nLD M1064\nANI M60\nOUT Y0", 10),
        ("LDI M8184\nOUT M60\nLD X0\nSET M60\nLD M1064\nAND M60\nOUT Y0", 11),
        ("LDI M8184\nOUT M60\nLD X0\nMOV K1 D300Z0\nLD M1064\nAND M60\nOUT Y0", 11),
        ("LD X1\nCJ P0\nLDI M8184\nOUT M60\nP0\nLD M1064\nAND M60\nOUT Y0", 12),
        ("LDI M8184\nSET M60\nLD M1064\nAND M60\nOUT Y0", 9),
    ],
)
def test_check_names_shared_bits_that_are_taken_without_the_error_flag(
    tmp_path: Path, rungs: str, line: int | None
) -> None:
    program = MASTER.replace("K2 D8178", "K1 D8178").replace("END", f"{rungs}\nEND")
    found = warnings(tmp_path, **{"one.il": program})
    found = [text for text in found if "does not share" not in text]
    if line is None:
        assert found == []
    else:
        (text,) = shown(found, tmp_path)
        at = rungs.splitlines()[line - 7].split()  # MASTER has six lines
        taken = {"K1M1062": "M1064", "K2M1064": "M1064", "K1M1064": "M1064"}.get(at[1], at[1])
        assert text.startswith(f"one.il:{line}:1: one: {at[0]} takes {taken} of station 1 (two) ")
        assert text.endswith(UNGUARDED.replace("bit", "word") if taken.startswith("D") else UNGUARDED)
    assert load(folder(tmp_path, **{"one.il": program})).warnings == ()  # a run does not say it again


def test_further_lines_of_one_station_are_named_together(tmp_path: Path) -> None:
    rungs = "".join(f"LD M{1064 + n}\nOUT Y{n}\n" for n in range(7))
    (found,) = warnings(tmp_path, **{"one.il": MASTER.replace("END", f"{rungs}END")})
    assert found.startswith("one.il:7:1: one: LD takes M1064 of station 1 (two) without")
    assert found.endswith("; also at line 9; also at line 11; also at line 13; also at line 15")


# -- RS2 -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rungs", "line"),
    [
        ("LD X0\nRS2 D200 H0 D210 D500 K3\nRS2 D201 H0 D210 D500 K3", 9),
        ("LD X0\nRS2 D200 H0 D210 D500 K3\nLD X0\nRS2 D201 H0 D210 D500 K3", 10),
        ("LD X0\nMPS\nAND X1\nRS2 D200 H0 D210 D500 K3\nMPP\nAND X1\nRS2 D201 H0 D210 D500 K3", 13),
        ("LD X0\nRS2 D200 H0 D210 D500 K3\nLDI X0\nRS2 D201 H0 D210 D500 K3", None),
        ("LD X0\nRS2 D200 H0 D210 D500 K3\nINV\nRS2 D201 H0 D210 D500 K3", None),
        ("LD X0\nRS2 D200 H0 D210 D500 K3\nRS2 D201 H0 D210 D500 K5", None),
    ],
)
def test_check_names_two_rs2_that_are_driven_at_once(tmp_path: Path, rungs: str, line: int | None) -> None:
    ports = "ports: {COM3: {bus: b}, COM5: {bus: b}, COM4: {bus: link}}"
    text = TEXT.replace("ports: {COM4: {bus: link}}", ports, 1).replace(
        "nn: true}", "nn: true}\n  - {name: b}"
    )
    files = {"one.il": MASTER.replace("END", f"LD M8002\nCPAVL D0 M0 K3\n{rungs}\nEND")}
    found = [each for each in shown(warnings(tmp_path, text, **files), tmp_path) if "RS2" in each]
    if line is None:
        assert found == []
    else:
        first = 8 + 1 + rungs.splitlines().index("RS2 D200 H0 D210 D500 K3")
        assert found == [
            f"one.il:{line + 2}:1: one: RS2 drives port K3 while RS2 at line {first} does, which keeps it (assumed)"
        ]


def test_an_rs2_on_a_port_without_a_bus_is_warned_of_once(tmp_path: Path) -> None:
    rungs = "LD X0\nRS2 D200 K8 D500 K10 K3\nLDI X0\nRS2 D200 K8 D500 K10 K3\nRS2 D200 K8 D500 K10 D9\nEND"
    (found,) = shown(warnings(tmp_path, **{"one.il": MASTER.replace("END", rungs)}), tmp_path)
    says = "ports does not name its bus: it does nothing; write ports: {COM3: {bus: …}}"
    assert found == f"one.il:8:1: one: RS2 drives COM3, but {says}"
