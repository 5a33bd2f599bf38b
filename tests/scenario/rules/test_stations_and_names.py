"""Station numbers that change in a run, names that messages offer, and what is warned of once."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from bussim import api
from bussim.scenario.builtin import names, read
from bussim.scenario.loader import examine, loads
from tests.scenario.samples import BASE, added, mistakes
from tests.selection import quick

RENUMBERED = """\
schema: 1
name: new number
duration: 10 s
buses: [{name: b, baud: 9600, format: 8N1}]
plcs:
  - name: p
    ports: {COM3: {bus: b, protocol: modbus-rtu-master, timeout: 200 ms}}
    polls:
      - {port: COM3, station: 1, function: 6, address: 16, values: [2], at: 1 s, times: 1}
      - {port: COM3, station: 1, function: 5, address: 0, values: [1], at: 2 s, times: 1}
      - {name: new, port: COM3, station: 2, function: 3, address: 0, count: 1, to: D400, at: 5 s, every: 500 ms}
devices:
  - {name: drive, model: stepper, bus: b, station: 1}
faults:
  - {at: 3 s, for: 1 s, power_off: drive}
"""
ABSENT = "p.COM3 asks station 2, which is not on b (it has 1)"


def test_a_station_number_that_a_poll_writes_is_on_the_bus_in_the_run_and_not_warned_of() -> None:
    scenario = loads(RENUMBERED)
    assert scenario.warnings == ()
    poll = api.run(scenario, rows=False).summary["ports"]["p.COM3"]["polls"]["new"]
    assert poll["turns"] == 10
    assert (poll["ok"], poll["failed_turns"]) == (10, 0)


@pytest.mark.parametrize(
    ("right", "wrong", "warned"),
    [
        ("function: 6, address: 16, values: [2]", "function: 6, address: 16, values: [3]", True),
        ("function: 6, address: 16, values: [2]", "function: 6, address: 15, values: [2]", True),
        ("station: 1, function: 6", "station: 7, function: 6", True),
        ("function: 6, address: 16, values: [2]", "function: 16, address: 14, values: [9, 9, 2]", False),
        ("function: 6, address: 16, values: [2]", "function: 6, address: 16, from: D0", False),
        ("station: 1, function: 6", "station: 0, function: 6", False),
        ("model: stepper", "model: lx", True),
    ],
)
def test_only_the_number_that_may_be_written_is_not_warned_of(right: str, wrong: str, warned: bool) -> None:
    assert right in RENUMBERED
    assert (ABSENT in loads(RENUMBERED.replace(right, wrong, 1)).warnings) == warned


REFUSED_PORT = """\
schema: 1
name: refused port
duration: 1 s
buses: [{name: b, baud: 9600, format: 8N1}]
plcs:
  - name: p
    ports: {COM3: {bus: b, cpavl: {words: D100, bits: M100}}}
    program: |
      LD M8000
      MOV K99 D100
      CPAVL D100 M100 K3
      END
