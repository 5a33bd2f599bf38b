"""Makes records and totals of what the engines of one bus report."""

from __future__ import annotations

from collections import Counter
from copy import deepcopy
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, assert_never

from bussim.engines.nn.codes import MEANINGS
from bussim.engines.nn.events import (
    AllHealthy,
    AttemptEnded,
    MasterWatchdog,
    NnEvent,
    ParametersRefused,
    ParametersTaken,
    PolledWithoutParameters,
    ScanEnded,
    StationBack,
    StationLost,
)
from bussim.engines.nn.master import Master
from bussim.engines.nn.slave import Slave
from bussim.plc.link_registers import (
    D_STATION,
    D_TIMEOUT,
    TIMEOUT_UNIT,
    bad_parameters,
    mode_refusal,
    refusal,
    selected_port,
)
from bussim.plc.plc import Plc
from bussim.sim.nn.contract import LinkStation
from bussim.sim.notes import Notes
from bussim.trace.blocks import Alike
from bussim.trace.records import LATE_REPLY, AttemptRecord, ScanRecord
from bussim.trace.sink import Sink
from bussim.units import format_ms
from bussim.words.language import say

if TYPE_CHECKING:
    import numpy as np


@dataclass(slots=True)
class MasterCounts:
    """What masters have counted: first attempts, failed attempts by station and code, station errors."""

    polls: int = 0
    failed_attempts: dict[int, Counter[int]] = field(default_factory=dict)
    station_errors: Counter[int] = field(default_factory=Counter)

    def add(self, engine: Master) -> None:
        """Add the counts of an engine."""
        self.polls += engine.polls
        for station, by_code in engine.failed_attempts.items():
            self.failed_attempts.setdefault(station, Counter()).update(by_code)
        self.station_errors.update(engine.station_errors)


