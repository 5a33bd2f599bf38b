"""From entries of ``noise`` and ``faults`` without mistakes to the scenario's frozen values."""

from collections.abc import Callable, Sequence
from typing import Any

from bussim.forms.fields import exact
from bussim.line.characters import LineTiming
from bussim.scenario.build.names import unique_names
from bussim.scenario.fault_kinds import (
    BoardError,
    CableCut,
    ClockPpm,
    Direction,
    DropReply,
    FaultKind,
    FlipBits,
    InsertChar,
    Jabber,
    LateRelease,
    LoseChar,
    Pause,
    PowerOff,
    Slow,
    Stop,
    WrongFormat,
)
from bussim.scenario.model import Fault, Noise, Target, Window
from bussim.scenario.resolve.nodes import Directory, Node
from bussim.scenario.schema.disturbances import CableCutIn, FaultIn, NoiseIn


def noise_of(entries: Sequence[NoiseIn], nodes: Directory) -> tuple[Noise, ...]:
    """The scenario's noise."""
    targets = [_target(entry, nodes) for entry in entries]
    labels = [f"{entry.kind} {at.station or at.bus}" for entry, at in zip(entries, targets, strict=True)]
    names = unique_names((entry.name for entry in entries), labels)
    return tuple(
        Noise(name, target, entry.value, Window(entry.at, entry.for_), entry.measured or "")
        for name, target, entry in zip(names, targets, entries, strict=True)
    )


def faults_of(entries: Sequence[FaultIn], nodes: Directory) -> tuple[Fault, ...]:
    """The scenario's faults, but for supplies that are switched on late."""
    kinds = [_fault_kind(entry, nodes) for entry in entries]
    labels = [_fault_label(entry, kind) for entry, kind in zip(entries, kinds, strict=True)]
    names = unique_names((entry.name for entry in entries), labels)
    return tuple(
        Fault(name, kind, Window(entry.at or 0, entry.for_))
        for name, kind, entry in zip(names, kinds, entries, strict=True)
    )


def _node(nodes: Directory, name: str, bus: str | None = None) -> Node:
    """The node that a fault or noise without mistakes names."""
    found = nodes.find(name, bus)
    if found is None:
        raise AssertionError(f"{name} was not found, but not reported either")
    return found


def _target(given: NoiseIn, nodes: Directory) -> Target:
    station = _node(nodes, given.station, given.bus).name if given.station is not None else None
    side = Direction.TX if given.reply_loss is not None else Direction(given.direction or Direction.RX)
    return Target(given.bus, station, side)


def _fault_label(given: FaultIn, kind: FaultKind) -> str:
    return f"cable_cut after {kind.after}" if isinstance(kind, CableCut) else f"{given.kind} {kind.node}"


def _fault_kind(given: FaultIn, nodes: Directory) -> FaultKind:
    kind = given.kind
    form = getattr(given, kind)
    if kind in _OF_OWNERS:
        return _OF_OWNERS[kind](form)
    at = _node(nodes, form.after, form.bus) if isinstance(form, CableCutIn) else _node(nodes, form.station)
    return _OF_NODES[kind](form, at, given.count)


#: What becomes of the kinds of faults: of a whole PLC or device …
_OF_OWNERS: dict[str, Callable[[Any], FaultKind]] = {
    "power_off": lambda given: PowerOff(given.station),
    "stop": lambda given: Stop(given.station),
    "board_error": lambda given: BoardError(given.plc, given.port, given.code),
}
#: … and of a node of a bus, for so many frames.
_OF_NODES: dict[str, Callable[[Any, Node, int | None], FaultKind]] = {
    "drop_reply": lambda _, at, count: DropReply(at.name, count),
    "slow": lambda given, at, _: Slow(at.name, given.extra),
    "jabber": lambda _given, at, _: Jabber(at.name),
    "cable_cut": lambda given, at, _: CableCut(given.bus, at.name),
    "wrong_format": lambda given, at, _: WrongFormat(
        at.name, LineTiming(given.baud or at.timing.baud, given.format or at.timing.format)
    ),
    "clock_ppm": lambda given, at, _: ClockPpm(at.name, exact(given.ppm)),
    "late_release": lambda given, at, _: LateRelease(at.name, given.by),
    "lose_char": lambda given, at, count: LoseChar(at.name, Direction(given.direction), count, given.index),
    "insert_char": lambda given, at, count: InsertChar(
        at.name, Direction(given.direction), count, given.index, given.value
    ),
    "pause": lambda given, at, count: Pause(at.name, given.by, count, given.index),
    "flip_bits": lambda given, at, count: FlipBits(
        at.name, Direction(given.direction), tuple(sorted(given.bits)), count, given.frame
    ),
}
