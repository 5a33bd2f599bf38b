"""A device of the scenario on its bus."""

from __future__ import annotations

from functools import partial
from typing import assert_never

from bussim.devices.contract import BusDevice, DeviceEvent, MasterSettings, SlaveSettings
from bussim.engines.contract import SERVE
from bussim.engines.free.events import CharacterDamaged, Received, Sent
from bussim.engines.modbus.events import (
    CycleEnded,
    ForeignFrame,
    FrameRejected,
    PollEnded,
    RequestServed,
    StationRefused,
    TransactionEnded,
)
from bussim.engines.modbus.slave import Slave
from bussim.line.random_streams import Streams
from bussim.plc.ports.events import TurnEnded
from bussim.plc.scan import ScanCycle
from bussim.sim.kernel import END, Kernel
from bussim.sim.serial.bus import SerialBus
from bussim.sim.serial.contract import SerialEvent
from bussim.sim.serial.node import SerialNode
from bussim.sim.serial.reporter import SerialReporter


class DeviceNode(SerialNode):
    """A device of the scenario with its one port."""

    def __init__(
        self,
        spec: BusDevice,
        bus: SerialBus,
        position: int,
        kernel: Kernel,
        reporter: SerialReporter,
        streams: Streams,
    ) -> None:
        super().__init__(
            spec.name,
            bus,
            position,
            kernel,
            reporter,
            delays=streams.uniforms("turnaround", spec.name),
            jitter=spec.jitter,
        )
        self.spec = spec
        self._powered = False
        self.stations = () if spec.station is None else (spec.station,)
        settings = spec.settings
        self._behaviour = settings.behaviour(spec, streams)
        # Of a PLC as a slave: its scan, at whose END it replies.
        self._scan = settings.plc_scan() if isinstance(settings, SlaveSettings) else None
        self._cycle = ScanCycle(streams.generator("scan", spec.name)) if self._scan is not None else None
        self._end_of_scan = kernel.timer(self._on_end_of_scan, END)
        # Of a master: what its running poll has tried so far.
        self._attempts: list[TransactionEnded] = []
        self._polls = settings.polls if isinstance(settings, MasterSettings) else ()

    @property
    def powered(self) -> bool:
        """Whether it has a supply."""
        return self._powered

    #: Whether it is at work: a device has no STOP.
    running = powered

    @property
    def nodes(self) -> tuple[DeviceNode]:
        """Itself: the nodes that its supply feeds."""
        return (self,)

    def switch(self, now: int, *, powered: bool, running: bool) -> None:
        """Go to this state; a device has no STOP."""
        if powered and not self._powered:
            self.power_on(now)
        elif self._powered and not powered:
            self.power_off(now)

    def power_on(self, now: int) -> None:
        """The supply comes."""
        self._powered = True
        if self._cycle is not None and self._scan is not None:
            self._cycle.run(now, self._scan.mean, self._scan.jitter, None)
        engine, timing = self._behaviour.power_on(now)
        self.use_engine(engine, timing, now)
        self.handle(engine.start(now), now)
        self._record_events()

    def power_off(self, now: int) -> None:
        """The supply goes."""
        self.halt(now)
        self._behaviour.power_off(now)
        self._record_events()
        if self._cycle is not None:
            self._cycle.stop(now)
        self._end_of_scan.cancel()
        self._powered = False

    def handle(self, hints: int, now: int) -> None:
        """Do what the engine asks for; a PLC serves at its END."""
        if hints & SERVE and self._cycle is not None:
            self._end_of_scan.set(self._cycle.next_end(now, now))
        super().handle(hints, now)

    def _on_end_of_scan(self, now: int) -> None:
        if isinstance(self.engine, Slave):
            self.handle(self.engine.serve(now), now)

    def handle_event(self, item: SerialEvent, now: int) -> None:
        """What becomes of an event."""
        reporter = self.reporter
        match item:
            case RequestServed() | StationRefused():
                reporter.slave_event(self, item)
                self._record_events(now)
            case FrameRejected():
                if self.kind == "response":
                    reporter.slave_event(self, item)
                    self._record_events()
            case TransactionEnded():
                self._attempts.append(item)
            case PollEnded():
                name = self._polls[item.index].name
                for number, attempt in enumerate(self._attempts, 1):
                    reporter.transaction(self, attempt, name, number, attempt.end)
                self._attempts.clear()
                turn = TurnEnded(name, item.start, item.tick, item.attempts, item.error, item.late)
                reporter.turn(self, turn)
            case CycleEnded():
                reporter.cycle(self, item)
            case Sent():
                reporter.sent(self, item, "")
            case ForeignFrame() | Received() | CharacterDamaged():
                pass  # no device acts on them
            case _:
                assert_never(item)

    def _record_events(self, now: int = 0) -> None:
        for event in self._behaviour.events():
            if now > self._kernel.now:  # the request was served ahead of its time
                self._kernel.at(now, partial(self._record, event), self._silence_timer.priority)
            else:
                self._record(event)

    def _record(self, event: DeviceEvent, _: int = 0) -> None:
        self.reporter.note(event.tick, event.kind, self.name, event.text)
        if event.warning:
            self.reporter.warn(event.warning)

    def state(self, now: int) -> dict[str, int]:
        """Its state for the summary, by name."""
        state = self._behaviour.state(now)
        self._record_events()
        return state
