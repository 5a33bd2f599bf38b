"""From entries of ``devices`` and ``polls`` without mistakes to the scenario's frozen values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bussim.devices.profiles import DEVICE_PROFILES
from bussim.devices.scripted import Message
from bussim.devices.stepper.axis import Switch
from bussim.devices.stepper.registers import BY_NAME
from bussim.engines.modbus.adu import Mode
from bussim.engines.modbus.server import Space
from bussim.line.characters import LineTiming
from bussim.plc.ports.spec import FreeSpec, PollSpec
from bussim.scenario.model import (
    BusDevice,
    DeviceSettings,
    FreeSettings,
    HmiSettings,
    LxSettings,
    MapSettings,
    Scan,
    StepperSettings,
    V80Settings,
)
from bussim.scenario.resolve.map_entries import entries, functions, stepper_profile
from bussim.scenario.resolve.members import Member, raw_devices
from bussim.scenario.resolve.port_configuration import FREE, own_line
from bussim.scenario.rules.devices import SPACES, reference
from bussim.scenario.schema.devices import (
    DeviceIn,
    FreeIn,
    HmiIn,
    LxIn,
    MapIn,
    MessageIn,
    SlaveIn,
    StepperIn,
    V80In,
)
from bussim.scenario.schema.polls import PollIn, TransactionIn
from bussim.scenario.yaml.user_code import Code


def device_of(
    given: DeviceIn, polls: Sequence[TransactionIn], line: LineTiming, power_on: int, code: Code
) -> BusDevice:
    """One device; ``line`` is its bus's rate and format."""
    slave = given if isinstance(given, SlaveIn) else None
    delay = DEVICE_PROFILES[given.model].delay if given.model in DEVICE_PROFILES else 0
    mode = given.mode if isinstance(given, SlaveIn | HmiIn) else Mode.RTU
    return BusDevice(
        name=given.name,
        model=given.model,
        bus=given.bus,
        station=slave.station if slave is not None else None,
        mode=Mode(mode),
        timing=own_line(given, line),
        delay=slave.delay if slave is not None and slave.delay is not None else delay,
        jitter=slave.jitter if slave is not None else 0,
        settings=settings_of(given, polls, code),
        power_on=power_on,
    )


def settings_of(given: DeviceIn, polls: Sequence[TransactionIn], code: Code) -> DeviceSettings:
    """What is peculiar to its model. Raises ValueError for a function of the user that cannot be had."""
    if isinstance(given, LxIn):
        return LxSettings(Scan(given.scan.mean, given.scan.jitter), raw_devices(given.registers))
    if isinstance(given, V80In):
        return V80Settings(_items(given))
    if isinstance(given, StepperIn):
        switches = tuple(Switch(switch.input, switch.low, switch.high) for switch in given.switches)
        steps = tuple(_parameters(step) for step in given.steps)
        registers = _parameters(given.registers)
        if steps:
            registers.setdefault("total_steps", len(steps))
        return StepperSettings(stepper_profile(given), switches, registers, steps)
    if isinstance(given, MapIn):
        return MapSettings(entries(given, code), functions(given))
    if isinstance(given, HmiIn):
        specs = [transaction(name, "", poll) for name, poll in named_polls(polls)]
        return HmiSettings(tuple(specs), given.timeout, given.interval, given.turnaround)
    if isinstance(given, FreeIn):
        return FreeSettings(tuple(_message(message) for message in given.says))
    raise AssertionError(f"no device is made of model {given.model}")


def _parameters(given: Mapping[str, int]) -> dict[str, int]:
    """Parameters of a stepper controller as its registers hold them."""
    return {name: value & ((1 << 16 * BY_NAME[name].words) - 1) for name, value in given.items()}


def _items(given: V80In) -> dict[tuple[Space, int], int]:
    return {
        (space, reference(section, key)): value & 0xFFFF
        for section, (space, _) in SPACES.items()
        for key, value in getattr(given, section).items()
    }


def _message(given: MessageIn) -> Message:
    heard = given.reply_to
    return Message(
        data=given.text or given.bytes or b"",
        at=given.at or 0,
        every=given.every,
        times=given.times,
        jitter=given.jitter or 0,
        reply_to=(heard.text or heard.bytes or b"") if heard is not None else b"",
        delay=given.delay or 0,
    )


# -- polls ---------------------------------------------------------------------------------------------


def polls_of(member: Member, polls: Sequence[TransactionIn]) -> tuple[PollSpec | FreeSpec, ...]:
    """The polls of a PLC."""
    free = {config.name for config in member.ports if config.protocol == FREE}
    return tuple(
        _free(name, poll) if poll.port in free else transaction(name, poll.port, poll)
        for name, poll in named_polls(polls)
        if isinstance(poll, PollIn)
    )


def named_polls(polls: Sequence[TransactionIn]) -> list[tuple[str, TransactionIn]]:
    """Polls with their names: those given, for the rest what they ask.

    Those that ask the same are numbered from the second on; no other poll changes a name.
    """
    seen: dict[str, int] = {}
    named = []
    for poll in polls:
        name = poll.name
        if name is None:
            label = _label(poll)
            seen[label] = seen.get(label, 0) + 1
            name = label if seen[label] == 1 else f"{label} #{seen[label]}"
        named.append((name, poll))
    return named


def _label(poll: TransactionIn) -> str:
    port = [poll.port] if isinstance(poll, PollIn) else []
    if poll.function is None:
        return " ".join([*port, "free"])
    return " ".join([*port, f"station {poll.station}", f"{poll.function:02X}", f"@{poll.address}"])


def transaction(name: str, port: str, poll: TransactionIn) -> PollSpec:
    """A Modbus poll."""
    if poll.station is None or poll.function is None or poll.address is None:
        raise AssertionError("a poll without mistakes has a station, a function and an address")
    device = (poll.to or poll.from_) if isinstance(poll, PollIn) else None
    return PollSpec(
        name=name,
        port=port,
        station=poll.station,
        function=poll.function,
        address=poll.address,
        count=poll.quantity,
        device=device,
        values=tuple(value & 0xFFFF for value in poll.values or ()),
        every=poll.every,
        at=poll.at,
        times=poll.times,
        retries=poll.retries or 0,
    )


def _free(name: str, poll: PollIn) -> FreeSpec:
    data = poll.data or poll.text or b""
    return FreeSpec(
        name=name,
        port=poll.port,
        send=poll.send,
        send_count=poll.send_count if poll.send_count is not None else len(data),
        data=data,
        device=poll.to,
        count=poll.count or 0,
        every=poll.every,
        at=poll.at,
        times=poll.times,
    )
