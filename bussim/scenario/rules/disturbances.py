"""What is wrong or odd about noise and faults: the nodes that they name, and when they act."""

from bussim.engines.modbus.adu import RTU_MAX, Mode
from bussim.scenario.resolve.nodes import Directory, Missing, Node, NodeRole
from bussim.scenario.resolve.scenario import Resolved
from bussim.scenario.schema.disturbances import (
    LINK_BITS,
    LINK_FRAME,
    LINK_FRAMES,
    LONGEST_FRAME,
    MODBUS_FRAMES,
    OF_THE_OWNER,
    CableCutIn,
    FaultIn,
    FlipBitsIn,
    InsertCharIn,
    LoseCharIn,
    NoiseIn,
    PauseIn,
    StationIn,
)
from bussim.scenario.schema.draft import Entry, readable
from bussim.scenario.yaml.source_map import Path, Report
from bussim.units import format_time
from bussim.wording import show, suggest

#: Faults of a slave's reply.
_OF_REPLIES = frozenset({"drop_reply", "slow"})


def _find(path: Path, name: str, nodes: Directory, report: Report, bus: str | None = None) -> Node | None:
    """The node of that name; what is wrong with it is reported."""
    try:
        return nodes.find(name, bus)
    except Missing as problem:
        report.error(path, str(problem))
        return None


def check_noise(resolved: Resolved, report: Report) -> None:
    """Check every entry of ``noise``."""
    for entry, noise in readable(resolved.draft.noise):
        _check_start(entry, noise.at, resolved.duration, report)
        if noise.station is None or noise.bus not in resolved.lines:
            continue
        node = _find((*entry.path, "station"), noise.station, resolved.nodes, report, noise.bus)
        if noise.reply_loss is not None and node is not None and not node.replies:
            report.warn((*entry.path, "station"), f"{_silence(node)} replies that could be lost")


def _silence(node: Node) -> str:
    """Why a node sends no reply, up to the word "replies"."""
    if node.role in (NodeRole.LINK_MASTER, NodeRole.MASTER):
        return f"{node.name} is a master: it sends no"
    return f"{node.name} is no slave: it sends no"


def _check_start(
    entry: Entry[NoiseIn] | Entry[FaultIn], at: int, duration: int | None, report: Report
) -> None:
    if duration is not None and at >= duration:
        name = report.source_map.full_name(entry.path)
        report.warn(
            (*entry.path, "at"),
            f"{name} begins at {format_time(at)}, after the end of the run ({format_time(duration)})",
        )


def check_faults(resolved: Resolved, report: Report) -> None:
    """Check every entry of ``faults``."""
    nodes, duration = resolved.nodes, resolved.duration
    switched_on: dict[str, Path] = {}
    for entry, fault in readable(resolved.draft.faults):
        kind = fault.kind
        if kind == "power_on":
            _check_power_on(entry, fault, nodes, switched_on, duration, report)
            continue
        _check_start(entry, fault.at or 0, duration, report)
        path = (*entry.path, kind)
        if not kind:
            continue
        if fault.cable_cut is not None:
            _check_cut(path, fault.cable_cut, resolved, report)
        elif fault.board_error is not None:
            _check_owner((*path, "plc"), fault.board_error.plc, nodes, report, plc_only=True)
        elif kind in OF_THE_OWNER:
            given: StationIn = getattr(fault, kind)
            subject = _subject(entry, kind)
            _check_owner(subject, given.station, nodes, report, plc_only=kind == "stop")
        else:
            _check_node(entry, kind, fault, nodes, report)


def _check_owner(path: Path, name: str, nodes: Directory, report: Report, *, plc_only: bool) -> None:
    """A fault of a whole PLC or device."""
    known = nodes.plcs if plc_only else [*nodes.plcs, *nodes.devices]
    if name in known or not known:
        return
    owner = name.partition(".")[0]
    if owner in known and owner != name:
        report.error(path, f"is {name}, but this happens to the whole of {owner}")
        return
    what = "no PLC" if plc_only or not nodes.devices else "no PLC and no device"
    if plc_only and name in nodes.devices:
        report.error(path, f"is {name}, a device, but this happens to PLCs only; {suggest(name, known)}")
        return
    report.error(path, f"is {show(name)}, which is {what}; {suggest(name, known)}")


