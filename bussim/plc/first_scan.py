"""What a program sets before its PLC takes settings over: the first scan, tried on a scratch memory."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bussim.plc.inputs import Stimulus
from bussim.plc.link_registers import TAKE_PART, memory_at_power_on
from bussim.plc.memory import Device, Memory, parse_device
from bussim.plc.ports import cpavl
from bussim.plc.profiles import Profile

if TYPE_CHECKING:
    from bussim.plc.program.program import Program


@dataclass(frozen=True, slots=True)
class SetUpPort:
    """A CPAVL that was carried out: where a port's words and bits lie, and what the words hold then."""

    words: Device
    bits: Device
    registers: dict[str, int]


@dataclass(slots=True)
class FirstScan:
    """``link`` are those of M8179 and D8176–D8180 that the program sets; ``ports`` its CPAVLs by port."""

    link: dict[str, int] = field(default_factory=dict)
    ports: dict[str, SetUpPort] = field(default_factory=dict)


class _Calls:
    """Takes RS2 and CPAVL in place of the PLC's ports, and keeps the CPAVLs."""

    def __init__(self) -> None:
        self.devices: dict[str, tuple[Device, Device]] = {}

    def drive(self, instruction: int, operands: tuple[Device | int, ...], now: int) -> None:
        """An RS2 sends nothing here."""

    def cpavl(self, words: Device, bits: Device, port: int) -> bool:
        """Keep where a port's words and bits lie."""
        self.devices[f"COM{port}"] = (words, bits)
        return True


def first_scan(
    program: Program,
    profile: Profile,
    registers: Mapping[Device, int],
    inputs: Mapping[Device, Stimulus],
    now: int = 0,
) -> FirstScan:
    """Carry out RUN at ``now`` and the first scan of a PLC with these registers and inputs.

    A program that writes the value which is there already sets it as well: so it is tried on two
    memories that differ in the link's settings, and what is the same afterwards, or was changed, the
    program has set.
    """

    def powered() -> Memory:
        memory = memory_at_power_on(profile, registers)
        for device, stimulus in inputs.items():
            memory.set(device, stimulus.level(now))
        return memory

    before, memory, other = powered(), powered(), powered()
    settings = {name: parse_device(name) for name in TAKE_PART}
    for device in settings.values():
        other.set(device, other.get(device) ^ (0x5A5A if device.is_word else 1))
    calls = _tried(program, profile, memory, now)
    setting, linked = program, memory
    if profile.link_at_step_0:
        setting, linked = program.link_settings, powered()
        _tried(setting, profile, linked, now)
    _tried(setting, profile, other, now)
    found = FirstScan()
    for name, device in settings.items():
        value = linked.get(device)
        if value == other.get(device) or value != before.get(device):
            found.link[name] = value
    if program.uses_rs:
        calls.devices.setdefault(profile.rs_port, (cpavl.RS_WORDS, cpavl.RS_BITS))
    for port, (words, bits) in calls.devices.items():
        last = min(words.address + cpavl.WORDS, len(memory.words(words.letter)))
        values = {
            str(Device(words.letter, address)): memory.word(words.letter, address)
            for address in range(words.address, last)
        }
        found.ports[port] = SetUpPort(words, bits, {name: value for name, value in values.items() if value})
    if "COM2" in found.ports:
        station = memory.get(cpavl.COM2_STATION)
        found.ports["COM2"].registers[str(cpavl.COM2_STATION)] = station
    return found


def settings_under_m8038(
    program: Program,
    profile: Profile,
    memory: Memory,
    values: Mapping[int, int],
    inputs: Mapping[Device, Stimulus],
    now: int,
) -> dict[int, int]:
    """D8176–D8180 that a PLC takes over which wants M8038 at step 0, at RUN with this memory.

    ``values`` are theirs without the program, by address: what other rungs wrote is without effect.
    """
    scratch = deepcopy(memory)
    for address, value in values.items():
        scratch.set_word("D", address, value)
    for device, stimulus in inputs.items():
        scratch.set(device, stimulus.level(now))
    _tried(program.link_settings, profile, scratch, now)
    return {address: scratch.word("D", address) for address in values}


def _tried(program: Program, profile: Profile, memory: Memory, now: int) -> _Calls:
    """RUN and the first scan on a memory; returns the ports that it set up."""
    from bussim.plc.program.execution import ProgramRun  # what only a PLC with a program pays

    calls = _Calls()
    run = ProgramRun(program, memory, times=profile.instruction_times, ports=calls, power_on=now)
    run.run(now)
    run.scan(now)
    return calls
