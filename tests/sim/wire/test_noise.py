"""Noise on the line: how often it hits, whom, and that it leaves all other random streams alone."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import sqrt
from typing import Any

import pytest

from bussim.plc.profiles import PROFILES
from bussim.scenario import fault_kinds, model
from bussim.trace.records import FrameRecord
from tests.selection import quick
from tests.sim.build import (
    CHAR,
    GAP,
    MS,
    POLL,
    SECOND,
    TURNAROUND,
    Done,
    data,
    fault,
    link,
    plain_scan,
    plc,
    run,
    timeout,
)

TX, RX = fault_kinds.Direction.TX, fault_kinds.Direction.RX
BIT = 1875
#: A difference of so many standard deviations comes once in 16,000 tests.
SIGMAS = 4


def noise(
    kind: model.NoiseKind,
    station: str | None = None,
    direction: fault_kinds.Direction = RX,
    window: model.Window | None = None,
    name: str = "noise",
) -> model.Noise:
    return model.Noise(name, model.Target("link", station, direction), kind, window or model.Window())


def bits(frame: FrameRecord) -> int:
    return 10 * len(frame.chars)


def binomial(hits: int, chances: list[float]) -> bool:
    """Whether so many hits are what these chances give, within the bound."""
    mean = sum(chances)
    return abs(hits - mean) <= SIGMAS * sqrt(sum(p * (1 - p) for p in chances))


# -- independent bit errors ------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("ber", [1e-4, 2e-3])
def test_bit_errors_hit_with_the_exact_probability(ber: float) -> None:
    done = run(link(3, 0, retries=2, seconds=30, noise=[noise(model.BitErrors(ber))]))
    frames = [frame for frame in done.record.frames if not frame.cut]
    hit = [frame for frame in frames if frame.damaged_bits]
    assert len(frames) > 1500
    # 1 - (1 - p)^n for each frame; n p for the number of bits.
    assert binomial(len(hit), [1 - (1 - ber) ** bits(frame) for frame in frames])
    total = sum(map(bits, frames))
    wrong = sum(len(frame.damaged_bits) for frame in frames)
    assert abs(wrong - total * ber) < SIGMAS * sqrt(total * ber * (1 - ber))
    # Anywhere in a frame alike: the places have the mean of a uniform variable.
    indices = [(index + 0.5) / bits(frame) for frame in hit for index in frame.damaged_bits]
    assert abs(sum(indices) / len(indices) - 0.5) < SIGMAS / sqrt(12 * len(indices))
    assert all(0 <= index < bits(frame) for frame in hit for index in frame.damaged_bits)
    assert done.link.undetected == 0
    # Nearly every hit costs an attempt; those of the master's data frame cost none.
    exchanges = [frame for frame in hit if not (frame.sender == "p0" and frame.kind == "data")]
    assert len(done.record.failures) <= len(exchanges)
    assert len(done.record.failures) >= 0.7 * len(exchanges)


@pytest.mark.parametrize("station", quick(1, ["p1", "p0"]))
def test_noise_on_a_sender_damages_its_frames_for_all(station: str) -> None:
    done = run(link(3, 0, seconds=10, noise=[noise(model.BitErrors(3e-3), station, TX)]))
    assert {frame.sender for frame in done.record.frames if frame.damaged_bits} == {station}
    assert not any(frame.damaged_at for frame in done.record.frames)
    own = [frame for frame in done.record.frames if frame.sender == station]
    assert binomial(sum(bool(f.damaged_bits) for f in own), [1 - 0.997 ** bits(f) for f in own])


def test_noise_in_a_receiver_damages_what_that_station_receives() -> None:
    done = run(link(3, 0, seconds=10, noise=[noise(model.BitErrors(3e-3), "p2", RX)]))
    frames = done.record.frames
    assert not any(frame.damaged_bits for frame in frames)
    hit = [frame for frame in frames if frame.damaged_at]
    assert {name for frame in hit for name in frame.damaged_at} == {"p2"}
    heard = [frame for frame in frames if frame.sender != "p2"]
    assert binomial(len(hit), [1 - 0.997 ** bits(frame) for frame in heard])
    assert "p2" not in {frame.sender for frame in hit}
    # The master and p1 hear each other as if there were no noise.
    assert not any(station == 1 for _, _, station, _ in done.record.failures)
    assert done.about("p0", 1) == done.about("p1", 0) == (0, 0, 0)
    assert done.about("p2", 0)[1] == 0x14


def test_a_window_begins_and_ends_noise_to_the_bit() -> None:
    window = model.Window(SECOND, SECOND // 2)
    done = run(link(3, 1, seconds=2, noise=[noise(model.BitErrors(1.0), window=window)]))
    for frame in done.record.frames:
        inside = tuple(
            index
            for index in range(bits(frame))
            if SECOND <= frame.start + index * BIT + BIT / 2 < SECOND * 3 // 2
        )
        assert frame.damaged_bits == inside
    assert {len(f.damaged_bits) for f in done.record.frames} >= {0, 50}


# -- bursts and impulses ---------------------------------------------------------------------------


@pytest.mark.slow
def test_bursts_cover_their_share_of_the_traffic() -> None:
    good, bad, ber = 200 * MS, 50 * MS, 0.5
    burst = noise(model.Burst(good, bad, 0.0, ber))
    done = run(link(2, 0, retries=0, seconds=120, noise=[burst]), traced=True)
    frames = done.record.frames
    # A bit in the bad state is wrong with probability one half: a frame is bad if any is.
    bad_frames = [bool(frame.damaged_bits) for frame in frames]
    wrong = sum(len(frame.damaged_bits) for frame in frames)
    total = sum(map(bits, frames))
    share = bad / (good + bad)
    # Of exponential good and bad times the share over a time T has the variance 2 (g b)² / ((g + b)³ T).
    variance = 2 * (good * bad) ** 2 / ((good + bad) ** 3 * done.totals.duration)
    # A burst slows the link down: fewer frames are sent in it than outside. So each frame stands for
    # the time up to the next one.
    starts = [frame.start for frame in frames] + [done.totals.duration]
    covered = sum(
        after - before for (before, after), was in zip(pairwise(starts), bad_frames, strict=True) if was
    )
    # A frame is bad if a burst touches it: the share grows by a frame and a timeout at each burst's end.
    edges = data(0) + timeout(5)
    assert covered / done.totals.duration > share - SIGMAS * sqrt(variance)
    assert covered / done.totals.duration < share + SIGMAS * sqrt(variance) + edges / (good + bad)
    assert 0 < wrong / total < ber * share


@pytest.mark.slow
@pytest.mark.parametrize("width", [BIT // 2, 5 * BIT, 40 * BIT])
def test_impulses_hit_the_bits_that_they_cover(width: int) -> None:
    every, phase, ber = 20 * MS, 3 * MS, 0.4
    impulse = noise(model.Impulse(every, width, ber, phase))
    done = run(link(3, 1, retries=3, seconds=15, noise=[impulse]))
    exposed = wrong = 0
    chances = []
    hit = 0
    for frame in done.record.frames:
        covered = {
            index
            for index in range(bits(frame))
            if frame.start + index * BIT + BIT / 2 >= phase
            and (frame.start + index * BIT + BIT / 2 - phase) % every < width
        }
        assert set(frame.damaged_bits) <= covered
        exposed += len(covered)
        wrong += len(frame.damaged_bits)
        chances.append(1 - (1 - ber) ** len(covered))
        hit += bool(frame.damaged_bits)
    assert exposed > 100
    assert abs(wrong - exposed * ber) < SIGMAS * sqrt(exposed * ber * (1 - ber))
    assert binomial(hit, chances)


def test_an_impulse_without_a_phase_has_a_random_one_of_its_own() -> None:
    def first_hit(seed: int, name: str) -> int:
        impulse = noise(model.Impulse(100 * MS, 60 * MS, 1.0), name=name)
        frames = run(link(2, 0, seed=seed, seconds=0.5, noise=[impulse])).record.frames
        return next(f.start + f.damaged_bits[0] * BIT for f in frames if f.damaged_bits)

    phases = {first_hit(seed, name) % (100 * MS) for seed in range(6) for name in ("a", "b")}
    assert len(phases) > 6
    assert first_hit(3, "a") == first_hit(3, "a")


# -- lost replies ----------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(("station", "who"), [(None, {1, 2}), ("p1", {1}), ("p2", {2})])
def test_replies_vanish_with_their_probability(station: str | None, who: set[int]) -> None:
    loss = 0.05
    done = run(link(3, 0, retries=8, seconds=60, noise=[noise(model.ReplyLoss(loss), station)]))
    attempts = [a for a in done.record.attempts if a.station in who]
    lost = [a for a in attempts if a.code]
    assert {a.station for a in done.record.attempts if a.code} == who
    assert {a.code for a in lost} == {1}
    assert abs(len(lost) - len(attempts) * loss) < SIGMAS * sqrt(len(attempts) * loss * (1 - loss))
    # Whole: each loss costs an attempt, to the tick.
    for scan in done.record.scans:
        assert scan.duration == plain_scan(3, 0) + scan.failed * (GAP + POLL + timeout(5))
    # Neighbouring attempts are independent: two losses in a row come with the square.
    pairs = sum(a.number >= 2 for a in lost)
    chance = loss * loss
    firsts = sum(a.number == 1 for a in attempts)
    assert abs(pairs - firsts * chance) < SIGMAS * sqrt(firsts * chance) + 2


def test_lost_replies_have_a_window_too() -> None:
    window = model.Window(SECOND, SECOND)
    done = run(link(2, 0, retries=0, seconds=3, noise=[noise(model.ReplyLoss(1.0), window=window)]))
    for attempt in done.record.attempts:
        due = attempt.start + POLL + TURNAROUND
        assert (attempt.code == 1) is (SECOND <= due < 2 * SECOND)


def test_without_loss_or_with_none_left_nothing_happens() -> None:
    assert run(link(3, 0, seconds=2, noise=[noise(model.ReplyLoss(0.0))])).record.failures == []
    assert run(link(3, 0, seconds=2, noise=[noise(model.BitErrors(0.0))])).record.failures == []


# -- whose rng is whose ---------------------------------------------------------------------------

EVERYTHING = (
    noise(model.BitErrors(5e-4), name="ber"),
    noise(model.Burst(300 * MS, 20 * MS, 0.0, 0.02), name="burst"),
    noise(model.Impulse(170 * MS, 3 * BIT, 0.5), name="impulse"),
    noise(model.ReplyLoss(0.02), name="loss"),
    noise(model.BitErrors(1e-3), "p2", RX, name="receiver"),
    noise(model.BitErrors(1e-3), "p1", TX, name="sender"),
)


def _records(done: Done) -> list[Any]:
    record = done.record
    notes = [note for note in record.notes if note.where not in ("fourth", "silent")]
    # Several stations may note something at one tick, in any order.
    notes.sort(key=lambda note: (note.tick, note.where))
    return [record.scans, record.attempts, record.frames, record.failures, notes]


@pytest.mark.parametrize("how", quick(1, ["listening", "in stop", "off", "refused"]))
@pytest.mark.parametrize("index", quick(1, ("first", "last")))
def test_a_silent_fourth_station_changes_no_draws(how: str, index: str) -> None:
    # Jitter of scans and turnarounds is rng as well.
    others = {station: {"scan": model.Scan(8 * MS, 3 * MS)} for station in range(3)}
    scenario = link(3, 1, retries=2, seconds=8, profile=PROFILES["pw10"], others=others, noise=EVERYTHING)
    three = run(scenario)
    registers = {"D8176": 9} if how == "refused" else {}
    fourth = plc(3, name="fourth", profile=PROFILES["pw10"], registers=registers)
    plcs = (*scenario.plcs, fourth) if index == "last" else (fourth, *scenario.plcs)
    kinds = {"in stop": fault_kinds.Stop("fourth"), "off": fault_kinds.PowerOff("fourth")}
    faults = (model.Fault("silent", kinds[how]),) if how in kinds else ()
    four = run(replace(scenario, plcs=plcs, faults=faults))
    assert len(three.record.failures) > 10
    assert not [frame for frame in four.record.frames if frame.sender == "fourth"]
    assert _records(four) == _records(three)
    assert four.link.failed_attempts == three.link.failed_attempts
    for name in ("p0", "p1", "p2"):
        assert four.registers(name) == three.registers(name)


def rngs(done: Done) -> dict[tuple[str, str, int | None], list[tuple[int, ...]]]:
    """Damage of the wire by who sends what to whom, frame after frame."""
    found: dict[tuple[str, str, int | None], list[tuple[int, ...]]] = {}
    for frame in done.record.frames:
        found.setdefault((frame.sender, frame.kind, frame.station), []).append(frame.damaged_bits)
    return found


@pytest.mark.parametrize(
    "added",
    quick(
        1,
        [
            noise(model.BitErrors(2e-3), "p2", RX, name="added"),
            noise(model.ReplyLoss(0.1), "p2", name="added"),
            noise(model.ReplyLoss(0.1), name="added"),
        ],
    ),
)
def test_a_noise_elsewhere_leaves_the_draws_of_others(added: model.Noise) -> None:
    base = noise(model.BitErrors(2e-3), name="base")
    one = rngs(run(link(3, 0, retries=1, seconds=10, noise=[base])))
    two = rngs(run(link(3, 0, retries=1, seconds=10, noise=[base, added])))
    three = rngs(run(link(3, 0, retries=1, seconds=10, noise=[added, base])))
    compared = 0
    for key, mine in one.items():
        for other in (two.get(key, []), three.get(key, [])):
            # There may be more or fewer of them, but the nth has the same rng.
            count = min(len(mine), len(other))
            assert mine[:count] == other[:count]
            compared += count
    assert compared > 1000


def test_a_fault_elsewhere_leaves_the_draws_of_others() -> None:
    base = noise(model.BitErrors(2e-3), name="base")
    one = rngs(run(link(3, 0, retries=1, seconds=6, noise=[base])))
    off = fault(fault_kinds.PowerOff("p2"), 2.0, 1.0)
    two = rngs(run(link(3, 0, retries=1, seconds=6, noise=[base], faults=[off])))
    for key in (("p1", "data", 1), ("p0", "poll", 1), ("p0", "data", 0)):
        count = min(len(one[key]), len(two[key]))
        assert count > 50
        assert one[key][:count] == two[key][:count]


def test_the_seed_decides_all_draws() -> None:
    def records(seed: int) -> list[Any]:
        return _records(run(link(3, 1, retries=2, seconds=3, seed=seed, noise=EVERYTHING)))

    assert records(5) == records(5)
    assert records(5) != records(6)


def test_damage_is_found_by_the_receiver_not_by_the_simulator() -> None:
    # Heavy noise: whatever was stored falsely was counted, and nothing else was stored falsely.
    done = run(link(3, 0, retries=1, seconds=20, noise=[noise(model.BitErrors(0.02))]))
    hits = {frame.end for frame in done.record.frames if frame.damaged_bits}
    refreshed = {tick for _, _, tick, _ in done.record.refreshes}
    assert refreshed & hits == set()
    sent = {frame.end for frame in done.record.frames if frame.kind == "data" and not frame.damaged_bits}
    assert refreshed <= sent
    undetected = {note.tick for note in done.notes("undetected")}
    assert len(undetected) == done.link.undetected
    assert undetected <= {tick + late for tick in hits for late in (0, CHAR)}
