"""Bounds where programs pass a signal on: plain paths and all others, held against what the programs do."""

from __future__ import annotations

from dataclasses import replace
from random import Random
from typing import Any

import pytest

from bussim import api
from bussim.exact.latency.bounds import LatencyBound, bounds_of
from bussim.plc.memory import Device
from bussim.plc.ports.spec import PortSpec
from bussim.plc.profiles import AbsentStation
from bussim.plc.sources import Toggle
from bussim.scenario.loader import from_data
from bussim.scenario.model import Scenario
from bussim.units import TICKS_PER_MS as MS
from tests.selection import quick

#: a sends its X0 as M1000, b shows it.
SEND, SHOW = "LD X0\nOUT M1000\n", "LD M1000\nOUT Y0\n"


def scenario(
    send: str = SEND, show: str = SHOW, *, seconds: int = 1, edge: str = "both", **entry: Any
) -> Scenario:
    """Two PLCs with these programs and one latency, a.X0 to b.Y0 unless ``entry`` says otherwise."""
    nn = {"bus": "link", "port": "COM4"}
    return from_data(
        {
            "schema": 1,
            "name": "programs",
            "duration": f"{seconds} s",
            "buses": [{"name": "link", "nn": True}],
            "plcs": [
                {
                    "name": "a",
                    "scan": "19 ms",
                    "nn": {**nn, "station": 0, "slaves": 1, "mode": 1, "timeout": "50 ms"},
                    "program": f"{send}END\n",
                    "inputs": {"X0": {"square": "1171.3 ms"}, "X1": {"times": ["1 ms"]}},
                },
                {"name": "b", "scan": "23 ms", "nn": {**nn, "station": 1}, "program": f"{show}END\n"},
            ],
            "latency": [
                {
                    "name": "path",
                    "from": entry.get("start", "a.X0"),
                    "to": entry.get("end", "b.Y0"),
                    "edge": edge,
                }
            ],
        }
    )


def bound(send: str = SEND, show: str = SHOW, **entry: Any) -> LatencyBound:
    return bounds_of(scenario(send, show, **entry))["path"]


