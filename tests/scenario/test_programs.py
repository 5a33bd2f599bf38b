"""Programs, inputs, observed devices and latency entries in a scenario: what they mean, and every mistake located."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from bussim.errors import ScenarioError
from bussim.plc.inputs import Pulse, RandomInput, Square, Times
from bussim.scenario.loader import examine, from_data, load, loads
from bussim.scenario.model import Edge, LinkAttachment
from bussim.scenario.yaml.dump import dumps
from bussim.units import TICKS_PER_MS as MS
from bussim.units import TICKS_PER_SECOND as S

MASTER = "LD M8002\nMOV K0 D8176\nMOV K1 D8177\nMOV K2 D8178\nMOV K5 D8180\nSET M8179\nEND\n"
SLAVE = "LD M8002\nMOV K1 D8176\nSET M8179\nLD X0\nOUT M1064\nEND\n"
TEXT = """\
schema: 1
name: test
duration: 10 s
buses:
  - {name: link, nn: true}
plcs:
  - name: one
    ports: {COM4: {bus: link}}
    program: one.il
  - name: two
    ports: {COM4: {bus: link}}
    program: two.il
    inputs: {X0: {square: 500 ms}}
observe: [one.M1064]
latency:
  - {from: two.X0, to: one.M1064, edge: rising}
"""


def folder(path: Path, text: str = TEXT, **files: str) -> Path:
    """A scenario and its programs on disk."""
    for name, content in {"one.il": MASTER, "two.il": SLAVE, **files}.items():
        (path / name.replace("__", ".")).write_text(content, encoding="utf-8")
    (path / "x.yaml").write_text(text, encoding="utf-8")
    return path / "x.yaml"


def problems(path: Path, text: str = TEXT, **files: str) -> list[str]:
    return [str(problem) for problem in examine(folder(path, text, **files)).errors]


def warnings(path: Path, text: str = TEXT, **files: str) -> list[str]:
    return [str(problem) for problem in examine(folder(path, text, **files)).warnings]


def shown(found: list[str], path: Path) -> list[str]:
    return [text.replace(f"{path}/", "") for text in found]


# -- what they mean ------------------------------------------------------------------------------------


def test_what_programs_set_is_known_before_the_run(tmp_path: Path) -> None:
    found = load(folder(tmp_path))
    one, two = found.plcs
    assert found.warnings == ()
    assert one.link == two.link == LinkAttachment("link", "COM4")
    assert [one.registers[f"D{n}"] for n in (8176, 8177, 8178, 8180)] == [0, 1, 2, 5]
    assert two.registers["D8176"] == 1
    assert two.inputs == {"X0": Square(500 * MS)}
    assert one.observed == ("M1064",)
    (entry,) = found.latency
    assert (entry.name, entry.edge, entry.inverted) == ("two.X0 to one.M1064", Edge.RISING, False)
    assert entry.source == "X0"
    assert "X0" in two.observed


def test_a_setting_that_the_first_scan_does_not_reach_is_none(tmp_path: Path) -> None:
    """Nor one that an input's level at power-on forbids."""
    gated = SLAVE.replace("LD M8002", "LD X1")
    text = TEXT.replace("X0: {square: 500 ms}", "X0: {square: 500 ms}, X1: {times: [1 s]}")
    found = examine(folder(tmp_path, text, **{"two.il": gated}))
    assert any("two and one share no" in str(p) or "share no N:N link" in str(p) for p in found.errors)
    text = TEXT.replace("X0: {square: 500 ms}", "X0: {square: 500 ms}, X1: {pulse: {width: 1 s}}")
    assert load(folder(tmp_path, text, **{"two.il": gated})).plcs[1].registers["D8176"] == 1


def test_the_same_value_as_at_power_on_is_set_as_well(tmp_path: Path) -> None:
    text = TEXT.replace("COM4", "COM3")
    only = "LD M8002\nMOV K0 D8176\nMOV K1 D8177\nEND\n"
    other = SLAVE.replace("SET M8179\n", "")
    found = load(folder(tmp_path, text, **{"one.il": only, "two.il": other}))
    assert found.plcs[0].link == LinkAttachment("link", "COM3")


