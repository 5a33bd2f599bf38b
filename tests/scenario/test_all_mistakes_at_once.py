"""Two mistakes of one PLC are told in one pass: neither hides the other."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from itertools import combinations
from typing import Any

import pytest

from bussim.errors import ScenarioError
from bussim.scenario.loader import from_data

Plc = dict[str, Any]


def scenario() -> dict[str, Any]:
    nn = {"bus": "link", "port": "COM4"}
    return {
        "schema": 1,
        "name": "two",
        "duration": "1 s",
        "buses": [{"name": "link", "nn": True}, {"name": "feeder", "baud": 9600}],
        "plcs": [
            {
                "name": "one",
                "profile": "fx2n",
                "scan": "8 ms",
                "nn": {**nn, "station": 0, "slaves": 1, "mode": 1, "retries": 3, "timeout": "50 ms"},
                "ports": {"COM3": {"bus": "feeder", "protocol": "modbus-rtu-master"}},
                "registers": {},
            },
            {"name": "two", "scan": "8 ms", "nn": {**nn, "station": 1}},
        ],
    }


def without(part: str, key: str) -> Callable[[Plc], None]:
    return lambda plc: plc[part].pop(key, None)


def changed(part: str, key: str, value: object) -> Callable[[Plc], None]:
    return lambda plc: plc[part].__setitem__(key, value)


#: Mistakes by what they are of; two of one key exclude each other.
MISTAKES: dict[str, Callable[[Plc], None]] = {
    "bus: none": without("nn", "bus"),
    "bus: unknown": changed("nn", "bus", "lnk"),
    "bus: no name": changed("nn", "bus", 7),
    "station: none": without("nn", "station"),
    "station: 12": changed("nn", "station", 12),
    "mode: 3": changed("nn", "mode", 3),
    "mode: 9": changed("nn", "mode", 9),
    "retries: 12": changed("nn", "retries", 12),
    "timeout: 55 ms": changed("nn", "timeout", "55 ms"),
    "key of nn": changed("nn", "slavse", 1),
    "register": changed("registers", "D8180", 7),
    "port's bus: none": lambda plc: plc["ports"]["COM3"].pop("bus"),
    "port's bus: unknown": lambda plc: plc["ports"]["COM3"].__setitem__("bus", "lnk"),
    "protocol": lambda plc: plc["ports"]["COM3"].__setitem__("protocol", "modbus"),
    "source": lambda plc: plc.__setitem__("sources", {"X0": {"toggle": "1 s"}}),
}


def told(*mistakes: str) -> set[str]:
    """What is said about a scenario with some mistakes."""
    data = deepcopy(scenario())
    for mistake in mistakes:
        MISTAKES[mistake](data["plcs"][0])
    with pytest.raises(ScenarioError) as raised:
        from_data(data)
    return {problem.message for problem in raised.value.problems}


def test_the_scenario_has_no_mistake() -> None:
    from_data(scenario())


@pytest.mark.slow
def test_each_pair_of_mistakes_is_told_at_once() -> None:
    single = {mistake: told(mistake) for mistake in MISTAKES}
    assert {mistake: len(said) for mistake, said in single.items()} == dict.fromkeys(MISTAKES, 1)
    hidden = []
    for one, two in combinations(MISTAKES, 2):
        if one.split(":")[0] == two.split(":")[0] or {one, two} == {"timeout: 55 ms", "register"}:
            continue  # of one key, or the register contradicts another timeout
        if told(one, two) != single[one] | single[two]:
            hidden.append((one, two, told(one, two)))
    assert hidden == []
