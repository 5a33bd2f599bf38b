"""A run gives the same frames, damage and outcomes in every recording of it: folder, session, packets, text."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pandas
import pytest

import bussim
from bussim.export.formats import export_trace
from bussim.scenario.loader import from_data
from bussim.scenario.model import Scenario
from bussim.trace.file import read_trace
from tests.live.recordings.reading import sniffed
from tests.selection import quick
from tests.undrawn import undrawn

pytestmark = pytest.mark.filterwarnings("ignore")


def scenario(seed: int) -> dict[str, Any]:
    """Seven lines with different troubles, in turn."""
    rng, kind = random.Random(seed), seed % 7
    nn = {"bus": "link", "port": "COM4"}
    if kind < 5:
        plcs = [{"name": "m", "nn": {**nn, "station": 0, "slaves": 2, "mode": 1, "timeout": "50 ms"}}]
        plcs += [{"name": f"s{k}", "nn": {**nn, "station": k}} for k in (1, 2)]
        found: dict[str, Any] = {"buses": [{"name": "link", "nn": True}], "plcs": plcs}
        if kind < 3:
            found["noise"] = [{"bus": "link", "ber": 10.0 ** (kind - 5)}]
        elif kind == 3:
            late = {"station": "s1", "by": f"{rng.choice([400, 700, 1500])} us"}
            found["faults"] = [{"at": "200 ms", "for": "2 s", "late_release": late}]
        else:
            plcs[2]["nn"] |= {"station": 0, "slaves": 1}
    else:
        polls = [
            {"station": 1, "function": 3, "address": 0, "count": rng.randint(1, 20), "every": "60 ms"},
            {"station": 2, "function": 1, "address": 4, "count": 20, "every": "90 ms"},
        ]
        found = {
            "buses": [{"name": "link", "baud": 19200, "format": "8E1"}],
            "plcs": [{"name": "idle"}],
            "devices": [
                {"name": "one", "model": "v80", "bus": "link", "station": 1, "delay": "8 ms"},
                {"name": "two", "model": "v80", "bus": "link", "station": 2, "delay": "8 ms"},
                {"name": "panel", "model": "hmi", "bus": "link", "timeout": "100 ms", "polls": polls},
            ],
            "noise": [{"bus": "link", "ber": 1e-4 if kind == 5 else 1e-3}],
        }
    return {"schema": 1, "name": "any", "seed": seed, "duration": "2 s"} | found


def recordings(run: Scenario, folder: Path) -> dict[str, tuple[Path, tuple[str, ...]]]:
    """The recordings of a run's first bus, by kind, with the options that they need."""
    with undrawn():
        bussim.run(run, out=folder / "run", trace=True)
    trace = read_trace(folder / "run")
    bus = trace.header.buses[0]
    for ending in ("sr", "pcapng", "csv"):
        export_trace(trace, folder / f"line.{ending}", ending, bus=bus.name)
    frames = pandas.read_csv(folder / "line.csv")
    lines = [
        f"{end:.9f} {heard}"
        for end, heard in zip(frames["end_s"], frames["heard"], strict=True)
        if isinstance(heard, str)
    ]
    (folder / "line.txt").write_text("\n".join(lines), encoding="utf-8")
    baud = ("-b", str(bus.baud))
    return {
        "run": (folder / "run", ()),
        "sr": (folder / "line.sr", ()),
        "pcapng": (folder / "line.pcapng", baud),
        "text": (folder / "line.txt", baud),
    }


def assert_same(run: dict[str, Any], found: dict[str, Any], kind: str, *, overlapping: bool) -> None:
    """What a recording shows is what the run's folder shows, as far as its kind can know it."""
    assert found["protocol"] == run["protocol"]
    # Neither a text nor RTU in pcapng has parity and stop bits: a frame of which only these are wrong is sound.
    blind = kind == "text" or (kind == "pcapng" and run["protocol"] == "modbus-rtu")
    parity = run["parity_errors"] + run["stop_errors"] if blind else 0
    # The distance of a text's lines proves nothing: a damaged frame of up to three characters is a stray.
    short = found["strays"] if kind == "text" else 0
    allowed = max(1, run["damaged"] // 50) + parity + short
    if overlapping and kind == "text":
        allowed += run["damaged"] // 4  # when a character came inside two frames is not in a line
    assert found["frames"] == pytest.approx(
        run["frames"], abs=1 + short + (overlapping and kind == "text") * 20
    )
    assert found["damaged"] == pytest.approx(run["damaged"], abs=allowed)
    for outcome in {*run["outcomes"], *found["outcomes"]} - {"undecided"}:
        ours, theirs = (each["outcomes"].get(outcome, 0) for each in (found, run))
        assert ours == pytest.approx(theirs, abs=max(1, theirs // 50) + parity), outcome


@pytest.mark.parametrize("seed", quick(1, range(100)))
def test_a_run_is_the_same_in_every_recording_of_it(seed: int, tmp_path: Path) -> None:
    kinds = recordings(from_data(scenario(seed)), tmp_path)
    run = sniffed(tmp_path / "run")
    for kind, (path, options) in kinds.items():
        protocol = ("--protocol", run["protocol"]) if kind == "text" else ()
        found = sniffed(path, *options, *protocol)
        assert_same(run, found, kind, overlapping=seed % 7 == 4)
        if kind == "sr":
            assert [found[key] for key in ("baud", "format", "channels")] == [
                run["baud"],
                run["format"],
                ["link"],
            ]


BUILT_IN = [
    *("barcode_reader", "foreign_block", "hmi_on_com2", "late_power_up", "manual_programs", "nn_with_modbus"),
    *("stepper_positioning", "timeout_too_short", "two_masters", "v80_ascii", "wrong_parity"),
]


@pytest.mark.slow
@pytest.mark.parametrize("name", BUILT_IN)
def test_a_built_in_scenario_is_the_same_in_every_recording_of_it(name: str, tmp_path: Path) -> None:
    kinds = recordings(bussim.load(name, ["duration=20s"]), tmp_path)
    run = sniffed(tmp_path / "run")
    for kind, (path, options) in kinds.items():
        protocol = ("--protocol", run["protocol"]) if kind == "text" and run["protocol"] else ()
        found = sniffed(path, *options, *protocol)
        assert_same(run, found, kind, overlapping=name == "two_masters")


def test_the_channels_of_nodes_are_not_read_beside_the_line(tmp_path: Path) -> None:
    """An export has the line and each node's own channel: that is one line, not several."""
    with undrawn():
        bussim.run(from_data(scenario(1)), out=tmp_path / "run", trace=True)
    export_trace(read_trace(tmp_path / "run"), tmp_path / "line.sr", "sr")
    run, found = sniffed(tmp_path / "run"), sniffed(tmp_path / "line.sr")
    assert found["channels"] == ["link"]
    assert (found["frames"], found["damaged"], found["outcomes"]) == (
        run["frames"],
        run["damaged"],
        run["outcomes"],
    )


@pytest.mark.slow
def test_drivers_that_release_late_are_counted_alike_in_packets(tmp_path: Path) -> None:
    """Characters of a collision have the times at which they were read, so that strays are told from damage."""
    kinds = recordings(bussim.load("late_release", ["duration=60s"]), tmp_path)
    run, packets = (sniffed(kinds[kind][0], *kinds[kind][1]) for kind in ("run", "pcapng"))
    keys = ("frames", "damaged", "strays", "stray_characters", "outcomes")
    assert run["damaged"] > 100
    assert run["strays"] > 0
    assert [packets[key] for key in keys] == [run[key] for key in keys]
