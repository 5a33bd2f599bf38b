"""What is wrong or odd about a device: what its model is and allows."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from bussim.devices.profiles import DEVICE_PROFILES, DeviceProfile
from bussim.devices.stepper.registers import BY_NAME, COILS, Group
from bussim.devices.v80 import V80_ITEMS
from bussim.engines.modbus.adu import Mode
from bussim.engines.modbus.server import Space
from bussim.forms.registers import check_registers
from bussim.line.characters import LineTiming
from bussim.scenario.resolve.members import line_of
from bussim.scenario.resolve.port_configuration import own_line
from bussim.scenario.rules.links import check_bus_name
from bussim.scenario.schema.devices import (
    DeviceIn,
    FreeIn,
    HmiIn,
    ItemIn,
    LxIn,
    MapIn,
    SlaveIn,
    StepperIn,
    V80In,
)
from bussim.scenario.schema.document import BusIn
from bussim.scenario.schema.draft import Entry
from bussim.scenario.yaml.source_map import Path, Report
from bussim.scenario.yaml.user_code import Code
from bussim.units import format_time
from bussim.wording import names, suggest

#: Sections of a register map, and their spaces with the first digit of their reference numbers.
SPACES = {
    "coils": (Space.COILS, 0),
    "inputs": (Space.INPUTS, 1),
    "input_registers": (Space.INPUT_REGISTERS, 3),
    "registers": (Space.HOLDING, 4),
}
_WRITABLE = ("coils", "registers")
#: Groups of the stepper's registers that are saved.
SAVED = (Group.BASIC, Group.PROJECT, Group.STEP)
#: Those that the scenario gives elsewhere.
_ELSEWHERE = {"station": "station", "baud": "baud"}
#: Registers that hold a signed distance.
SIGNED = ("distance", "step_distance")
_ADDRESSES = 0x10000


def check_device(
    entry: Entry[DeviceIn], device: DeviceIn, buses: Sequence[Entry[BusIn]], code: Code, report: Report
) -> None:
    """Judge one entry of ``devices``."""
    bus = check_bus_name((*entry.path, "bus"), device.bus, buses, report)
    if not device.known:
        return
    if bus is not None and bus.nn:
        report.error((*entry.path, "bus"), f"is {bus.name}, an N:N link, on which there are PLCs only (nn:)")
    elif bus is not None and not any(e.value is bus and e.lost("nn", "baud", "format") for e in buses):
        _check_line(entry, device, bus, report)
    if isinstance(device, SlaveIn):
        _check_slave(entry, device, report)
    check: dict[type[DeviceIn], Callable[[], None]] = {
        LxIn: lambda: _check_lx(entry, device, report),
        V80In: lambda: _check_v80(entry, device, report),
        StepperIn: lambda: _check_stepper(entry, device, report),
        MapIn: lambda: _check_map(entry, device, code, report),
        HmiIn: lambda: _check_hmi(entry, device, report),
        FreeIn: lambda: None,
    }
    check[type(device)]()


def _check_line(entry: Entry[DeviceIn], device: DeviceIn, bus: BusIn, report: Report) -> None:
    line = line_of(bus)
    timing = own_line(device, line)
    mode = getattr(device, "mode", None)
    if mode == Mode.RTU.value and timing.format.data_bits != 8 and not entry.lost("mode", "format"):
        needs = "Modbus RTU needs 8 data bits"
        if device.format is not None:
            report.error((*entry.path, "format"), f"is {timing.format}, but {needs}")
        else:
            report.error((*entry.path, "bus"), f"is {bus.name}, whose format is {timing.format}, but {needs}")
        return
    profile = DEVICE_PROFILES.get(device.model)
    if profile is not None and not entry.lost("baud"):
        _check_baud(entry, device, profile, timing, report)
    if (timing.baud, timing.format) != (line.baud, line.format):
        report.warn(
            entry.path,
            f"{device.name} runs at {timing.baud} {timing.format}, {bus.name} at {line.baud} {line.format}: "
            "nobody there understands it",
        )
    elif isinstance(device, StepperIn) and profile is not None and timing.format != profile.format:
        report.warn(
            (*entry.path, "format" if device.format is not None else "bus"),
            f"{device.name} runs at {timing.format}; a stepper controller has {profile.format} only",
        )


def _check_baud(
    entry: Entry[DeviceIn], device: DeviceIn, profile: DeviceProfile, timing: LineTiming, report: Report
) -> None:
    if timing.baud in profile.bauds:
        return
    allowed = ", ".join(map(str, profile.bauds))
    if device.baud is not None:
        report.error((*entry.path, "baud"), f"is {timing.baud}, allowed {allowed} ({profile.name})")
    else:
        report.error(
            (*entry.path, "bus"),
            f"is {device.bus}, which runs at {timing.baud}, but a {profile.name} has {allowed} only",
        )


def _check_slave(entry: Entry[DeviceIn], device: SlaveIn, report: Report) -> None:
    profile = DEVICE_PROFILES[device.model]
    if Mode(device.mode) not in profile.modes:
        allowed = ", ".join(mode.value for mode in profile.modes)
        report.error((*entry.path, "mode"), f"is {device.mode}, allowed {allowed} ({profile.name})")
    if device.delay is not None and device.delay < profile.delay:
        report.error(
            (*entry.path, "delay"),
            f"is {format_time(device.delay)}, but a {profile.name} answers no sooner than "
            f"{format_time(profile.delay)}",
        )


def _check_lx(entry: Entry[DeviceIn], device: DeviceIn, report: Report) -> None:
    if isinstance(device, LxIn):
        check_registers((*entry.path, "registers"), device.registers, report, link=False)


# -- v80 -----------------------------------------------------------------------------------------------


def reference(section: str, key: str) -> int:
    """The address of a reference number such as 40108 or 00127, or of a plain number such as 127.

    Raises ValueError with a message for the user.
    """
    digit = SPACES[section][1]
    low, high = digit * 10_000 + 1, digit * 10_000 + V80_ITEMS
    allowed = f"allowed {low:05}..{high:05}" + (f" or 1..{V80_ITEMS}" if digit else "")
    if not (key.isascii() and key.isdecimal() and len(key) <= 5):
        raise ValueError(f"is no reference number; {allowed}")
    number = int(key)
    if low <= number <= high:
        return number - low
    if 1 <= number <= V80_ITEMS and not (len(key) == 5 and digit):
        return number - 1
    owner = next((name for name, (_, first) in SPACES.items() if first == number // 10_000), None)
    other = f" but of {owner}" if owner not in (None, section) and len(key) == 5 else ""
    raise ValueError(f"is no reference number of {section}{other}; {allowed}")


def _check_v80(entry: Entry[DeviceIn], device: DeviceIn, report: Report) -> None:
    for section in SPACES:
        seen: dict[int, str] = {}
        for key in getattr(device, section):
            path = (*entry.path, section, key)
            try:
                address = reference(section, key)
            except ValueError as error:
                report.error(path, str(error), key=True)
                continue
            first = seen.setdefault(address, key)
            if first != key:
                report.error(path, f"is the same item as {first}", key=True)


# -- stepper -------------------------------------------------------------------------------------------


def _check_stepper(entry: Entry[DeviceIn], device: DeviceIn, report: Report) -> None:
    if not isinstance(device, StepperIn):
        return
    saved = [name for name, register in BY_NAME.items() if register.group in SAVED]
    allowed = [name for name in saved if name not in _ELSEWHERE]
    of_steps = [name for name in saved if BY_NAME[name].group is Group.STEP]
    for name, value in device.registers.items():
        path = (*entry.path, "registers", name)
        if name in _ELSEWHERE:
            report.error(path, f"is given with the device itself ({_ELSEWHERE[name]}:)", key=True)
        elif name not in allowed:
            known = "is not saved by the controller" if name in BY_NAME else "is no register"
            report.error(path, f"{known}; {suggest(name, allowed)}", key=True)
        elif device.steps and name in of_steps:
            report.error(path, "excludes steps, which are all steps of the program", key=True)
        else:
            _check_parameter(path, name, value, report)
    for number, step in enumerate(device.steps):
        for name, value in step.items():
            path = (*entry.path, "steps", number, name)
            if name in of_steps:
                _check_parameter(path, name, value, report)
            else:
                known = "belongs to no step" if name in BY_NAME else "is no register"
                report.error(path, f"{known}; {suggest(name, of_steps)}", key=True)
    coil = device.profile.save_coil if device.profile is not None else None
    taken = next((known.name for known in COILS if known.number == coil and known.name != "save"), None)
    if taken is not None:
        report.error((*entry.path, "profile", "save_coil"), f"is {coil}, the coil of {taken}")


def _check_parameter(path: Path, name: str, value: int, report: Report) -> None:
    register = BY_NAME[name]
    low = -(1 << 31) if name in SIGNED else register.low
    if not low <= value <= register.high:
        report.error(path, f"is {value}, allowed {low}..{register.high} ({register.number})")


# -- map -----------------------------------------------------------------------------------------------


def _check_map(entry: Entry[DeviceIn], device: DeviceIn, code: Code, report: Report) -> None:
    for section, (space, _) in SPACES.items():
        items: list[ItemIn] = getattr(device, section)
        taken: list[tuple[int, int, Path]] = []
        for index, item in enumerate(items):
            path = (*entry.path, section, index)
            _check_item(path, section, item, code, report)
            end = item.address + item.count * item.words
            if end > _ADDRESSES:
                report.error(
                    (*path, "address"), f"is {item.address}; its items end at {end - 1}, beyond 65535"
                )
            for start, stop, other in taken:
                if start < end and item.address < stop:
                    where = report.where(other)
                    report.error(
                        (*path, "address"),
                        f"is {item.address}, where the item at {start} already lies ({where})",
                    )
                    break
            taken.append((item.address, end, path))
            if space.is_bit and item.words == 2:
                report.error((*path, "words"), "is 2, but bits have one")
    if not any(getattr(device, section) for section in SPACES) and not entry.lost(*SPACES):
        report.error(entry.path, f"has nothing in it; expected one of {', '.join(SPACES)}")


def _check_item(path: Path, section: str, item: ItemIn, code: Code, report: Report) -> None:
    bit = SPACES[section][0].is_bit
    low, high = (0, 1) if bit else (-(1 << 16 * item.words - 1), (1 << 16 * item.words) - 1)
    values = [("value", item.value)]
    if item.ramp is not None:
        values = [("ramp.from", item.ramp.from_), ("ramp.to", item.ramp.to)]
    for key, value in values:
        if value is not None and not low <= value <= high:
            report.error((*path, *key.split(".")), f"is {value}, allowed {low}..{high}")
    for key in ("low", "high"):
        value = getattr(item, key)
        if value is not None and not 0 <= value <= high:
            report.error((*path, key), f"is {value}, allowed 0..{high} (unsigned)")
    if item.writable and section not in _WRITABLE:
        report.error(
            (*path, "writable"), f"is true, but Modbus cannot write {section}, only {names(_WRITABLE)}"
        )
    if item.call is not None:
        try:
            code.find(item.call)
        except ValueError as error:
            report.error((*path, "call"), str(error))


def _check_hmi(entry: Entry[DeviceIn], device: DeviceIn, report: Report) -> None:
    if isinstance(device, HmiIn) and not device.polls and not entry.lost("polls"):
        report.warn(entry.path, f"{device.name} has no polls: it sends nothing")
