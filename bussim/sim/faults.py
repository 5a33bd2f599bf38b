"""A scenario's faults, carried out at their ticks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from bussim.line.characters import LineTiming
from bussim.plc.plc import Plc, PlcState
from bussim.plc.streams import Streams
from bussim.scenario import model
from bussim.sim.bus import Bus
from bussim.sim.disturb import Drop, FrameFault
from bussim.sim.jabber import Jabber
from bussim.sim.kernel import FAULT, Kernel
from bussim.sim.port import Port
from bussim.trace import NoteRecord, Sink
from bussim.units import format_time

Undo = Callable[[int], None]


class FaultPlan:
    """Begins and ends every fault of a scenario, and the PLCs' supply.

    ``ports`` are the link ports by PLC name; a PLC outside of any link has none.
    """

    def __init__(
        self,
        scenario: model.Scenario,
        kernel: Kernel,
        plcs: Mapping[str, Plc],
        buses: Mapping[str, Bus],
        ports: Mapping[str, Port],
        streams: Streams,
        sink: Sink,
    ) -> None:
        self._kernel = kernel
        self._plcs = plcs
        self._buses = buses
        self._ports = ports
        self._streams = streams
        self._sink = sink
        # Reasons why a PLC has no supply or is in STOP; several may overlap.
        self._unpowered: dict[str, int] = {}
        self._stopped: dict[str, int] = {}
        self._timings: dict[str, list[tuple[str, LineTiming | None, model.ClockPpm | None]]] = {}
        self._jabbers: dict[str, list[Jabber]] = {}
        self._cuts: dict[str, list[int]] = {name: [] for name in buses}
        for plc in scenario.plcs:
            self._unpowered[plc.name] = 1
            kernel.at(plc.power_on, self._supply(plc.name, -1), FAULT)
        for fault in scenario.faults:
            if fault.window.at < scenario.duration:
                kernel.at(fault.window.at, self._beginning(fault), FAULT)

    def _note(self, tick: int, kind: str, fault: model.Fault, text: str) -> None:
        detail: dict[str, int | str] = {}
        for key in ("node", "bus", "count"):
            value = getattr(fault.kind, key, None)
            if value is not None:
                detail[key] = value
        self._sink.note(NoteRecord(tick, kind, fault.name, text, detail))

    def _beginning(self, fault: model.Fault) -> Undo:
        def begin(now: int) -> None:
            duration = fault.window.duration
            lasting = f" for {format_time(duration)}" if duration is not None else ""
            self._note(now, "fault", fault, f"{describe(fault.kind)}{lasting}")
            undo = self._begin(fault, now)
            until = fault.window.until
            if until is not None and undo is not None:

                def end(now: int) -> None:
                    self._note(now, "fault_over", fault, describe(fault.kind))
                    undo(now)

                self._kernel.at(until, end, FAULT)

        return begin

    def _begin(self, fault: model.Fault, now: int) -> Undo | None:
        kind = fault.kind
        if isinstance(kind, model.CableCut):
            return self._cut_cable(kind, now)
        plc = kind.node
        if isinstance(kind, model.PowerOff):
            self._supply(plc, 1)(now)
            return self._supply(plc, -1)
        if isinstance(kind, model.Stop):
            self._switch(plc, 1)(now)
            return self._switch(plc, -1)
        if isinstance(kind, model.BoardError):
            self._plcs[plc].board_error(kind.port, kind.code)
            return lambda _: self._plcs[plc].board_error_over(kind.port, kind.code)
        port = self._ports.get(plc)
        if port is None:
            return None  # the rest are a link port's faults
        if isinstance(kind, model.Jabber):
            return self._jabber(fault.name, port, now)
        if isinstance(kind, (model.DropReply, model.LoseChar, model.InsertChar, model.FlipBits)):
            return self._frame_fault(fault.name, port, kind)
        return self._station_fault(fault.name, port, kind, now)

    def _jabber(self, name: str, port: Port, now: int) -> Undo:
        jabber = Jabber(port, self._kernel, self._streams.uniforms("jabber", name))
        jabbers = self._jabbers.setdefault(port.name, [])
        jabbers.append(jabber)
        if port.plc.state is not PlcState.OFF:
            jabber.begin(now)

        def well(now: int) -> None:
            jabbers.remove(jabber)
            jabber.end(now)
            if jabbers and not port.jabbering and port.plc.state is not PlcState.OFF:
                jabbers[0].begin(now)  # it jabbers on for another fault

        return well

    # -- supply and mode switch ----------------------------------------------------------------------

    def _supply(self, plc: str, change: int) -> Undo:
        def act(now: int) -> None:
            self._unpowered[plc] += change
            self._apply_state(plc, now)

        return act

    def _switch(self, plc: str, change: int) -> Undo:
        def act(now: int) -> None:
            self._stopped[plc] = self._stopped.get(plc, 0) + change
            self._apply_state(plc, now)

        return act

    def _apply_state(self, name: str, now: int) -> None:
        port = self._ports.get(name)
        plc = self._plcs[name]
        powered = self._unpowered[name] <= 0
        running = powered and self._stopped.get(name, 0) <= 0
        if plc.state is PlcState.RUN and not running:
            if port is not None:
                port.halt(now)
            plc.stop(now)
        if plc.state is not PlcState.OFF and not powered:
            plc.power_off(now)
            for jabber in self._jabbers.get(name, ()):
                jabber.end(now)
            if port is not None:
                port.bus.ledger.forget(port.seat)
        if plc.state is PlcState.OFF and powered:
            plc.power_on()
            for jabber in self._jabbers.get(name, ()):
                jabber.begin(now)
        if plc.state is PlcState.STOP and running:
            if port is not None:
                port.run(now)
            else:
                plc.run(now, traced=False)

    # -- single frames -------------------------------------------------------------------------------

    def _frame_fault(
        self,
        name: str,
        port: Port,
        kind: model.DropReply | model.LoseChar | model.InsertChar | model.FlipBits,
    ) -> Undo:
        disturber = port.bus.disturber
        item: Drop | FrameFault
        if isinstance(kind, model.DropReply):
            item = Drop(port.seat, kind.count)
        else:
            item = FrameFault(
                action="flip",
                seat=port.seat,
                receiver=kind.direction is model.Direction.RX,
                left=kind.count,
                draws=self._streams.uniforms("fault", name),
            )
            if isinstance(kind, model.FlipBits):
                item.bits, item.frame = kind.bits, kind.frame
            elif isinstance(kind, model.LoseChar):
                item.action, item.index = "lose", kind.index
            else:
                item.action, item.index, item.value = "insert", kind.index, kind.value
        disturber.add(item)
        return lambda _: disturber.remove(item)

    # -- a station's port ----------------------------------------------------------------------------

    def _station_fault(
        self,
        name: str,
        port: Port,
        kind: model.Slow | model.LateRelease | model.WrongFormat | model.ClockPpm,
        now: int,
    ) -> Undo:
        if isinstance(kind, model.Slow):
            extra = kind.extra
            port.extra_turnaround += extra
            port.bus.audience_changed()

            def fast(now: int) -> None:
                del now
                port.extra_turnaround -= extra
                port.bus.audience_changed()

            return fast
        if isinstance(kind, model.LateRelease):
            by = kind.by
            port.late_release += by
            port.bus.audience_changed()

            def prompt(now: int) -> None:
                del now
                port.late_release -= by
                port.bus.audience_changed()

            return prompt
        wrong = self._timings.setdefault(port.name, [])
        entry = (
            name,
            kind.timing if isinstance(kind, model.WrongFormat) else None,
            kind if isinstance(kind, model.ClockPpm) else None,
        )
        wrong.append(entry)
        self._retime(port, now)

        def right(now: int) -> None:
            wrong.remove(entry)
            self._retime(port, now)

        return right

    def _retime(self, port: Port, now: int) -> None:
        """The port's timing with all the faults that are on: the latest format, clock errors added."""
        timing = port.bus.timing
        for _, other, _ in self._timings[port.name]:
            timing = other or timing
        for _, _, clock in self._timings[port.name]:
            if clock is not None:
                timing = replace(timing, ppm=timing.ppm + clock.ppm)
        port.set_timing(timing, now)

    # -- the cable -----------------------------------------------------------------------------------

    def _cut_cable(self, kind: model.CableCut, now: int) -> Undo | None:
        bus = self._buses.get(kind.bus)
        seat = self._ports[kind.after].seat if kind.after in self._ports else None
        if bus is None or seat is None:
            return None
        cuts = self._cuts[kind.bus]
        cuts.append(seat)
        bus.set_cuts(cuts, now)

        def mend(now: int) -> None:
            cuts.remove(seat)
            bus.set_cuts(cuts, now)

        return mend


def describe(kind: model.FaultKind) -> str:
    """A fault in a few words, for labels."""
    match kind:
        case model.PowerOff(plc):
            return f"{plc} without power"
        case model.Stop(plc):
            return f"{plc} in STOP"
        case model.DropReply(plc, count):
            return f"{plc}: {'all' if count is None else count} replies dropped"
        case model.Slow(plc, extra):
            return f"{plc} slow by {format_time(extra)}"
        case model.Jabber(plc):
            return f"{plc} jabbers"
        case model.CableCut(_, after):
            return f"cable cut behind {after}"
        case model.WrongFormat(plc, timing):
            return f"{plc} at {timing.baud} {timing.format}"
        case model.ClockPpm(plc, ppm):
            return f"{plc} clock off by {float(ppm):g} ppm"
        case model.LateRelease(plc, by):
            return f"{plc} releases its driver {format_time(by)} late"
        case model.LoseChar(plc):
            return f"{plc} loses characters"
        case model.InsertChar(plc):
            return f"{plc} inserts characters"
        case model.FlipBits(plc):
            return f"{plc}: chosen bits inverted"
        case model.BoardError(plc, port, code):
            return f"{plc}: board error {code:02d} on {port}"
