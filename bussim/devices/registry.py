"""The device models by name. A model is loaded when a scenario has a device of it."""

from importlib import import_module
from typing import Annotated, NoReturn

from bussim.devices.forms import DeviceIn, Find
from bussim.forms.fields import choice
from bussim.plc.ports.spec import PollSpec

#: Where the form of each model is. A new model is one line here.
MODELS = {
    "lx": "bussim.devices.lx.model:LxIn",
    "v80": "bussim.devices.v80.model:V80In",
    "stepper": "bussim.devices.stepper.model:StepperIn",
    "map": "bussim.devices.map.model:MapIn",
    "hmi": "bussim.devices.hmi:HmiIn",
    "free": "bussim.devices.free.model:FreeIn",
}


class UnknownDeviceIn(DeviceIn):
    """A device of no known model: what can be read of it all the same."""

    known = False

    model: Annotated[str, choice(*MODELS)]

    def settings(self, polls: tuple[PollSpec, ...], find: Find) -> NoReturn:
        """There are none: its model was reported."""
        raise AssertionError(f"{self.model} is no model")


def form_of(raw: object) -> type[DeviceIn]:
    """The form in which an entry of ``devices`` is read."""
    name = raw.get("model") if isinstance(raw, dict) else None
    if not isinstance(name, str) or name not in MODELS:
        return UnknownDeviceIn
    module, _, form = MODELS[name].partition(":")
    found: type[DeviceIn] = getattr(import_module(module), form)
    return found
