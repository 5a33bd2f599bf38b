"""A scenario's faults, carried out at their ticks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from fractions import Fraction
from typing import assert_never

from bussim.line.characters import LineTiming
from bussim.line.random_streams import Streams
from bussim.scenario import fault_kinds, model
from bussim.sim.kernel import FAULT, Kernel
from bussim.sim.power_units import PlcUnit, Unit
from bussim.sim.wire.disturber import Drop, FrameFault
from bussim.sim.wire.jabber import JabberSender
from bussim.sim.wire.line import Line
from bussim.sim.wire.node import Node
from bussim.trace.records import IN_RUN, IN_STOP, LEFT_RUN, WITHOUT_SUPPLY, NoteRecord
from bussim.trace.sink import Sink
from bussim.units import format_time
from bussim.words.language import say

Undo = Callable[[int], None]


class FaultPlan:
    """Begins and ends every fault of a scenario, and the supply of PLCs and devices.

    ``units`` are by the names of PLCs and devices, ``nodes`` by their own.
    """

    def __init__(
        self,
        scenario: model.Scenario,
        kernel: Kernel,
        units: Mapping[str, Unit],
        buses: Mapping[str, Line],
        nodes: Mapping[str, Node],
        streams: Streams,
        sink: Sink,
    ) -> None:
        self._kernel = kernel
        self._units = units
        self._buses = buses
        self._nodes = nodes
        self._streams = streams
        self._sink = sink
        # Reasons why something has no supply or is in STOP; several may overlap.
        self._stopped: dict[str, int] = {}
        self._jabbers: dict[str, list[JabberSender]] = {}
        self._cuts: dict[str, list[int]] = {name: [] for name in buses}
        self._order = {bus.name: scenario.nodes_on(bus.name) for bus in scenario.buses}
        supplied = [(plc.name, plc.power_on) for plc in scenario.plcs]
        supplied += [(device.name, device.power_on) for device in scenario.devices]
        self._unpowered = {name: 1 for name, _ in supplied}
        faults = [fault for fault in scenario.faults if fault.window.at < scenario.duration]
        away = [fault for fault in faults if isinstance(fault.kind, fault_kinds.PowerOff | fault_kinds.Stop)]
        # What is kept from running in the very tick of its power-on carries no scan out before.
        for fault in away:
            kernel.at(fault.window.at, self._beginning(fault), FAULT)
        for name, since in supplied:
            kernel.at(since, self._supply(name, -1), FAULT)
        kernel.at(0, self._note_those_away, FAULT)
        for fault in faults:
            if fault not in away:
                kernel.at(fault.window.at, self._beginning(fault), FAULT)

    def inject(self, fault: model.Fault) -> None:
        """Begin a fault that the scenario does not have now, regardless of its window's beginning.

        Not to be called while the kernel runs.
        """
        now = self._kernel.now
        self._beginning(replace(fault, window=model.Window(now, fault.window.duration)))(now)

    def _note(self, tick: int, kind: str, fault: model.Fault, text: str) -> None:
        detail: dict[str, int | str] = {}
        for key in ("node", "bus", "count"):
            value = getattr(fault.kind, key, None)
            if value is not None:
                detail[key] = value
        self._sink.take(NoteRecord(tick, kind, fault.name, text, detail))

    def _note_those_away(self, now: int) -> None:
        for name, unit in self._units.items():
            if not unit.running:
                text = IN_STOP if unit.powered else WITHOUT_SUPPLY
                self._sink.take(NoteRecord(now, LEFT_RUN, name, text, {}))

    def _beginning(self, fault: model.Fault) -> Undo:
        def begin(now: int) -> None:
            duration = fault.window.duration
            text = describe(fault.kind)
            if duration is not None:
                text = say("fault_for", fault=text, time=format_time(duration))
            self._note(now, "fault", fault, text)
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
        match kind:
            case fault_kinds.CableCut():
                return self._cut_cable(kind, now)
            case fault_kinds.PowerOff(name):
                self._supply(name, 1)(now)
                return self._supply(name, -1)
            case fault_kinds.Stop(name):
                self._switch(name, 1)(now)
                return self._switch(name, -1)
            case fault_kinds.BoardError():
                return self._board_error(kind, now)
        node = self._nodes.get(kind.node)
        if node is None:
            return None  # the rest are faults of a port, which a PLC may do without
        match kind:
            case fault_kinds.Jabber():
                return self._jabber(fault.name, node, now)
            case (
                fault_kinds.DropReply()
                | fault_kinds.LoseChar()
                | fault_kinds.InsertChar()
                | fault_kinds.FlipBits()
                | fault_kinds.Pause()
            ):
                return self._frame_fault(fault.name, node, kind)
            case fault_kinds.Slow(_, extra):
                return _added(node, "extra_turnaround", extra)
            case fault_kinds.LateRelease(_, by):
                return _added(node, "late_release", by)
            case fault_kinds.WrongFormat(_, timing):
                return _timed(node, (timing, Fraction(0)), now)
            case fault_kinds.ClockPpm(_, ppm):
                return _timed(node, (None, ppm), now)
            case _:
                assert_never(kind)

    def _board_error(self, kind: fault_kinds.BoardError, now: int) -> Undo:
        unit = self._units[kind.node]
        assert isinstance(unit, PlcUnit)  # noqa: S101 - narrows the type; only PLCs have boards
        plc = unit.plc
        plc.wake(now)
        plc.board_error(kind.port, kind.code)

        def over(now: int) -> None:
            plc.wake(now)
            plc.board_error_over(kind.port, kind.code)

        return over

    def _jabber(self, name: str, node: Node, now: int) -> Undo:
        jabber = JabberSender(node, self._kernel, self._streams.uniforms("jabber", name))
        jabbers = self._jabbers.setdefault(node.name, [])
        jabbers.append(jabber)
        if node.powered:
            jabber.begin(now)

        def end(now: int) -> None:
            jabbers.remove(jabber)
            jabber.end(now)
            if jabbers and not node.jabbering and node.powered:
                jabbers[0].begin(now)  # it jabbers on for another fault

        return end

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
        unit = self._units[name]
        powered, running = self._unpowered[name] <= 0, self._stopped.get(name, 0) <= 0
        was, worked = unit.powered, unit.running
        unit.switch(now, powered=powered, running=running)
        changed = unit.running is not worked or powered is not was
        if changed and (now or worked):  # all that have a supply begin at work
            away = (LEFT_RUN, IN_STOP if powered else WITHOUT_SUPPLY)
            kind, text = (IN_RUN, "in RUN") if unit.running else away
            self._sink.take(NoteRecord(now, kind, name, text, {}))
        if powered is not was:
            for node in unit.nodes:
                for jabber in self._jabbers.get(node.name, ()):
                    (jabber.begin if powered else jabber.end)(now)

    # -- single frames -------------------------------------------------------------------------------

    def _frame_fault(
        self,
        name: str,
        node: Node,
        kind: fault_kinds.DropReply
        | fault_kinds.LoseChar
        | fault_kinds.InsertChar
        | fault_kinds.FlipBits
        | fault_kinds.Pause,
    ) -> Undo:
        disturber = node.line.disturber
        if isinstance(kind, fault_kinds.DropReply):
            drop = Drop(node.position, kind.count)
            disturber.add(drop)
            return lambda _: disturber.remove(drop)
        item = FrameFault(
            action="flip",
            position=node.position,
            receiver=not isinstance(kind, fault_kinds.Pause) and kind.direction is fault_kinds.Direction.RX,
            left=kind.count,
            draws=self._streams.uniforms("fault", name),
        )
        match kind:
            case fault_kinds.FlipBits():
                item.bits, item.frame = kind.bits, kind.frame
            case fault_kinds.LoseChar():
                item.action, item.index = "lose", kind.index
            case fault_kinds.InsertChar():
                item.action, item.index, item.value = "insert", kind.index, kind.value
            case fault_kinds.Pause():
                item.action, item.index, item.value = "pause", kind.index, kind.by
            case _:
                assert_never(kind)
        disturber.add(item)
        return lambda _: disturber.remove(item)

    # -- the cable -----------------------------------------------------------------------------------

    def _cut_cable(self, kind: fault_kinds.CableCut, now: int) -> Undo | None:
        bus = self._buses.get(kind.bus)
        node = self._nodes.get(kind.after)
        if bus is None or node is None:
            return None
        position = node.position
        if node.line is not bus:  # it is on an external line: the cut lies behind the node before it
            before = self._order[kind.bus]
            positions = [
                self._nodes[name].position
                for name in before[: before.index(kind.after)]
                if self._nodes[name].line is bus
            ]
            if not positions:
                return None
            position = max(positions)
        cuts = self._cuts[kind.bus]
        cuts.append(position)
        bus.set_cuts(cuts, now)

        def mend(now: int) -> None:
            cuts.remove(position)
            bus.set_cuts(cuts, now)

        return mend


def _added(node: Node, delay: str, ticks: int) -> Undo:
    """One of a node's delays is longer by ``ticks``; returns what makes it as it was."""

    def add(more: int) -> None:
        setattr(node, delay, getattr(node, delay) + more)
        node.line.listeners_changed()

    add(ticks)
    return lambda _: add(-ticks)


