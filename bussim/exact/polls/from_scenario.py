"""A scenario's poll lists as :class:`~bussim.exact.polls.poll_list.PollListModel` values.

The figures are those without errors: noise and faults are left out (and named), except that a slave which a
fault makes slow is as slow as that, and one that is dead for the whole run is named.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeVar, assert_never

from bussim.devices.contract import BusDevice, FreeProtocolSettings, MasterSettings, SlaveSettings
from bussim.devices.lx.map import LxMap
from bussim.engines.modbus.framing import Framing
from bussim.exact.polls.failures import LineErrors
from bussim.exact.polls.master_timing import Direct, Scans, Span, exactly
from bussim.exact.polls.one_poll import MasterModel, joined, poll_model, silence_needed, too_hasty
from bussim.exact.polls.poll_list import PollListModel, PollModel
from bussim.exact.polls.slaves import SlaveModel, device_model
from bussim.line.characters import LineTiming
from bussim.plc.link_registers import bad_parameters, setting_values
from bussim.plc.memory import Memory
from bussim.plc.ports.cpavl import BadSettings, PortSettings, configured
from bussim.plc.ports.spec import FreeSpec, PollSpec
from bussim.scenario.fault_kinds import DropReply, PowerOff, Slow, Stop
from bussim.scenario.model import Fault, Plc, Scenario, Window
from bussim.units import round_half_up
from bussim.wording import names
from bussim.words.language import say


def poll_lists(
    scenario: Scenario, *, sized: bool = False, baud: int | None = None, join: bool = False
) -> dict[str, PollListModel]:
    """Every poll list of a scenario, by its node: ``press1.COM3``, or an HMI's name.

    ``sized``: timeout and interval are still to be chosen, so that none is too short. ``baud`` is the rate of
    every bus with polls instead of its own; ``join`` makes neighbouring reads one each.
    """
    return _Reader(scenario, sized=sized, baud=baud, join=join).read()


@dataclass(slots=True)
class _Port:
    """One port of a PLC and what its words say."""

    plc: Plc
    name: str
    bus: str
    settings: PortSettings | BadSettings

    @property
    def node(self) -> str:
        return self.plc.port_node(self.name)

    @property
    def protocol(self) -> str:
        settings = self.settings
        return settings.protocol or "" if isinstance(settings, PortSettings) else ""

    @property
    def works(self) -> bool:
        """Whether it may have a transaction under way."""
        return self.protocol not in ("", "hmi")


@dataclass(slots=True)
class _Reader:
    scenario: Scenario
    sized: bool = False
    baud: int | None = None
    join: bool = False
    ports: list[_Port] = field(default_factory=list)
    slaves: list[SlaveModel] = field(default_factory=list)
    masters: list[MasterModel] = field(default_factory=list)
    asking: dict[str, list[str]] = field(default_factory=dict)  # masters by bus
    scripted: dict[str, list[str]] = field(default_factory=dict)
    broken: dict[str, PollListModel] = field(default_factory=dict)

    def read(self) -> dict[str, PollListModel]:
        scenario = self.scenario
        for plc in scenario.plcs:
            self.ports += _ports(plc, self.baud)
        for port in self.ports:
            self._port(port)
        for device in scenario.devices:
            self._device(_at(device, self.baud))
        found = self.broken | {master.node: self._list(master) for master in self.masters}
        order = [port.node for port in self.ports] + [device.name for device in scenario.devices]
        return {node: found[node] for node in order if node in found}

    # -- nodes ------------------------------------------------------------------------------

    def _port(self, port: _Port) -> None:
        plc, settings = port.plc, port.settings
        polls = [poll for poll in plc.polls if poll.port == port.name]
        asked = tuple(poll for poll in polls if isinstance(poll, PollSpec))
        said = [poll for poll in polls if isinstance(poll, FreeSpec)]
        if isinstance(settings, BadSettings):
            if polls:
                self._no_list(port, settings.text)
            return
        profile, protocol = plc.profile, port.protocol
        if protocol == "free":
            if any(poll.sends for poll in said):
                self.scripted.setdefault(port.bus, []).append(port.node)
            if polls:
                self._no_list(port, say("poll_free"))
            return
        if plc.program is not None and protocol.endswith("-master") and (polls or plc.program.uses_ports):
            self._program(port, say("poll_longer_scans" if polls else "poll_drives"))
            return
        framing = (
            Framing.ascii(profile.ascii_gap)
            if "ascii" in protocol
            else Framing.rtu(settings.timing, profile.rtu_gaps)
            if "rtu" in protocol
            else None
        )
        if framing is None:
            if polls:
                self._no_list(port, say("poll_no_protocol"))
        elif protocol.endswith("-slave"):
            self._slave_port(port, settings, framing)
        elif asked:
            self._master(
                MasterModel(
                    node=port.node,
                    bus=port.bus,
                    framing=framing,
                    timing=settings.timing,
                    timeout=settings.timeout,
                    turnaround=profile.broadcast_turnaround,
                    master_timing=self._scans(port, settings.interval),
                    polls=asked,
                    begun_holds=profile.begun_holds,
                    first_end=plc.phase or 0,  # where it is random, it may be any
                    words=next(spec.words.address for spec in plc.ports if spec.name == port.name),
                )
            )

    def _slave_port(self, port: _Port, settings: PortSettings, framing: Framing) -> None:
        plc = port.plc
        if [poll for poll in plc.polls if poll.port == port.name]:
            self._no_list(port, say("poll_slave"))
        loads = sum(other.works for other in self.ports if other.plc is plc) * plc.profile.transaction_time
        self.slaves.append(
            SlaveModel(
                name=port.node,
                owner=plc.name,
                bus=port.bus,
                station=settings.station,
                framing=framing,
                timing=settings.timing,
                map=LxMap(Memory()),
                end=_scan(plc).most + loads - 1,
                extra=self._slowness(port.node),
                off=self._off(plc.name, port.node),
                programmed=plc.program is not None,
            )
        )

    def _program(self, port: _Port, why: str) -> None:
        self.asking.setdefault(port.bus, []).append(port.node)
        self._no_list(port, why)

    def _scans(self, port: _Port, interval: int) -> Scans:
        plc = port.plc
        execution = plc.profile.transaction_time
        others = sum(other.works for other in self.ports if other.plc is plc and other is not port)
        return Scans(_scan(plc), execution, others * execution, interval)

    def _master(self, master: MasterModel) -> None:
        self.asking.setdefault(master.bus, []).append(master.node)
        errors = LineErrors.of(self.scenario.noise, master.bus, master.node)
        polls, names_joined = joined(master.polls) if self.join else (master.polls, ())
        changed = replace(master, errors=errors, sized=self.sized, polls=polls, joined=names_joined)
        self.masters.append(changed)

    def _no_list(self, port: _Port, why: str) -> None:
        self.broken[port.node] = PollListModel(port.node, port.bus, port.protocol, obstacles=(why,))

    def _device(self, device: BusDevice) -> None:
        name, bus = device.name, device.bus
        match device.settings:
            case FreeProtocolSettings():
                self.scripted.setdefault(bus, []).append(name)
            case SlaveSettings() as slave:
                extra, off = self._slowness(name), self._off(name, name)
                found = device_model(device, slave, extra=extra, off=off)
                if found is not None:
                    self.slaves.append(found)
            case MasterSettings() as master:
                if master.polls:
                    self._master(_device_master(device, master))
            case _ as never:
                assert_never(never)

    # -- faults ------------------------------------------------------------------------------------

    def _whole(self, window: Window) -> bool:
        return window.at == 0 and (window.until is None or window.until >= self.scenario.duration)

    def _slowness(self, node: str) -> Span:
        extra = Span(0, 0)
        for fault in self.scenario.faults:
            kind = fault.kind
            if isinstance(kind, Slow) and kind.node == node:
                extra += Span(kind.extra if self._whole(fault.window) else 0, kind.extra)
        return extra

    def _off(self, owner: str, node: str) -> bool:
        return any(
            self._whole(fault.window)
            and (
                (isinstance(fault.kind, (PowerOff, Stop)) and fault.kind.node == owner)
                or (
                    isinstance(fault.kind, DropReply) and fault.kind.node == node and fault.kind.count is None
                )
            )
            for fault in self.scenario.faults
        )

    def _left_out(self, bus: str, off: Iterable[str]) -> list[str]:
        """What else the scenario does to a bus, which has no say in figures without errors."""
        nodes = {port.node for port in self.ports if port.bus == bus}
        nodes |= {port.plc.name for port in self.ports if port.bus == bus}
        nodes |= {device.name for device in self.scenario.devices if device.bus == bus}
        gone = set(off)
        found = [
            fault.name
            for fault in self.scenario.faults
            if not isinstance(fault.kind, Slow)
            and _owner(fault) in nodes | {bus}
            and _owner(fault) not in gone
        ]
        found += [noise.name for noise in self.scenario.noise if noise.target.bus == bus]
        return [say("poll_left_out", names=names(found))] if found else []

    # -- the list ----------------------------------------------------------------------------------

    def _list(self, master: MasterModel) -> PollListModel:
        slaves = [slave for slave in self.slaves if slave.bus == master.bus]
        obstacles = self._crowd(master)
        polls: list[PollModel] = []
        asked: list[SlaveModel] = []
        for spec in master.polls:
            poll = poll_model(master, spec, slaves)
            if isinstance(poll, str):
                obstacles.append(say("poll_of", poll=spec.name, why=poll))
            else:
                polls.append(poll)
                asked += [slave for slave in slaves if slave.name == poll.device]
        obstacles += too_hasty(master, slaves)
        model = PollListModel(
            node=master.node,
            bus=master.bus,
            protocol=f"modbus-{master.framing.mode.value}",
            line=_line(master.timing),
            timeout=master.timeout,
            master_timing=master.master_timing,
            obstacles=tuple(obstacles),
        )
        if obstacles:
            return model
        off = tuple(dict.fromkeys(slave.name for slave in asked if slave.off))
        owners = [slave.owner for slave in asked if slave.off]
        notes = tuple(self._notes(master, polls, [*off, *owners]))
        return replace(
            model,
            tail=master.tail,
            first_end=master.first_end,
            polls=tuple(polls),
            off=off,
            notes=notes,
            noise_reasons=tuple(master.errors.reasons),
            silence=max(silence_needed(master, slaves).values(), default=0),
            words=master.words,
            timing=master.timing,
            joined=master.joined,
        )

    def _crowd(self, master: MasterModel) -> list[str]:
        found = []
        others = [node for node in self.asking[master.bus] if node != master.node]
        if others:
            key = "poll_asks" if len(others) == 1 else "poll_ask"
            found.append(say(key, names=names(others), bus=master.bus))
        scripted = self.scripted.get(master.bus, [])
        if scripted:
            found.append(say("poll_scripted", names=names(scripted), bus=master.bus))
        return found

    def _notes(self, master: MasterModel, polls: list[PollModel], off: list[str]) -> list[str]:
        notes = []
        if any(poll.waits for poll in polls):
            waiting = dict.fromkeys(poll.device for poll in polls if poll.waits)
            notes.append(say("poll_at_end", names=names(waiting)))
        elif master.plc and master.master_timing.mean(exactly(1)) is None:
            notes.append(say("poll_other_ports"))
        return notes + self._left_out(master.bus, off)


def _device_master(device: BusDevice, settings: MasterSettings) -> MasterModel:
    return MasterModel(
        node=device.name,
        bus=device.bus,
        framing=device.framing(),
        timing=device.timing,
        timeout=settings.timeout,
        turnaround=settings.turnaround,
        master_timing=Direct(settings.interval),
        polls=settings.polls,
        plc=False,
    )


def _line(timing: LineTiming) -> str:
    return f"{timing.baud} {timing.format}"


def _owner(fault: Fault) -> str:
    """The node or bus that a fault sits on."""
    kind = fault.kind
    return str(getattr(kind, "node", getattr(kind, "bus", "")))


def _ports(plc: Plc, baud: int | None) -> list[_Port]:
    read = partial(configured, registers=plc.registers, com2_station=plc.profile.com2_station)
    return [_Port(plc, spec.name, spec.bus, _at(read(spec.name, spec.words), baud)) for spec in plc.ports]


_Timed = TypeVar("_Timed", BusDevice, PortSettings | BadSettings)


def _at(timed: _Timed, baud: int | None) -> _Timed:
    """A device or a port's settings at another rate (None: its own)."""
    if baud is None or isinstance(timed, BadSettings):
        return timed
    return replace(timed, timing=replace(timed.timing, baud=baud))


def _scan(plc: Plc) -> Span:
    """Shortest and longest scan without any transaction, under N:N if the PLC takes part in it."""
    mean, jitter = plc.scan.mean, plc.scan.jitter
    if plc.link is not None and not bad_parameters(plc.profile, setting_values(plc.profile, plc.registers)):
        factor = plc.profile.scan_factor
        mean, jitter = round_half_up(mean * factor), round_half_up(jitter * factor)
    return Span(max(1, mean - jitter), mean + jitter)
