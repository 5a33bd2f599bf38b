"""Random scenarios: every kind of noise and fault, overlapping, on links of all sorts."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from random import Random
from typing import Any

from bussim.line.characters import CharFormat, LineTiming
from bussim.plc.profiles import PROFILES, AbsentStation, Attempts, ErrorCount, Profile, Reply, Turnaround
from bussim.plc.sources import Counter, Source, Toggle
from bussim.scenario import fault_kinds, model
from tests.sim.build import MS, SECOND, TURNAROUND, link, plc

TIMINGS = (
    LineTiming(19200, CharFormat(7, "E", 1)),
    LineTiming(38400, CharFormat(8, "N", 1)),
    LineTiming(38400, CharFormat(7, "O", 1)),
    LineTiming(115200, CharFormat(8, "E", 2)),
)


def _profile(rng: Random) -> Profile:
    return replace(
        PROFILES[rng.choice(["pw10", "fx2n"])],
        attempts=rng.choice(list(Attempts)),
        absent_station=rng.choice(list(AbsentStation)),
        error_count=rng.choice(list(ErrorCount)),
        reply=rng.choice([Reply.INTERRUPT, Reply.INTERRUPT, Reply.END]),
        # Without jitter stations fall into step: many things at one tick.
        turnaround=Turnaround(TURNAROUND, rng.choice([0, 7200, 7200])),
    )


def _window(rng: Random, seconds: float, *, endless: float) -> model.Window:
    at = 0 if rng.random() < 0.3 else int(rng.random() * seconds * SECOND)
    lasting = None if rng.random() < endless else 1 + int(rng.random() ** 2 * 0.4 * SECOND)
    return model.Window(at, lasting)


def _noise(rng: Random, number: int, names: list[str], seconds: float) -> model.Noise:
    station = rng.choice([None, *names])
    target = model.Target("link", station, rng.choice(list(fault_kinds.Direction)))
    ber = 10 ** rng.uniform(-4, -1.5)
    kind = rng.choice(
        [
            model.BitErrors(ber),
            model.Burst(rng.randint(1, 100) * MS, rng.randint(1, 20) * MS, 0.0, 0.05),
            model.Impulse(rng.randint(5, 40) * MS, rng.randint(2000, 80_000), 0.4),
            model.ReplyLoss(rng.choice([0.01, 0.2])),
        ]
    )
    return model.Noise(f"noise{number}", target, kind, _window(rng, seconds, endless=0.6))


def _kind(rng: Random, name: str) -> fault_kinds.FaultKind:
    direction = rng.choice(list(fault_kinds.Direction))
    count = rng.choice([None, 1, 3])
    return rng.choice(
        [
            fault_kinds.PowerOff(name),
            fault_kinds.PowerOff(name),
            fault_kinds.Stop(name),
            fault_kinds.Stop(name),
            fault_kinds.DropReply(name, count),
            # The timeout is 50 or 60 ms: many of these come in the wrong attempt, or in that of another station.
            fault_kinds.Slow(name, rng.randint(1, 90) * MS),
            fault_kinds.Slow(name, rng.randint(48, 66) * MS),
            fault_kinds.Slow(name, rng.randint(48, 66) * MS),
            fault_kinds.Slow(name, rng.randint(48, 66) * MS),
            fault_kinds.Slow(name, rng.randint(48, 66) * MS),
            fault_kinds.Jabber(name),
            fault_kinds.CableCut("link", name),
            fault_kinds.WrongFormat(name, rng.choice(TIMINGS)),
            fault_kinds.ClockPpm(name, Fraction(rng.choice([-60_000, -200, 200, 25_000, 60_000]))),
            fault_kinds.LateRelease(name, rng.choice([1000, 20_000, 40_000, 90_000])),
            fault_kinds.LoseChar(name, direction, count, rng.choice([None, 0, 3])),
            fault_kinds.InsertChar(
                name, direction, count, rng.choice([None, 0, 3]), rng.choice([None, 2, 3, 5, 0x30])
            ),
            fault_kinds.Pause(
                name, rng.choice([1000, 20_000, 40_000, 90_000]), count, rng.choice([None, 0, 3])
            ),
            fault_kinds.FlipBits(
                name,
                direction,
                tuple(rng.randrange(400) for _ in range(rng.randint(1, 4))),
                count,
                rng.choice([None, "data", "poll", "parameters"]),
            ),
            # Bits 0 and 1 of two neighbours: often neither parity nor sum shows it.
            fault_kinds.FlipBits("p0", fault_kinds.Direction.TX, (11, 12, 21, 22), None, "poll"),
            fault_kinds.BoardError(name, "COM4", 5),
        ]
    )


def scenario(seed: int, seconds: float = 0.7) -> model.Scenario:
    """A random scenario, the same for the same seed."""
    rng = Random(seed)
    stations, profile = rng.choice([2, 3, 3, 3, 4, 5]), _profile(rng)
    others: dict[int, dict[str, Any]] = {}
    for station in range(stations):
        word = profile.word_spacing * station
        sources: dict[str, Source] = {
            f"D{word}": Counter(rng.randint(1, 50) * MS),
            f"M{1000 + 64 * station}": Toggle(rng.randint(1, 50) * MS),
        }
        mean = rng.randint(1, 12) * MS
        others[station] = {
            # One slave in twenty is of a family that has mode 0 only.
            "profile": PROFILES["fx1s"] if station and rng.random() < 0.05 else profile,
            "scan": model.Scan(mean, rng.choice([0, mean // 3])),
            "phase": rng.choice([None, None, 0, 3 * MS]),
            "power_on": rng.choice([0, 0, 0, rng.randint(0, 300) * MS]),
            "sources": sources,
        }
    more: list[model.Plc] = []
    if rng.random() < 0.25:
        twin = rng.randint(0, stations - 1)
        registers = {"D8177": stations - 1} if twin == 0 else {}
        more.append(plc(twin, profile=profile, name="twin", registers=registers, phase=2 * MS))
    names = [f"p{k}" for k in range(stations)] + [other.name for other in more]
    noise = [_noise(rng, number, names, seconds) for number in range(rng.choice([0, 0, 1, 2]))]
    faults = [
        model.Fault(f"fault{number}", _kind(rng, rng.choice(names)), _window(rng, seconds, endless=0.2))
        for number in range(rng.choice([0, 1, 2, 3, 5]))
    ]
    return link(
        stations,
        rng.choice([0, 0, 1, 2]),
        seconds=seconds,
        retries=rng.choice([0, 0, 0, 1, 2]),
        units=rng.randint(5, 6),
        profile=profile,
        seed=seed,
        others=others,
        more=more,
        noise=noise,
        faults=faults,
    )
