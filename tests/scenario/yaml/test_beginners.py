"""Beginners' mistakes in a packing line's scenario: what is said of each, where, and that no more is said."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from yaml import safe_load

from bussim.cli import main
from bussim.scenario.yaml import parser as yaml
from tests.scenario.samples import mistakes
from tests.selection import quick

LINE = """\
schema: 1
name: packing line
duration: 60 s
buses:
  - {name: link, nn: true}
  - {name: hmi, baud: 19200, format: 8N1}
  - {name: vfd, baud: 9600, format: 8N1}
plcs:
  - name: main
    profile: pw10
    scan: {mean: 10 ms, jitter: 2 ms}
    nn: {bus: link, port: COM4, station: 0, slaves: 4, mode: 2, retries: 3, timeout: 50 ms}
    ports:
      COM2: {bus: hmi, protocol: modbus-rtu-slave}
      COM3: {bus: vfd, protocol: modbus-rtu-master, timeout: 100 ms}
    polls:
      - {name: vfd_status, port: COM3, station: 1, function: 3, address: 0x2100, count: 4, to: D400, every: 100 ms, retries: 2}
      - {name: vfd_cmd, port: COM3, station: 1, function: 16, address: 0x2000, count: 2, from: D410, every: 200 ms, retries: 2}
  - {name: feeder, scan: 6 ms, nn: {bus: link, port: COM4, station: 1}}
  - {name: wrapper, scan: 12 ms, nn: {bus: link, port: COM4, station: 2}}
  - {name: labeler, scan: 5 ms, nn: {bus: link, port: COM4, station: 3}}
  - {name: palletizer, scan: 20 ms, nn: {bus: link, port: COM4, station: 4}}
devices:
  - name: panel
    model: hmi
    bus: hmi
    polls:
      - {station: 1, function: 3, address: 0, count: 20, every: 250 ms}
      - {station: 1, function: 1, address: 0, count: 16, every: 500 ms}
  - name: vfd1
    model: map
    bus: vfd
    station: 1
    delay: 5 ms
    registers:
      - {address: 0x2000, count: 2, value: 0, writable: true}
      - {address: 0x2100, count: 4, value: 0}
