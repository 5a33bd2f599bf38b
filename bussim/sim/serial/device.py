"""A device of the scenario on its bus."""

from __future__ import annotations

from typing import Any

from bussim.engines.contract import SERVE
from bussim.engines.free.events import Sent
from bussim.engines.modbus.events import CycleEnded, PollEnded, TransactionEnded
from bussim.engines.modbus.slave import Slave
from bussim.line.random_streams import Streams
from bussim.plc.ports.events import TurnEnded
from bussim.plc.scan import ScanCycle
from bussim.scenario import model
from bussim.sim.kernel import END, Kernel
from bussim.sim.serial.bus import SerialBus
from bussim.sim.serial.models import behaviour
from bussim.sim.serial.node import SerialNode
from bussim.sim.serial.reporter import SerialReporter


class DeviceNode(SerialNode):
    """A device of the scenario with its one port."""

    __slots__ = ("_attempts", "_behaviour", "_cycle", "_end_of_scan", "_powered", "_slave", "spec")

    def __init__(
        self,
        spec: model.BusDevice,
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
        self._behaviour = behaviour(spec, streams)
        self._slave = spec.station is not None
        # Of a PLC as a slave: its scan, at whose END it answers.
        self._cycle: ScanCycle | None = None
        self._end_of_scan = kernel.timer(self._on_end_of_scan, END)
        # Of a master: what its running poll has tried so far.
        self._attempts: list[TransactionEnded] = []
        if isinstance(spec.settings, model.LxSettings):
            self._cycle = ScanCycle(streams.generator("scan", spec.name))

    @property
    def powered(self) -> bool:
        """Whether it has a supply."""
        return self._powered

    def power_on(self, now: int) -> None:
        """The supply comes."""
        self._powered = True
        settings = self.spec.settings
        if self._cycle is not None and isinstance(settings, model.LxSettings):
            self._cycle.run(now, settings.scan.mean, settings.scan.jitter, None)
        engine, timing = self._behaviour.power_on(now)
        self.use_engine(engine, timing, now)
        self.handle(engine.start(now), now)
        self._behaviour.tell(self.reporter)

    def power_off(self, now: int) -> None:
        """The supply goes."""
        self.halt(now)
        self._behaviour.power_off(now)
        self._behaviour.tell(self.reporter)
        if self._cycle is not None:
            self._cycle.stop(now)
        self._end_of_scan.cancel()
        self._powered = False

    def handle(self, hints: int, now: int) -> None:
        """Look at what the engine asks for; a PLC serves at its END."""
        if hints & SERVE and self._cycle is not None:
            self._end_of_scan.set(self._cycle.next_end(now, now))
        super().handle(hints, now)

    def _on_end_of_scan(self, now: int) -> None:
        if isinstance(self.engine, Slave):
            self.handle(self.engine.serve(now), now)

    def handle_event(self, item: Any, now: int) -> None:
        """What becomes of an event."""
        del now
        reporter = self.reporter
        if self._slave:
            reporter.slave_event(self, item)
            self._behaviour.tell(self.reporter)
        elif isinstance(item, TransactionEnded):
            self._attempts.append(item)
        elif isinstance(item, PollEnded):
            name = self._poll_name(item.index)
            self._record_attempts(name)
            turn = TurnEnded(name, item.start, item.tick, item.attempts, item.error, item.late)
            reporter.turn(self, turn)
        elif isinstance(item, CycleEnded):
            reporter.cycle(self, item)
        elif isinstance(item, Sent):
            reporter.sent(self, item, "")

    def _poll_name(self, index: int) -> str:
        settings = self.spec.settings
        assert isinstance(settings, model.HmiSettings)  # noqa: S101 - narrows the type; no other polls
        return settings.polls[index].name

    def _record_attempts(self, poll: str) -> None:
        for number, attempt in enumerate(self._attempts, 1):
            self.reporter.transaction(self, attempt, poll, number, attempt.end)
        self._attempts.clear()

    def state(self, now: int) -> dict[str, int]:
        """What is worth telling of the device at the end."""
        state = self._behaviour.state(now)
        self._behaviour.tell(self.reporter)
        return state
