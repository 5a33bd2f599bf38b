"""From a draft without mistakes to the frozen scenario."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from bussim.forms.fields import PlcPoint
from bussim.line.contention import Contention
from bussim.plc.ports.spec import FreeSpec, PollSpec, PortSpec
from bussim.plc.scan import Scan
from bussim.scenario.build.canonical import canonical
from bussim.scenario.build.disturbances import faults_of, noise_of
from bussim.scenario.build.names import unique_names
from bussim.scenario.model import Bus, CarriedWarning, Edge, Latency, LinkAttachment, Plc, Scenario
from bussim.scenario.provenance import ASSUMED, ENTERED, MEASURED
from bussim.scenario.resolve.members import Member, device_name
from bussim.scenario.resolve.scenario import Resolved
from bussim.scenario.schema.draft import readable, values_of
from bussim.scenario.schema.profiles import ProfileIn
from bussim.scenario.schema.programs import LatencyIn

if TYPE_CHECKING:
    from bussim.devices.contract import BusDevice
    from bussim.scenario.schema.polls import TransactionIn


def build(resolved: Resolved) -> Scenario:
    """The scenario of a draft in which no mistake was found."""
    draft, nodes = resolved.draft, resolved.nodes
    document = draft.document
    if document is None:
        raise AssertionError("a draft without mistakes has a document")
    latency = values_of(draft.latency)
    observed = _observed(document.observe, latency)
    return Scenario(
        name=document.name,
        duration=document.duration,
        seed=document.seed,
        buses=tuple(
            Bus(line.name, line.bus.protocol, line.timing, Contention(line.bus.contention))
            for line in resolved.lines.values()
        ),
        plcs=tuple(_plc(member, resolved, observed.get(member.name, ())) for member in resolved.members),
        devices=_devices(resolved) if draft.devices else (),
        noise=noise_of(values_of(draft.noise), nodes),
        faults=faults_of([fault for fault in values_of(draft.faults) if fault.power_on is None], nodes),
        latency=_latency(latency),
        carried=tuple(CarriedWarning(each.code, each.text) for each in document.warnings),
        source=canonical(resolved, document),
    )


def _observed(observe: Sequence[PlcPoint], latency: Sequence[LatencyIn]) -> dict[str, tuple[str, ...]]:
    """Devices by PLC: those to be observed, and those that latencies are measured between."""
    points = [*observe, *(point for entry in latency for point in (entry.from_, entry.to))]
    found: dict[str, dict[str, None]] = {}
    for plc, device in points:
        found.setdefault(plc, {})[str(device)] = None
    return {plc: tuple(devices) for plc, devices in found.items()}


def _latency(given: Sequence[LatencyIn]) -> tuple[Latency, ...]:
    names = unique_names((entry.name for entry in given), (f"{entry.from_} to {entry.to}" for entry in given))
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


def _devices(resolved: Resolved) -> tuple[BusDevice, ...]:
    from bussim.scenario.build.polls import master_polls  # what only a scenario with devices pays

    return tuple(
        device.device(
            resolved.lines[device.bus].timing,
            resolved.power_on.get(device.name, 0),
            master_polls(values_of(resolved.draft.polls.get(entry.path, ()))),
            resolved.code.find,
        )
        for entry, device in readable(resolved.draft.devices)
    )


def _polls(member: Member, polls: Sequence[TransactionIn]) -> tuple[PollSpec | FreeSpec, ...]:
    if not polls:
        return ()
    from bussim.scenario.build.polls import polls_of  # what only a scenario with polls pays

    return polls_of(member, polls)


def _plc(member: Member, resolved: Resolved, observed: tuple[str, ...]) -> Plc:
    plc = member.plc
    return Plc(
        name=plc.name,
        profile=member.profile,
        scan=Scan(plc.scan.mean, plc.scan.jitter),
        link=LinkAttachment(member.bus, member.port) if member.bus is not None else None,
        registers=member.registers,
        sources={device_name(name) or name: source.value for name, source in plc.sources.items()},
        phase=plc.phase,
        power_on=resolved.power_on.get(plc.name, 0),
        ports=tuple(PortSpec(port.name, port.bus, port.words, port.bits) for port in member.ports),
        polls=_polls(member, values_of(resolved.draft.polls.get(member.path, ()))),
        program=member.logic.program,
        inputs=dict(member.logic.inputs),
        observed=observed,
        origins=_origins(plc.profile),
        comments=dict(member.logic.comments),
        scan_origin=ENTERED if "scan" in plc.model_fields_set else ASSUMED,
    )


def _origins(given: ProfileIn) -> dict[str, str]:
    """Where the fields of a profile come from that the file gives."""
    measured = given.measured or {}
    return {
        name: f"{MEASURED} in {measured[name]}" if name in measured else ENTERED
        for name in given.given("base", "measured")
    }