# end
"""

#: What stands in the scenario, what is written instead, and all that is said.
CASES: dict[str, dict[str, Any]] = safe_load((Path(__file__).parent / "beginners.yaml").read_text("utf-8"))


def test_the_line_itself_is_right() -> None:
    assert mistakes(LINE) == []


@pytest.mark.parametrize(("right", "wrong", "said"), [*map(dict.values, CASES.values())], ids=CASES.keys())
def test_a_mistake_is_named_with_its_place_and_what_is_right(right: str, wrong: str, said: list[str]) -> None:
    assert right in LINE
    assert mistakes(LINE.replace(right, wrong, 1)) == [f"x.yaml:{message}" for message in said]


def test_whole_texts_with_wide_colons() -> None:
    assert mistakes("schema: 1\nname: 测试\nduration： 60 s\n") == [
        "x.yaml:1:1: plcs is missing",
        "x.yaml:3:9: there is ： (fullwidth colon); write :",
    ]
    assert mistakes("schema：1\nname：测试\nduration：10 s\n") == [
        "x.yaml:1:1: plcs is missing",
        "x.yaml:1:7: there is ： (fullwidth colon); write :",
        "x.yaml:2:5: there is ： (fullwidth colon); write :",
        "x.yaml:3:9: there is ： (fullwidth colon); write :",
    ]


def test_wide_comma_in_a_short_scenario() -> None:
    text = (
        "schema: 1\nname: a\nduration: 60 s\nbuses: [{name: link, nn: true}]\nplcs:\n"
        "  - {name: m, scan: 5 ms，nn: {bus: link, port: COM4, station: 0, slaves: 1}}\n"
    )
    assert mistakes(text) == ["x.yaml:6:25: there is ， (fullwidth comma); write ,"]


def test_wide_punctuation_that_is_meant_is_left_alone() -> None:
    text = LINE.replace("name: packing line", "name: 包装线，第二条：测试（一）")
    assert mistakes(text) == []
    assert mistakes(text.replace("duration: 60 s", "duration:60 s")) == [
        "x.yaml:3:1: duration has no blank after its colon; write duration: 60 s"
    ]


def test_every_mistake_is_named_and_those_of_values_beside_them_at_their_own_places() -> None:
    text = LINE
    for right, wrong in (
        ("duration: 60 s", "duration:60 s"),
        ("{name: hmi, baud: 19200", "{name：hmi, baud: 19201"),
        ("retries: 3,", "retries: 30,"),
        ("timeout: 50 ms}", "timeout: 55 ms"),
        ("  - {name: labeler, ", "  labeler: {"),
        ("bus: link, port: COM4, station: 4", "bus: lnk，port: COM4, station: 4"),
        ("    station: 1\n    delay: 5 ms", "    station: 1\n\tdelay: 5 msec"),
    ):
        assert right in text
        text = text.replace(right, wrong, 1)
    assert mistakes(text) == [
        "x.yaml:3:1: duration has no blank after its colon; write duration: 60 s",
        "x.yaml:6:10: there is ： (fullwidth colon); write :",
        "x.yaml:6:22: baud is 19201, allowed 4800, 9600, 19200, 38400, 57600, 115200",
        "x.yaml:12:74: nn.retries is 30, allowed 0..10",
        "x.yaml:12:87: nn.timeout is 55 ms, allowed are multiples of 10 ms, here 50 ms or 60 ms",
        "x.yaml:12:92: a { is never closed; write } here",
        "x.yaml:21:3: labeler is a mapping among list entries; write - {name: labeler, scan: 5 ms …",
        "x.yaml:22:47: nn.bus is 'lnk', which is no bus; did you mean link?",
        "x.yaml:22:50: there is ， (fullwidth comma); write ,",
        "x.yaml:34:1: a tab indents the line; YAML takes blanks only",
        "x.yaml:34:9: delay has the unit 'msec'; allowed are ns, us, ms, s, min, h, d, y; did you mean ms?",
    ]


def _lines_named(text: str) -> set[int]:
    return {int(message.split(":")[1]) for message in mistakes(text)}


#: Lines that begin with a key whose value stands beside it, and what may stand for the colon and the blank.
COLONS = [
    (number, wrong)
    for wrong in (":", "：", " ", " = ")
    for number, line in enumerate(LINE.splitlines(), 1)
    if re.match(r"( *(?:- )?\w+): (?=\S)", line)
]


@pytest.mark.parametrize(("number", "wrong"), quick(20, COLONS))
def test_the_line_is_the_right_one_whatever_stands_for_its_first_colon(number: int, wrong: str) -> None:
    lines = LINE.splitlines()
    lines[number - 1] = lines[number - 1].replace(": ", wrong, 1)
    assert _lines_named("\n".join(lines)) == {number}


@pytest.mark.parametrize(
    "number", quick(5, [number for number, line in enumerate(LINE.splitlines(), 1) if "}" in line])
)
def test_the_line_is_the_right_one_where_a_brace_is_missing_or_too_many(number: int) -> None:
    lines = LINE.splitlines()
    cut, doubled = list(lines), list(lines)
    cut[number - 1] = lines[number - 1].rstrip()[:-1]
    doubled[number - 1] = lines[number - 1].rstrip() + "}"
    assert _lines_named("\n".join(cut)) == _lines_named("\n".join(doubled)) == {number}


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_places_do_not_depend_on_line_ends_or_a_byte_order_mark(end: str) -> None:
    text = LINE.replace("duration: 60 s", "duration:60 s").replace("\n", end)
    for source in (text, "\ufeff" + text, text.encode("utf-8-sig")):
        _, _, problems = yaml.read(source, "x.yaml")
        assert [(problem.line, problem.column) for problem in problems] == [(3, 1)]


@pytest.mark.parametrize(
    ("coding", "said"),
    [
        ("utf-16", "1:1: is UTF-16 text; save the file as UTF-8"),
        ("utf-16-le", "1:1: is UTF-16 text; save the file as UTF-8"),
        ("utf-16-be", "1:1: is UTF-16 text; save the file as UTF-8"),
        (
            "gbk",
            "2:7: the byte 0xB0 is not UTF-8 text; save the file as UTF-8 (is it in GBK, Big5, Shift-JIS or Latin-1?)",
        ),
    ],
)
def test_other_codings(
    coding: str,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("x.yaml").write_bytes(LINE.replace("packing line", "包装线").encode(coding))
    assert main(["check", "x.yaml"]) == 2
    assert capsys.readouterr().err == f"x.yaml:{said}\n"


@pytest.mark.parametrize("name", ["README.md", "pyproject.toml", "bussim/cli.py"])
def test_of_another_kind_of_file_one_thing_is_said(name: str) -> None:
    text = Path(__file__).parents[3].joinpath(name).read_text(encoding="utf-8")
    assert len(mistakes(text)) == 1


@pytest.mark.slow
def test_of_very_many_mistakes_some_are_named_and_the_search_ends() -> None:
    assert 50 < len(mistakes(re.sub(": ", ":", LINE * 5))) < 1000


@pytest.mark.parametrize(
    ("device", "said"),
    [
        (
            'model: free, bus: hmi, says: [{data: "11 12 13 14", at: 500 ms}]',
            [
                "50: says.0.data is not a key here; allowed are text, bytes, at, every, times, jitter, reply_to, delay"
            ],
        ),
        (
            'model: free, bus: hmi, says: [{text: "A", reply_too: "B"}]',
            [
                (
                    "61: says.0.reply_too is not a key here; allowed are text, bytes, at, every, times, "
                    "jitter, reply_to, delay; did you mean reply_to?"
                )
            ],
        ),
        (
            "model: stepper, bus: vfd, station: 2, switches: [{inptu: 1, low: -100, high: 0}]",
            [
                "68: switches.0.input is missing",
                "69: switches.0.inptu is not a key here; allowed are input, low, high; did you mean input?",
            ],
        ),
    ],
)
def test_the_keys_of_the_entries_of_a_list_are_offered(device: str, said: list[str]) -> None:
    text = LINE.replace("# end", f"  - {{name: extra, {device}}}")
    assert mistakes(text) == [f"x.yaml:38:{message}" for message in said]