class LinkReporter(Notes):
    """Writes one bus's records. ``names`` are the first PLC with each station number.

    A link scan's cause names its slowest reply if that came later than ``longest_turnaround`` ticks after
    the poll that it replies to: a simulated station knows which, of another the latest is taken. A bus with
    several masters is reported as the ``primary`` one sees it: the first along the cable.
    """

    def __init__(
        self, bus: str, sink: Sink, names: dict[int, str], primary: str | None, longest_turnaround: int
    ) -> None:
        self._longest_turnaround = longest_turnaround
        self._bus = bus
        super().__init__(sink)
        self._names = names
        self._primary = primary
        # Link scans so far, over all RUNs of the primary master.
        self._scans = 0
        self.healthy_at: int | None = None
        self._slow: dict[
            int, int
        ] = {}  # how late each station's slow reply of this scan began after its poll
        # Of engines of the primary master that have stopped.
        self._stopped = MasterCounts()

    def station_label(self, station: int) -> str:
        """``station 1 (press2)``."""
        name = self._names.get(station)
        return f"station {station} ({name})" if name else f"station {station}"

    # -- engines -----------------------------------------------------------------------------------

    def engine_event(self, port: LinkStation, event: NnEvent, now: int) -> None:
        """Record an engine's event."""
        match event:
            case ScanEnded() | AttemptEnded() | AllHealthy():
                if port.name == self._primary:
                    self._master_event(port, event)
            case StationLost():
                self._lost(port, event)
            case StationBack(tick, station):
                label = self.station_label(station)
                self.note(tick, "recovered", port.name, say("note_recovered", station=label), station=station)
            case MasterWatchdog(tick, heard):
                self.note(tick, "watchdog", port.name, say("note_watchdog"), heard=heard)
            case PolledWithoutParameters(tick):
                self.note(tick, "no_parameters", port.name, say("note_no_parameters"))
            case ParametersTaken(tick, settings):
                port.plc.parameters(settings, now)
                self.note(tick, "parameters", port.name, say("note_parameters"))
            case ParametersRefused(_, settings):
                port.plc.refuse(now)
                text = say("note_mode", mode=settings.mode, profile=port.plc.profile.name)
                self.note(now, "refused", port.name, text)
                self.warn(mode_refusal(port.name, port.plc.profile, settings.mode))
            case _:
                assert_never(event)

    def _master_event(self, port: LinkStation, event: ScanEnded | AttemptEnded | AllHealthy) -> None:
        sink = self._sink
        match event:
            case ScanEnded():
                sink.take(
                    ScanRecord(
                        self._bus,
                        self._scans,
                        event.start,
                        event.duration,
                        event.attempts,
                        len(event.failures),
                        len(event.in_error),
                        self._cause(event),
                    )
                )
                self._scans += 1
            case AttemptEnded():
                if event.code:
                    name = self._names.get(event.station)
                    asked = next((each for each in port.line.ports if each.name == name), port)
                    garbled = asked.receiver.heard_at > event.start
                    sink.failed(self._bus, event.end, event.station, event.code, garbled=garbled)
                if sink.traced:
                    sink.take(self._attempt(event))
            case AllHealthy(tick):
                if self.healthy_at is None:
                    self.healthy_at = tick
                self.note(tick, "healthy", self._bus, say("note_healthy"))
            case _:
                assert_never(event)

    def scans(self, port: LinkStation, starts: np.ndarray, attempts: int) -> list[Alike]:
        """Records of the link scans between data frames that began at these ticks, without errors."""
        import numpy as np

        if port.name != self._primary or len(starts) < 2:
            return []
        first, self._scans = self._scans, self._scans + len(starts) - 1
        durations, numbers = starts[1:] - starts[:-1], np.arange(first, self._scans)
        record = ScanRecord(self._bus, 0, 0, 0, attempts, 0, 0, "")
        return [Alike(record, {"start": starts[:-1], "number": numbers, "duration": durations})]

    def attempts(self, port: LinkStation, station: int, *times: np.ndarray) -> list[Alike]:
        """Records of first attempts that succeeded; of polls and of replies the beginnings and the ends."""
        if port.name != self._primary:
            return []
        start, polled, replied, end = times
        record = self._attempt(AttemptEnded(0, 0, 0, 0, station, 1, 0))
        return [Alike(record, {"start": start, "end": end, "turnaround": replied - polled})]

    def _attempt(self, event: AttemptEnded) -> AttemptRecord:
        return AttemptRecord(
            self._bus,
            event.start,
            event.end,
            event.station,
            event.number,
            MEANINGS[event.code] if event.code else "ok",
            event.code,
            None if event.reply is None else event.reply - event.polled,
        )

    def _lost(self, port: LinkStation, event: StationLost) -> None:
        if not event.new:
            return
        label = self.station_label(event.station)
        text = say(
            "note_station_error", station=label, code=f"{event.code:02X}", meaning=MEANINGS[event.code]
        )
        self.note(event.tick, "station_error", port.name, text, station=event.station, code=event.code)

    def _cause(self, event: ScanEnded) -> str:
        """Why a link scan took longer than one without faults, in words."""
        reasons: list[str] = []
        for station in dict.fromkeys(station for station, _ in event.failures):
            failed = [code for number, code in event.failures if number == station]
            label, count = self.station_label(station), len(failed)
            if len(set(failed)) == 1:
                codes = f"all {failed[0]:02X}" if count > 1 else f"{failed[0]:02X}"
            else:
                codes = ", ".join(f"{code:02X}" for code in failed)
            if station in event.in_error:
                attempts = "attempt" if count == 1 else "attempts"
                reasons.append(f"{label}: {count} {attempts}, {codes}")
            else:
                attempts = "attempt" if count == 1 else "attempts"
                reasons.append(f"{label}: {count} failed {attempts} before the reply, {codes}")
        if event.parameters:
            reasons.append("parameter frame")
        station, waited = event.slowest
        if self._slow:
            station, waited = max(self._slow.items(), key=lambda item: item[1])
            self._slow.clear()
        if waited > self._longest_turnaround:
            reasons.append(f"{self.station_label(station)} replied {format_ms(waited)} after its poll")
        return "; ".join(reasons)

    def replied(self, port: LinkStation, waited: int, now: int, lasting: int) -> None:
        """A slave's reply that lasts so long begins so many ticks after its poll, later than usual."""
        engine = port.engine
        if isinstance(engine, Slave):
            station, settings = engine.config.station, engine.settings
            self._slow[station] = max(waited, self._slow.get(station, 0))
            if settings is not None and waited + lasting > settings.timeout * TIMEOUT_UNIT:
                self._sink.irregular(self._bus, port.name, now, LATE_REPLY)

    def refused(self, now: int, plc: Plc) -> None:
        """A PLC went to RUN without an engine: its parameters are bad."""
        values = {address: plc.memory.word("D", address) for address in range(D_STATION, D_TIMEOUT + 1)}
        text = refusal(plc.profile, plc.name, bad_parameters(plc.profile, values), selected_port(plc.memory))
        self.note(now, "refused", plc.name, text, D8063=plc.link_registers.registers()["D8063"])
        self.warn(text)

    # -- totals ------------------------------------------------------------------------------------

    def add_up(self, port: LinkStation) -> None:
        """An engine is about to stop: keep what the primary master has counted."""
        if isinstance(port.engine, Master) and port.name == self._primary:
            self._stopped.add(port.engine)

    def counts(self, running: Master | None) -> MasterCounts:
        """What the primary master has counted over all its RUNs, the running engine's included."""
        total = deepcopy(self._stopped)
        if running is not None:
            total.add(running)
        return total
