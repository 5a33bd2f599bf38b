"""What is wrong or odd about a device on its bus; what its model is and allows, its form checks."""

from __future__ import annotations

from bussim.devices.forms import DeviceIn, MasterIn
from bussim.engines.modbus.adu import Mode
from bussim.line.characters import LineTiming
from bussim.scenario.resolve.buses import Line
from bussim.scenario.resolve.scenario import Resolved
from bussim.scenario.rules.buses import understood
from bussim.scenario.schema.draft import Entry, readable
from bussim.scenario.yaml.source_map import Report
from bussim.units import format_ms


def check_devices(resolved: Resolved, report: Report) -> None:
    """Check every entry of ``devices``."""
    for entry, device in readable(resolved.draft.devices):
        if not device.known:
            continue
        line = resolved.lines.get(device.bus)
        if line is not None and line.is_link:
            nothing_else = "an N:N link, on which there are PLCs only (nn:)"
            report.error((*entry.path, "bus"), f"is {line.name}, {nothing_else}")
        elif line is not None and not line.entry.lost("nn", "baud", "format"):
            _check_line(entry, device, line, report)
        device.check(entry, resolved.code.find, report)


def _check_line(entry: Entry[DeviceIn], device: DeviceIn, bus: Line, report: Report) -> None:
    timing = device.timing(bus.timing)
    mode, _ = device.address()
    if mode is Mode.RTU and timing.format.data_bits != 8 and not entry.lost("mode", "format"):
        needs = "Modbus RTU needs 8 data bits"
        if device.format is not None:
            report.error((*entry.path, "format"), f"is {timing.format}, but {needs}")
        else:
            report.error((*entry.path, "bus"), f"is {bus.name}, whose format is {timing.format}, but {needs}")
        return
    port = device.port
    if isinstance(device, MasterIn) and device.silence is not None and mode is Mode.RTU:
        waits = port.framing(mode, timing, device.silence).quiet + device.least_interval
        needed = port.framing(mode, timing).quiet
        if waits < needed:
            when = f"{format_ms(waits)} after a reply, which a silence of {format_ms(needed)} ends"
            what = "to slaves that received it, it and the next request are one frame"
            report.warn((*entry.path, "silence"), f"{device.name} goes on {when}: {what}")
    if not entry.lost("baud"):
        _check_baud(entry, device, timing, report)
    same = understood(entry.path, device.name, timing, bus, report)
    if same and port.formats and timing.format not in port.formats:
        report.warn(
            (*entry.path, "format" if device.format is not None else "bus"),
            f"{device.name} runs at {timing.format}; a {port.name} has "
            f"{', '.join(map(str, port.formats))} only",
        )


def _check_baud(entry: Entry[DeviceIn], device: DeviceIn, timing: LineTiming, report: Report) -> None:
    port = device.port
    allowed = ", ".join(map(str, port.bauds))
    if timing.baud not in port.bauds and device.baud is not None:
        report.error((*entry.path, "baud"), f"is {timing.baud}, allowed {allowed} ({port.name})")
    elif timing.baud not in port.bauds:
        text = f"is {device.bus}, which runs at {timing.baud}, but a {port.name} has {allowed} only"
        report.error((*entry.path, "bus"), text)
