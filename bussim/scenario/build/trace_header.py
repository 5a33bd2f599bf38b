"""What the first line of a trace says of a scenario."""

from __future__ import annotations

from bussim.plc.link_registers import D_STATION
from bussim.scenario.model import Bus, Scenario
from bussim.trace.records import TraceBus, TraceHeader


def trace_header(scenario: Scenario) -> TraceHeader:
    """The header of a trace of this scenario, its nodes in cable order: PLCs and their ports, then devices.

    Station numbers are those of the PLCs on N:N links and of the devices; a PLC's Modbus slave takes its own
    from CPAVL when it goes to RUN.
    """
    return TraceHeader(
        buses=tuple(_bus(bus, scenario) for bus in scenario.buses),
        scenario=scenario.name,
        seed=scenario.seed,
        duration=scenario.duration,
    )


def _bus(bus: Bus, scenario: Scenario) -> TraceBus:
    nodes: list[str] = []
    stations: dict[str, int] = {}
    for plc in scenario.plcs:
        if plc.link is not None and plc.link.bus == bus.name:
            nodes.append(plc.name)
            stations[plc.name] = plc.registers.get(f"D{D_STATION}", 0)
        nodes += [plc.port_node(port.name) for port in plc.ports if port.bus == bus.name]
    for device in scenario.devices:
        if device.bus == bus.name:
            nodes.append(device.name)
            if device.station is not None:
                stations[device.name] = device.station
    timing, own = bus.timing, bus.contention
    return TraceBus(bus.name, bus.protocol, timing.baud, str(timing.format), tuple(nodes), stations, own)