"""


@pytest.mark.parametrize(
    ("text", "warnings"),
    [
        (
            REFUSED_PORT,
            [
                (
                    "p.COM3 refuses its parameters (COM3: the format word 0063H names no rate): M8063 on, "
                    "D8063 = 7306, and it is silent"
                )
            ],
        ),
        (
            BASE.replace("slaves: 2", "slaves: 2, mode: 1").replace(
                "name: press2, ", "name: press2, profile: fx1s, "
            ),
            [
                "press2: a PLC of profile fx1s has COM3, not COM4, which is simulated as if it were there",
                "press2 (fx1s) does not have the master's refresh mode 1: it stays out of the link",
            ],
        ),
        (
            read("bad_parameter"),
            [
                (
                    "master refuses its N:N settings (D8177 is 0, allowed 1..7): M8063 on, D8063 = 7348, "
                    "and it sends nothing"
                )
            ],
        ),
    ],
    ids=["port", "mode", "link"],
)
def test_what_a_plc_refuses_is_warned_of_once(text: str, warnings: list[str]) -> None:
    assert api.run(loads(text, overrides=["duration=1s"]), rows=False).summary["warnings"] == warnings


@pytest.mark.parametrize("name", quick(12, names()))
def test_every_node_that_is_offered_for_an_unknown_one_is_taken(name: str) -> None:
    text = read(name)
    fault = "\nfaults:\n  - {late_release: {station: NODE, by: 1 us}}\n"
    text = re.sub(r"^faults:(\n .*|\n)+", "", text, flags=re.MULTILINE) + fault
    said = [message for message in mistakes(text.replace("NODE", "Zz")) if "'Zz'" in message]
    offered = re.sub(r".*(allowed are |did you mean )", "", said[0]).strip("?").split(", ")
    for node in offered:
        if node != "…":
            assert [text for text in mistakes(text.replace("NODE", node)) if "late_release" in text] == []


def test_a_port_by_itself_is_among_the_names_that_are_offered() -> None:
    text = added("faults:\n  - {drop_reply: COM2, count: 1}\n").replace(
        "buses:\n", "buses:\n  - {name: hmi, baud: 9600, format: 8N1}\n"
    )
    text = text.replace(
        "    scan: 8 ms\n",
        "    scan: 8 ms\n    ports: {COM2: {bus: hmi, protocol: modbus-rtu-slave, station: 1}}\n",
    )
    (said,) = mistakes(text)
    assert said.endswith("which is no PLC; allowed are press1.COM2, press1, press2, press3")
    assert mistakes(text.replace("drop_reply: COM2", "drop_reply: press1.COM2")) == []


TWO_CPAVL = REFUSED_PORT.replace(
    "{COM3: {bus: b, cpavl: {words: D100, bits: M100}}}", "{COM3: {bus: b}, COM5: {bus: b}}"
).replace(
    "      MOV K99 D100\n      CPAVL D100 M100 K3\n",
    "      MOV H81 D0\n      MOV H81 D10\n      CPAVL D0 M0 K3\n      CPAVL D10 M100 K5\n",
)


@pytest.mark.parametrize(
    ("operands", "said"),
    [
        ("D10 M100", "is D10, the first of 20 words, which overlap those of COM3 (D0 on)"),
        ("D20 M10", "is M10, the first of 20 bits, which overlap those of COM3 (M0 on)"),
        ("D7990 M100", "is D7990, the first of 20 words; allowed D0..D7980"),
    ],
)
def test_words_that_a_program_gives_a_port_are_named_at_its_cpavl(operands: str, said: str) -> None:
    text = TWO_CPAVL.replace("D10 M100", operands)
    assert mistakes(text) == [f"x.yaml:13:7: the operand for p.COM5 {said}"]
    assert text.splitlines()[12].strip() == f"CPAVL {operands} K5"


def test_words_that_a_scenario_gives_a_port_are_named_at_their_key() -> None:
    text = REFUSED_PORT.split("    program")[0].replace("words: D100", "words: D7990")
    assert (
        mistakes(text)[0]
        == "x.yaml:7:43: ports.COM3.cpavl.words is D7990, the first of 20 words; allowed D0..D7980"
    )


def test_what_a_program_sets_up_and_the_plc_refuses_is_named_at_its_cpavl(tmp_path: Path) -> None:
    file = tmp_path / "x.yaml"
    file.write_text(REFUSED_PORT.replace(", cpavl: {words: D100, bits: M100}", ""), encoding="utf-8")
    (warning,) = examine(file).warnings
    assert (warning.line, warning.column, warning.path) == (11, 7, "plcs.p.program")
    assert warning.message.startswith("p.COM3 refuses its parameters (")


ALONE = """\
schema: 1
name: devices alone
duration: 1 s
buses: [{name: b, baud: 9600, format: 8N1}]
devices:
  - {name: panel, model: hmi, bus: b, polls: [{station: 1, function: 3, address: 0, count: 2, every: 100 ms}]}
  - {name: drive, model: lx, bus: b, station: 1}
"""


def test_devices_need_no_plcs_and_no_empty_list_of_them() -> None:
    run = [api.run(loads(text), rows=False).summary for text in (ALONE, ALONE + "plcs: []\n")]
    assert run[0] == run[1]
    assert run[0]["devices"]["panel"]["ok"] == 10
    assert mistakes(ALONE.split("devices:")[0]) == ["x.yaml:1:1: plcs is missing"]
    assert mistakes(ALONE.split("devices:")[0] + "devices: []\n") == ["x.yaml:1:1: plcs is missing"]