def _check_power_on(
    entry: Entry[FaultIn],
    fault: FaultIn,
    nodes: Directory,
    switched_on: dict[str, Path],
    duration: int | None,
    report: Report,
) -> None:
    for name, tick in (fault.power_on or {}).items():
        path = (*entry.path, "power_on", name)
        if unknown := nodes.unknown(name):
            report.error(path, unknown, key=True)
        elif name in switched_on:
            where = report.where(switched_on[name])
            report.error(path, f"is given twice, first {where}", key=True)
        else:
            switched_on[name] = path
        if duration is not None and tick >= duration:
            report.warn(path, f"{name} is switched on at {format_time(tick)}, after the end of the run")


def _check_cut(path: Path, cut: CableCutIn, resolved: Resolved, report: Report) -> None:
    if cut.bus not in resolved.lines:
        return
    node = _find((*path, "after"), cut.after, resolved.nodes, report, cut.bus)
    if node is not None and resolved.nodes.on(cut.bus)[-1] is node:
        what = "station" if node.role in (NodeRole.LINK_MASTER, NodeRole.LINK_SLAVE) else "node"
        report.warn(
            (*path, "after"), f"{node.name} is the last {what} on {cut.bus}: a cut behind it changes nothing"
        )


def _subject(entry: Entry[FaultIn], kind: str) -> Path:
    """Where the fault names its station: in its mapping, or instead of it."""
    in_full = isinstance(entry.raw, dict) and isinstance(entry.raw.get(kind), dict)
    return (*entry.path, kind, "station") if in_full else (*entry.path, kind)


def _check_node(entry: Entry[FaultIn], kind: str, fault: FaultIn, nodes: Directory, report: Report) -> None:
    given: StationIn = getattr(fault, kind)
    path, subject = (*entry.path, kind), _subject(entry, kind)
    try:
        node = nodes.find(given.station)
    except Missing as problem:
        nothing = f": there is nothing for {kind} to act on" if str(problem).endswith("on no bus") else ""
        report.error(subject, f"{problem}{nothing}")
        return
    if node is None:
        return
    if kind in _OF_REPLIES and not node.replies:
        report.warn(subject, f"{_silence(node)} replies, and {kind} does nothing")
    wrong, right = fault.wrong_format, node.timing
    if wrong is not None and wrong.format in (None, right.format) and wrong.baud in (None, right.baud):
        report.warn(
            path,
            f"wrong_format of {node.name} is {right.baud} {right.format}, which is right: it does nothing",
        )
    if isinstance(given, LoseCharIn):
        _check_character(path, given, node, report)
    if isinstance(given, FlipBitsIn):
        _check_bits(path, given, node, report)
    if isinstance(given, PauseIn) and given.index is not None:
        longest = LINK_FRAME if _on_link(node) else RTU_MAX if node.mode is Mode.RTU else LONGEST_FRAME
        if given.index > longest - 2:
            report.error(
                (*path, "index"),
                f"is {given.index}, allowed 0..{longest - 2}: no frame of {node.name} goes on after it",
            )


def _on_link(node: Node) -> bool:
    return node.role in (NodeRole.LINK_MASTER, NodeRole.LINK_SLAVE)


def _check_character(path: Path, given: LoseCharIn, node: Node, report: Report) -> None:
    if _on_link(node) and given.index is not None and given.index >= LINK_FRAME:
        report.error((*path, "index"), f"is {given.index}, allowed 0..{LINK_FRAME - 1}")
    bits = node.timing.format.data_bits
    if isinstance(given, InsertCharIn) and given.value is not None and given.value >> bits:
        report.error((*path, "value"), f"is {given.value}, allowed 0..{(1 << bits) - 1}")


def _check_bits(path: Path, given: FlipBitsIn, node: Node, report: Report) -> None:
    if _on_link(node) and max(given.bits) >= LINK_BITS:
        report.error((*path, "bits"), f"has {max(given.bits)}, allowed 0..{LINK_BITS - 1}")
    if given.frame is None:
        return
    kinds = LINK_FRAMES if _on_link(node) else MODBUS_FRAMES if node.mode is not None else ()
    if given.frame not in kinds:
        protocol = "N:N" if _on_link(node) else "Modbus" if kinds else "no protocol with kinds of frames"
        allowed = f"; allowed {', '.join(kinds)}" if kinds else ""
        report.error((*path, "frame"), f"is {given.frame}, but {node.name} speaks {protocol}{allowed}")
