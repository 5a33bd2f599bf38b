"""The device model ``stepper``: a stepper motor controller with its parameters, program and switches."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Annotated, Any

from pydantic import Field, model_validator

from bussim.devices.contract import Behaviour, BusDevice, DeviceEvent, SlaveSettings
from bussim.devices.forms import Find, Long, SlaveIn
from bussim.devices.stepper.axis import Switch
from bussim.devices.stepper.map import Stepper
from bussim.devices.stepper.profile import STEPPER_PORT, STEPPER_PROFILE, StepOutput, StepperProfile
from bussim.devices.stepper.registers import BY_NAME, COILS, INPUTS, MAX_STEPS, Group, signed
from bussim.engines.modbus.slave import Slave
from bussim.forms.fields import Flag, choice, fail, number, whole
from bussim.forms.form import Model, changed
from bussim.forms.mistakes import EntryView, Path, Reporter
from bussim.line.characters import LineTiming
from bussim.line.random_streams import Streams
from bussim.plc.ports.spec import PollSpec
from bussim.words.language import say
from bussim.words.values import suggest

#: Parameters that the scenario gives with the device itself.
_ELSEWHERE = ("station", "baud")
_OF_STEPS = [name for name, register in BY_NAME.items() if register.group is Group.STEP]
#: Parameters that an entry's ``registers`` may name: those that the controller saves.
_SAVED = [
    name
    for name, register in BY_NAME.items()
    if register.group in (Group.BASIC, Group.PROJECT, Group.STEP) and name not in _ELSEWHERE
]
#: Registers that hold a signed distance.
_SIGNED = ("distance", "step_distance")
#: Registers whose values at the end of a run are in its summary.
_STATE = ("position", "running", "arrived", "running_step")


@dataclass(frozen=True, slots=True)
class StepperSettings(SlaveSettings):
    """``registers`` are parameters by their names in the register table, as saved before power-on.

    ``steps`` are those of the program's steps, from the first on.
    """

    port = STEPPER_PORT
    station_register = BY_NAME["station"].address

    profile: StepperProfile = STEPPER_PROFILE
    switches: tuple[Switch, ...] = ()
    registers: dict[str, int] = field(default_factory=dict)
    steps: tuple[dict[str, int], ...] = ()

    def register_map(self, station: int = 1, baud: int = 9600) -> Stepper:
        """A controller under power, with its parameters saved. Raises ValueError as the controller does."""
        made = Stepper(station, baud, self.switches, self.profile)
        made.parameters.preset(self.registers, self.steps)
        return made

    def behaviour(self, device: BusDevice, streams: Streams) -> StepperBehaviour:
        """The controller in a run."""
        return StepperBehaviour(device, self)


class StepperBehaviour(Behaviour):
    """The controller exists on without supply: what was saved stays, and the axis stands where it was."""

    def __init__(self, device: BusDevice, settings: StepperSettings) -> None:
        super().__init__(self._power_on)
        self._device = device
        self._settings = settings
        self._stepper = settings.register_map(device.station or 1, device.timing.baud)
        if device.power_on > 0:
            self._stepper.power_off(0)

    def _power_on(self, now: int) -> tuple[Slave, LineTiming]:
        """The engine at the station and rate that were saved."""
        stepper, device = self._stepper, self._device
        stepper.power_on(now)
        timing = LineTiming(stepper.baud, device.timing.format, device.timing.ppm)
        now_set = replace(device, station=stepper.station, timing=timing)
        return self._settings.engine(now_set, stepper), timing

    def power_off(self, now: int) -> None:
        """What was not saved is lost."""
        self._stepper.power_off(now)

    def state(self, now: int) -> dict[str, int]:
        """Where the axis is, what it does, and how the controller is set."""
        stepper = self._stepper
        stepper.advance(now)
        found = {name: stepper.value(name, now) for name in _STATE}
        found["position"] = signed(found["position"])
        return {**found, "station": stepper.station, "baud": stepper.baud}

    def events(self) -> Iterator[DeviceEvent]:
        """What the controller does."""
        while (event := self._stepper.poll()) is not None:
            yield DeviceEvent(event[0], "device", event[1])


class SwitchIn(Model):
    """A switch along the axis."""

    example = "{input: 1, low: -100, high: 0}"

    input: Annotated[int, whole(1, INPUTS)]
    low: Long | None = None
    high: Long | None = None

    @model_validator(mode="after")
    def _in_order(self) -> SwitchIn:
        if self.low is not None and self.high is not None and self.low > self.high:
            raise fail(say("model_below_low", high=self.high, low=self.low), "high")
        return self


class StepperProfileIn(Model):
    """What the controller's manual leaves open."""

    example = "{save_coil: 1, refused_command: 4}"

    save_coil: Annotated[int, whole(1, 0xFFFF)] | None = None
    acceleration_unit: Annotated[float, number(1e-6, 1e6)] | None = None
    homing_zeroes: Flag | None = None
    refused_command: Annotated[int, whole(0, 4)] | None = None
    step_output: Annotated[str, choice(*StepOutput)] | None = None
    zero_is_endless: Flag | None = None