def test_ports_that_a_program_sets_up(tmp_path: Path) -> None:
    text = """\
schema: 1
name: test
duration: 1 s
buses: [{name: bus, baud: 9600, format: 8N1}]
plcs:
  - name: one
    ports: {COM3: {bus: bus}}
    program: one.il
  - name: two
    ports: {COM3: {bus: bus, protocol: modbus-rtu-slave, station: 1}}
"""
    program = "LD M8002\nCPAVL D20 M40 K3\nMOV H81 D20\nMOV H20 D26\nLD M0\nRS2 D0 H4 D4 D5 K3\nEND\n"
    found = load(folder(tmp_path, text, **{"one.il": program}))
    (port,) = found.plcs[0].ports
    assert (str(port.words), str(port.bits)) == ("D20", "M40")
    assert found.plcs[0].registers["D26"] == 0x20
    assert found.warnings == ()
    nowhere = text.replace("COM3: {bus: bus}", "COM4: {bus: bus}", 1)
    assert shown(warnings(tmp_path, nowhere, **{"one.il": program}), tmp_path)[-1] == (
        "one.il:2:1: one: CPAVL sets COM3 up, but ports does not name its bus: it does nothing; "
        "write ports: {COM3: {bus: …}}"
    )


def test_every_kind_of_input(tmp_path: Path) -> None:
    text = TEXT.replace(
        "{X0: {square: 500 ms}}",
        "{X0: {square: {period: 1 s, at: 20 ms}}, X1: {pulse: {width: 50 ms, every: 2 s, at: 1 s, times: 3}}, "
        "X10: {random: {on: 1 s, off: 2 s}}, X2: {times: [1 s, 1200 ms]}, X3: {csv: edges.csv}}",
    )
    (tmp_path / "edges.csv").write_text("# recorded\ntime (s)\n0.5\n\n1.25\n2e0\n", encoding="utf-8")
    found = load(folder(tmp_path, text))
    assert found.plcs[1].inputs == {
        "X0": Square(S, 20 * MS),
        "X1": Pulse(50 * MS, S, 2 * S, 3),
        "X10": RandomInput(S, 2 * S),
        "X2": Times((S, 1200 * MS)),
        "X3": Times((S // 2, 1250 * MS, 2 * S)),
    }


def test_what_a_run_leaves_needs_no_other_file(tmp_path: Path) -> None:
    text = TEXT.replace("X0: {square: 500 ms}", "X0: {csv: edges.csv}")
    (tmp_path / "edges.csv").write_text("1\n2\n", encoding="utf-8")
    found = load(folder(tmp_path, text))
    written = dumps(found)
    assert "program: |\n" in written
    again = loads(written)
    assert again == found
    assert dumps(again) == written
    assert from_data(found.source) == found


def test_a_program_in_the_scenario_and_one_that_is_named_in_full(tmp_path: Path) -> None:
    inline = TEXT.replace(
        "program: one.il", "program: |\n" + "".join(f"      {x}\n" for x in MASTER.split("\n"))
    )
    assert load(folder(tmp_path, inline)) == load(folder(tmp_path))
    named = TEXT.replace("program: one.il", "program: {file: one.txt}")
    assert load(folder(tmp_path, named, one__txt=MASTER)) == load(folder(tmp_path))


# -- mistakes ------------------------------------------------------------------------------------------


def test_a_mistake_in_a_program_has_its_position_there(tmp_path: Path) -> None:
    found = problems(tmp_path, **{"one.il": "LD X0\n  MVO K1 D0\nOUT X3\nEND\n"})
    assert found[0].startswith("one.il:2:3: 'MVO' is no instruction; did you mean MOV?")
    assert found[1].startswith("one.il:3:5: OUT X3: X is an input")


def test_a_mistake_in_an_inline_program_has_the_scenarios_line(tmp_path: Path) -> None:
    inline = TEXT.replace(
        "program: one.il", "program: |\n\n      ; a comment\n      LD X0\n        MVO K1 D0\n      END"
    )
    (found,) = problems(tmp_path, inline)
    line = next(n for n, text in enumerate(inline.split("\n"), 1) if "MVO" in text)
    assert found.startswith(f"{tmp_path}/x.yaml:{line}:9: 'MVO' is no instruction")
    assert inline.split("\n")[line - 1].index("MVO") == 8


def test_a_mistake_in_a_folded_text_names_its_line_of_the_program() -> None:
    data = {
        "schema": 1,
        "name": "x",
        "duration": "1 s",
        "buses": [{"name": "b", "nn": True}],
        "plcs": [{"name": "p", "program": "LD X0\nMVO K1 D0\nEND\n"}],
    }
    with pytest.raises(ScenarioError) as caught:
        from_data(data)
    assert "line 2 of the program: 'MVO' is no instruction" in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("program: one.il", "program: on.il", "x.yaml:9:14: program is on.il, but there is no such file beside the scenario; did you mean one.il?"),
        ("program: one.il", "program: LD X0", "x.yaml:9:14: program is 'LD X0', expected the name of a file such as press1.il or main.csv, or the program's lines as a block (program: |); another file name needs {file: …}"),
        ("program: one.il", "program: {file: one.il, text: END}", "x.yaml:9:35: program.text excludes file in the same entry"),
        ("program: one.il", "program: {name: one.il}", "x.yaml:9:15: program.name is not a key here; allowed are file, text"),
        ("program: one.il", "program: 5", "x.yaml:9:14: program is 5, expected the name of a file such as press1.il or main.csv, or the program's lines as a block (program: |)"),
        ("X0: {square: 500 ms}", "Y0: {square: 500 ms}", "x.yaml:13:14: inputs.Y0 is no input: Y cannot be driven here, only X"),
        ("X0: {square: 500 ms}", "X8: {square: 500 ms}", "x.yaml:13:14: a device of inputs is 'X8', but X is numbered in octal (no 8 or 9); point 8 of X is X10"),
        ("{square: 500 ms}", "{sqare: 500 ms}", "x.yaml:13:19: inputs.X0.sqare is not a key here; allowed are pulse, square, random, times, csv; did you mean square?"),
        ("{square: 500 ms}", "{square: 500}", "x.yaml:13:27: inputs.X0.square is 500, a time without a unit; write one of ns, us, ms, s, min, h, d, y, such as 500 ms"),
        ("{square: 500 ms}", "{pulse: {width: 2 s, every: 1 s}}", "x.yaml:13:46: inputs.X0.pulse.every must be more than width"),
        ("{square: 500 ms}", "{pulse: {width: 2 s, times: 3}}", "x.yaml:13:46: inputs.X0.pulse.times needs every"),
        ("{square: 500 ms}", "{times: [1 s, 1 s]}", "x.yaml:13:26: inputs.X0.times must rise: each change is later than the one before"),
        ("{square: 500 ms}", "{square: 1 s, times: [1 s]}", "x.yaml:13:39: inputs.X0.times excludes square in the same entry"),
        ("{square: 500 ms}", "{csv: no.csv}", "x.yaml:13:24: inputs.X0.csv is no.csv, but there is no such file beside the scenario"),
        ("[one.M1064]", "[on.M1064]", "x.yaml:14:11: observe.0 is 'on.M1064', but on is no PLC; did you mean one?"),
        ("[one.M1064]", "[one.Q4]", "x.yaml:14:11: observe.0 is one.Q4, whose device is 'Q4', not a device; write a letter of X Y M S T C D TN CN V Z and a number"),
        ("[one.M1064]", "[one.V8]", "x.yaml:14:11: observe.0 is one.V8, whose device is 'V8', allowed V0–V7"),
        ("[one.M1064]", "[one.TS0]", "x.yaml:14:11: observe.0 is one.TS0, whose device is 'TS0', not a device; did you mean T0?"),
        ("name: two\n", "name: two\n    registers: {CN1: 5}\n", "x.yaml:11:17: a device of registers is 'CN1', which can only be observed; allowed are X Y M S T C D"),
        ("[one.M1064]", "[M1064]", "x.yaml:14:11: observe.0 is 'M1064', expected a device of a PLC such as press1.D8201"),
        ("to: one.M1064", "to: one.D0", "x.yaml:16:24: to is one.D0: two.X0 is a bit and one.D0 is a word, but a latency has two of a kind"),
        ("to: one.M1064", "to: one.X4", "x.yaml:16:24: to is one.X4, an input: no program can set it"),
        ("to: one.M1064", "to: three.M1064", "x.yaml:16:24: to is 'three.M1064', but three is no PLC; allowed are one, two"),
        ("edge: rising", "edge: up", "x.yaml:16:41: edge is 'up', allowed rising, falling, both"),
        ("from: two.X0, to: one.M1064", "from: two.D32, to: one.D32", "x.yaml:16:34: edge has no meaning for words, and two.D32 is one"),
        ("edge: rising", "egde: rising", "x.yaml:16:35: egde is not a key here; allowed are name, from, to, edge, inverted; did you mean edge?"),
    ],
)  # fmt: skip
def test_a_mistake(tmp_path: Path, old: str, new: str, expected: str) -> None:
    assert old in TEXT
    assert expected in shown(problems(tmp_path, TEXT.replace(old, new, 1)), tmp_path)


