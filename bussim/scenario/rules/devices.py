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
from bussim.words.language import say


def check_devices(resolved: Resolved, report: Report) -> None:
    """Check every entry of ``devices``."""
    loads: dict[str, float] = {}
    for entry, device in readable(resolved.draft.devices):
        if not device.known:
            continue
        line = resolved.lines.get(device.bus)
        if line is not None and line.is_link:
            nothing_else = say("rule_plcs_only")
            report.error((*entry.path, "bus"), say("rule_bus_is", line=line.name, why=nothing_else))
        elif line is not None and not line.entry.lost("nn", "baud", "format"):
            _check_line(entry, device, line, report)
            if isinstance(device, FreeIn):
                _check_load(entry, device, line, loads, report)
        device.check(entry, resolved.code.find, report)


def _check_line(entry: Entry[DeviceIn], device: DeviceIn, bus: Line, report: Report) -> None:
    timing = device.timing(bus.timing)
    mode, _ = device.address()
    if mode is Mode.RTU and timing.format.data_bits != 8 and not entry.lost("mode", "format"):
        needs = say("rule_rtu_bits")
        if device.format is not None:
            report.error((*entry.path, "format"), say("rule_fixed", found=timing.format, why=needs))
        else:
            report.error(
                (*entry.path, "bus"), say("rule_bus_format", bus=bus.name, format=timing.format, why=needs)
            )
        return
    port = device.port
    if isinstance(device, MasterIn) and device.silence is not None and mode is Mode.RTU:
        waits = port.framing(mode, timing, device.silence).quiet + device.least_interval
        needed = port.framing(mode, timing).quiet
        if waits < needed:
            when = say("rule_goes_on_when", waits=format_ms(waits), needed=format_ms(needed))
            what = say("rule_one_frame")
            report.warn(
                (*entry.path, "silence"), say("rule_goes_on", device=device.name, when=when, what=what)
            )
    if not entry.lost("baud"):
        _check_baud(entry, device, timing, report)
    same = understood(entry.path, device.name, timing, bus, report)
    if same and port.formats and timing.format not in port.formats:
        formats = ", ".join(map(str, port.formats))
        report.warn(
            (*entry.path, "format" if device.format is not None else "bus"),
            say("rule_formats_only", device=device.name, format=timing.format, port=port.name, only=formats),
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
                say(
                    "rule_overloaded",
                    device=device.name,
                    size=size,
                    every=format_time(message.every),
                    takes=format_ms(takes),
                    what=say("rule_beside") if before else "",
                    bus=bus.name,
                    most=MOST_WAITING,
                ),
            )


def _check_baud(entry: Entry[DeviceIn], device: DeviceIn, timing: LineTiming, report: Report) -> None:
    port = device.port
    allowed = ", ".join(map(str, port.bauds))
    if timing.baud not in port.bauds and device.baud is not None:
        report.error(
            (*entry.path, "baud"),
            say("rule_not_among_port", baud=timing.baud, allowed=allowed, port=port.name),
        )
    elif timing.baud not in port.bauds:
        text = say("rule_bus_baud", bus=device.bus, baud=timing.baud, port=port.name, allowed=allowed)
        report.error((*entry.path, "bus"), text)
