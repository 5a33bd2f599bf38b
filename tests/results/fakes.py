"""Made-up runs: records as a simulation would send them, from a seeded generator."""

from __future__ import annotations

import random
from dataclasses import dataclass, replace
from typing import Any

from bussim.results.collector import Collector, Rows
from bussim.results.run_record import RunRecord
from bussim.trace.records import (
    AttemptRecord,
    BusTotals,
    CycleRecord,
    DeviceTotals,
    DeviceValueRecord,
    FrameRecord,
    FreeRecord,
    LinkTotals,
    NoteRecord,
    PlcTotals,
    PollRecord,
    PortTotals,
    RunTotals,
    ScanRecord,
    TransactionRecord,
)
from bussim.trace.sink import Sink
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND

NODES = ("press1", "press2", "press3")
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
                sink.take(NoteRecord(now, kind, "press2", "power_off press2", {"name": "power_off-0"}))
            length = self.plain + chance.randint(-self.jitter, self.jitter)
            repeats = 6 if is_dead else (1 if chance.random() < self.loss else 0)
            length += repeats * 50 * TICKS_PER_MS
            if now + length > self.duration:
                break
            for repeat in range(repeats):
                sink.failed(bus, now + (repeat + 1) * 50 * TICKS_PER_MS, 1, 1)
            if is_dead and not flagged:
                sink.take(
                    NoteRecord(now + length, "station_error", NODES[0], "station 1 lost", {"station": 1})
                )
            elif flagged and not is_dead:
                sink.take(
                    NoteRecord(now + length, "recovered", NODES[0], "station 1 is back", {"station": 1})
                )
            flagged = is_dead
            failures, errors, polls = failures + repeats, errors + is_dead, polls + 2
            if number == 2:
                sink.take(NoteRecord(now, "healthy", bus, "all stations reply", {}))
            if sink.traced:
                self._trace(sink, now)
            for position in range(3):
                if is_dead:
                    if position != 1:
                        sink.refreshed(bus, position, now + position + 1, [2 - position])
                else:
                    sink.refreshed(bus, position, now + position + 1, None)
            cause = f"station 1 (press2): {repeats} attempts, all 01" if repeats else ""
            sink.take(ScanRecord(bus, number, now, length, 2 + repeats, repeats, int(is_dead), cause))
            now, number = now + length, number + 1
        link = LinkTotals(
            bus=bus,
            plc_names=NODES,
            station_names=dict(enumerate(NODES)),
            master=NODES[0],
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
        plcs = tuple(PlcTotals(name, dict(REGISTERS), 7000, 8.8 * TICKS_PER_MS, 712_800) for name in NODES)
        return RunTotals(self.duration, (link,), plcs, ("a warning",))

    def _trace(self, sink: Sink, now: int) -> None:
        poll = b"\x0510" + b"91"
        sink.take(
            FrameRecord(self.bus, now, now + 93_750, "press1", "poll", 1, 0, poll, (3,), {}, False, False)
        )
        sink.take(AttemptRecord(self.bus, now, now + 700_000, 1, 1, "ok", 0, 30_060))
        sink.take(AttemptRecord(self.bus, now + 700_000, now + 4_300_000, 2, 1, "no reply", 1, None))

    def run(
        self, *, traced: bool = False, rows: Rows | None = None, name: str = "three presses"
    ) -> RunRecord:
        collector = Collector(traced=traced, rows=rows, bus_of=dict.fromkeys(NODES, self.bus))
        return record_of(self.feed(collector), collector, name=name, seed=self.seed)


def record_of(totals: RunTotals, collector: Collector, *, name: str = "fake", seed: int = 7) -> RunRecord:
    return collector.run(totals, scenario=name, seed=seed)


def quiet(**changes: Any) -> Fake:
    """A run without a single failure."""
    return replace(Fake(loss=0.0, dead=None), **changes)


@dataclass(frozen=True)
class Feeder:
    """A Modbus bus: a PLC's port polls a stepper twice a round; a scanner talks to another port.

    Of the polls ``position`` (a read) and ``speed`` (a write) every ``bad``-th attempt fails, in
    turn with a timeout, a CRC error, an exception, a framing error and a response to another request;
    a failed attempt is repeated once.
    """

    duration: int = 60 * TICKS_PER_SECOND
    seed: int = 7
    bus: str = "feeder"
    node: str = "press1.COM3"
    bad: int = 20
    timeout: int = 100 * TICKS_PER_MS
    plc_scan: int = 8 * TICKS_PER_MS

    def feed(self, sink: Sink) -> RunTotals:
        chance = random.Random(self.seed)
        now, number, attempts, errors = 10 * TICKS_PER_MS, 0, 0, {3: 0, 8: 0, 9: 0}
        while now + 4 * self.timeout < self.duration:
            start = now
            for poll, function in (("position", 3), ("speed", 16)):
                begun, error = now, None
                for attempt in (1, 2):
                    attempts += 1
                    record = self._attempt(chance, poll, function, attempt, now, attempts)
                    sink.take(record)
                    now = record.taken
                    error = record.error
                    if error in errors:
                        errors[error] += 1
                    if error is None:
                        break
                sink.take(PollRecord(self.bus, self.node, poll, begun, now, attempt, error, begun - start))
            sink.take(CycleRecord(self.bus, self.node, number, start, now - start))
            sink.take(FreeRecord("scan", "scanner", "", "sent", now, now + 9000, b"A1\r", "", 0))
            came = number % 10 != 9
            sink.take(
                FreeRecord(
                    "scan", "press2.COM3", "code", "received", now if came else None, now + 9000,
                    b"A1\r" if came else b"", "end character" if came else "timeout", int(number % 10 == 4),
                )
            )  # fmt: skip
            sink.take(DeviceValueRecord(now, "press1", "D400", number % 65536))
            if sink.traced:
                sink.ends("press1", [start, now])
            number += 1
        return RunTotals(self.duration, (), (), buses=self._buses(attempts), **self._nodes(number, errors))

    def _attempt(
        self, chance: random.Random, poll: str, function: int, attempt: int, now: int, number: int
    ) -> TransactionRecord:
        asked = now + 600_000
        responded = asked + 35 * TICKS_PER_MS + chance.randrange(TICKS_PER_MS)
        served = responded - 500_000
        record = TransactionRecord(
            self.bus, self.node, poll, attempt, 1, function, 0x16, 2, now, asked, responded - 450_000, responded,
            responded, self._end(responded), "ok", None, 0, served, False, 17,
        )  # fmt: skip
        if number % self.bad:
            return record
        what = number // self.bad % 5
        if what == 0:
            over = asked + self.timeout
            return record._replace(
                answer_start=None, answer_end=None, end=over, taken=self._end(over), served=None,
                outcome="no response in time", error=9, chars=8,
            )  # fmt: skip
        if what == 1:
            return record._replace(outcome="CRC or LRC", error=3, served=None)
        if what == 2:
            return record._replace(outcome="exception", error=2, exception=2, served=None)
        if what == 3:
            return record._replace(outcome="framing", error=8, served=None)
        return record._replace(mismatched=True, served=None)

    def _end(self, tick: int) -> int:
        """The PLC's next END."""
        return -(-tick // self.plc_scan) * self.plc_scan

    def _buses(self, attempts: int) -> tuple[BusTotals, ...]:
        nodes = (self.node, "feeder1")
        return (
            BusTotals(self.bus, 9600, "8N1", nodes, self.duration // 4, 2 * attempts, 0, 1),
            BusTotals("scan", 19200, "8N1", ("press2.COM3", "scanner"), 0, attempts, 0, 0),
        )

    def _nodes(self, rounds: int, errors: dict[int, int]) -> dict[str, Any]:
        slave = {
            "requests": 30,
            "answered": 29,
            "exceptions": {3: 1, 4: 0},
            "rejected": {"CRC or LRC wrong": 2},
        }
        plain: dict[str, Any] = {"requests": 0, "answered": 0, "exceptions": {}, "rejected": {}}
        ports = (
            PortTotals(
                self.node, "press1", "COM3", self.bus, "modbus-rtu-master", None, errors, **plain,
                timeout=self.timeout,
            ),
            PortTotals("press1.COM5", "press1", "COM5", "hmi", "modbus-rtu-slave", 4, {}, **slave),
            PortTotals("press2.COM3", "press2", "COM3", "scan", "free", None, {}, **plain),
            PortTotals("press2.COM5", "press2", "COM5", "hmi", None, None, {0: 1}, **plain),
        )  # fmt: skip
        devices = (
            DeviceTotals(
                "feeder1", "stepper", self.bus, 1, 2 * rounds, 2 * rounds, 0, {2: 1}, {}, {"position": 20000}
            ),
            DeviceTotals("scanner", "free", "scan", None, 0, 0, 0, {}, {}, {}),
            DeviceTotals("panel", "hmi", "hmi", None, 0, 0, 0, {}, {}, {}, timeout=500 * TICKS_PER_MS),
        )
        return {"ports": ports, "devices": devices}

    def run(self, *, traced: bool = False, rows: Rows | None = None, name: str = "feeder") -> RunRecord:
        collector = Collector(traced=traced, rows=rows)
        return record_of(self.feed(collector), collector, name=name, seed=self.seed)