@pytest.mark.parametrize(
    ("show", "reason"),
    [
        (
            "LD M1000\nOUT T0 K10\nLD T0\nOUT Y0\n",
            "OUT T0 K10 at line 2 is no plain contact, coil or move (b)",
        ),
        ("LD M1000\nOUT C0 K1\nLD C0\nOUT Y0\n", "OUT C0 K1 at line 2 is no plain contact, coil or move (b)"),
        ("LD M1000\nPLS M0\nLD M0\nOUT Y0\n", "PLS M0 at line 2 is no plain contact, coil or move (b)"),
        ("LDP M1000\nOUT Y0\n", "LDP M1000 at line 1 is no plain contact, coil or move (b)"),
        ("LD M1000\nSET Y0\nLDI M1000\nRST Y0\n", "RST Y0 at line 4 writes Y0 too (b)"),
        ("LD M1000\nMOV K1 K1Y0\n", "MOV K1 K1Y0 at line 2 is no plain contact, coil or move (b)"),
        ("LD M1000\nMOV K1M1000 K1Y0\n", "MOV K1M1000 K1Y0 at line 2 is no plain contact, coil or move (b)"),
        (
            "LD M8000\nMOVP K1M1000 K1Y0\n",
            "MOVP K1M1000 K1Y0 at line 2 is no plain contact, coil or move (b)",
        ),
        ("LD M8000\nCML K1M1000 K1Y0\n", "CML K1M1000 K1Y0 at line 2 is no plain contact, coil or move (b)"),
        (
            "LD M8000\nSET M8024\nBMOV K1Y0 K1M1000 K1\n",
            "BMOV K1Y0 K1M1000 K1 at line 3 is no plain contact, coil or move (b)",
        ),
        (
            "LD M8000\nADD K1M1000 K1 K1Y0\n",
            "ADD K1M1000 K1 K1Y0 at line 2 is no plain contact, coil or move (b)",
        ),
        (
            "LD M8000\nMOV K1M1000 D0\nLD= D0 K1\nOUT Y0\n",
            "LD= D0 K1 at line 3 is no plain contact, coil or move (b)",
        ),
        (
            "LD M8000\nMOV K1M1000 D0\nMOV D0 K1Y0\n",
            "MOV D0 K1Y0 at line 3 is no plain contact, coil or move (b)",
        ),
        (
            "LD M1000\nOR M0\nOUT M0\nLD M0\nOUT Y0\n",
            "several contacts of OUT M0 at line 3 depend on X0 (b)",
        ),
        ("LD M1000\nOR Y0\nOUT Y0\n", "several contacts of OUT Y0 at line 3 depend on X0 (b)"),
        ("LD M1000\nAND= K1 K1M1000\nOUT Y0\n", "several contacts of OUT Y0 at line 3 depend on X0 (b)"),
        ("LD M1001\nOUT Y0\n", "nothing leads from a.X0 to b.Y0"),
        (
            "LD M1000\nOUT Y0\nLD M8000\nMOV K1 K1Y4Z0\n",
            "MOV K1 K1Y4Z0 at line 4 is no plain contact, coil or move (b)",
        ),
        (
            "LD M8000\nMC N0 M0\nLD M1000\nOUT Y0\nMCR N0\n",
            "MC N0 M0 at line 2 is no plain contact, coil or move (b)",
        ),
        (
            "LD X4\nCJ P0\nLD M1000\nOUT Y0\nP0\n",
            "CJ P0 at line 2 is no plain contact, coil or move (b)",
        ),
        (
            "LD M1000\nMPS\nAND M1\nOUT T1 K1\nMPP\nAND T1\nOUT Y0\n",
            "several contacts of OUT Y0 at line 7 depend on X0 (b)",
        ),
        ("LD M1000\nAND M8020\nOUT Y0\n", "AND M8020 at line 2 is no plain contact, coil or move (b)"),
        ("LD M1000\nANDP M1\nOUT Y0\n", "ANDP M1 at line 2 is no plain contact, coil or move (b)"),
        ("LD M1000\nCALL P0\nFEND\nP0\nLD M1000\nOUT Y0\nSRET\n", "CALL P0 at line 2 is no plain contact"),
        ("LD M8000\nCALL P0\nFEND\nP0\nLD M1000\nOUT Y0\nSRET\n", "CALL P0 at line 2 is no plain contact"),
    ],
)
def test_what_is_not_plain_is_a_reason(show: str, reason: str) -> None:
    found = bound(show=show)
    assert not found.valid
    assert found.cases() == {}
    assert found.to_json()["reasons"] == [found.reason]
    assert found.reason.startswith(reason)


def test_what_stands_in_front_of_the_link_counts_as_well() -> None:
    found = bound("LD X0\nOUT T0 K10\nLD T0\nOUT M1000\n")
    assert found.reason == "OUT T0 K10 at line 2 is no plain contact, coil or move (a)"
    # Beside the path it does not.
    assert bound(f"LD X1\nOUT T0 K10\n{SEND}", f"LD X1\nOUT T0 K10\n{SHOW}LD M1000\nOUT C0 K5\n").valid


@pytest.mark.parametrize(
    ("show", "edge", "gates"),
    [
        ("LD M1000\nAND X1\nOUT Y0\n", "both", ("X1 (b)",)),
        ("LD M1000\nAND X1\nOUT Y0\n", "rising", ("X1 (b)",)),
        ("LD M1000\nAND X1\nOUT Y0\n", "falling", ()),  # off is off, whatever the other says
        ("LD M1000\nOR X1\nOUT Y0\n", "rising", ()),
        ("LD M1000\nOR X1\nOUT Y0\n", "falling", ("X1 (b)",)),
        ("LDI M1000\nAND X1\nOUT Y0\n", "rising", ()),
        ("LDI M1000\nAND X1\nOUT Y0\n", "falling", ("X1 (b)",)),
        ("LD M1000\nAND X1\nINV\nOUT Y0\n", "falling", ()),
        ("LD M1000\nAND X1\nINV\nOR X2\nOUT Y0\n", "falling", ()),
        ("LD M1000\nAND X1\nINV\nAND X2\nOUT Y0\n", "falling", ("X2 (b)",)),
        ("LD M1000\nAND M8000\nANI M8001\nOUT Y0\n", "both", ()),
        ("LD M1000\nOR M8001\nOUT Y0\n", "both", ()),
        ("LD M1000\nMPS\nAND X1\nOUT Y1\nMPP\nAND X2\nOUT Y0\n", "rising", ("X2 (b)",)),
        ("LD M1000\nOUT M5\nAND X3\nOUT Y0\n", "rising", ("X3 (b)",)),
        ("LD M8000\nMOV K1M1000 K1Y0\n", "both", ()),
        ("LDI M8183\nMOV K1M1000 K1Y0\n", "both", ("M8183 (b)",)),
    ],
)
def test_what_must_let_the_signal_through_is_named(show: str, edge: str, gates: tuple[str, ...]) -> None:
    found = bound(show=show, edge=edge)
    assert found.valid
    assert found.gates == gates
    assert found.program == 0
    assert [said for said in found.caveats if "let it through" in said] == (
        [f"holds as long as {', '.join(gates)} let it through"] if gates else []
    )


