"""The form of a scenario file: devices, each model with keys of its own."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import Field, ValidationInfo, model_validator

from bussim.devices.stepper.profile import StepOutput
from bussim.devices.stepper.registers import INPUTS, MAX_STEPS
from bussim.engines.modbus.adu import FIRST_STATION, LAST_STATION, Mode
from bussim.forms.fields import (
    Baud,
    Flag,
    Format,
    Hex,
    Name,
    Positive,
    Text,
    Time,
    Times,
    callable_name,
    choice,
    fail,
    function_code,
    number,
    time,
    whole,
)
from bussim.forms.form import Model, ScanIn, only_one
from bussim.units import TICKS_PER_SECOND

MAX_ENTRIES, MAX_MESSAGES = 1000, 1000
_LONG = (-(1 << 31), (1 << 32) - 1)
_Long = Annotated[int, whole(*_LONG)]
_Word = Annotated[int, whole(-32768, 0xFFFF)]
_Address = Annotated[int, whole(0, 0xFFFF)]
_Delay = Annotated[int, time(0, 60 * TICKS_PER_SECOND)]
_MODES = tuple(mode.value for mode in Mode)


class DeviceIn(Model):
    """What every device has."""

    example = "{name: feeder1, model: stepper, bus: feeder, station: 1}"
    #: Whether it is of a model that is known.
    known: ClassVar[bool] = True

    name: Name
    model: str
    bus: Name
    baud: Baud | None = None
    format: Format | None = None


class SlaveIn(DeviceIn):
    """A Modbus slave."""

    station: Annotated[int, whole(FIRST_STATION, LAST_STATION)] = 1
    mode: Annotated[str, choice(*_MODES)] = Mode.RTU.value
    delay: _Delay | None = None
    jitter: _Delay = 0


class LxIn(SlaveIn):
    """A PLC of which nothing but its Modbus port is simulated."""

    scan: ScanIn = ScanIn(mean="10 ms")  # type: ignore[arg-type] # read as from a file
    registers: dict[str, _Word] = Field({})


class V80In(SlaveIn):
    """A V80 or PPC controller; its items by reference number."""

    coils: dict[str, Annotated[int, whole(0, 1)]] = Field({})
    inputs: dict[str, Annotated[int, whole(0, 1)]] = Field({})
    input_registers: dict[str, _Word] = Field({})
    registers: dict[str, _Word] = Field({})


class SwitchIn(Model):
    """A switch along the axis."""

    example = "{input: 1, low: -100, high: 0}"

    input: Annotated[int, whole(1, INPUTS)]
    low: _Long | None = None
    high: _Long | None = None

    @model_validator(mode="after")
    def _in_order(self) -> SwitchIn:
        if self.low is not None and self.high is not None and self.low > self.high:
            raise fail(f"is {self.high}, below low ({self.low})", "high")
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
    """A stepper motor controller; its saved parameters by name, those of its program step by step."""

    registers: dict[str, _Long] = Field({})
    steps: Annotated[list[dict[str, _Long]], Field(max_length=MAX_STEPS)] = Field([])
    switches: Annotated[list[SwitchIn], Field(max_length=50)] = Field([])
    profile: StepperProfileIn | None = None


class SweepIn(Model):
    """A value that goes linearly from one to another."""

    example = "{from: 0, to: 1000, over: 10 s}"

    from_: _Long = Field(alias="from")
    to: _Long
    over: Positive
    repeat: Flag = False


class NoiseValueIn(Model):
    """A random value."""

    example = "{center: 500, spread: 20, every: 1 s}"

    center: _Long
    spread: Annotated[int, whole(0, _LONG[1])]
    every: Positive
    normal: Flag = False


class ItemIn(Model):
    """Some equal items of a register map."""

    example = "{address: 0, value: 5}"

    name: Name | None = None
    address: _Address
    count: Annotated[int, whole(1, 0x10000)] = 1
    value: _Long | None = None
    ramp: SweepIn | None = None
    noise: NoiseValueIn | None = None
    call: Annotated[str, callable_name()] | None = None
    words: Annotated[int, whole(1, 2)] = 1
    high_first: Flag = False
    writable: Flag = False
    low: _Long | None = None
    high: _Long | None = None

    @model_validator(mode="after")
    def _one_value(self, info: ValidationInfo) -> ItemIn:
        if any(getattr(self, key) is not None for key in VALUE_KEYS):
            only_one(self, VALUE_KEYS, info)
        if self.high_first and self.words == 1:
            raise fail("needs words: 2", "high_first")
        for key in ("low", "high"):
            if getattr(self, key) is not None and not self.writable:
                raise fail("needs writable: true", key)
        if self.low is not None and self.high is not None and self.low > self.high:
            raise fail(f"is {self.high}, below low ({self.low})", "high")
        return self


VALUE_KEYS = ("value", "ramp", "noise", "call")
_Items = Annotated[list[ItemIn], Field(max_length=MAX_ENTRIES)]


class MapIn(SlaveIn):
    """A register map of the scenario's own."""

    functions: Annotated[list[Annotated[int, function_code()]], Field(min_length=1, max_length=8)] | None = (
        None
    )
    coils: _Items = Field([])
    inputs: _Items = Field([])
    input_registers: _Items = Field([])
    registers: _Items = Field([])


