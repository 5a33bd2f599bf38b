"""The register map of a device of the scenario, as it is at power-on."""

from __future__ import annotations

from bussim.devices.areas import AreaMap
from bussim.devices.lx import LxMap
from bussim.devices.stepper.device import Stepper
from bussim.devices.user import UserMap
from bussim.devices.v80 import V80
from bussim.plc.memory import Memory, parse_device
from bussim.scenario.model import DeviceSettings, LxSettings, MapSettings, StepperSettings, V80Settings


def register_map(settings: DeviceSettings) -> AreaMap | None:
    """A new map with a slave's addresses, functions, limits and values; None for what is no slave.

    A stepper controller, whose map lives on without supply, is made by :func:`stepper`.
    """
    if isinstance(settings, MapSettings):
        return UserMap(settings.entries, settings.functions)
    if isinstance(settings, StepperSettings):
        return stepper(settings)
    if isinstance(settings, V80Settings):
        device = V80()
        for (space, address), value in settings.items.items():
            device.set(space, address, value)
        return device
    return plc_map(settings.registers) if isinstance(settings, LxSettings) else None


def plc_map(registers: dict[str, int]) -> LxMap:
    """What a PLC's slave port shows: devices by name."""
    memory = Memory()
    for name, value in registers.items():
        memory.set(parse_device(name), value)
    return LxMap(memory)


def stepper(settings: StepperSettings, station: int = 1, baud: int = 9600) -> Stepper:
    """A controller under power, with its parameters saved. Raises ValueError as the controller does."""
    made = Stepper(station, baud, settings.switches, settings.profile)
    made.parameters.preset(settings.registers, settings.steps)
    return made