def test_sizes_are_bounded(tmp_path: Path) -> None:
    big = "; " + "x" * 200_000 + "\n" + MASTER
    (found,) = shown(problems(tmp_path, **{"one.il": big}), tmp_path)
    assert found == "x.yaml:9:14: program is one.il, which has more than 128 KiB"
    large = "; " + "x" * 100_000 + "\n"
    files = {f"p{n}.il": large + "LD X0\nOUT Y0\nEND\n" for n in range(3)}
    text = (
        TEXT.split("plcs:")[0]
        + "plcs:\n"
        + "".join(f"  - {{name: p{n}, program: p{n}.il}}\n" for n in range(3))
    )
    found_all = shown(problems(tmp_path, text, **files), tmp_path)
    assert found_all == ["x.yaml:7:3: the programs of all PLCs have 293 KiB together, allowed 256 KiB"]


# -- oddities ------------------------------------------------------------------------------------------


def test_nn_and_registers_that_a_program_overrules(tmp_path: Path) -> None:
    text = TEXT.replace(
        "name: one\n", "name: one\n    nn: {bus: link, port: COM4, station: 0, slaves: 3, timeout: 50 ms}\n"
    )
    assert shown(warnings(tmp_path, text), tmp_path) == [
        "x.yaml:8:53: the program of one sets D8177 to 1: nn.slaves, which stands for 3, is lost"
    ]
    found = load(folder(tmp_path, text))
    assert found.plcs[0].registers["D8177"] == 1
    assert loads(dumps(found)) == found
    text = TEXT.replace("name: two\n", "name: two\n    registers: {D8176: 4}\n")
    assert shown(warnings(tmp_path, text), tmp_path) == [
        "x.yaml:11:16: the program of two sets D8176 to 1: the 4 of registers is lost"
    ]