def _timed(node: Node, entry: tuple[LineTiming | None, Fraction], now: int) -> Undo:
    """A node has another rate and format, or a clock that is off; returns what makes it right."""
    node.timing_faults.append(entry)
    node.retime(now)

    def undo_timing(now: int) -> None:
        node.timing_faults.remove(entry)
        node.retime(now)

    return undo_timing


def describe(kind: fault_kinds.FaultKind) -> str:
    """A fault in a few words, for labels."""
    match kind:
        case fault_kinds.PowerOff(plc):
            return say("fault_power_off", plc=plc)
        case fault_kinds.Stop(plc):
            return say("fault_stop", plc=plc)
        case fault_kinds.DropReply(plc, count):
            if count is None:
                return say("fault_drop_all", plc=plc)
            return say("fault_drop", plc=plc, count=count)
        case fault_kinds.Slow(plc, extra):
            return say("fault_slow", plc=plc, time=format_time(extra))
        case fault_kinds.Jabber(plc):
            return say("fault_jabber", plc=plc)
        case fault_kinds.CableCut(_, after):
            return say("fault_cut", after=after)
        case fault_kinds.WrongFormat(plc, timing):
            return say("fault_format", plc=plc, format=f"{timing.baud} {timing.format}")
        case fault_kinds.ClockPpm(plc, ppm):
            return say("fault_clock", plc=plc, ppm=f"{float(ppm):g}")
        case fault_kinds.LateRelease(plc, by):
            return say("fault_release", plc=plc, time=format_time(by))
        case fault_kinds.LoseChar(plc):
            return say("fault_lose", plc=plc)
        case fault_kinds.InsertChar(plc):
            return say("fault_insert", plc=plc)
        case fault_kinds.Pause(plc, by):
            return say("fault_pause", plc=plc, time=format_time(by))
        case fault_kinds.FlipBits(plc):
            return say("fault_bits", plc=plc)
        case fault_kinds.BoardError(plc, port, code):
            return say("fault_board", plc=plc, code=f"{code:02d}", port=port)
        case _:
            assert_never(kind)