class HmiIn(DeviceIn):
    """A Modbus master without a scan."""

    mode: Annotated[str, choice(*_MODES)] = Mode.RTU.value
    timeout: Annotated[int, time(1, 3600 * TICKS_PER_SECOND)] = TICKS_PER_SECOND
    interval: _Delay = TICKS_PER_SECOND // 200
    turnaround: _Delay = TICKS_PER_SECOND // 10
    polls: list[Any] = Field([])


class BytesIn(Model):
    """Bytes as text or in hexadecimal."""

    text: Text | None = None
    bytes: Hex | None = None

    @model_validator(mode="after")
    def _one_form(self, info: ValidationInfo) -> BytesIn:
        only_one(self, ("text", "bytes"), info)
        return self


class HeardIn(BytesIn):
    """Bytes that are answered."""

    example = 'a text, or {bytes: "02 41 03"}'
    shorthand = "text"


class MessageIn(BytesIn):
    """Something that a free-protocol device sends."""

    example = '{text: "ABC\\r", every: 1 s}'

    at: Time | None = None
    every: Positive | None = None
    times: Times | None = None
    jitter: Time | None = None
    reply_to: HeardIn | None = None
    delay: _Delay | None = None

    @model_validator(mode="after")
    def _on_its_own_or_a_reply(self) -> MessageIn:
        if self.reply_to is not None:
            for key in ("at", "every", "times", "jitter"):
                if getattr(self, key) is not None:
                    raise fail("excludes reply_to in the same entry", key)
        elif self.delay is not None:
            raise fail("needs reply_to", "delay")
        if self.times is not None and self.times > 1 and self.every is None:
            raise fail("needs every", "times")
        return self


class FreeIn(DeviceIn):
    """A device with a protocol of its own."""

    says: Annotated[list[MessageIn], Field(min_length=1, max_length=MAX_MESSAGES)]


#: The form of each model.
MODELS: dict[str, type[DeviceIn]] = {
    "lx": LxIn,
    "v80": V80In,
    "stepper": StepperIn,
    "map": MapIn,
    "hmi": HmiIn,
    "free": FreeIn,
}


class UnknownDeviceIn(DeviceIn):
    """A device of no known model: what can be read of it all the same."""

    known = False

    model: Annotated[str, choice(*MODELS)]


def form_of(raw: object) -> type[DeviceIn]:
    """The form in which an entry of ``devices`` is read."""
    model = raw.get("model") if isinstance(raw, dict) else None
    return MODELS.get(model, UnknownDeviceIn) if isinstance(model, str) else UnknownDeviceIn
