"""A PLC's port on a serial bus, and the timer of those ENDs that its ports wait for."""

from __future__ import annotations

from collections.abc import Iterable
from typing import assert_never

from simpy.events import EventPriority

from bussim.engines.contract import SERVE
from bussim.engines.free.engine import FreePort
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
from bussim.plc.plc import Plc, PlcState
from bussim.plc.ports.events import (
    FreeReceived,
    FreeSent,
    PortErrorRaised,
    TransactionTaken,
    TurnEnded,
)
from bussim.plc.ports.port_registers import PortRegisters
from bussim.sim.kernel import END, Kernel
from bussim.sim.serial.bus import SerialBus
from bussim.sim.serial.contract import SerialEvent
from bussim.sim.serial.node import SerialNode
from bussim.sim.serial.reporter import SerialReporter
from bussim.sim.serial.turn_path import TurnPath
from bussim.sim.wire.contract import LineNode


class PlcPort(SerialNode):
    """One port of a PLC. What CPAVL and RS2 do with it is the business of its port registers."""

    def __init__(
        self, plc: Plc, port: str, bus: SerialBus, position: int, kernel: Kernel, reporter: SerialReporter
    ) -> None:
        super().__init__(f"{plc.name}.{port}", bus, position, kernel, reporter)
        self.plc = plc
        self.port_registers: PortRegisters = plc.port_registers[port]
        self.clock: EndClock | None = None

    @property
    def powered(self) -> bool:
        """Whether the PLC has a supply."""
        return self.plc.state is not PlcState.OFF

    def run(self, now: int) -> None:
        """The PLC is in RUN and its parameters were taken over."""
        engine, settings = self.port_registers.engine, self.port_registers.settings
        if engine is not None and settings is not None:
            self.use_engine(engine, settings.timing, now)
            self.handle(engine.start(now), now)
        self.report_events()

    def understands(self, sender: LineNode) -> bool:
        """See the base class; with the free protocol each END shows what has come: no frame is whole."""
        return not isinstance(self.engine, FreePort) and super().understands(sender)

    def handle(self, hints: int, now: int) -> None:
        """Do what the engine asks for with its hints; a request waits for END."""
        super().handle(hints, now)
        if hints & SERVE:
            self.schedule_end(now)

    def schedule_end(self, now: int) -> None:
        """An END may be waited for now."""
        if self.clock is not None:
            self.clock.schedule_end(now)

    def handle_event(self, item: SerialEvent, now: int) -> None:
        """Pass an event on to the port registers, which act on it at END."""
        match item:
            case RequestServed() | StationRefused():
                self.reporter.slave_event(self, item)
            case FrameRejected():
                if self.kind == "response":
                    self.reporter.slave_event(self, item)
            case TransactionEnded() | ForeignFrame() | PollEnded() | CycleEnded():
                pass  # of a master: the port registers report what becomes of it
            case Sent() | Received() | CharacterDamaged():
                pass  # likewise
            case _:
                assert_never(item)
        self.port_registers.event(item, now)
        self.report_events()
        self.schedule_end(now)

    def report_events(self) -> None:
        """Report the events of the port registers."""
        reporter = self.reporter
        while (event := self.port_registers.poll()) is not None:
            match event:
                case TransactionTaken(taken, poll, attempt, ended):
                    reporter.transaction(self, ended, poll, attempt, taken)
                case TurnEnded():
                    reporter.turn(self, event)
                case CycleEnded():
                    reporter.cycle(self, event)
                case FreeSent(poll, sent):
                    reporter.sent(self, sent, poll)
                case FreeReceived(poll, received):
                    reporter.received(self, received, poll)
                case PortErrorRaised():
                    reporter.port_error(self, event)
                case _:
                    assert_never(event)


class EndClock:
    """Carries out those ENDs of a PLC, the ``number``-th, that something waits for; others are no events."""

    def __init__(self, plc: Plc, kernel: Kernel, ports: Iterable[PlcPort], number: int) -> None:
        self._plc = plc
        self._ports = {port.port_registers.spec.name: port for port in ports}
        alone = self._ports and not plc.every_end
        self._turn_path = TurnPath(plc, tuple(self._ports.values()), kernel) if alone else None
        # Those of one tick come in the order of PLCs, whether some were left out before or not.
        priority = EventPriority(END + number) if plc.every_end else END
        self.timer = kernel.timer(self._on_end, priority)
        plc.on_wake = self.schedule_end
        for port in self._ports.values():
            port.clock = self

    def schedule_end(self, now: int) -> None:
        """Arm the timer for the next END that is waited for."""
        at = self._plc.wanted_end(now)
        if at is None:
            self.timer.cancel()
        elif self.timer.at != at:
            self.timer.set(at)

    def stop(self) -> None:
        """STOP or power-off: no END happens any more."""
        self.timer.cancel()

    def _on_end(self, now: int) -> None:
        if self._turn_path is not None and self._turn_path.pass_turns(now):
            self.schedule_end(now)
            return
        hints = self._plc.end(now)
        for name, port in self._ports.items():
            if hints[name]:
                port.handle(hints[name], now)
            port.report_events()
        self.schedule_end(now)