@pytest.mark.parametrize(
    ("send", "show", "scans"),
    quick(
        3,
        [
            (SEND, SHOW, (0, 0)),
            ("LD M1\nOUT M1000\nLD M0\nOUT M1\nLD X0\nOUT M0\n", "LD M0\nOUT Y0\nLD M1000\nOUT M0\n", (2, 1)),
            (SEND, "LD M8000\nMOV K1M50 K1Y0\nMOV K1M1000 K1M50\n", (0, 1)),
            ("LD X0\nOUT M0\nLD M0\nOUT M1000\n", "LD M1000\nOUT M0\nLD M0\nOUT Y0\n", (0, 0)),
            ("LD M0\nOUT M1000\nLD X0\nOUT M0\n", SHOW, (1, 0)),
            (SEND, "LD M0\nOUT Y0\nLD M1000\nOUT M0\n", (0, 1)),
            (SEND, "LD M1\nOUT Y0\nLD M0\nOUT M1\nLD M1000\nOUT M0\n", (0, 2)),
            (SEND, "LD M8000\nMOV K1M1000 K1M50\nMOV K1M50 K1Y0\n", (0, 0)),
            (SEND, "LD M0\nOUT Y0\nLD M1000\nOUT M0\nLD M1000\nOUT M1\n", (0, 1)),
        ],
    ),
)
def test_a_rung_in_front_of_its_source_costs_a_scan(send: str, show: str, scans: tuple[int, int]) -> None:
    given = scenario(send, show, seconds=50)
    found, (a, b) = bounds_of(given)["path"], given.plcs
    assert found.valid
    assert found.program == scans[0] * a.longest_scan + scans[1] * b.longest_scan
    times = api.run(given, rows=False).summary["latency"]["path"]["ms"]
    assert 0.8 * found.no_error / MS <= times["max"] <= found.no_error / MS + 1e-6


@pytest.mark.parametrize(
    ("start", "end", "send", "program"),
    quick(
        4,
        [
            ("a.M1000", "b.M1000", SEND, 0),
            ("a.M0", "b.Y0", "LD M0\nOUT M1000\nLD X0\nOUT M0\n", 1),
            ("a.X0", "a.M7", "LD M6\nOUT M7\nLD X0\nOUT M6\n", 1),
            ("a.M6", "a.M7", "LD M6\nOUT M7\nLD X0\nOUT M6\n", 1),
            ("a.M6", "a.M7", "LD X0\nOUT M6\nLD M6\nOUT M7\n", 0),
            ("a.M1000", "b.Y0", SEND, 0),
            ("a.M0", "b.Y0", "LD X0\nOUT M0\nLD M0\nOUT M1000\n", 0),
            ("a.X0", "a.M1000", SEND, 0),
        ],
    ),
)
def test_paths_that_begin_or_end_elsewhere(start: str, end: str, send: str, program: int) -> None:
    given = scenario(send, seconds=40, start=start, end=end)
    found = bounds_of(given)["path"]
    assert found.program == program * given.plcs[0].longest_scan
    longest = api.run(given, rows=False).summary["latency"]["path"]["ms"]["max"]
    assert 0.8 * found.no_error / MS <= longest <= found.no_error / MS + 1e-6


