"""From a draft without mistakes to the frozen scenario."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from bussim.forms.fields import PlcPoint
from bussim.plc.ports.spec import FreeSpec, PollSpec, PortSpec
from bussim.plc.sources import Constant, Counter, Ramp, Source, Toggle
from bussim.scenario.build.canonical import canonical
from bussim.scenario.build.disturbances import faults_of, noise_of
from bussim.scenario.build.names import unique_names
from bussim.scenario.model import (
    Bus,
    Edge,
    Latency,
    LinkAttachment,
    Plc,
    Scan,
    Scenario,
)
from bussim.scenario.resolve.members import Member, device_name, line_of
from bussim.scenario.resolve.nodes import lines_of
from bussim.scenario.rules.check import Checked
from bussim.scenario.schema.document import SourceIn
from bussim.scenario.schema.draft import Draft, Entry
from bussim.scenario.schema.programs import LatencyIn
from bussim.scenario.yaml.source_map import Path

if TYPE_CHECKING:
    from bussim.devices.contract import BusDevice
    from bussim.devices.forms import DeviceIn
    from bussim.scenario.schema.polls import TransactionIn

#: Polls of PLCs and HMIs by the path of their owner.
Polls = Mapping[Path, Sequence["TransactionIn"]]


def build(draft: Draft, checked: Checked) -> Scenario:
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
        noise=noise_of(noise, nodes),
        faults=faults_of(acting, nodes),
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
    names = unique_names([entry.name for entry in given], [f"{entry.from_} to {entry.to}" for entry in given])
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
    from bussim.scenario.build.polls import master_polls  # what only a scenario with devices pays

    lines = lines_of(draft)
    return tuple(
        entry.value.device(
            lines[entry.value.bus],
            power_on.get(entry.value.name, 0),
            master_polls(polls.get(entry.path, ())),
            checked.code.find,
        )
        for entry in devices
        if entry.value is not None
    )


def _polls(member: Member, polls: Sequence[TransactionIn]) -> tuple[PollSpec | FreeSpec, ...]:
    if not polls:
        return ()
    from bussim.scenario.build.polls import polls_of

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