FOREIGN = "in the shared block of station 0 (one): the link overwrites it with every frame from there, and no other station sees it"


def test_writes_into_another_stations_block_are_reported_line_by_line(tmp_path: Path) -> None:
    """Each with the part of it that lies there: station 0 has M1000–M1063 and D0–D7 in mode 2."""
    program = SLAVE.replace(
        "END", "MOV K5 D0\nOUT M1000\nMOV K1 D33\nBMOV D100 D28 K10\nMOV K0 K4M1060\nDMOV D1 D7\nEND"
    )
    found = shown(warnings(tmp_path, **{"two.il": program}), tmp_path)
    written = {
        6: "MOV writes D0",
        7: "OUT writes M1000",
        10: "MOV writes M1060 to M1063",
        11: "DMOV writes D7",
    }
    own = [text for text in found if "shared block" in text]
    assert own == [f"two.il:{line}:1: two: {what}, {FOREIGN}" for line, what in written.items()]


def test_many_writes_into_another_stations_block_are_counted(tmp_path: Path) -> None:
    program = SLAVE.replace("END", "MOV K5 D0\n" * 23 + "END")
    found = warnings(tmp_path, **{"two.il": program})
    assert len(found) == 21
    assert "two.il:26:1: two: 3 more writes into blocks of other stations" in found


def test_lines_that_messages_of_an_inline_program_name_are_the_files(tmp_path: Path) -> None:
    inline = (
        "program: |\n      LD X0\n      CALL P5\n      FEND\n      P5\n      LD X1\n      OUT Y1\n      END"
    )
    (found,) = shown(problems(tmp_path, TEXT.replace("program: one.il", inline)), tmp_path)
    assert found == "x.yaml:11:7: CALL P5: the subroutine at line 13 has no SRET"


def test_a_warning_of_an_inline_program_has_the_files_lines_and_a_run_those_of_the_program(
    tmp_path: Path,
) -> None:
    lines = "".join(f"      {line}\n" for line in SLAVE.replace("END", "LD X1\nOUT M1064\nEND").splitlines())
    path = folder(tmp_path, TEXT.replace("program: two.il\n", f"program: |\n{lines}"))
    (found,) = shown([str(each) for each in examine(path).warnings], tmp_path)
    assert found == "x.yaml:19:7: two: M1064 is driven at line 17 too; the last one executed wins"
    said = ("two: M1064 is driven at line 5 of the program too; the last one executed wins",)
    assert load(path).warnings == said
    assert loads(dumps(load(path))).warnings == said


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
