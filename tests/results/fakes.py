"""Made-up runs: records as a simulation would send them, from a seeded generator."""

from __future__ import annotations

import random
from dataclasses import dataclass, replace
from typing import Any

from bussim.results.collector import Collector, Rows
from bussim.results.record import RunRecord
from bussim.results.summary import summarise
from bussim.trace import (
    AttemptRecord,
    FrameRecord,
    LinkTotals,
    NoteRecord,
    PlcTotals,
    RunTotals,
    ScanRecord,
    Sink,
)
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND

SEATS = ("press1", "press2", "press3")
REGISTERS = {"D8201": 50, "D8202": 349, "M8191": 1}


@dataclass(frozen=True)
class Fake:
    """Three stations: 50 ms scans, repeats now and then, a fault that kills station 1 for a while."""

    duration: int = 60 * TICKS_PER_SECOND
    seed: int = 7
    bus: str = "link"
    plain: int = 50 * TICKS_PER_MS
    jitter: int = TICKS_PER_MS * 3 // 20
    loss: float = 0.02
    dead: tuple[int, int] | None = (10 * TICKS_PER_SECOND, 15 * TICKS_PER_SECOND)

    def feed(self, sink: Sink) -> RunTotals:
        chance = random.Random(self.seed)
        bus, now, number, failures, errors, polls = self.bus, 0, 0, 0, 0, 0
        flagged = False
        while True:
            is_dead = self.dead is not None and self.dead[0] <= now < self.dead[1]
            if is_dead != flagged and self.dead is not None:
                kind = "fault" if is_dead else "fault_over"
                sink.note(NoteRecord(now, kind, "press2", "power_off press2", {"name": "power_off-0"}))
            length = self.plain + chance.randint(-self.jitter, self.jitter)
            repeats = 6 if is_dead else (1 if chance.random() < self.loss else 0)
            length += repeats * 50 * TICKS_PER_MS
            if now + length > self.duration:
                break
            for repeat in range(repeats):
                sink.failed(bus, now + (repeat + 1) * 50 * TICKS_PER_MS, 1, 1)
            if is_dead and not flagged:
                sink.note(
                    NoteRecord(now + length, "station_error", SEATS[0], "station 1 lost", {"station": 1})
                )
            elif flagged and not is_dead:
                sink.note(
                    NoteRecord(now + length, "recovered", SEATS[0], "station 1 is back", {"station": 1})
                )
            flagged = is_dead
            failures, errors, polls = failures + repeats, errors + is_dead, polls + 2
            if number == 2:
                sink.note(NoteRecord(now, "healthy", bus, "all stations answer", {}))
            if sink.traced:
                self._trace(sink, now)
            for seat in range(3):
                if is_dead:
                    if seat != 1:
                        sink.refreshed(bus, seat, now + seat + 1, [2 - seat])
                else:
                    sink.refreshed(bus, seat, now + seat + 1, None)
            cause = f"station 1 (press2): {repeats} attempts, all 01" if repeats else ""
            sink.scan(ScanRecord(bus, number, now, length, 2 + repeats, repeats, int(is_dead), cause))
            now, number = now + length, number + 1
        link = LinkTotals(
            bus=bus,
            seats=SEATS,
            station_names=dict(enumerate(SEATS)),
            master=SEATS[0],
            slaves=2,
            mode=2,
            retries=5,
            attempts=6,
            timeout=50 * TICKS_PER_MS,
            polls=polls,
            failed_attempts={1: {1: failures, 4: 0}, 2: {}},
            station_errors={1: errors},
            busy=self.duration * 4 // 5,
            frames=5 * number,
            collisions=0,
            undetected=0,
            healthy_at=TICKS_PER_SECOND // 10,
        )
        plcs = tuple(PlcTotals(name, dict(REGISTERS), 7000, 8.8 * TICKS_PER_MS, 712_800) for name in SEATS)
        return RunTotals(self.duration, (link,), plcs, ("a warning",))

    def _trace(self, sink: Sink, now: int) -> None:
        poll = b"\x0510" + b"91"
        sink.frame(
            FrameRecord(self.bus, now, now + 93_750, "press1", "poll", 1, 0, poll, (3,), {}, False, False)
        )
        sink.attempt(AttemptRecord(self.bus, now, now + 700_000, 1, 1, "ok", 0, 30_060))
        sink.attempt(AttemptRecord(self.bus, now + 700_000, now + 4_300_000, 2, 1, "no reply", 1, None))

    def run(
        self, *, traced: bool = False, rows: Rows | None = None, name: str = "three presses"
    ) -> RunRecord:
        collector = Collector(traced=traced, rows=rows, bus_of=dict.fromkeys(SEATS, self.bus))
        return record_of(self.feed(collector), collector, name=name, seed=self.seed)


def record_of(totals: RunTotals, collector: Collector, *, name: str = "fake", seed: int = 7) -> RunRecord:
    links = collector.links(totals)
    summary = summarise(totals, links, scenario=name, seed=seed)
    return RunRecord(summary, totals.duration, links, tuple(collector.notes), collector.left_out)


def quiet(**changes: Any) -> Fake:
    """A run without a single failure."""
    return replace(Fake(loss=0.0, dead=None), **changes)
