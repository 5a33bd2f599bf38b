"""What PLCs, ports, devices and buses have counted at the end of a run."""

from __future__ import annotations

from bussim.devices.contract import MasterSettings
from bussim.engines.nn.master import Master
from bussim.plc.link_registers import master_config, setting_values
from bussim.plc.plc import Plc
from bussim.scenario import model
from bussim.sim.nn.bus import LinkBus
from bussim.sim.serial.bus import SerialBus
from bussim.sim.serial.device import DeviceNode
from bussim.sim.serial.plc_port import PlcPort
from bussim.trace.records import BusTotals, DeviceTotals, LinkTotals, PlcTotals, PortTotals


def plc_totals(plc: Plc) -> PlcTotals:
    """A PLC's scans and registers."""
    cycle = plc.cycle
    return PlcTotals(
        name=plc.name,
        registers=plc.link_registers.registers(),
        own_names=plc.link_registers.own_names(),
        set_under=plc.profile.set_under,
        scans=cycle.count,
        scan_mean=cycle.total / cycle.count if cycle.count else None,
        scan_max=cycle.longest if cycle.count else None,
        state=plc.state.value,
    )


def link_totals(
    bus: LinkBus, primary: model.Plc | None, engine: Master | None, names: dict[int, str]
) -> LinkTotals:
    """A link as its primary master (None: it has none) sees it; ``engine`` is that master's while in RUN.

    ``names`` are the PLCs' names by station number.
    """
    counts, reporter = bus.reporter.counts(engine), bus.reporter
    errors = dict(counts.station_errors)
    settings = config = None
    if primary is not None:
        config = master_config(primary.profile, setting_values(primary.profile, primary.registers))
        settings = config.settings
        errors = {**dict.fromkeys(range(1, settings.slaves + 1), 0), **errors}
    return LinkTotals(
        bus=bus.name,
        plc_names=bus.plc_names,
        station_names=dict(names),
        master=None if primary is None else primary.name,
        slaves=settings.slaves if settings else None,
        mode=settings.mode if settings else None,
        retries=settings.retries if settings else None,
        attempts=config.attempts if config else None,
        timeout=config.timeout if config else None,
        polls=counts.polls,
        failed_attempts={station: dict(codes) for station, codes in counts.failed_attempts.items()},
        station_errors=errors,
        busy=bus.busy,
        frames=bus.frames,
        collisions=bus.collisions,
        undetected=bus.undetected_frames,
        healthy_at=reporter.healthy_at,
    )


def bus_totals(bus: SerialBus) -> BusTotals:
    """A bus beside the link."""
    return BusTotals(
        bus=bus.name,
        baud=bus.timing.baud,
        format=str(bus.timing.format),
        nodes=tuple(node.name for node in bus.ports),
        busy=bus.busy,
        frames=bus.frames,
        collisions=bus.collisions,
        undetected=bus.undetected_frames,
    )


def port_totals(port: PlcPort) -> PortTotals:
    """A PLC's port beside its link."""
    counts, settings = port.reporter.counts(port.name), port.port_registers.settings
    slave = port.kind == "response"
    return PortTotals(
        node=port.name,
        plc=port.plc.name,
        port=port.port_registers.spec.name,
        bus=port.bus.name,
        protocol=settings.protocol if settings is not None else None,
        station=settings.station if settings is not None and slave else None,
        errors=dict(port.reporter.errors.get(port.name, {})),
        requests=counts.requests,
        answered=counts.answered,
        exceptions=dict(counts.exceptions),
        rejected=dict(counts.rejected),
        timeout=settings.timeout if settings is not None and _is_master(settings.protocol) else None,
        late=dict(port.replies.late.get(port.name, {})),
    )


def _is_master(protocol: str | None) -> bool:
    """Whether a port with this protocol asks others."""
    return protocol is not None and protocol.endswith("-master")


def device_totals(node: DeviceNode, now: int) -> DeviceTotals:
    """A device; its state is that at ``now``."""
    counts, spec = node.reporter.counts(node.name), node.spec
    return DeviceTotals(
        name=spec.name,
        model=spec.model,
        bus=node.bus.name,
        station=spec.station,
        requests=counts.requests,
        answered=counts.answered,
        broadcasts=counts.broadcasts,
        exceptions=dict(counts.exceptions),
        rejected=dict(counts.rejected),
        state=node.state(now),
        timeout=spec.settings.timeout if isinstance(spec.settings, MasterSettings) else None,
        late=dict(node.replies.late.get(node.name, {})),
    )
