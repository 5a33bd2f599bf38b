"""The JSON Schema of scenario files against what the loader says of the same files."""

from __future__ import annotations

import json
import re
from importlib import resources
from pathlib import Path
from typing import Any, get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator
from pydantic_core import PydanticCustomError

from bussim.cli import main
from bussim.devices.registry import MODELS, form_of
from bussim.forms import fields
from bussim.forms.kind import Kind
from bussim.scenario import builtin
from bussim.scenario.schema.draft import read_draft
from bussim.scenario.schema.json_schema import json_schema
from bussim.scenario.yaml import parser
from bussim.scenario.yaml.source_map import Report
from tests.scenario.build.test_every_key import EVERY_KEY
from tests.scenario.rules import (
    test_broken_devices,
    test_broken_disturbances,
    test_broken_plcs,
    test_broken_polls,
    test_broken_ports,
)

SCHEMA = json_schema()
VALIDATOR = Draft202012Validator(SCHEMA)
BROKEN = [
    case
    for module in (
        test_broken_devices,
        test_broken_disturbances,
        test_broken_plcs,
        test_broken_polls,
        test_broken_ports,
    )
    for case in module.CASES.values()
]
#: What the loader says of the form of what a JSON Schema has no words for: a value depends on another one,
#: a time is out of its range, a text has no such meaning.
BEYOND = re.compile(
    r"must be |must not be |excludes |needs |has no meaning |more than what|less than what|twice|overlap"
    r"|the first must not|allowed 5\.\.225|has 2 entries, values has 1|is no byte|is 'D9999'"
    r"|is \.nan|allowed more than 0|allowed [\d.]+ [mu]?s\.\.|wrong_format.format is missing"
)
#: What the kinds of values take or refuse, as YAML has it.
SCALARS = """8 ms|-0 s|.5us|1e3 ms|5|5 min|1.5 µs|1.5 μs|8N1|7E1|8-o-2|70|9N1|none|3.5|true|false|yes|0x10|007|2147483648
|9600|9601|'7'|'A'|'\\r'|"\\r"|02|02 41 0D|0x02 0x41|2 41|D400|D9999|M500-M3071|press1.D8201|press1|COM3|COM5|压机1|press 1
|𠀀|-a|a-b_1|press1.COM3|press1.COM7|x:y|sensors.tank:level|x|''|' '|"a\\nb"|é|€|1.0|1.0e-6|2|-1|.inf|rtu|[1]|{a: 1}""".replace(
    "\n", ""
).split("|")


def data(text: str) -> Any:
    return parser.read(text, "x.yaml")[0]


def mistakes_of_form(text: str) -> list[str]:
    values, source_map, *_ = parser.read(text, "x.yaml")
    report = source_map if isinstance(source_map, Report) else Report(source_map)
    read_draft(values, report)
    return [str(problem) for problem in report.errors]


def test_it_is_a_schema_and_the_file_in_the_package_is_this_one(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """To write it again: bussim check --schema -o bussim/scenario/schema/scenario.schema.json --force."""
    Draft202012Validator.check_schema(SCHEMA)
    text = resources.files("bussim.scenario.schema").joinpath("scenario.schema.json").read_text("utf-8")
    assert json.loads(text) == SCHEMA
    assert main(["check", "--schema"]) == 0
    assert capsys.readouterr().out == text
    target = tmp_path / "s.json"
    assert main(["check", "--schema", "-o", str(target)]) == 0
    assert target.read_bytes() == text.encode()
    target.write_text("mine")
    assert main(["check", "--schema", "--out", str(target)]) == 2
    assert target.read_text() == "mine"
    assert main(["check", "--schema", "press_line"]) == 2
    assert main(["check", "press_line", "-o", str(target), "--force"]) == 2


@pytest.mark.parametrize(
    "text", [*map(builtin.read, builtin.names()), EVERY_KEY], ids=[*builtin.names(), "every key"]
)
def test_it_takes_what_is_right(text: str) -> None:
    assert not [error.message for error in VALIDATOR.iter_errors(data(text))]


@pytest.mark.parametrize("model", MODELS)
def test_it_takes_every_key_of_a_device(model: str) -> None:
    scenario = {
        "schema": 1,
        "name": "x",
        "duration": "1 s",
        "devices": [data(form_of({"model": model}).example)],
    }
    assert not [error.message for error in VALIDATOR.iter_errors(scenario)]


def test_it_refuses_what_the_loader_finds_wrong_in_form_and_nothing_else() -> None:
    refused = 0
    for text, _ in BROKEN:
        said = mistakes_of_form(text)
        valid = VALIDATOR.is_valid(data(text))
        assert valid or said, text
        assert not valid or all(map(BEYOND.search, said)), said
        refused += not valid
    assert refused >= 85


def test_an_empty_list_may_stand_and_an_empty_value_may_not() -> None:
    text = builtin.read("two_stations")
    assert VALIDATOR.is_valid(data(text) | {"faults": None})
    assert not VALIDATOR.is_valid(data(text) | {"plcs": None})
    assert not VALIDATOR.is_valid(data(text) | {"seed": None})


def test_a_default_is_written_as_in_a_file() -> None:
    plc = SCHEMA["$defs"]["PlcIn"]["properties"]
    assert (plc["scan"]["default"]["mean"], plc["profile"]["default"]) == ("10 ms", {"base": "pw10"})
    assert SCHEMA["$defs"]["HmiIn"]["properties"]["turnaround"]["default"] == "100 ms"


def test_nothing_is_left_open_by_oversight() -> None:
    """A kind of values without a form would take anything; a pattern must be one of ECMAScript, too."""

    def walk(schema: Any) -> None:
        if isinstance(schema, list):
            for each in schema:
                walk(each)
        if isinstance(schema, dict):
            for key, each in schema.items():
                if key == "properties":
                    assert all(each.values()), [name for name, form in each.items() if not form]
                if key in ("items", "additionalProperties"):
                    assert each != {}
                if key == "pattern" and isinstance(each, str):
                    assert {*re.findall(r"\\.", each)} <= {
                        r"\s",
                        r"\S",
                        r"\d",
                        r"\.",
                        r"\n",
                        r"\x",
                        r"\[",
                        r"\^",
                    }
                walk(each)

    walk(SCHEMA)


KINDS = {
    name: mark for name, each in vars(fields).items() for mark in get_args(each)[1:] if isinstance(mark, Kind)
} | {
    "number or none": fields.none_or(fields.number(0, 9)),
    "characters or time": fields.characters_or_time(0.1, 9),
    "nanoseconds": fields.nanoseconds(0, 10**9),
    "one of": fields.one_of([70, 5]),
    "choice": fields.choice("rtu", "none"),
}


def agrees(kind: Kind, value: object) -> None:
    try:
        kind.read(value)
    except PydanticCustomError:
        return
    Draft202012Validator(kind.form).validate(value)


@pytest.mark.parametrize("name", KINDS)
def test_a_kind_s_form_takes_every_value_that_the_kind_takes(name: str) -> None:
    for text in SCALARS:
        agrees(KINDS[name], data(f"a: {text}")["a"])


@given(st.sampled_from(sorted(KINDS)), st.text(max_size=12) | st.integers() | st.floats(allow_nan=False))
def test_a_kind_s_form_takes_any_value_that_the_kind_takes(name: str, value: object) -> None:
    agrees(KINDS[name], value)
