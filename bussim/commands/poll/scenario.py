"""Poll lists of a scenario for ``bussim poll``: the same polls, line and times on a real port."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from bussim.commands.poll.plan import Plan, Planned
from bussim.devices.contract import BusDevice, MasterSettings
from bussim.engines.modbus.adu import Mode
from bussim.engines.modbus.pdu import WRITES
from bussim.errors import UsageError
from bussim.live.value_notation import Form
from bussim.plc.memory import Memory, parse_device
from bussim.plc.ports.cpavl import BadSettings, read_settings
from bussim.plc.ports.device_layout import fetch, fits, is_bits
from bussim.plc.ports.requests import poll_of
from bussim.plc.ports.spec import PollSpec, PortSpec
from bussim.scenario.model import Plc

if TYPE_CHECKING:
    from bussim.scenario.model import Scenario

_MODES = {"modbus-rtu-master": Mode.RTU, "modbus-ascii-master": Mode.ASCII}


def plan_of(file: str, node: str, *, allow_code: bool) -> Plan:
    """The polls of a master of a scenario: ``press1.COM3``, or the name of an ``hmi`` device.

    Raises ScenarioError for a bad file, UsageError where there is no such master. A write takes its
    ``values``, or what its device holds at power-on: there is no program here.
    """
    from bussim import api
    from bussim.words.values import suggest

    scenario = api.load(file, allow_code=allow_code)
    for device in scenario.devices:
        if device.name == node and isinstance(device.settings, MasterSettings):
            return _of_hmi(device, device.settings)
    for plc in scenario.plcs:
        for port in plc.ports:
            if node in (plc.port_node(port.name), f"{plc.name}.{port.name}"):
                return _of_port(plc, port)
    masters = _masters(scenario)
    hint = suggest(node, masters) if masters else "it has no Modbus master"
    raise UsageError(f"{file} has no port or HMI {node!r} with a poll list; {hint}")


def _masters(scenario: Scenario) -> list[str]:
    names = [device.name for device in scenario.devices if isinstance(device.settings, MasterSettings)]
    for plc in scenario.plcs:
        polled = {poll.port for poll in plc.polls if isinstance(poll, PollSpec)}
        names += [plc.port_node(port.name) for port in plc.ports if port.name in polled]
    return names


def _of_hmi(device: BusDevice, settings: MasterSettings) -> Plan:
    return Plan(
        mode=device.mode,
        line=device.timing,
        polls=_planned(settings.polls, device.name),
        timeout=settings.timeout,
        interval=settings.interval,
        turnaround=settings.turnaround,
    )


def _of_port(plc: Plc, port: PortSpec) -> Plan:
    memory = Memory()
    for name, value in plc.registers.items():
        memory.set(parse_device(name), value)
    node = plc.port_node(port.name)
    settings = read_settings(port.name, memory, port.words)
    if isinstance(settings, BadSettings):
        raise UsageError(f"{node}: {settings.text}")
    mode = _MODES.get(settings.protocol or "")
    if mode is None:
        raise UsageError(f"{node} speaks {settings.protocol or 'nothing'}: it is no Modbus master")
    polls = [
        _with_values(spec, memory)
        for spec in plc.polls
        if isinstance(spec, PollSpec) and spec.port == port.name
    ]
    return Plan(
        mode=mode,
        line=settings.timing,
        polls=_planned(tuple(polls), node),
        timeout=settings.timeout,
        interval=settings.interval,
        resync=False,  # as a PLC's port goes on
    )


def _with_values(spec: PollSpec, memory: Memory) -> PollSpec:
    """A write with what its device holds, where the poll itself has no values."""
    if spec.function not in WRITES or spec.values or spec.device is None:
        return spec
    if not fits(spec.device, spec.function, spec.count):
        raise UsageError(f"poll {spec.name}: {spec.count} items from {spec.device} on do not exist")
    return replace(spec, values=tuple(fetch(memory, spec.device, spec.function, spec.count)))


def _planned(specs: tuple[PollSpec, ...], node: str) -> tuple[Planned, ...]:
    if not specs:
        raise UsageError(f"{node} has no polls")
    planned = []
    for spec in specs:
        try:
            poll = poll_of(spec)
        except ValueError as error:
            raise UsageError(f"{node}: {error}") from error
        form = None if is_bits(spec.function) else Form.UINT
        planned.append(Planned(poll, spec.name, spec.address, form))
    return tuple(planned)