class StepperIn(SlaveIn):
    """An entry of this model; its saved parameters by name, those of its program step by step."""

    example = """
{name: feeder1, model: stepper, bus: feeder, station: 9, delay: 40 ms, jitter: 2 ms,
  rtu_gaps: {end: 5, inner: none, fast_character: none},
  registers: {pitch: 1000}, steps: [{step_speed: 300, step_distance: -500}],
  switches: [{input: 1, low: -5, high: 0}], profile: {save_coil: 30, acceleration_unit: 2.5,
  homing_zeroes: true, refused_command: 0, step_output: step, zero_is_endless: false}}
"""
    port = STEPPER_PORT

    registers: dict[str, Long] = Field({})
    steps: Annotated[list[dict[str, Long]], Field(max_length=MAX_STEPS)] = Field([])
    switches: Annotated[list[SwitchIn], Field(max_length=50)] = Field([])
    profile: StepperProfileIn | None = None

    def check(self, entry: EntryView, find: Find, report: Reporter) -> None:
        """Check the names and values of its parameters, and its profile's coil."""
        super().check(entry, find, report)
        path = (*entry.path, "registers")
        for name, value in self.registers.items():
            if name in _ELSEWHERE:
                report.error((*path, name), say("model_given_itself", name=name), key=True)
            elif self.steps and name in _OF_STEPS:
                text = say("model_excludes_steps")
                report.error((*path, name), text, key=True)
            else:
                _check_parameter(path, name, value, _SAVED, "model_not_saved", report)
        for index, step in enumerate(self.steps):
            for name, value in step.items():
                path = (*entry.path, "steps", index)
                _check_parameter(path, name, value, _OF_STEPS, "model_no_step", report)
        coil = self.profile.save_coil if self.profile is not None else None
        taken = COILS.get(coil) if coil is not None else None
        if taken not in (None, "save"):
            report.error((*entry.path, "profile", "save_coil"), say("model_coil_of", coil=coil, taken=taken))

    def _profile(self) -> StepperProfile:
        """The controller's profile with the given fields changed."""
        return changed(STEPPER_PROFILE, self.profile.given() if self.profile is not None else {})

    def settings(self, polls: tuple[PollSpec, ...], find: Find) -> StepperSettings:
        """Its profile, switches, parameters and steps."""
        switches = tuple(Switch(**switch.given()) for switch in self.switches)
        registers = _parameters(self.registers)
        if self.steps:
            registers.setdefault("total_steps", len(self.steps))
        return StepperSettings(self._profile(), switches, registers, tuple(map(_parameters, self.steps)))

    def fill(self, written: dict[str, Any]) -> None:
        """The whole profile."""
        super().fill(written)
        profile = self._profile()
        unit, output = float(profile.acceleration_unit), profile.step_output.value
        written["profile"] = asdict(profile) | {"acceleration_unit": unit, "step_output": output}


def _parameters(given: Mapping[str, int]) -> dict[str, int]:
    """Parameters as the controller's registers hold them."""
    return {name: value & ((1 << 16 * BY_NAME[name].words) - 1) for name, value in given.items()}


def _check_parameter(
    path: Path, name: str, value: int, allowed: Sequence[str], other: str, report: Reporter
) -> None:
    """Check one parameter by name; ``other`` is the key of what is said of one not ``allowed`` here."""
    if name not in allowed:
        known = say(other if name in BY_NAME else "model_no_register")
        report.error((*path, name), say("model_hint", known=known, hint=suggest(name, allowed)), key=True)
        return
    register = BY_NAME[name]
    low = -(1 << 31) if name in _SIGNED else register.low
    if not low <= value <= register.high:
        report.error(
            (*path, name),
            say("model_register_range", value=value, low=low, high=register.high, number=register.number),
        )
