"""From a draft without mistakes to the frozen scenario."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from bussim.forms.fields import PlcPoint, exact
from bussim.line.characters import LineTiming
from bussim.plc.ports.spec import FreeSpec, PollSpec, PortSpec
from bussim.plc.sources import Constant, Counter, Ramp, Source, Toggle
from bussim.scenario.build.canonical import canonical
from bussim.scenario.model import (
    BitErrors,
    BoardError,
    Burst,
    Bus,
    BusDevice,
    CableCut,
    ClockPpm,
    Direction,
    DropReply,
    Edge,
    Fault,
    FaultKind,
    FlipBits,
    Impulse,
    InsertChar,
    Jabber,
    Latency,
    LateRelease,
    LinkAttachment,
    LoseChar,
    Noise,
    NoiseKind,
    Plc,
    PowerOff,
    ReplyLoss,
    Scan,
    Scenario,
    Slow,
    Stop,
    Target,
    Window,
    WrongFormat,
)
from bussim.scenario.resolve.members import Member, device_name, line_of
from bussim.scenario.resolve.nodes import Directory, Node, lines_of
from bussim.scenario.rules.check import Checked
from bussim.scenario.rules.disturbances import OF_THE_OWNER
from bussim.scenario.schema.disturbances import FaultIn, NoiseIn
from bussim.scenario.schema.document import SourceIn
from bussim.scenario.schema.draft import Draft, Entry
from bussim.scenario.schema.programs import LatencyIn
from bussim.scenario.yaml.source_map import Path

if TYPE_CHECKING:
    from bussim.scenario.schema.devices import DeviceIn
    from bussim.scenario.schema.polls import TransactionIn

#: Polls of PLCs and HMIs by the path of their owner.
Polls = Mapping[Path, Sequence["TransactionIn"]]


def build(draft: Draft, checked: Checked, warnings: tuple[str, ...]) -> Scenario:
    """The scenario of a draft in which no mistake was found."""
    members, nodes = checked.members, checked.nodes
    document = draft.document
    if document is None:
        raise AssertionError("a draft without mistakes has a document")
    buses = [entry.value for entry in draft.buses if entry.value is not None]
    devices = [entry for entry in draft.devices if entry.value is not None]
    polls = {
        path: [poll.value for poll in found if poll.value is not None] for path, found in draft.polls.items()
    }
    noise = [entry.value for entry in draft.noise if entry.value is not None]
    faults = [entry.value for entry in draft.faults if entry.value is not None]
    latency = [entry.value for entry in draft.latency if entry.value is not None]
    observed = _observed(document.observe, latency)
    power_on: dict[str, int] = {}
    for fault in faults:
        power_on.update(fault.power_on or {})
    acting = [fault for fault in faults if fault.power_on is None]
    noise_names = _unique([entry.name for entry in noise], [_noise_label(entry, nodes) for entry in noise])
    fault_names = _unique([fault.name for fault in acting], [_fault_label(fault, nodes) for fault in acting])
    return Scenario(
        name=document.name,
        duration=document.duration,
        seed=document.seed,
        buses=tuple(Bus(bus.name, bus.protocol, line_of(bus)) for bus in buses),
        plcs=tuple(
            _plc(
                member,
                polls.get(member.path, ()),
                power_on.get(member.name, 0),
                observed.get(member.name, ()),
            )
            for member in members
        ),
        devices=_devices(devices, draft, polls, power_on, checked),
        noise=tuple(_noise(name, entry, nodes) for name, entry in zip(noise_names, noise, strict=True)),
        faults=tuple(_fault(name, fault, nodes) for name, fault in zip(fault_names, acting, strict=True)),
        warnings=warnings,
        latency=_latency(latency),
        source=canonical(
            document,
            buses,
            members,
            [(entry.value, polls.get(entry.path, ())) for entry in devices if entry.value is not None],
            polls,
            noise,
            faults,
            latency,
        ),
    )


def _observed(observe: Sequence[PlcPoint], latency: Sequence[LatencyIn]) -> dict[str, tuple[str, ...]]:
    """Devices by PLC: those to be observed, and those that latencies are measured between."""
    points = [*observe, *(point for entry in latency for point in (entry.from_, entry.to))]
    found: dict[str, dict[str, None]] = {}
    for plc, device in points:
        found.setdefault(plc, {})[str(device)] = None
    return {plc: tuple(devices) for plc, devices in found.items()}


def _latency(given: Sequence[LatencyIn]) -> tuple[Latency, ...]:
    names = _unique([entry.name for entry in given], [f"{entry.from_} to {entry.to}" for entry in given])
    return tuple(
        Latency(
            name,
            entry.from_.plc,
            str(entry.from_.device),
            entry.to.plc,
            str(entry.to.device),
            Edge(entry.edge or "both"),
            bool(entry.inverted),
        )
        for name, entry in zip(names, given, strict=True)
    )


def _devices(
    devices: Sequence[Entry[DeviceIn]],
    draft: Draft,
    polls: Polls,
    power_on: Mapping[str, int],
    checked: Checked,
) -> tuple[BusDevice, ...]:
    if not devices:
        return ()
    from bussim.scenario.build.devices import device_of  # what only a scenario with devices pays

    lines = lines_of(draft)
    return tuple(
        device_of(
            entry.value,
            polls.get(entry.path, ()),
            lines[entry.value.bus],
            power_on.get(entry.value.name, 0),
            checked.code,
        )
        for entry in devices
        if entry.value is not None
    )


def _polls(member: Member, polls: Sequence[TransactionIn]) -> tuple[PollSpec | FreeSpec, ...]:
    if not polls:
        return ()
    from bussim.scenario.build.devices import polls_of

    return polls_of(member, polls)


def _plc(member: Member, polls: Sequence[TransactionIn], power_on: int, observed: tuple[str, ...]) -> Plc:
    plc = member.plc
    return Plc(
        name=plc.name,
        profile=member.profile,
        scan=Scan(plc.scan.mean, plc.scan.jitter),
        link=LinkAttachment(member.bus, member.port) if member.bus is not None else None,
        registers=member.registers,
        sources={device_name(name) or name: _source(source) for name, source in plc.sources.items()},
        phase=plc.phase,
        power_on=power_on,
        ports=tuple(PortSpec(link.name, link.bus, link.words, link.bits) for link in member.ports),
        polls=_polls(member, polls),
        program=member.logic.program,
        inputs=dict(member.logic.inputs),
        observed=observed,
    )


def _source(given: SourceIn) -> Source:
    if given.toggle is not None:
        return Toggle(given.toggle)
    if given.counter is not None:
        return Counter(given.counter)
    if given.ramp is not None:
        return Ramp(given.ramp.from_, given.ramp.to, given.ramp.over)
    return Constant(given.constant or 0)


def _node(nodes: Directory, name: str, bus: str | None = None) -> Node:
    """The node that a fault or noise without mistakes names."""
    found = nodes.find(name, bus)
    if found is None:
        raise AssertionError(f"{name} was not found, but not reported either")
    return found


def _noise_label(noise: NoiseIn, nodes: Directory) -> str:
    place = _node(nodes, noise.station, noise.bus).name if noise.station is not None else noise.bus
    return f"{noise.kind} {place}"


def _fault_label(fault: FaultIn, nodes: Directory) -> str:
    if fault.cable_cut is not None:
        return f"cable_cut after {_node(nodes, fault.cable_cut.after, fault.cable_cut.bus).name}"
    if fault.board_error is not None:
        return f"board_error {fault.board_error.plc}"
    name = getattr(fault, fault.kind).station
    return f"{fault.kind} {name if fault.kind in OF_THE_OWNER else _node(nodes, name).name}"


def _unique(given: list[str | None], labels: list[str]) -> list[str]:
    """The given names, and for the rest their labels, numbered from the second of its kind on.

    A label has a space, which no given name has. It does not depend on the entry's position, so
    that another entry changes nobody's random stream.
    """
    seen: dict[str, int] = {}
    names = []
    for name, label in zip(given, labels, strict=True):
        if name is not None:
            names.append(name)
            continue
        seen[label] = seen.get(label, 0) + 1
        names.append(label if seen[label] == 1 else f"{label} #{seen[label]}")
    return names


def _noise(name: str, given: NoiseIn, nodes: Directory) -> Noise:
    kind: NoiseKind
    side = given.direction or Direction.RX
    if given.ber is not None:
        kind = BitErrors(given.ber)
    elif given.burst is not None:
        kind = Burst(given.burst.good, given.burst.bad, given.burst.ber_good, given.burst.ber_bad)
    elif given.impulse is not None:
        kind = Impulse(given.impulse.every, given.impulse.width, given.impulse.ber, given.impulse.phase)
    else:
        kind, side = ReplyLoss(given.reply_loss or 0.0), Direction.TX
    station = _node(nodes, given.station, given.bus).name if given.station is not None else None
    target = Target(given.bus, station, Direction(side))
    return Noise(name, target, kind, Window(given.at, given.for_))


def _fault(name: str, given: FaultIn, nodes: Directory) -> Fault:
    return Fault(name, _fault_kind(given, nodes), Window(given.at or 0, given.for_))


def _fault_kind(given: FaultIn, nodes: Directory) -> FaultKind:
    if given.power_off is not None:
        return PowerOff(given.power_off.station)
    if given.stop is not None:
        return Stop(given.stop.station)
    if given.cable_cut is not None:
        cut = given.cable_cut
        return CableCut(cut.bus, _node(nodes, cut.after, cut.bus).name)
    if given.board_error is not None:
        return BoardError(given.board_error.plc, given.board_error.port, given.board_error.code)
    return _node_fault(given, _node(nodes, getattr(given, given.kind).station))


def _node_fault(given: FaultIn, at: Node) -> FaultKind:
    """A fault of one node of a bus."""
    count, node = given.count, at.name
    if given.drop_reply is not None:
        return DropReply(node, count)
    if given.slow is not None:
        return Slow(node, given.slow.extra)
    if given.jabber is not None:
        return Jabber(node)
    if given.wrong_format is not None:
        wrong = given.wrong_format
        return WrongFormat(node, LineTiming(wrong.baud or at.timing.baud, wrong.format or at.timing.format))
    if given.clock_ppm is not None:
        return ClockPpm(node, exact(given.clock_ppm.ppm))
    if given.late_release is not None:
        return LateRelease(node, given.late_release.by)
    if given.insert_char is not None:
        insert = given.insert_char
        return InsertChar(node, Direction(insert.direction), count, insert.index, insert.value)
    if given.lose_char is not None:
        lose = given.lose_char
        return LoseChar(node, Direction(lose.direction), count, lose.index)
    if given.flip_bits is not None:
        flip = given.flip_bits
        return FlipBits(node, Direction(flip.direction), tuple(sorted(flip.bits)), count, flip.frame)
    raise AssertionError(f"no fault is made of {given.kind}")
