"""A scenario that is written and read again is the same; whatever is read raises nothing but ScenarioError."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bussim.devices.registry import MODELS
from bussim.errors import UsageError
from bussim.scenario import builtin
from bussim.scenario.loader import from_data, loads
from bussim.scenario.model import Scenario
from bussim.scenario.yaml.dump import dumps
from bussim.units import format_nanoseconds, format_time
from tests.scenario.port_samples import FULL_PORTS, PORTS
from tests.scenario.samples import BASE
from tests.scenario.test_loader import FULL

#: How long an example takes is no verdict.
PATIENT = settings(suppress_health_check=[HealthCheck.too_slow])


@pytest.mark.parametrize("text", [BASE, FULL, PORTS, FULL_PORTS, *map(builtin.read, builtin.names())])
def test_written_and_read_again(text: str) -> None:
    first = loads(text)
    written = dumps(first)
    again = loads(written)
    # What is odd in a program is named by its file's line, or by that of the text within the scenario.
    first = replace(first, warnings=())
    assert replace(again, warnings=()) == first
    assert again.source == first.source
    assert dumps(again) == written
    assert replace(from_data(first.source), warnings=()) == first


def test_every_default_is_written() -> None:
    assert loads(BASE).source == {
        "schema": 1,
        "name": "test",
        "duration": "10 s",
        "seed": 1,
        "buses": [{"name": "link", "nn": True, "contention": "undefined"}],
        "plcs": [
            {
                "name": "press1",
                "profile": "pw10",
                "scan": {"mean": "8 ms", "jitter": "0 s"},
                "nn": {
                    "bus": "link",
                    "port": "COM4",
                    "station": 0,
                    "slaves": 2,
                    "mode": 0,
                    "retries": 3,
                    "timeout": "50 ms",
                },
            },
            *(
                {
                    "name": f"press{number}",
                    "profile": "pw10",
                    "scan": {"mean": "5 ms", "jitter": "0 s"},
                    "nn": {"bus": "link", "port": "COM4", "station": number - 1},
                }
                for number in (2, 3)
            ),
        ],
        "noise": [],
        "faults": [],
    }


def test_every_default_of_ports_polls_and_devices_is_written() -> None:
    source = loads(PORTS).source
    assert source["plcs"][0]["ports"] == {  # type: ignore[index]
        "COM3": {
            "bus": "line",
            "protocol": "modbus-rtu-master",
            "timeout": "100 ms",
            "interval": "5 ms",
            "cpavl": {"words": "D7920", "bits": "M2920"},
        },
        "COM5": {
            "bus": "codes",
            "protocol": "free",
            "timeout": "100 ms",
            "start": 0,
            "end": 0,
            "cpavl": {"words": "D7960", "bits": "M2960"},
        },
    }
    assert source["plcs"][0]["polls"][0] == {  # type: ignore[index]
        "station": 1,
        "function": 3,
        "address": 0,
        "count": 2,
        "every": "0 s",
        "at": "0 s",
        "retries": 0,
        "skip_after_failure": 1,
        "port": "COM3",
        "to": "D400",
    }
    assert source["devices"][0] == {  # type: ignore[index]
        "name": "drive",
        "model": "stepper",
        "bus": "line",
        "station": 1,
        "mode": "rtu",
        "delay": "35 ms",
        "jitter": "0 s",
        "profile": {
            "save_coil": 1,
            "acceleration_unit": 1.0,
            "homing_zeroes": False,
            "refused_command": 4,
            "step_output": "delay",
            "zero_is_endless": True,
        },
    }


def test_a_replaced_seed_or_duration_is_written() -> None:
    changed = dataclasses.replace(loads(BASE), seed=99, duration=72_000_000, name="other")
    assert loads(dumps(changed)) == changed


def test_a_scenario_that_no_loader_made_cannot_be_written() -> None:
    with pytest.raises(UsageError, match="was not loaded"):
        dumps(dataclasses.replace(loads(BASE), source={}))


# Scenarios without mistakes, with most of what the form allows.

_TICKS = st.integers(1, 10**12)


_TIME = _TICKS.map(format_time)


_PART = st.floats(0, 1)


_NAMES = ("a", "B2", "press-3", "förder_4", "站5")


@st.composite
def _profiles(draw: st.DrawFn) -> Any:
    base = draw(st.sampled_from(["pw10", "fx2n", "fx3u"]))
    fields = {
        "master_gap": st.integers(0, 72_000).map(format_time),
        "turnaround": st.one_of(
            st.integers(0, 720_000).map(format_time),
            st.just({"mean": "2 ms", "jitter": "1 ms"}),
            st.lists(st.integers(1, 99).map(lambda n: f"{n} us"), min_size=1, max_size=4).map(
                lambda values: {"values": values, "weights": [0.1 * (i + 1) for i in range(len(values))]}
            ),
        ),
        "attempts": st.sampled_from(["retries", "retries+1"]),
        "reply": st.sampled_from(["interrupt", "end"]),
        "scan_factor": st.floats(1, 2),
        "word_spacing": st.integers(32, 64),
        "modes": st.just([0, 1, 2]),
        "transaction_time": st.integers(0, 72_000).map(format_time),
        "rtu_gaps": st.fixed_dictionaries(
            {},
            optional={
                "end": st.floats(2, 9),
                "inner": st.floats(0.5, 2),
                "fast_character": st.just("none") | st.integers(1, 72_000).map(format_time),
            },
        ),
        "begun_holds": st.booleans(),
        "com2_station": st.integers(1, 247),
        "instruction_times": st.fixed_dictionaries(
            {},
            optional={
                "basic": st.integers(0, 10**9).map(format_nanoseconds),
                "others": st.dictionaries(st.sampled_from(["MOV", "LD", "ADD off"]), st.just("1.52 us")),
            },
        ),
    }
    chosen = draw(st.fixed_dictionaries({}, optional=fields))
    return {"base": base, **chosen} if chosen or draw(st.booleans()) else base


@st.composite
def _plcs(draw: st.DrawFn, number: int) -> Any:
    plc: dict[str, Any] = {"name": _NAMES[number], "profile": draw(_profiles())}
    mean = draw(st.integers(7_200, 720_000_000))
    plc["scan"] = draw(
        st.just(format_time(mean))
        | st.integers(0, mean - 1).map(
            lambda jitter: {"mean": format_time(mean), "jitter": format_time(jitter)}
        )
    )
    if draw(st.booleans()):
        plc["phase"] = draw(st.integers(0, 72_000_000).map(format_time))
    optional = {
        "slaves": st.integers(1, 7),
        "mode": st.integers(0, 2),
        "retries": st.integers(0, 10),
        "timeout": st.integers(5, 225).map(lambda n: f"{n}0 ms"),
        "port": st.sampled_from(["COM3", "COM4"]),
    }
    config = {"bus": st.just("link"), "station": st.integers(0, 7)}
    form = draw(st.sampled_from(["nn", "raw", "none"]))
    if form == "nn":
        plc["nn"] = draw(st.fixed_dictionaries(config, optional=optional))
    elif form == "raw":
        value = st.integers(-32768, 65535)
        plc["registers"] = draw(
            st.fixed_dictionaries({"D8176": value}, optional={"D8177": value, "D8178": value, "D9": value})
        )
        plc["ports"] = {"COM3": {"bus": "link"}}
    if draw(st.booleans()):
        _add_ports(plc, draw(_PORTS), draw(st.lists(_POLLS, max_size=4)))
    plc["sources"] = draw(
        st.fixed_dictionaries(
            {},
            optional={
                "M1000": st.one_of(
                    st.fixed_dictionaries({"toggle": _TIME}),
                    st.just({"constant": 1}),
                    st.just({"counter": "1 s"}),
                ),
                "D3": st.fixed_dictionaries({"constant": st.integers(-32768, 65535)}),
                "D7999": st.fixed_dictionaries(
                    {
                        "ramp": st.fixed_dictionaries(
                            {"from": st.integers(-9, 9), "to": st.just(7), "over": _TIME}
                        )
                    }
                ),
            },
        )
    )
    return plc


def _add_ports(plc: dict[str, Any], port: Any, polls: list[Any]) -> None:
    """A master on COM5 and another port on COM6, with polls of both."""
    master = {"bus": "spare", "protocol": "modbus-rtu-master", **port}
    free = {"bus": "spare", "protocol": "free", "start": 2, "end": "x", "eight_bit": True}
    plc["ports"] = {**plc.get("ports", {}), "COM5": master, "COM6": free}
    plc["polls"] = [{**poll, "port": "COM6" if "send" in poll else "COM5"} for poll in polls]


_PORTS = st.fixed_dictionaries(
    {},
    optional={
        "timeout": st.integers(1, 65535).map(lambda n: f"{n}0 ms"),
        "interval": st.integers(0, 65535).map(lambda n: f"{n}00 us"),
        "baud": st.sampled_from([4800, 115200]),
        "format": st.sampled_from(["8E1", "8N2"]),
        "cpavl": st.fixed_dictionaries({}, optional={"words": st.just("D7000"), "bits": st.just("M50")}),
    },
)


_DUE = {
    "every": st.integers(0, 10**10).map(format_time),
    "at": st.integers(0, 10**10).map(format_time),
    "times": st.integers(1, 1000),
}


_READS = st.fixed_dictionaries(
    {
        "station": st.integers(1, 247),
        "function": st.sampled_from([1, 2, 3, 4]),
        "address": st.integers(0, 65000),
        "to": st.sampled_from(["D500", "D8000"]),
    },
    optional={"count": st.integers(1, 125), "retries": st.integers(0, 100), **_DUE},
)


_WRITES = st.fixed_dictionaries(
    {
        "station": st.integers(0, 247),
        "function": st.just(16),
        "address": st.integers(0, 65000),
        "values": st.lists(st.integers(-32768, 65535), min_size=1, max_size=9),
    },
    optional={"from": st.just("D600"), **_DUE},
)


_FREE = (
    st.fixed_dictionaries(
        {"send": st.just("D700")},
        optional={"to": st.just("D800"), "count": st.just(256), "send_count": st.just(256), **_DUE},
    )
    .flatmap(
        lambda poll: st.one_of(
            st.binary(min_size=1, max_size=20).map(lambda data: {**poll, "data": data.hex(" ")}),
            st.text("ab\r\x02é€ÿ: #'\"", min_size=1, max_size=20)
            .filter(lambda text: "€" not in text)
            .map(lambda text: {**poll, "text": text}),
        )
    )
    .filter(lambda poll: ("count" in poll) == ("to" in poll))
)


_POLLS = st.one_of(_READS, _WRITES, _FREE)


@st.composite
def _devices(draw: st.DrawFn, number: int) -> Any:
    device: dict[str, Any] = {"name": f"device{number}", "bus": "spare"}
    model = device["model"] = draw(st.sampled_from(sorted(MODELS)))
    if model == "hmi":
        polls = draw(st.lists(st.one_of(_READS, _WRITES), max_size=3))
        device["polls"] = [{k: v for k, v in poll.items() if k not in ("to", "from")} for poll in polls]
    elif model == "free":
        text = draw(st.text("AB\r\n\x00\x02 ", min_size=1, max_size=9))
        device["says"] = [{"text": text, "at": "1 s"}, {"bytes": "02 ff", "reply_to": {"bytes": "05"}}]
    else:
        common = {"station": st.integers(1, 247), "jitter": st.just("2 ms"), "delay": st.just("35 ms")}
        device |= draw(st.fixed_dictionaries({}, optional=common))
    value = st.integers(-32768, 65535)
    if model == "lx":
        device["registers"] = draw(st.dictionaries(st.sampled_from(["D5", "D7"]), value))
    elif model == "v80":
        device["registers"] = draw(st.dictionaries(st.sampled_from(["40108", "7", "49999"]), value))
        device["coils"] = draw(st.dictionaries(st.sampled_from(["00127", "8"]), st.integers(0, 1)))
    elif model == "stepper":
        device["registers"] = draw(st.dictionaries(st.just("distance"), st.integers(-99, 99)))
        unit = st.floats(0.001, 1000)
        device["profile"] = draw(st.fixed_dictionaries({}, optional={"acceleration_unit": unit}))
    elif model == "map":
        kinds = [{"value": 5}, {"noise": {"center": 5, "spread": 2, "every": "1 s"}}, {}]
        source_map = draw(st.lists(st.integers(0, 65535), min_size=1, max_size=5, unique=True))
        device["registers"] = [{"address": at, **draw(st.sampled_from(kinds))} for at in source_map]
    return device


_WHEN = {"at": st.integers(0, 10**12).map(format_time), "for": _TIME}


_NOISE = st.one_of(
    st.fixed_dictionaries({"bus": st.just("link"), "ber": _PART}, optional=_WHEN),
    st.fixed_dictionaries({"bus": st.just("link"), "reply_loss": _PART}, optional=_WHEN),
    st.fixed_dictionaries(
        {
            "bus": st.just("link"),
            "burst": st.fixed_dictionaries(
                {"good": _TIME, "bad": _TIME, "ber_bad": _PART}, optional={"ber_good": _PART}
            ),
        },
        optional=_WHEN,
    ),
    st.just({"bus": "link", "impulse": {"every": "20 ms", "width": "50 us", "phase": "1 ms"}}),
)


_FAULTS = st.one_of(
    st.sampled_from(["power_off", "stop"]).flatmap(
        lambda kind: st.fixed_dictionaries({kind: st.just("a")}, optional=_WHEN)
    ),
    st.just({"power_on": {"a": "4 s"}}),
    st.just({"board_error": {"plc": "a", "port": "COM5", "code": 12}}),
)


@st.composite
def _scenarios(draw: st.DrawFn) -> dict[str, Any]:
    count = draw(st.integers(1, len(_NAMES)))
    faults = draw(st.lists(_FAULTS, max_size=4, unique_by=lambda fault: "power_on" in fault or id(fault)))
    return {
        "schema": 1,
        "name": draw(st.text("ab é7E1:#'\"-", min_size=1, max_size=30).filter(str.strip)),
        "duration": draw(_TIME),
        "seed": draw(st.integers(0, 2**63 - 1)),
        "buses": [{"name": "link", "nn": True}, {"name": "spare", "baud": 4800}],
        "plcs": [draw(_plcs(number)) for number in range(count)],
        "devices": [draw(_devices(number)) for number in range(draw(st.integers(0, 3)))],
        "noise": draw(st.lists(_NOISE, max_size=4)),
        "faults": faults,
    }


@PATIENT
@given(_scenarios())
def test_any_scenario_is_the_same_after_writing_and_reading(data: dict[str, Any]) -> None:
    first = from_data(data)
    written = dumps(first)
    assert _unworded(loads(written)) == _unworded(first)
    assert dumps(loads(written)) == written
    assert loads(json.dumps(data, ensure_ascii=False)) == first


def _unworded(scenario: Scenario) -> Scenario:
    """Without the text of warnings that show a time as it is written (50.01 s or 50010 ms, scan or scan.mean)."""
    warnings = ("" if " is usually " in text else text for text in scenario.warnings)
    return replace(scenario, warnings=tuple(warnings))
