"""What is estimated of simulated lines covers what they were made with; what is written behaves alike.

Bounds are those that a right program misses less than once in 200 times; the seeds are fixed.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

import pytest

from bussim.cli import main
from bussim.line.characters import CharFormat, LineTiming
from bussim.live.fit.modbus import BusEstimate
from bussim.live.sniff.heard import LineProtocol
from bussim.units import TICKS_PER_MS
from tests.live.fit.acceptance import (
    INDEPENDENT,
    ROWS,
    RTU,
    Known,
    bus,
    bus_data,
    estimate,
    link,
    right,
    traced,
)
from tests.live.fit.test_statistics import covers
from tests.live.recordings.generator import Serial, modbus, nn_link, sigrok, wave
from tests.live.recordings.test_frames import strays
from tests.selection import quick

SEEDS = range(8)


def misses(row: str, seeds: Iterable[int] = SEEDS) -> int:
    """How many intervals do not cover their truth; whatever else is asked of a row is so."""
    found = [(seed, each) for seed in seeds for each in ROWS[row][0](seed)]
    assert [each for each in found if not isinstance(each[1], Known) and not right(each[1])] == []
    return sum(not right(each) for _, each in found if isinstance(each, Known))


@pytest.mark.slow
def test_intervals_of_a_link_cover_what_it_was_made_with() -> None:
    """Eight lines, five figures: more than six of forty 95 % intervals miss once in 300 times."""
    assert misses("link run") <= 6


@pytest.mark.slow
def test_intervals_of_a_bus_cover_what_it_was_made_with() -> None:
    """Eight lines, four figures: more than five of 32 95 % intervals miss once in 180 times."""
    assert misses("bus run") <= 5


@pytest.mark.parametrize(
    ("kind", "share"), quick(1, [(k, s) for s in (1.0, 0.1) for k in ("text", "rtu", "nn")])
)
def test_strays_change_no_estimate(
    kind: str, share: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Lone characters behind frames, however many, the last one aside: the recording ends with that."""
    serial = Serial(38400, 7, "E", 1) if kind == "nn" else Serial(9600, 8, "E", 1)
    plain = nn_link(serial, 60) if kind == "nn" else modbus(serial, 20, 5, lost=0.1)[0]
    found = []
    for sent in (plain, [*strays(plain[:-1], serial, share, 2)[0], plain[-1]]):
        if kind == "text":
            path = tmp_path / "line.txt"
            ends = [f"{each.at + serial.lasts(len(each.chars)):.6f} {each.chars.hex()}" for each in sent]
            path.write_text("\n".join(ends), encoding="utf-8")
        else:
            rate = 10 * serial.baud
            path = sigrok(tmp_path / "line.sr", rate, {"D0": wave(sent, serial, rate)})
        line = ("-b", "9600", "-P", "even") if kind == "text" else ()
        assert main(["fit", str(path), *line, "--simulate", "0 s", "--json"]) == 0
        found.append(json.loads(capsys.readouterr().out))
    assert found[0] == found[1]


@pytest.mark.slow
def test_bursts_are_seen_and_their_times_lie_within_the_intervals() -> None:
    """Of 300 and 10 ms: seen in 95 of 100, so hardly ever in fewer than six of eight; covered in 85, four."""
    found = [{each.name: right(each) for each in ROWS["bursts"][0](seed)} for seed in SEEDS]
    assert sum(each["seen"] for each in found) >= 6
    assert sum(each["both times covered"] for each in found) >= 4


@pytest.mark.slow
def test_independent_errors_of_the_same_mean_are_no_bursts() -> None:
    assert sum(link(seed, INDEPENDENT).noise.bursts.seen is True for seed in range(6)) == 0


@pytest.mark.slow
def test_noise_at_the_masters_receiver_is_found_there() -> None:
    """Eight 95 % intervals: more than two miss once in 170 times.

    In the last two a start bit is damaged: the receiver takes another one for it, and the master repeats later.
    """
    assert misses("master", (*SEEDS, 9, 23)) <= 2


@pytest.mark.slow
def test_noise_of_one_senders_frames_is_told_from_that_of_all() -> None:
    one = bus(1, 20, {"station": "one", "direction": "tx", "ber": 1e-3}).noise
    assert covers(one.senders[1], 1e-3)
    assert one.senders[0].value == one.senders[2].value == 0
    assert bus(1, 20, {"ber": 3e-4}).noise.senders == {}


@pytest.mark.slow
def test_damage_and_loss_count_once() -> None:
    """In the last one a sound reply is asked for again: as soon as others are followed, for it was damaged."""
    assert misses("once", (*range(4), 15)) == 0


@pytest.mark.slow
def test_a_turn_that_is_due_behind_a_late_one_shows_no_timeout() -> None:
    """Of one request only, with lost replies: a turn comes sooner than the timeout behind one that was late."""
    data = bus_data(2, 40, {"ber": 1e-5}, {"station": "one", "reply_loss": 0.1})
    panel = data["devices"][2]
    panel |= {"timeout": "100 ms", "interval": "20 ms", "polls": [panel["polls"][0] | {"every": "200 ms"}]}
    data["buses"][0] |= {"baud": 9600, "format": "8N1"}
    found = estimate(traced(data), LineProtocol.RTU, LineTiming(9600, CharFormat(8, "N", 1)))
    assert isinstance(found, BusEstimate)
    assert found.timeout is not None
    assert found.timeout == pytest.approx(120 * TICKS_PER_MS, abs=TICKS_PER_MS)


@pytest.mark.parametrize("retries", [0, 2])
def test_only_a_master_that_repeats_shows_noise_at_its_receiver(retries: int) -> None:
    """Of replies that it sees damaged one that never repeats says nothing: the share is not known, and not 0."""
    data = bus_data(1, 20, {"station": "panel", "direction": "rx", "ber": 2e-4})
    data["devices"][2]["polls"] = [each | {"retries": retries} for each in data["devices"][2]["polls"]]
    found = estimate(traced(data), LineProtocol.RTU, RTU)
    assert isinstance(found, BusEstimate)
    receiver = found.noise.master_receiver
    if retries:
        assert receiver.ber is not None
        assert covers(receiver.ber, 2e-4)
    else:
        assert (receiver.repeats, receiver.loss, receiver.unheard, receiver.ber) == (0, None, None, None)
