"""From a device's entry to what its register map is made of."""

from __future__ import annotations

from dataclasses import replace

from bussim.devices.stepper.profile import STEPPER_PROFILE, StepOutput, StepperProfile
from bussim.devices.user import Entry
from bussim.devices.values import Computed, Fixed, Noise, Sweep, Value
from bussim.engines.modbus.pdu import FUNCTIONS
from bussim.forms.fields import exact
from bussim.scenario.rules.devices import SPACES
from bussim.scenario.schema.devices import ItemIn, MapIn, StepperIn
from bussim.scenario.yaml.user_code import Code


def stepper_profile(given: StepperIn) -> StepperProfile:
    """The controller's profile with the given fields changed."""
    if given.profile is None:
        return STEPPER_PROFILE
    changes = {key: value for key, value in given.profile if value is not None}
    if given.profile.acceleration_unit is not None:
        changes["acceleration_unit"] = exact(given.profile.acceleration_unit)
    if given.profile.step_output is not None:
        changes["step_output"] = StepOutput(given.profile.step_output)
    return replace(STEPPER_PROFILE, **changes)


def functions(given: MapIn) -> frozenset[int]:
    """The functions that a map serves."""
    return frozenset(given.functions) if given.functions is not None else FUNCTIONS


def entries(given: MapIn, code: Code) -> tuple[Entry, ...]:
    """The items of a map. Raises ValueError for a function of the user that cannot be had."""
    return tuple(
        Entry(
            space=space,
            address=item.address,
            value=_value(item, code),
            count=item.count,
            name=item.name or "",
            writable=item.writable,
            words=item.words,
            high_first=item.high_first,
            low=item.low,
            high=item.high,
        )
        for section, (space, _) in SPACES.items()
        for item in getattr(given, section)
    )


def _value(item: ItemIn, code: Code) -> Value:
    if item.ramp is not None:
        return Sweep(item.ramp.from_, item.ramp.to, item.ramp.over, item.ramp.repeat)
    if item.noise is not None:
        # The scenario gives it its key, which follows the seed.
        return Noise(item.noise.center, item.noise.spread, item.noise.every, b"", item.noise.normal)
    if item.call is not None:
        return Computed(code.find(item.call))
    return Fixed(item.value or 0)
