"""Programs, inputs, observed devices and latency entries in a scenario: what they mean, and every mistake located."""

from __future__ import annotations

from pathlib import Path

import pytest

from bussim.errors import ScenarioError
from bussim.plc.inputs import Pulse, RandomInput, Square, Times
from bussim.scenario.loader import examine, from_data, load, loads
from bussim.scenario.model import Edge, LinkAttachment
from bussim.scenario.yaml.dump import dumps
from bussim.units import TICKS_PER_MS as MS
from bussim.units import TICKS_PER_SECOND as S
from tests.scenario.program_files import MASTER, SLAVE, TEXT, folder, problems, shown, warnings

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
