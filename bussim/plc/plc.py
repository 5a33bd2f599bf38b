"""One PLC: supply, RUN and STOP, memory, scan cycle, its ports and what drives its block."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from enum import Enum
from fractions import Fraction

from bussim.engines.nn.frames import MODES, LinkSettings
from bussim.engines.nn.master import Master
from bussim.line.random_streams import Streams
from bussim.plc.errors import SerialErrors
from bussim.plc.inputs import Change, Stimulus
from bussim.plc.link_registers import LinkEngine, LinkRegisters, setting_defaults
from bussim.plc.logic import Logic
from bussim.plc.memory import Device, Memory, parse_device
from bussim.plc.ports.cpavl import COM2_STATION
from bussim.plc.ports.port_registers import Maps, PortRegisters
from bussim.plc.ports.rs2 import Drive, Rs2, port_of
from bussim.plc.ports.spec import FreeSpec, PollSpec, PortSpec
from bussim.plc.profiles import MAX_SLAVES, Profile
from bussim.plc.program.faults import Halt, OperationFault
from bussim.plc.program.program import Program
from bussim.plc.scan import ScanCycle
from bussim.plc.sources import Source
from bussim.units import round_half_up

#: What the link has received for this PLC after one tick and up to another: (station, newest image).
Received = Callable[[int, int], Iterable[tuple[int, bytes]]]

_NEVER = 1 << 62


class PlcState(Enum):
    """Supply and mode switch."""

    OFF = "off"
    STOP = "stop"
    RUN = "run"


class Plc:
    """A PLC as its buses see it. All times are ticks.

    ``scan_mean`` and ``scan_jitter`` are without N:N; the profile's factor is applied while the link
    runs. ``registers`` are written at power-on. ``linked`` says whether it takes part in N:N. ``ports``
    are those that CPAVL has set up, ``polls`` what is exchanged on them where no program does it;
    ``maps`` makes the register map of those that are Modbus slaves. A PLC with a ``program`` or ``inputs``
    carries every scan out (see :mod:`bussim.plc.logic`), and so does one with ``observed`` devices.

    Whoever runs it carries its ENDs out: :meth:`end` at the tick that :meth:`wanted_end` names. All other
    ENDs need no call; what they would have done is done when somebody looks.
    """

    def __init__(
        self,
        name: str,
        profile: Profile,
        *,
        scan_mean: int,
        scan_jitter: int,
        phase: int | None,
        registers: Mapping[str, int],
        sources: Mapping[str, Source],
        linked: bool,
        streams: Streams,
        ports: Sequence[PortSpec] = (),
        polls: Sequence[PollSpec | FreeSpec] = (),
        maps: Maps | None = None,
        program: Program | None = None,
        inputs: Mapping[Device, Stimulus] | None = None,
        observed: Iterable[Device] = (),
    ) -> None:
        self.name = name
        self.profile = profile
        self.state = PlcState.OFF
        self.cycle = ScanCycle(streams.generator("scan", name))
        self.memory = Memory()
        self.errors = SerialErrors(self.memory)
        self.link_registers = LinkRegisters(profile, self.memory, self.errors)
        #: Its ports beside the link, by name.
        self.port_registers = {
            spec.name: PortRegisters(spec, [poll for poll in polls if poll.port == spec.name], profile, maps)
            for spec in ports
        }
        self._port_list = tuple(self.port_registers.values())
        #: Set by whoever connects the PLC to a link.
        self.received: Received | None = None
        #: Called before the link's status is published: others may have listened for its engine.
        self.before_status: Callable[[], None] | None = None
        self._scan = (scan_mean, scan_jitter)
        self._phase = phase
        self._registers = {parse_device(name): value for name, value in registers.items()}
        self._sources = {parse_device(name): source for name, source in sources.items()}
        self._linked = linked
        self._board_errors: list[tuple[str, int]] = []
        self._image: bytes | None = None
        self._image_until = -1
        self._driven = self._taken = -1  # the ENDs at which sources and received blocks were taken last
        self._done = -1  # the END that was carried out last
        self._program = program
        self._inputs = dict(inputs or {})
        #: Its program and inputs, from power-on to power-off; None where it has neither.
        self.logic: Logic | None = None
        #: Told of an input's changes: the device, the changes since the sampling before, the sampling and
        #: the END of the scan that begins with it.
        self.sampled: Callable[[Device, Sequence[Change], int, int], None] | None = None
        self._observed = dict.fromkeys(observed, 0)
        #: Whether every END is carried out.
        self.every_end = program is not None or bool(self._inputs) or bool(self._observed)
        #: Told of every END that is carried out, when it has left the memory as it is, before the next scan.
        self.ended: Callable[[int], None] | None = None
        #: Told of a new value of an observed device: the device, its value, the END.
        self.changed: Callable[[Device, int, int], None] | None = None
        #: Told at an END of what the scan before it met: operation errors, or that the program has stopped.
        self.faulted: Callable[[OperationFault | Halt, int], None] | None = None
        # Not told yet: operation errors by code, with the first one's step and their number; a stop.
        self._errors: dict[int, tuple[int, int]] = {}
        self._halt: Halt | None = None
        self._halted = False  # whether a stop was told, or is about to be

    def scan_under_link(self) -> tuple[int, int]:
        """Mean and jitter of the scan while N:N runs, in ticks."""
        factor = self.profile.scan_factor
        return round_half_up(self._scan[0] * factor), round_half_up(Fraction(self._scan[1]) * factor)

    def longest_scan(self) -> int:
        """The longest scan while N:N runs, in ticks, a transaction on every other port included."""
        return sum(self.scan_under_link()) + len(self.port_registers) * self.profile.transaction_time

    # -- supply and mode switch --------------------------------------------------------------------

    def power_on(self, now: int = 0) -> None:
        """The supply comes back: memory at its power-on values, then STOP."""
        self.memory = Memory()
        for address, value in setting_defaults(self.profile).items():
            self.memory.set_word("D", address, value)
        self.memory.set(COM2_STATION, self.profile.com2_station)
        for device, value in self._registers.items():
            self.memory.set(device, value)
        self.errors = SerialErrors(self.memory)
        self.link_registers = LinkRegisters(self.profile, self.memory, self.errors)
        for port, code in self._board_errors:
            self.errors.report((port, code), port, code)
        if self._program is not None or self._inputs:
            self.logic = Logic(
                self._program,
                self._inputs,
                self.memory,
                (MAX_SLAVES + 1) * self.profile.word_spacing,
                self.profile.instruction_times,
                self._rs2,
                self.cpavl,
                now,
                self._failed,
            )
        self.state = PlcState.STOP

    def run(self, now: int, *, traced: bool) -> tuple[LinkEngine | None, int]:
        """STOP→RUN: settings are taken over; returns the link's engine and the first END's tick.

        The engine is None where the PLC takes no part in N:N or refuses its parameters (then M8063
        and D8063 say so). The other ports' engines are those of :attr:`port_registers`, to be started too.
        """
        # The first scan begins; settings that its program writes are in force from here on.
        self._halted = False
        spent = self.logic.run(now) if self.logic is not None else 0
        self._look_for_halt(now)
        mean, jitter = self.scan_under_link()
        engine = self.link_registers.take_over(self.longest_scan(), traced=traced) if self._linked else None
        if engine is None:
            mean, jitter = self._scan
        self.state = PlcState.RUN
        self._driven = self._taken = -1
        self._done = now - 1
        for port in self.port_registers.values():
            port.take_over(self.memory, self.errors, now)
        self._image, self._image_until = None, -1
        first_end = self.cycle.run(now, mean, jitter, self._phase)
        if spent and (self._phase is None or self._halted):
            first_end = self.cycle.run(now, mean, jitter, first_end - now + spent)
            if self._halted:
                self.cycle.noticed(first_end - now)
        self._tell_inputs(now, first_end)
        return engine, first_end

    def stop(self, now: int) -> None:
        """RUN→STOP: what had arrived by the last END stays in memory. An END at ``now`` does not happen."""
        self.sync(now - 1)
        self.cycle.stop(now - 1)
        self.link_registers.release()
        for port in self.port_registers.values():
            port.release(now)
        if self.logic is not None:
            self.record_faults(now)
            self.logic.stop()
        self.state = PlcState.STOP

    def power_off(self, now: int) -> None:
        """The supply goes; the memory is lost when it comes back."""
        if self.state is PlcState.RUN:
            self.stop(now)
        self.state = PlcState.OFF

    def board_error(self, port: str, code: int) -> None:
        """The exchange with a port's board fails from now on: M8063 on, D8063 = 7xyy."""
        self._board_errors.append((port, code))
        self.errors.report((port, code), port, code)

    def board_error_over(self, port: str, code: int) -> None:
        """It works again: M8063 goes off unless something else keeps it on; D8063 stays."""
        self._board_errors.remove((port, code))
        if (port, code) not in self._board_errors:
            self.errors.over((port, code))

    def parameters(self, settings: LinkSettings, now: int) -> None:
        """A slave has learnt the master's settings: its block may lie elsewhere now."""
        self.sync(now - 1)  # what came in another mode
        self.link_registers.parameters(settings)
        self._taken = -1
        self._image, self._image_until = None, -1

    def refuse(self, now: int) -> None:
        """The master asks for a mode that this family does not have: no link."""
        self.sync(now - 1)
        self.link_registers.refuse()

    # -- END ---------------------------------------------------------------------------------------

    def image_at(self, now: int) -> bytes:
        """This station's block as its latest END at or before ``now`` left it.

        Before the first END since RUN: the memory at RUN. The same object as long as nothing changed.
        """
        image = self._image
        if image is not None and now < self._image_until:
            return image  # whichever END was the latest one
        if self.logic is not None:
            return self._frozen_image()
        end = self.cycle.latest_end(now)
        if image is not None and (end is None or end < self._image_until):
            return image
        if end is not None:
            self._drive(end)
        place = self.link_registers.place
        fresh = self.memory.block_image(place) if place is not None else b""
        self._image_until = self._next_change(end)
        if image is None or fresh != image:
            self._image = fresh
            return fresh
        return image

    def _frozen_image(self) -> bytes:
        """The block as the latest END left it, which the scan under way does not change."""
        assert self.logic is not None  # noqa: S101 - narrows the type; asked for only then
        place = self.link_registers.place
        fresh = self.logic.image(place) if place is not None else b""
        if self._image is None or fresh != self._image:
            self._image = fresh
        self._image_until = _NEVER  # until END says otherwise
        return self._image

    def _next_change(self, end: int | None) -> int:
        if end is None:
            return -1  # the first END may change everything
        changes = [source.next_change(end) for source in self._sources.values()]
        return min((change for change in changes if change is not None), default=_NEVER)

    def _drive(self, end: int) -> None:
        if end == self._driven:
            return  # what a port has written since stays
        self._driven = end
        for device, source in self._sources.items():
            value = source.value(end)
            self.memory.set(device, value if device.is_word else value & 1)

    def sync(self, now: int) -> None:
        """Bring the memory to what this PLC's latest END at or before ``now`` left in it."""
        if self.state is not PlcState.RUN:
            return
        if self.logic is None:  # else every END is carried out when it happens
            end = self.cycle.latest_end(now)
            if end is not None:
                self._arrive(end)
        self._publish()

    def _publish(self) -> None:
        """The link's status shows in the special devices."""
        if self.before_status is not None:
            self.before_status()
        self.link_registers.publish()

    def _arrive(self, end: int) -> None:
        """An END: sources and received blocks show in memory, once."""
        self._drive(end)
        if self.received is not None and end > self._taken:
            since, self._taken = self._taken, end
            self._take(self.received(since, end))

    # -- the other ports ---------------------------------------------------------------------------

    def wanted_end(self, now: int) -> int | None:
        """The next END that matters to some port, not before ``now``; None: none before something happens.

        May be another after every call of a port's engine, and after every change of load.
        """
        if self.state is not PlcState.RUN:
            return None
        if self.every_end:
            return self.cycle.next_end(self._done + 1 if self._done >= now else now, now)
        wanted: int | None = None
        for port in self._port_list:
            tick = port.wanted_end(now)
            if tick is not None and (wanted is None or tick < wanted):
                wanted = tick
        return None if wanted is None else self.cycle.next_end(max(wanted, self._done + 1, now), now)

    @property
    def has_ends(self) -> bool:
        """Whether any END may have to be carried out: it has ports, a program, inputs or observed devices."""
        return bool(self.port_registers or self._program or self._inputs or self._observed)

    def end(self, now: int) -> dict[str, int]:
        """Carry out the END at ``now``; returns hints for each port's engine.

        What has been received by then shows in memory before the ports act on it, and what they write
        is in the block's image at once. The scan that begins lasts longer by the profile's
        ``transaction_time`` for each port with a transaction under way, and by its instructions' time.
        """
        self._done = now
        logic, port_registers = self.logic, self.port_registers
        if self._errors or self._halt is not None:
            self.record_faults(now)
        self._arrive(now)
        if self.every_end or (self._linked and any(port.shows_memory for port in port_registers.values())):
            self._publish()
        hints: dict[str, int] = {}
        active = 0
        for name, each in port_registers.items():
            hints[name] = each.at_end(now)
            active += each.active
        extra = active * self.profile.transaction_time
        self._image_until = -1
        if self._observed:
            self._observe(now)
        if self.ended is not None:
            self.ended(now)
        if logic is not None:
            logic.freeze()
            extra += logic.scan(now)
        self.cycle.set_load(now, extra)
        if logic is not None:
            following = self.cycle.next_end(now + 1, now)
            if logic.overrun(following - now):
                self._look_for_halt(now)
            self._tell_inputs(now, following)
        return hints

    # -- what its program meets ---------------------------------------------------------------------

    def _failed(self, code: int, step: int) -> None:
        first, count = self._errors.get(code, (step, 0))
        self._errors[code] = (first, count + 1)

    def _look_for_halt(self, begun: int) -> None:
        """The scan that began at a tick may have stopped the program."""
        if self.logic is not None and self.logic.halted and not self._halted:
            self._halted = True
            self._halt = self.logic.halt(begun)

    def record_faults(self, now: int) -> None:
        """Tell what was met since the latest END, without waiting for the next one."""
        errors, self._errors = self._errors, {}
        halt, self._halt = self._halt, None
        if self.faulted is not None:
            for code, (step, count) in errors.items():
                self.faulted(OperationFault(code, step, count), now)
            if halt is not None:
                self.faulted(halt, now)

    def _tell_inputs(self, sampled: int, end: int) -> None:
        if self.logic is not None and self.sampled is not None:
            for device, changes in self.logic.changes:
                self.sampled(device, changes, sampled, end)

    def _observe(self, end: int) -> None:
        memory, seen = self.memory, self._observed
        for device, before in seen.items():
            value = memory.get(device)
            if value != before:
                seen[device] = value
                if self.changed is not None:
                    self.changed(device, value, end)

    def _rs2(self, instruction: Hashable, operands: Rs2, now: int, driven: bool) -> Drive:  # noqa: FBT001 - as the logic's ports call it
        return self.rs2(instruction, operands, now, driven=driven)

    def rs2(self, instruction: Hashable, operands: Rs2, now: int, *, driven: bool) -> Drive:
        """An RS2 instruction is executed in the scan before the next END, its contact on or off.

        ``instruction`` tells it from the program's others. Refused where n1 names no port that runs
        the protocol for it.
        """
        port = port_of(operands, self.memory)
        registers = self.port_registers.get(port) if port is not None else None
        if registers is None:
            return Drive.REFUSED
        if driven:
            return registers.drive(instruction, operands, now)
        registers.undrive(instruction, now)
        return Drive.OFF

    def cpavl(self, port: int, words: Device, bits: Device) -> bool:
        """CPAVL: a port's words and bits lie here from the next STOP→RUN on.

        False if there is no such port, or they do not lie in memory.
        """
        registers = self.port_registers.get(f"COM{port}")
        if registers is None:
            return False
        try:
            registers.move(words, bits)
        except ValueError:
            return False
        return True

    def _take(self, blocks: Iterable[tuple[int, bytes]]) -> None:
        link_registers = self.link_registers
        mode = link_registers.mode
        if mode is None:
            return
        for station, image in blocks:
            if station != link_registers.station and len(image) == MODES[mode].size:
                self.memory.store_block(link_registers.place_of(station, mode), image)

    def read(self, name: str) -> int:
        """The value of a device by name, as the memory holds it (see :meth:`sync`)."""
        return self.memory.get(parse_device(name))

    @property
    def master(self) -> Master | None:
        """The link's engine if this PLC is a working master."""
        engine = self.link_registers.engine
        return engine if isinstance(engine, Master) else None