def test_the_caveats_are_named_wherever_the_bound_is() -> None:
    gated = api.run(scenario(show="LD M1000\nAND M8000\nANI M8183\nOUT Y0\n", seconds=20)).summary
    entry = gated["latency"]["path"]
    assert entry["bound_notes"] == ["holds as long as M8183 (b) let it through"]
    assert "bound_reasons" not in entry
    late = api.run(scenario(show="LD M1000\nOUT T0 K3\nLD T0\nOUT Y0\n", seconds=20)).summary["latency"][
        "path"
    ]
    assert late["ms"]["max"] > 300
    assert late["bound_reasons"] == ["OUT T0 K3 at line 2 is no plain contact, coil or move (b)"]
    assert "bound_ms" not in late


@pytest.mark.parametrize(
    ("send", "show", "reason"),
    [
        ("LD X0\nOUT M1000\nLD X1\nOUT M1000\n", SHOW, "OUT M1000 at line 4 writes M1000 too (a)"),
        (f"LD X1\nOUT M1000\n{SEND}", SHOW, "OUT M1000 at line 4 writes M1000 too (a)"),
        (f"{SEND}LD X1\nMOV K0 K4M1000\n", SHOW, "MOV K0 K4M1000 at line 4 writes M1000 too (a)"),
        (f"{SEND}LD X1\nRST M1000\n", SHOW, "RST M1000 at line 4 writes M1000 too (a)"),
        (f"{SEND}LD X1\nZRST M990 M1100\n", SHOW, "ZRST M990 M1100 at line 4 writes M1000 too (a)"),
        (
            "LD M8000\nMOV K1X0 K1M1000\nLD X1\nAND X2\nOUT M1000\n",
            SHOW,
            "OUT M1000 at line 5 writes M1000 too (a)",
        ),
        (
            "LD X0\nOUT M5\nLD X1\nOUT M5\nLD M5\nOUT M1000\n",
            SHOW,
            "OUT M5 at line 4 writes M5 too (a)",
        ),
        (SEND, f"LD X1\nOUT M1000\n{SHOW}", "OUT M1000 at line 2 writes M1000 too (b)"),
        (SEND, f"{SHOW}LD X1\nMOV K0 K4M1000\n", "MOV K0 K4M1000 at line 4 writes M1000 too (b)"),
        (
            SEND,
            "LD M1000\nOUT M7\nLD X1\nOUT M7\nLD M7\nOUT Y0\n",
            "OUT M7 at line 4 writes M7 too (b)",
        ),
        (SEND, f"{SHOW}LD X1\nOUT Y0\n", "OUT Y0 at line 4 writes Y0 too (b)"),
        (SEND, f"LD X1\nSET Y0\n{SHOW}", "OUT Y0 at line 4 writes Y0 too (b)"),
        ("LD X0\nOUT M1064\nLD M1064\nOUT M1000\n", SHOW, "the link writes M1064 too (a)"),
        (SEND, "LD M1000\nOUT M1001\nLD M1001\nOUT Y0\n", "OUT M1001 at line 2 writes M1001 too (b)"),
    ],
)
def test_a_second_writer_of_a_device_on_the_path_is_a_reason(send: str, show: str, reason: str) -> None:
    found = bound(send, show)
    assert found.reason == reason
    assert found.cases() == {}


def test_what_writes_beside_the_program_is_named() -> None:
    given = scenario()
    a, b = given.plcs
    port = PortSpec("COM3", "line", Device("D", 200), Device("M", 200))
    (note,) = bounds_of(replace(given, plcs=(a, replace(b, ports=(port,)))))["path"].caveats
    assert note == "holds as long as no port of b writes a device on the path"
    driven = replace(a, sources={"M1000": Toggle(500 * MS)})
    reason = bounds_of(replace(given, plcs=(driven, b)))["path"].reason
    assert reason == "a source of the scenario writes M1000 too (a)"


def test_what_else_writes_the_source_matters_between_two_of_them() -> None:
    first, read, last = "LD X0\nOUT M5\n", "LD M5\nOUT M1000\n", "LD X1\nOUT M5\n"
    found = bound(first + read + last, start="a.M5")
    assert found.reason == "M5 is read between those that write it (a)"
    assert bound(first + last + read, start="a.M5").valid
    assert bound(read + first + last, start="a.M5").valid


