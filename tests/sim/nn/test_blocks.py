"""Many link scans at once: whole results folders are the same as of one scan after the other."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import pytest

import bussim
from bussim.line.random_streams import Streams
from bussim.plc.profiles import PROFILES
from bussim.scenario import builtin, fault_kinds, model
from bussim.sim.kernel import Kernel
from bussim.sim.nn.block_path import BlockPath
from bussim.sim.nn.bus import LinkBus
from bussim.sim.wire.receiver import Receiver
from tests.sim.build import SECOND, fault, link, run

LOSS = model.Noise("loss", model.Target("link"), model.ReplyLoss(0.02), model.Window(SECOND, 2 * SECOND))
BURST = model.Noise("burst", model.Target("link"), model.Burst(SECOND // 3, SECOND // 50, 0.0, 2e-3))
NOISE = {
    "none": [],
    "loss within a window": [LOSS],
    "bit errors": [model.Noise("ber", model.Target("link"), model.BitErrors(1e-5))],
    "bit errors at one receiver": [model.Noise("ber", model.Target("link", "p1"), model.BitErrors(3e-5))],
    "bursts": [BURST],
    "impulses": [
        model.Noise("drive", model.Target("link"), model.Impulse(SECOND // 5, SECOND // 500, 1e-2, None))
    ],
}


def folder(scenario: model.Scenario, out: Path, *, traced: bool) -> dict[str, bytes]:
    bussim.run(scenario, out=out, trace=traced)
    return {path.name: path.read_bytes() for path in out.iterdir()}


def told(scenario: model.Scenario, *, traced: bool) -> list[Any]:
    result = bussim.run(scenario, trace=traced)
    found = [result.summary, result.record.histograms(), result.record.notes, result.link_scans.to_csv()]
    return [*found, result.trace if traced else []]


@pytest.mark.parametrize("traced", [False, True])
@pytest.mark.parametrize("name", NOISE)
def test_noise(name: str, traced: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    scenario = link(4, 1, seconds=5, profile=PROFILES["pw10"], noise=NOISE[name])
    at_once = told(scenario, traced=traced)
    monkeypatch.setattr(LinkBus, "in_blocks", False)
    assert told(scenario, traced=traced) == at_once


@pytest.mark.slow
@pytest.mark.parametrize("name", builtin.names())
def test_built_in(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for traced in (False, True):
        scenario = bussim.load(name, ["duration=12 s"])
        at_once = folder(scenario, tmp_path / f"a{traced}", traced=traced)
        with monkeypatch.context() as patch:
            patch.setattr(LinkBus, "in_blocks", False)
            assert folder(scenario, tmp_path / f"b{traced}", traced=traced) == at_once


def test_most_scans_are_done_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    sizes: list[int] = []
    original = BlockPath._pass

    def counted(self: BlockPath, stations: object, scans: object, now: int) -> None:
        sizes.append(scans.number)  # type: ignore[attr-defined]
        original(self, stations, scans, now)  # type: ignore[arg-type]

    monkeypatch.setattr(BlockPath, "_pass", counted)
    for noise in NOISE.values():
        sizes.clear()
        done = run(link(4, 1, seconds=5, noise=noise), traced=False)
        assert sum(sizes) > 0.8 * len(done.record.scans)


@pytest.mark.parametrize("traced", [False, True])
def test_what_is_recorded_every_second_ends_no_block(traced: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    ends: list[int] = []
    original = BlockPath._pass

    def counted(self: BlockPath, stations: object, scans: object, now: int) -> None:
        original(self, stations, scans, now)  # type: ignore[arg-type]
        ends.append(scans.end - now)  # type: ignore[attr-defined]

    monkeypatch.setattr(BlockPath, "_pass", counted)
    scenario = link(4, 1, seconds=9, profile=PROFILES["pw10"])
    at_once = told(scenario, traced=traced)
    assert max(ends) > 8 * SECOND
    monkeypatch.setattr(LinkBus, "in_blocks", False)
    assert told(scenario, traced=traced) == at_once


def test_most_characters_of_damaged_frames_are_received_ahead(monkeypatch: pytest.MonkeyPatch) -> None:
    events = []
    original = Receiver._on_character

    def counted(self: Receiver, now: int) -> None:
        events.append(now)
        original(self, now)

    monkeypatch.setattr(Receiver, "_on_character", counted)
    scenario = link(4, 2, seconds=5, noise=NOISE["bit errors"])
    found = run(scenario, traced=False)
    ahead = len(events)
    monkeypatch.setattr(LinkBus, "in_blocks", False)
    events.clear()
    one_by_one = run(scenario, traced=False)
    assert found.totals == one_by_one.totals
    assert 0 < ahead < 0.3 * len(events)


def test_notes_of_one_tick_come_in_the_order_of_stations() -> None:
    noise = [model.Noise("burst", model.Target("link"), model.Burst(SECOND // 2, SECOND // 20, 0.0, 0.02))]
    dead = [fault(fault_kinds.PowerOff("p0"), 3, 1)]
    done = run(link(8, 2, seconds=6, noise=noise, faults=dead, seed=4, retries=1), traced=False)
    kinds = ("station_error", "watchdog", "recovered")
    ticks = Counter(note.tick for note in done.record.notes if note.kind in kinds)
    together = [tick for tick, number in ticks.items() if number > 2]
    assert len(together) > 2
    for tick in together:
        names = [note.where for note in done.record.notes if note.tick == tick and note.kind in kinds]
        assert names == sorted(names)


def test_looking_at_numbers_ahead_takes_none() -> None:
    streams, at = Streams(5), 0
    numbers = streams.generator("x").random(20_000).tolist()
    drawn = streams.uniforms("x")
    choices = streams.uniforms("choices")
    for _ in range(3_000):
        what, number = int(next(choices) * 4), int(next(choices) * 1_500)
        if what == 0 and at < 15_000:
            assert next(drawn) == numbers[at]
            at += 1
        elif what == 1:
            assert drawn.ahead(number % 40).tolist() == numbers[at : at + number % 40]
        elif what == 2 and at < 15_000:
            drawn.skip(number % 20)
            at += number % 20
        else:
            bound = (0.0, 0.003, 0.003, 0.2)[number % 4]
            free = next((n for n in range(number) if numbers[at + n] < bound), number)
            assert drawn.before(bound, number) == free
    assert at > 5_000


def test_the_next_event_is_none_of_a_timer_that_was_set_anew() -> None:
    kernel, found = Kernel(), []
    timer = kernel.timer(found.append, 3)  # type: ignore[arg-type]
    timer.set(50)
    timer.set(90)
    kernel.at(70, found.append, 2)  # type: ignore[arg-type]
    assert kernel.next() == 70
    seen: list[int] = []
    kernel.run(80, seen.append)
    assert (found, seen, kernel.next()) == ([70], [80], 90)


def test_events_are_passed_up_to_a_tick_and_priority_and_no_further() -> None:
    kernel, found = Kernel(), []
    later = kernel.timer(lambda now: found.append(("later", now)), 2)  # type: ignore[arg-type]

    def first(now: int) -> None:
        found.append(("first", now))
        later.set(70)

    def passing(now: int) -> None:
        assert kernel.next({early}) == 60
        kernel.pass_events(60, 3)
        found.append(("passed", now))

    early = kernel.timer(first, 2)  # type: ignore[arg-type]
    early.set(20)
    for priority in (2, 3):
        kernel.at(60, lambda now, p=priority: found.append((p, now)), priority)  # type: ignore[misc,arg-type]
    kernel.at(10, passing, 2)  # type: ignore[arg-type]
    kernel.run(100)
    assert found == [("first", 20), (2, 60), ("passed", 10), (3, 60), ("later", 70)]
