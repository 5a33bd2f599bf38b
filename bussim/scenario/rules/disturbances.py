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
from bussim.words.language import say
from bussim.words.values import show, suggest

#: Faults of a slave's reply.
_OF_REPLIES = frozenset({"drop_reply", "slow"})


def _find(path: Path, name: str, nodes: Directory, report: Report, bus: str | None = None) -> Node | None:
    """The node of that name; what is wrong with it is reported."""
    try:
        return nodes.find(name, bus)
    except Missing as problem:
        report.error(path, problem.args[0])
        return None


def check_noise(resolved: Resolved, report: Report) -> None:
    """Check every entry of ``noise``."""
    for entry, noise in readable(resolved.draft.noise):
        _check_start(entry, noise.at, resolved.duration, report)
        if noise.station is None or noise.bus not in resolved.lines:
            continue
        node = _find((*entry.path, "station"), noise.station, resolved.nodes, report, noise.bus)
        if noise.reply_loss is not None and node is not None and not node.replies:
            report.warn((*entry.path, "station"), say("rule_lost_replies", silence=_silence(node)))


def _silence(node: Node) -> str:
    """Why a node sends no reply, up to the word "replies"."""
    if node.role in (NodeRole.LINK_MASTER, NodeRole.MASTER):
        return say("rule_is_master", node=node.name)
    return say("rule_no_slave", node=node.name)


def _check_start(
    entry: Entry[NoiseIn] | Entry[FaultIn], at: int, duration: int | None, report: Report
) -> None:
    if duration is not None and at >= duration:
        name = report.source_map.full_name(entry.path)
        report.warn(
            (*entry.path, "at"),
            say("rule_begins_late", name=name, at=format_time(at), duration=format_time(duration)),
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
    known = nodes.plcs if plc_only else [*nodes.plcs, *nodes.devices]
    if name in known or not known:
        return
    owner = name.partition(".")[0]
    if owner in known and owner != name:
        report.error(path, say("rule_whole", name=name, owner=owner))
        return
    what = say("rule_no_plc") if plc_only or not nodes.devices else say("rule_no_plc_or_device")
    if plc_only and name in nodes.devices:
        report.error(path, say("rule_device_not_plc", name=name, hint=suggest(name, known)))
        return
    report.error(path, say("rule_what_not", name=show(name), what=what, hint=suggest(name, known)))


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
            report.error(path, say("rule_twice_first", where=where), key=True)
        else:
            switched_on[name] = path
        if duration is not None and tick >= duration:
            report.warn(path, say("rule_on_late", name=name, tick=format_time(tick)))


def _check_cut(path: Path, cut: CableCutIn, resolved: Resolved, report: Report) -> None:
    if cut.bus not in resolved.lines:
        return
    node = _find((*path, "after"), cut.after, resolved.nodes, report, cut.bus)
    if node is not None and resolved.nodes.on(cut.bus)[-1] is node:
        what = say("word_station" if _on_link(node) else "word_node")
        report.warn((*path, "after"), say("rule_last_on_bus", node=node.name, what=what, bus=cut.bus))


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
        text = problem.args[0]
        if text.endswith("on no bus"):
            text = say("rule_nothing_to_act", problem=text, kind=kind)
        report.error(subject, text)
        return
    if node is None:
        return
    if kind in _OF_REPLIES and not node.replies:
        report.warn(subject, say("rule_kind_nothing", silence=_silence(node), kind=kind))
    wrong, right = fault.wrong_format, node.timing
    if wrong is not None and wrong.format in (None, right.format) and wrong.baud in (None, right.baud):
        report.warn(path, say("rule_format_right", node=node.name, baud=right.baud, format=right.format))
    if isinstance(given, LoseCharIn):
        _check_character(path, given, node, report)
    if isinstance(given, FlipBitsIn):
        _check_bits(path, given, node, report)
    if isinstance(given, PauseIn) and given.index is not None:
        longest = LINK_FRAME if _on_link(node) else RTU_MAX if node.mode is Mode.RTU else LONGEST_FRAME
        if given.index > longest - 2:
            report.error(
                (*path, "index"), say("rule_index_pause", index=given.index, most=longest - 2, node=node.name)
            )


def _on_link(node: Node) -> bool:
    return node.role in (NodeRole.LINK_MASTER, NodeRole.LINK_SLAVE)


def _check_character(path: Path, given: LoseCharIn, node: Node, report: Report) -> None:
    if _on_link(node) and given.index is not None and given.index >= LINK_FRAME:
        report.error((*path, "index"), say("rule_index", index=given.index, most=LINK_FRAME - 1))
    bits = node.timing.format.data_bits
    if isinstance(given, InsertCharIn) and given.value is not None and given.value >> bits:
        report.error((*path, "value"), say("rule_index", index=given.value, most=(1 << bits) - 1))


def _check_bits(path: Path, given: FlipBitsIn, node: Node, report: Report) -> None:
    if _on_link(node) and max(given.bits) >= LINK_BITS:
        report.error((*path, "bits"), say("rule_has_index", bits=max(given.bits), most=LINK_BITS - 1))
    if given.frame is None:
        return
    kinds = LINK_FRAMES if _on_link(node) else MODBUS_FRAMES if node.mode is not None else ()
    if given.frame not in kinds:
        protocol = "N:N" if _on_link(node) else "Modbus" if kinds else say("rule_no_kinds")
        allowed = say("rule_allowed_too", kinds=", ".join(kinds)) if kinds else ""
        report.error(
            (*path, "frame"),
            say("rule_speaks", frame=given.frame, node=node.name, protocol=protocol, allowed=allowed),
        )
