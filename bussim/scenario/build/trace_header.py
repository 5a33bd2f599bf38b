"""What the first line of a trace says of a scenario."""

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
    stations = {
        plc.name: plc.registers.get(f"D{D_STATION}", 0)
        for plc in scenario.plcs
        if plc.link is not None and plc.link.bus == bus.name
    }
    stations |= {
        device.name: device.station
        for device in scenario.devices
        if device.bus == bus.name and device.station is not None
    }
    nodes = scenario.nodes_on(bus.name)
    timing, own = bus.timing, bus.contention
    return TraceBus(bus.name, bus.protocol, timing.baud, str(timing.format), nodes, stations, own)
