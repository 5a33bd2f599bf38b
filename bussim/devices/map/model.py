"""The device model ``map``: a Modbus slave whose register map the scenario defines."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated, Any, Self

from pydantic import Field, ValidationInfo, model_validator

from bussim.devices.areas import ADDRESSES, SECTIONS, WRITABLE
from bussim.devices.contract import Behaviour, BusDevice, DeviceEvent, SlaveSettings
from bussim.devices.forms import LONG, Find, Long, SlaveIn
from bussim.devices.map.map import Entry, UserMap
from bussim.devices.map.values import Computed, Fixed, Noise, Sweep, Value, noise_key
from bussim.devices.serial_settings import DevicePort
from bussim.engines.modbus.pdu import FUNCTIONS
from bussim.engines.modbus.slave import Slave
from bussim.forms.fields import CallableName, Flag, FunctionCode, Name, Positive, fail, whole
from bussim.forms.form import Model, only_one
from bussim.forms.mistakes import EntryView, Path, Reporter
from bussim.line.characters import LineTiming
from bussim.line.random_streams import Streams
from bussim.plc.ports.spec import PollSpec
from bussim.wording import names
from bussim.words.language import say

MAX_ENTRIES = 1000
MAP_PORT = DevicePort("map")
VALUE_KEYS = ("value", "ramp", "noise", "call")


@dataclass(frozen=True, slots=True)
class MapSettings(SlaveSettings):
    """The entries of the map, and the functions that it serves."""

    port = MAP_PORT

    entries: tuple[Entry, ...]
    functions: frozenset[int]

    def register_map(self) -> UserMap:
        """The map."""
        return UserMap(self.entries, self.functions)

    def behaviour(self, device: BusDevice, streams: Streams) -> MapBehaviour:
        """The map in a run."""
        return MapBehaviour(device, self)

    def seeded(self, seed: int, device: str) -> Self:
        """Noise has its key from seed, device and address, wherever it stands in the file."""
        return replace(self, entries=tuple(_seeded(entry, seed, device) for entry in self.entries))


def _seeded(entry: Entry, seed: int, device: str) -> Entry:
    if not isinstance(entry.value, Noise):
        return entry
    key = noise_key(seed, device, entry.space.value, entry.address)
    return replace(entry, value=replace(entry.value, key=key))


class MapBehaviour(Behaviour):
    """The map in a run, which reports the failures of the user's functions."""

    def __init__(self, device: BusDevice, settings: MapSettings) -> None:
        super().__init__(self._power_on)
        self._device = device
        self._settings = settings
        self._map = settings.register_map()

    def _power_on(self, now: int) -> tuple[Slave, LineTiming]:
        self._map = self._settings.register_map()
        return self._settings.engine(self._device, self._map), self._device.timing

    def events(self) -> Iterator[DeviceEvent]:
        """Functions that failed."""
        while (failure := self._map.poll()) is not None:
            warning = f"{self._device.name}: the function of {failure.name} failed: {failure.error}"
            yield DeviceEvent(failure.tick, "value_failed", f"{failure.name}: {failure.error}", warning)


class SweepIn(Model):
    """A value that goes linearly from one to another."""

    example = "{from: 0, to: 1000, over: 10 s}"

    from_: Long = Field(alias="from")
    to: Long
    over: Positive
    repeat: Flag = False


class NoiseValueIn(Model):
    """A random value."""

    example = "{center: 500, spread: 20, every: 1 s}"

    center: Long
    spread: Annotated[int, whole(0, LONG[1])]
    every: Positive
    normal: Flag = False


class ItemIn(Model):
    """Some equal items of a register map."""

    example = "{address: 0, value: 5}"

    name: Name | None = None
    address: Annotated[int, whole(0, ADDRESSES - 1)]
    count: Annotated[int, whole(1, ADDRESSES)] = 1
    value: Long | None = None
    ramp: SweepIn | None = None
    noise: NoiseValueIn | None = None
    call: CallableName | None = None
    words: Annotated[int, whole(1, 2)] = 1
    high_first: Flag = False
    writable: Flag = False
    low: Long | None = None
    high: Long | None = None

    @model_validator(mode="after")
    def _one_value(self, info: ValidationInfo) -> ItemIn:
        if any(getattr(self, key) is not None for key in VALUE_KEYS):
            only_one(self, VALUE_KEYS, info)
        if self.high_first and self.words == 1:
            raise fail(say("model_needs_words"), "high_first")
        for key in ("low", "high"):
            if getattr(self, key) is not None and not self.writable:
                raise fail(say("model_needs_writable"), key)
        if self.low is not None and self.high is not None and self.low > self.high:
            raise fail(say("model_below_low", high=self.high, low=self.low), "high")
        return self

    @property
    def end(self) -> int:
        """The first address behind it."""
        return self.address + self.count * self.words

    def values(self, find: Find) -> Value:
        """Where its value comes from. Raises ValueError for a function of the user that cannot be had."""
        if self.ramp is not None:
            return Sweep(self.ramp.from_, self.ramp.to, self.ramp.over, self.ramp.repeat)
        if self.noise is not None:
            return Noise(key=b"", **self.noise.given())  # the scenario gives it its key, from the seed
        if self.call is not None:
            return Computed(find(self.call))
        return Fixed(self.value or 0)


