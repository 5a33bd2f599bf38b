"""Silences and lengths alone: against what simulated links record of themselves, and on lines that are no N:N links."""

import random
from collections import Counter

import pytest

import bussim
from bussim.line.characters import NN_LINE
from bussim.live.layout.silences import Burst, Polling, bursts, polling
from bussim.live.recordings.frames import TraceFile
from bussim.live.recordings.source import LineSetup
from bussim.trace.records import AttemptRecord, ScanRecord
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND

CHARACTER = NN_LINE.characters(1)


def outcomes(found: Polling) -> Counter[tuple[int, bool]]:
    """Attempts by station, and by whether they failed."""
    return Counter((each.station, each.failed) for scan in found.scans for each in scan.attempts)


@pytest.mark.parametrize(
    ("name", "duration", "timeout", "torn"),
    [
        ("press_line", "5 s", None, 0),
        pytest.param("electrical_noise", "30 s", 50, 0, marks=pytest.mark.slow),
        # The recorder sees the end of a reply that a dip of the supply cuts as a late one.
        pytest.param("drops_out_and_rejoins", "60 s", 60, 2, marks=pytest.mark.slow),
    ],
)
def test_a_simulated_link_is_read_as_its_master_saw_it(
    name: str, duration: str, timeout: int | None, torn: int
) -> None:
    trace = bussim.run(bussim.load(name, [f"duration={duration}"]), rows=False, trace=True).open_trace()
    bus = trace.header.buses[0]
    source = TraceFile(trace, bus)
    found = polling(list(bursts(source.chunks(LineSetup(NN_LINE)), CHARACTER)), CHARACTER)
    assert found is not None
    truth = Counter((each.station, each.code != 0) for each in trace.of(AttemptRecord))
    assert (outcomes(found) - truth).total() + (truth - outcomes(found)).total() <= torn
    scans = [each.duration for each in trace.of(ScanRecord)]
    assert [scan.duration for scan in found.scans if scan.duration is not None] == scans
    assert found.stations == max(station for station, _ in truth)
    assert (found.timeout is None) == (timeout is None)
    if timeout is not None and found.timeout is not None:
        assert found.timeout / TICKS_PER_MS == pytest.approx(timeout, abs=0.2)


def line(
    replies: tuple[int, ...],
    *,
    pause: float,
    loss: float = 0.0,
    dead: tuple[int, ...] = (),
    alike: bool = False,
    own: bool = False,
) -> tuple[list[Burst], float, dict[int, int]]:
    """A master with polls of eight characters: bursts, mean cycle in ms, attempts by station.

    ``own``: it begins each cycle with data of its own, as long as the first station's.
    """
    rng, now = random.Random(1), 0.1
    found, starts, attempts = [], [], Counter[int]()

    def send(chars: bytes) -> None:
        nonlocal now
        start = now
        now += len(chars) * 0.00026
        found.append(Burst(round(start * TICKS_PER_SECOND), round(now * TICKS_PER_SECOND), chars))

    for _ in range(200):
        starts.append(now)
        if own:
            send(rng.randbytes(replies[0]))
            now += 0.004
        for station, size in enumerate(replies, 1):
            for _ in range(3):
                send(bytes([station] * 8) if alike else rng.randbytes(8))
                attempts[station] += 1
                if station in dead or rng.random() < loss:
                    now += 0.204
                    continue
                now += rng.uniform(0.003, 0.006)
                send(rng.randbytes(size))
                now += 0.004
                break
        now += pause
    return found, 1000 * (starts[-1] - starts[0]) / (len(starts) - 1), dict(attempts)


@pytest.mark.parametrize(
    ("replies", "options"),
    [
        ((7, 25, 9), {"pause": 0.05}),
        ((7, 7), {"pause": 0.05}),
        ((15, 25, 9), {"pause": 0.05, "loss": 0.02}),
        ((15, 25, 9), {"pause": 0.05, "dead": (2,)}),
        ((15, 25, 9), {"pause": 0.05, "dead": (3,)}),
        ((15, 25, 9), {"pause": 0.0, "alike": True}),
        ((25, 25, 25), {"pause": 0.004, "own": True, "dead": (3,)}),
        ((25, 25, 25), {"pause": 0.004, "own": True, "dead": (2,)}),
        ((25, 25, 25), {"pause": 0.004, "own": True, "dead": (2, 3), "alike": True}),
        ((25, 25, 25), {"pause": 0.004, "own": True, "dead": (1, 3)}),
    ],
)
def test_what_a_master_polls_is_understood(replies: tuple[int, ...], options: dict[str, object]) -> None:
    found, mean, attempts = line(replies, **options)  # type: ignore[arg-type]
    polled = polling(found, CHARACTER)
    assert polled is not None
    assert polled.stations == len(replies)
    durations = [scan.duration for scan in polled.scans if scan.duration is not None]
    assert sum(durations) / len(durations) / TICKS_PER_MS == pytest.approx(mean, abs=0.1)
    seen = Counter(each.station for scan in polled.scans for each in scan.attempts)
    for station, count in attempts.items():
        assert count - 1 <= seen[station] <= count  # the last one may be open


def test_where_neither_silences_nor_polls_differ_nothing_is_said() -> None:
    found, _, _ = line((15, 25, 9), pause=0.0)
    assert polling(found, CHARACTER) is None
