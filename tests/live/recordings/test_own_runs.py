"""A run gives the same frames, damage and outcomes in every recording of it: folder, session, packets, text."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pandas
import pytest

import bussim
from bussim.commands.common.recording import open_line, read
from bussim.export.formats import export_trace
from bussim.live.sniff.reading import Settings
from bussim.scenario import builtin
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


def recordings(folder: Path, bus: str) -> dict[str, tuple[Path, tuple[str, ...]]]:
    """The recordings of a bus of the run in a folder, by kind, with the options that they need."""
    trace = read_trace(folder / "run")
    for ending in ("sr", "pcapng", "csv"):
        export_trace(trace, folder / f"{bus}.{ending}", ending, bus=bus)
    frames = pandas.read_csv(folder / f"{bus}.csv")
    lines = [
        f"{end:.9f} {heard}"
        for end, heard in zip(frames["end_s"], frames["heard"], strict=True)
        if isinstance(heard, str)
    ]
    (folder / f"{bus}.txt").write_text("\n".join(lines), encoding="utf-8")
    baud = ("-b", str(trace.bus(bus).baud))
    return {
        "run": (folder / "run", ("--bus", bus)),
        "sr": (folder / f"{bus}.sr", ()),
        "pcapng": (folder / f"{bus}.pcapng", baud),
        "text": (folder / f"{bus}.txt", baud),
    }


def of_run(run: Scenario, folder: Path) -> dict[str, tuple[Path, tuple[str, ...]]]:
    """The recordings of the bus ``link`` of a run."""
    with undrawn():
        bussim.run(run, out=folder / "run", trace=True)
    return recordings(folder, "link")


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
    # Of two that send at once a sample more or less moves a bit, and with it what is between two silences.
    pieces = {"text": 20, "sr": run["damaged"] // 50}.get(kind, 0) if overlapping else 0
    assert found["frames"] == pytest.approx(run["frames"], abs=1 + short + pieces)
    assert found["damaged"] == pytest.approx(run["damaged"], abs=allowed)
    for outcome in {*run["outcomes"], *found["outcomes"]} - {"undecided"}:
        ours, theirs = (each["outcomes"].get(outcome, 0) for each in (found, run))
        assert ours == pytest.approx(theirs, abs=max(1, theirs // 50) + parity), outcome


@pytest.mark.parametrize("seed", quick(1, range(100)))
def test_a_run_is_the_same_in_every_recording_of_it(seed: int, tmp_path: Path) -> None:
    kinds = of_run(from_data(scenario(seed)), tmp_path)
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


#: Of these more is on the line later on: collisions, programs that begin to poll.
LONG = {"same_number_twice": 20, "two_masters": 20, "manual_programs": 20, "foreign_block": 20}
#: Its program is refused before anything is sent.
SILENT = "bad_parameter"


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in builtin.names() if name != SILENT])
def test_a_built_in_scenario_is_the_same_in_every_recording_of_it(name: str, tmp_path: Path) -> None:
    with undrawn():
        bussim.run(bussim.load(name, [f"duration={LONG.get(name, 8)}s"]), out=tmp_path / "run", trace=True)
    for bus in read_trace(tmp_path / "run").header.buses:
        run = sniffed(tmp_path / "run", "--bus", bus.name)
        if run["protocol"] is None:
            continue  # the free protocol has no frames of its own
        for kind, (path, options) in recordings(tmp_path, bus.name).items():
            protocol = ("--protocol", run["protocol"]) if kind == "text" else ()
            found = sniffed(path, *options, *protocol)
            assert_same(run, found, kind, overlapping=name in ("two_masters", "same_number_twice"))
            if kind == "sr":
                assert found["channels"] == [bus.name]


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
    kinds = of_run(bussim.load("late_release", ["duration=60s"]), tmp_path)
    run, packets = (sniffed(kinds[kind][0], *kinds[kind][1]) for kind in ("run", "pcapng"))
    keys = ("frames", "damaged", "strays", "stray_characters", "outcomes")
    assert run["damaged"] > 100
    assert run["strays"] > 0
    assert [packets[key] for key in keys] == [run[key] for key in keys]


def test_what_is_read_says_how_far_it_is(tmp_path: Path) -> None:
    for kind, (path, _) in of_run(from_data(scenario(1)), tmp_path).items():
        said: list[tuple[str, int, int]] = []
        line = open_line(
            str(path), Settings(), bus=None, tolerance=0, progress=lambda *each, said=said: said.append(each)
        )
        read(line, None, None)
        assert {what for what, _, _ in said} == {
            "reading",
            *(["looking for the line"] if kind == "sr" else []),
        }
        assert all(0 <= done <= total for _, done, total in said), kind
        if kind == "sr":
            assert said[-1][1] == said[-1][2]