#: Devices that two random programs read and write, several times over and in any order.
_FROM, _TO = ("X0", "X1", "M0", "M1", "M1000", "M1001"), ("M0", "M1", "M5", "M1000", "M1001")
_SHOWN, _OUT = ("X1", "M0", "M1", "M1000", "M1001", "Y1"), ("M0", "M1", "M5", "M1000", "Y0", "Y1")
_ENDS = (("X0", "Y0"), ("X0", "Y1"), ("X0", "M1000"), ("M0", "Y0"), ("M1000", "Y1"))


def _program(random: Random, read: tuple[str, ...], written: tuple[str, ...], first: str) -> str:
    rungs = [first] * (random.random() < 0.7)
    for _ in range(random.randint(1, 4)):
        at, beside = random.sample(read, 2)
        to = random.choice(written)
        copy = f"LD {at}\nMOV K{random.choice((0, 1))} K1{written[0]}\n"
        both = (
            f"{random.choice(('LD', 'LDI'))} {at}\n{random.choice(('AND', 'OR', 'ANI'))} {beside}\nOUT {to}\n"
        )
        move = f"LD M8000\nMOV K1{at} K1{to}\n"
        plain = f"LD {at}\nOUT {to}\n"
        rungs.append(random.choice((*[plain] * 6, f"LD {at}\nRST {to}\n", copy, both, both, move)))
    random.shuffle(rungs)
    return "".join(rungs)


@pytest.mark.parametrize("seed", quick(3, range(24)))
def test_with_any_writers_a_bound_is_not_exceeded(seed: int) -> None:
    random = Random(seed)
    data: dict[str, Any] = {
        "schema": 1,
        "name": "writers",
        "duration": "12 s",
        "seed": seed,
        "buses": [{"name": "link", "nn": True}],
        "plcs": [
            {
                "name": "a",
                "scan": {"mean": "6 ms", "jitter": "1 ms"},
                "nn": {"bus": "link", "port": "COM4", "station": 0, "slaves": 1, "mode": 1},
                "program": f"{_program(random, _FROM, _TO, SEND)}END\n",
                "inputs": {"X0": {"square": "911.3 ms"}, "X1": {"square": {"period": "1.7 s", "at": "1 s"}}},
            },
            {
                "name": "b",
                "scan": "9 ms",
                "nn": {"bus": "link", "port": "COM4", "station": 1},
                "program": f"{_program(random, _SHOWN, _OUT, SHOW)}END\n",
                "inputs": {"X1": {"square": {"period": "1.3 s", "at": "1.2 s"}}},
            },
        ],
        "latency": [
            {"name": f"{a}_{b}_{inverted}", "from": f"a.{a}", "to": f"b.{b}", "inverted": inverted}
            for a, b in _ENDS
            for inverted in (False, True)
        ],
    }
    given = from_data(data)
    bounds = bounds_of(given)
    measured = api.run(given, rows=False).summary["latency"]
    for name, found in bounds.items():
        longest = measured[name]["ms"]["max"]
        if found.valid and not found.gates and longest is not None:
            assert longest <= found.no_error / MS + 1e-6, (name, data["plcs"])


def test_where_the_longest_scan_is_not_known_there_is_no_bound() -> None:
    endless = "LD M8000\nOUT Y4\nFOR D10\nNEXT\n"
    assert bound(show=f"{SHOW}{endless}").reason == "FOR D10 at line 5 is no plain contact, coil or move (b)"


@pytest.mark.parametrize(("policy", "slaves", "named"), [("probe", 2, 1), ("probe", 1, 0), ("full", 2, 0)])
def test_from_when_on_it_holds_with_absent_stations_is_named(policy: str, slaves: int, named: int) -> None:
    given = scenario()
    a, b = given.plcs
    assert a.link is not None
    a, b = (
        replace(plc, profile=replace(plc.profile, absent_station=AbsentStation(policy))) for plc in (a, b)
    )
    a = replace(a, registers={**a.registers, "D8177": slaves})
    found = bounds_of(replace(given, plcs=(a, b)))["path"]
    assert found.valid
    said = [note for note in found.caveats if "never reply (2) are on" in note]
    assert len(said) == named