_Items = Annotated[list[ItemIn], Field(max_length=MAX_ENTRIES)]
_Functions = Annotated[list[FunctionCode], Field(min_length=1, max_length=8)]


class MapIn(SlaveIn):
    """An entry of this model."""

    example = """
{name: sensors, model: map, bus: feeder, station: 9, mode: ascii, delay: 3 ms, jitter: 2 ms,
  rtu_gaps: {end: 5, inner: 2, fast_character: 400 us},
  functions: [3, 4, 6], coils: [{address: 5}], inputs: [{address: 3, count: 4, value: 1, name: doors}],
  input_registers: [{address: 3, noise: {center: 500, spread: 20, every: 1 s, normal: true}}],
  registers: [{address: 0, ramp: {from: 5, to: 99, over: 10 s, repeat: true}},
    {address: 8, words: 2, high_first: true, writable: true, low: 1, high: 9}]}
"""
    port = MAP_PORT

    functions: _Functions | None = None
    coils: _Items = Field([])
    inputs: _Items = Field([])
    input_registers: _Items = Field([])
    registers: _Items = Field([])

    def check(self, entry: EntryView, find: Find, report: Reporter) -> None:
        """Check where its items lie, and their values."""
        super().check(entry, find, report)
        for section, space in SECTIONS.items():
            items: list[ItemIn] = getattr(self, section)
            for index, item in enumerate(items):
                path = (*entry.path, section, index)
                _check_item(path, section, item, find, report)
                if item.end > ADDRESSES:
                    text = say("model_end_beyond", address=item.address, last=item.end - 1)
                    report.error((*path, "address"), text)
                for before, other in enumerate(items[:index]):
                    if other.address < item.end and item.address < other.end:
                        where = report.where((*path[:-1], before))
                        text = say("model_already", address=item.address, other=other.address, where=where)
                        report.error((*path, "address"), text)
                        break
                if space.is_bit and item.words == 2:
                    report.error((*path, "words"), say("model_bits_one"))
        if not any(getattr(self, section) for section in SECTIONS) and not entry.lost(*SECTIONS):
            report.error(entry.path, say("model_nothing", sections=", ".join(SECTIONS)))

    def settings(self, polls: tuple[PollSpec, ...], find: Find) -> MapSettings:
        """Its entries. Raises ValueError for a function of the user that cannot be had."""
        entries = tuple(
            Entry(space=space, value=item.values(find), **item.given(*VALUE_KEYS))
            for section, space in SECTIONS.items()
            for item in getattr(self, section)
        )
        return MapSettings(entries, FUNCTIONS if self.functions is None else frozenset(self.functions))

    def fill(self, written: dict[str, Any]) -> None:
        """The functions that it serves."""
        super().fill(written)
        written["functions"] = sorted(FUNCTIONS if self.functions is None else self.functions)


def _check_item(path: Path, section: str, item: ItemIn, find: Find, report: Reporter) -> None:
    bit = SECTIONS[section].is_bit
    low, high = (0, 1) if bit else (-(1 << 16 * item.words - 1), (1 << 16 * item.words) - 1)
    values = [("value", item.value)]
    if item.ramp is not None:
        values = [("ramp.from", item.ramp.from_), ("ramp.to", item.ramp.to)]
    for key, value in values:
        if value is not None and not low <= value <= high:
            report.error((*path, *key.split(".")), say("form_between", value=value, least=low, most=high))
    for key in ("low", "high"):
        value = getattr(item, key)
        if value is not None and not 0 <= value <= high:
            report.error((*path, key), say("model_unsigned", value=value, high=high))
    if item.writable and SECTIONS[section] not in WRITABLE:
        writable = names(name for name, space in SECTIONS.items() if space in WRITABLE)
        report.error((*path, "writable"), say("model_cannot_write", section=section, writable=writable))
    if item.call is not None:
        try:
            find(item.call)
        except ValueError as error:
            report.error((*path, "call"), error.args[0])
