"""Whatever faults act, a verdict calls nothing healthy that a station or port shows, and no innocent by name."""

from __future__ import annotations

import random
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from bussim.results.verdict.verdict import faults

from .cases import Data, link, modbus
from .test_verdict import console, items, page, run

#: Special devices that are 0 in every station of a link on which nothing was wrong.
SHOWN = [f"D{address}" for address in range(8203, 8219)] + [f"M{address}" for address in range(8183, 8191)]
SERIAL = ["D8063", "M8063"]
#: Sentences about one node, by what makes them true.
OF_A_NODE = {
    "not_running": ("power_off", "stop", "power_on"),
    "still_not_running": ("power_off", "stop", "power_on"),
    "no_frame": ("jabber",),
    "late_release": ("late_release",),
    "pauses": ("pause",),
    "other_rate": ("wrong_format", "clock_ppm"),
    "late_replies": ("slow",),
}
HEALTHY = ("no_station_in_error", "own_data")


def _seeds(number: int, fast: int) -> list[Any]:
    """So many seeds, the first of them in the fast suite."""
    return [*range(fast), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(fast, number))]


def _fault(draw: random.Random, names: list[str], duration: int) -> tuple[Data, str, str]:
    """A fault of any kind from 0, from the middle or to the end; its kind, and the node that it acts on."""
    name = draw.choice(names)
    at = draw.choice((0, draw.randint(1, duration - 2)))
    when: Data = {"at": f"{at} s"}
    if draw.random() < 0.6:
        when["for"] = f"{draw.choice((20, 300, 1500))} ms"
    kind, of = draw.choice(
        [
            ("power_off", name),
            ("stop", name),
            ("drop_reply", name),
            ("jabber", name),
            ("slow", {"station": name, "extra": f"{draw.choice((5, 60, 120))} ms"}),
            ("cable_cut", {"bus": "link", "after": draw.choice(names[:-1])}),
            ("wrong_format", {"station": name, "format": draw.choice(("7O1", "8N1"))}),
            ("clock_ppm", {"station": name, "ppm": draw.choice((-80_000, 2_000, 80_000))}),
            ("late_release", {"station": name, "by": "2 ms"}),
            ("lose_char", {"station": name}),
            ("insert_char", {"station": name}),
            ("pause", {"station": name, "by": f"{draw.choice((1, 3, 60))} ms"}),
            ("board_error", {"plc": name, "port": "COM4", "code": 41}),
            ("power_on", {name: f"{draw.randint(1, 4)} s"}),
        ]
    )
    return ({kind: of} if kind == "power_on" else {**when, kind: of}), kind, name


def _a_link(seed: int) -> tuple[Data, set[tuple[str, str]]]:
    draw = random.Random(seed)
    line = link(draw, duration="6 s")
    line["plcs"][0]["nn"]["timeout"] = draw.choice(("50 ms", "80 ms", "2250 ms"))
    names = [plc["name"] for plc in line["plcs"]]
    found = [_fault(draw, names, 6) for _ in range(draw.randint(1, 2))]
    found = [found[0], *(each for each in found[1:] if each[1:] != found[0][1:])]  # a PLC is switched on once
    line["faults"] = [fault for fault, _, _ in found]
    return line, {(kind, name) for _, kind, name in found}


def _a_bus(seed: int) -> Data:
    draw = random.Random(seed)
    bus = modbus(draw)
    at = draw.choice((0, 3))
    when: Data = {"at": f"{at} s"} | ({"for": "2 s"} if draw.random() < 0.5 else {})
    kind, of = draw.choice(
        [
            ("power_off", draw.choice(("press", "drive"))),
            ("stop", "press"),
            ("drop_reply", "drive"),
            ("jabber", draw.choice(("press.COM3", "drive"))),
            ("slow", {"station": "drive", "extra": "150 ms"}),
            ("wrong_format", {"station": draw.choice(("press.COM3", "drive")), "format": "8E1"}),
            ("pause", {"station": draw.choice(("press.COM3", "drive")), "by": "20 ms"}),
            ("board_error", {"plc": "press", "port": "COM3", "code": 41}),
        ]
    )
    return {**bus, "faults": [{**when, kind: of}]}


def _said_alike(result: Any) -> None:
    """Console, JSON and report have the same sentences of what was wrong."""
    shown, shown_page = console(result), page(result)
    for item in faults(items(result)):
        assert f"  {item['text']}\n" in shown
        assert f"<li>{item['text']}</li>" in shown_page


def _anything_on(summary: Mapping[str, Any]) -> bool:
    return any(
        registers.get(device)
        for plc in summary["plcs"].values()
        for registers in (plc["registers"],)
        for device in SHOWN + SERIAL
    )


@pytest.mark.parametrize("seed", _seeds(60, 15))
def test_what_a_station_shows_is_never_called_healthy(seed: int, tmp_path: Path) -> None:
    line, true = _a_link(seed)
    result = run(line, tmp_path)
    found = items(result)
    wrong = faults(found)
    if _anything_on(result.summary):
        assert wrong
    healthy = [item for item in found if item["key"] in HEALTHY]
    assert not (healthy and wrong)
    # A PLC without frames up to the end, or from the beginning, is one whatever registers show.
    for kind, name in true:
        if kind in ("power_off", "stop", "power_on"):
            assert any(item["values"].get("plc") == name for item in wrong)
    for item in wrong:
        if item["key"] in OF_A_NODE:
            name = item["values"].get("node", item["values"].get("plc"))
            assert any((kind, name) in true for kind in OF_A_NODE[item["key"]]), item["text"]
    _said_alike(result)


@pytest.mark.parametrize("seed", _seeds(24, 8))
def test_what_a_port_shows_is_never_called_healthy(seed: int, tmp_path: Path) -> None:
    result = run(_a_bus(seed), tmp_path)
    wrong = faults(items(result))
    port = result.summary["ports"]["press.COM3"]
    # A PLC that is in STOP from its power-on on never sets its port up.
    started = port["protocol"] is not None
    if _anything_on(result.summary) or not started or port["answered_with_own_data"] < port["transactions"]:
        assert wrong
    if {"power_off", "stop"} & set(_a_bus(seed)["faults"][0]):
        assert {"not_running", "still_not_running"} & {item["key"] for item in wrong}
    _said_alike(result)
