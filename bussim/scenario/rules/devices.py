"""What is wrong or odd about a device on its bus; what its model is and allows, its form checks."""

from bussim.devices.forms import DeviceIn, MasterIn
from bussim.devices.free.model import FreeIn
from bussim.devices.free.scripted import MOST_WAITING
from bussim.engines.modbus.adu import Mode
from bussim.line.characters import LineTiming
from bussim.scenario.resolve.buses import Line
from bussim.scenario.resolve.scenario import Resolved
from bussim.scenario.rules.buses import understood
from bussim.scenario.schema.draft import Entry, readable
from bussim.scenario.yaml.source_map import Report
from bussim.units import format_ms, format_time
from bussim.wording import counted


def check_devices(resolved: Resolved, report: Report) -> None:
    """Check every entry of ``devices``."""
    loads: dict[str, float] = {}
    for entry, device in readable(resolved.draft.devices):
        if not device.known:
            continue
        line = resolved.lines.get(device.bus)
        if line is not None and line.is_link:
            nothing_else = "an N:N link, on which there are PLCs only (nn:)"
            report.error((*entry.path, "bus"), f"is {line.name}, {nothing_else}")
        elif line is not None and not line.entry.lost("nn", "baud", "format"):
            _check_line(entry, device, line, report)
            if isinstance(device, FreeIn):
                _check_load(entry, device, line, loads, report)
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


def _check_load(
    entry: Entry[DeviceIn], device: FreeIn, bus: Line, loads: dict[str, float], report: Report
) -> None:
    """Warn of the message with which what is sent again and again takes more than all of the time."""
    for number, message in enumerate(device.says):
        if message.every is None or (message.times is not None and message.times <= MOST_WAITING):
            continue
        size = len(message.message().data)
        takes, before = device.timing(bus.timing).characters(size), loads.get(bus.name, 0.0)
        loads[bus.name] = before + takes / message.every
        if before <= 1 < loads[bus.name]:
            report.warn(
                (*entry.path, "says", number, "every"),
                f"{device.name} sends {counted(size, 'character')} every {format_time(message.every)}, which "
                f"take {format_ms(takes)}{' beside what else is sent' if before else ''}: {bus.name} cannot "
                f"carry it; {MOST_WAITING} messages wait, what is due beyond them is never sent",
            )


def _check_baud(entry: Entry[DeviceIn], device: DeviceIn, timing: LineTiming, report: Report) -> None:
    port = device.port
    allowed = ", ".join(map(str, port.bauds))
    if timing.baud not in port.bauds and device.baud is not None:
        report.error((*entry.path, "baud"), f"is {timing.baud}, allowed {allowed} ({port.name})")
    elif timing.baud not in port.bauds:
        text = f"is {device.bus}, which runs at {timing.baud}, but a {port.name} has {allowed} only"
        report.error((*entry.path, "bus"), text)
