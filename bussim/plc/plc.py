"""One PLC: supply, RUN and STOP, memory, scan cycle, ports, and the sources of its block."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import Enum
from fractions import Fraction
from typing import TYPE_CHECKING

from bussim.engines.nn.frames import MODES, LinkSettings
from bussim.engines.nn.master import Master
from bussim.line.random_streams import Streams
from bussim.plc.errors import SerialErrors
from bussim.plc.first_scan import settings_under_m8038
from bussim.plc.inputs import NEVER, Stimulus
from bussim.plc.link_devices import LINK_STATUS
from bussim.plc.link_registers import LinkEngine, LinkRegisters, memory_at_power_on, setting_values
from bussim.plc.logic import Logic
from bussim.plc.memory import FIRST_SPECIAL, OWN_DEVICES, Device, Memory, parse_device
from bussim.plc.observer import PlcObserver
from bussim.plc.ports.port_instructions import ProgramPorts
from bussim.plc.ports.port_registers import Maps, PortRegisters
from bussim.plc.ports.spec import FreeSpec, PollSpec, PortSpec
from bussim.plc.profiles import MAX_SLAVES, Profile
from bussim.plc.scan import ScanCycle
from bussim.plc.sources import Source, Sources
from bussim.plc.system_devices import SystemDevices
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND, round_half_up

if TYPE_CHECKING:
    from bussim.plc.program.program import Program
    from bussim.plc.program.rest import Dependence

#: What the link has received for this PLC after one tick and up to another: (station, newest image).
Received = Callable[[int, int], Iterable[tuple[int, bytes]]]

#: Of how long scans are drawn ahead for an END that matters.
_AHEAD = 60 * TICKS_PER_SECOND


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
    carries every scan out (see :mod:`bussim.plc.logic`), and so does one with ``observed`` devices, but for
    those that it proves to change nothing (:meth:`may_rest`).

    Its driver carries ENDs out: it calls :meth:`end` at the tick that :meth:`wanted_end` names. All other
    ENDs need no call: what they would have done is done when the memory or the block is asked for.
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
        self._registers = {parse_device(name): value for name, value in registers.items()}
        self.memory = memory_at_power_on(profile, self._registers)
        self.errors = SerialErrors(self.memory)
        self.link_registers = LinkRegisters(profile, self.memory, self.errors)
        #: Its ports beside the link, by name.
        self.port_registers = {
            spec.name: PortRegisters(spec, [poll for poll in polls if poll.port == spec.name], profile, maps)
            for spec in ports
        }
        self._port_list = tuple(self.port_registers.values())
        #: Set where the PLC is connected to a link.
        self.received: Received | None = None
        self._scan = (scan_mean, scan_jitter)
        self._phase = phase
        self._sources = Sources({parse_device(name): source for name, source in sources.items()})
        self._linked = linked
        self._kept: Memory | None = None  # at the latest power-off
        self._board_errors: list[tuple[str, int]] = []
        self._image: bytes | None = None
        #: Until when the block is what :meth:`image_at` returned last, unless an END is carried out.
        self.image_until = -1
        self._taken = -1  # the END at which received blocks were taken last
        self._stores_blocks = True  # whether ENDs that are carried out store them
        self._done = -1  # the END that was carried out last
        self._program = program
        self._inputs = dict(inputs or {})
        #: Its program and inputs, from power-on to power-off; None where it has neither.
        self.logic: Logic | None = None
        self._system: SystemDevices | None = None  # of a PLC without a program, which shows them itself
        self._observed = dict.fromkeys(observed, 0)
        self._observes_specials = any(device.address >= FIRST_SPECIAL for device in self._observed)
        #: Whether every END is carried out.
        self.every_end = program is not None or bool(self._inputs) or bool(self._observed)
        self.observer: PlcObserver | None = None
        # What its scans depend on, where some ENDs may be left out; whether they may since RUN.
        self._depends: Dependence | None = None
        self._may_rest = False
        #: Whether received blocks may change what ENDs do, which may be left out if they do not.
        self.reads_blocks = False
        self._rests_until = -1  # before this tick no END changes anything; -1: the next one may
        #: Whether its ports write to no block, source or special device, nor polls over bits of their port.
        self.ports_apart = False
        #: Called with the tick when an END has come to matter that did not.
        self.on_wake: Callable[[int], None] | None = None

    def may_rest(self) -> None:
        """Leave ENDs out, from RUN on, that nothing shows; its driver sets :attr:`on_wake`.

        Where every END is told, it is all that those do.
        """
        program, status = self._program, LINK_STATUS[self.profile.family].values()
        shown = self.port_registers or self._observes_specials or any(at in status for at in self._observed)
        if self.every_end and not shown:
            from bussim.plc.program.rest import Dependence, dependence  # what only such PLCs pay

            self._depends = dependence(program) if program is not None else Dependence()

    @property
    def longest_drawn(self) -> int:
        """The longest scan since RUN without what lengthens it, in ticks."""
        return self._longest

    @property
    def is_independent(self) -> bool:
        """Whether no received block changes what it does."""
        return self.received is None or not self._stores_blocks

    def scan_under_link(self) -> tuple[int, int]:
        """Mean and jitter of the scan while N:N runs, in ticks."""
        factor = self.profile.scan_factor
        return round_half_up(self._scan[0] * factor), round_half_up(Fraction(self._scan[1]) * factor)

    def longest_scan(self) -> int:
        """The longest scan while N:N runs, in ticks, a transaction on every other port included."""
        return sum(self.scan_under_link()) + len(self.port_registers) * self.profile.transaction_time

    # -- supply and mode switch --------------------------------------------------------------------

    def power_on(self, now: int = 0) -> None:
        """The supply comes (back): memory at its power-on values, but what is latched, then STOP."""
        self.memory = memory_at_power_on(self.profile, self._registers, self._kept)
        self.errors = SerialErrors(self.memory, self.profile.error_codes)
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
                ProgramPorts(self.port_registers, self.memory, self.profile.rs_port),
                now,
                () if self.profile.latched_pulse_again else self.profile.latched,
            )
            if self._depends is not None:
                self.logic.may_rest(self._depends)
        if self._program is None:
            self._system = system = SystemDevices(self.memory, now)
            self.memory.refresh_specials = lambda end: system.scan(end, self.cycle.times(end))
        self.state = PlcState.STOP

    def run(self, now: int, *, traced: bool) -> tuple[LinkEngine | None, int]:
        """STOP→RUN: settings are taken over; returns the link's engine and the first END's tick.

        The engine is None where the PLC takes no part in N:N or refuses its parameters (then M8063
        and D8063 say so). The other ports' engines are those of :attr:`port_registers`, to be started too.
        """
        # The first scan begins; settings that its program writes are in force from here on, if they may be.
        logic, program, profile = self.logic, self._program, self.profile
        given = None
        if program is not None and profile.link_at_step_0:
            given = setting_values(profile, {str(device): at for device, at in self._registers.items()})
            given = settings_under_m8038(program, profile, self.memory, given, self._inputs, now)
        if self._system is not None:
            self._system.scan(now, (0, 0, 0))
        if logic is not None:
            logic.run(now)
        self.observe(now)
        spent = logic.scan(now) if logic is not None else 0
        take_over = self.link_registers.take_over
        engine = take_over(self.longest_scan(), traced=traced, values=given) if self._linked else None
        mean, jitter = self._scan if engine is None else self.scan_under_link()
        self.state = PlcState.RUN
        self._taken = self._sources.written = -1
        self._done = now - 1
        for port in self.port_registers.values():
            port.take_over(self.memory, self.errors, now)
        self._image, self.image_until = None, -1
        self._rests_until = -1
        all_blocks = self.link_registers.blocks()
        blocks = [block for station, block in all_blocks.items() if station != self.link_registers.station]
        depends = self._depends
        # What is written into other stations' blocks the next block undoes.
        self._may_rest = depends is not None and not depends.touches(blocks, writes=True)
        self.reads_blocks = depends is not None and (
            depends.touches(blocks) or any(block.holds(at) for block in blocks for at in self._observed)
        )
        stores = self.every_end or any(port.reads_devices for port in self._port_list)
        self._stores_blocks = stores if depends is None else self.reads_blocks
        written = [port.writes for port in self._port_list]
        self.ports_apart = None not in written and not any(
            device in self._sources.by_device
            or (device.letter in "MD" and device.address >= FIRST_SPECIAL)
            or any(block.holds(device) for block in all_blocks.values())
            for devices in written
            for device in devices or ()
        )
        first_end = self.cycle.run(now, mean, jitter, self._phase)
        self._longest = mean + jitter
        halted = logic is not None and logic.halted
        if logic is not None and halted and self._depends is not None:
            logic.show_specials(now, (0, 0, 0))
        if spent and (self._phase is None or halted):
            first_end = self.cycle.run(now, mean, jitter, first_end - now + spent)
            if halted:
                self.cycle.count_first(first_end - now)
        self._report_inputs(now, first_end)
        return engine, first_end

    def stop(self, now: int) -> None:
        """RUN→STOP. An END at ``now`` does not happen.

        What had arrived by the last END stays in memory where that is latched. All else that a program
        uses becomes what it is at power-on, unless M8033 is on (FX programming manual, 4.12.1).
        """
        self._show_end(now - 1)
        self.cycle.stop(now - 1)
        self.link_registers.release()
        for port in self.port_registers.values():
            port.release(now)
        self.record_faults(now)
        for part in (self.logic, self._system):
            if part is not None:
                part.stop()
        if not self.memory.bits("M")[8033]:
            self.memory.keep(memory_at_power_on(self.profile, self._registers, self.memory), OWN_DEVICES)
        self.state = PlcState.STOP

    def power_off(self, now: int) -> None:
        """The supply goes; of the memory only what is latched will be there when it comes back."""
        if self.state is PlcState.RUN:
            self.stop(now)
        self._kept = self.memory
        self.state = PlcState.OFF

    def board_error(self, port: str, code: int) -> None:
        """The exchange with a port's board fails from now on: M8063 on, D8063 = 7xyy."""
        self._board_errors.append((port, code))
        self.errors.report((port, code), port, code)

    def board_error_over(self, port: str, code: int) -> None:
        """The exchange works again: M8063 goes off unless another error keeps it on; D8063 stays."""
        self._board_errors.remove((port, code))
        if (port, code) not in self._board_errors:
            self.errors.over((port, code))

    def parameters(self, settings: LinkSettings, now: int) -> None:
        """A slave has received the master's settings: its block may lie elsewhere now."""
        self.wake(now)
        self._show_end(now - 1)  # blocks received in another mode
        self.link_registers.parameters(settings)
        self._taken = -1
        self._image, self.image_until = None, -1

    def refuse(self, now: int) -> None:
        """The master asks for a mode that this family does not have: no link."""
        self._show_end(now - 1)
        self.link_registers.refuse()

    # -- ENDs that are left out --------------------------------------------------------------------

    def _may_expire(self, extra: int) -> bool:
        """Whether a scan that lasts so much longer than drawn may exceed the watchdog."""
        return self._longest + extra > self.memory.words("D")[8000] * TICKS_PER_MS

    def _rest_after(self, end: int, extra: int) -> int:
        """Until when ENDs after the one that is carried out change nothing; -1: the next one may.

        Scans last so much longer by their instructions.
        """
        until = self._sources.next_change(end) if self._sources.by_device else NEVER
        if self.logic is not None:
            until = min(until, self.logic.rests_until)
            if self._may_expire(extra):
                return -1
            if self._observed and self.logic.changes:
                return -1  # the next END reports the inputs that this scan has sampled
        # Scans are drawn ahead for a minute at most, of all PLCs for the same one.
        return until if until == NEVER else min(until, (end // _AHEAD + 1) * _AHEAD)

    def received_news(self, station: int, image: bytes, now: int) -> None:
        """Another image has come of a station than before, or to another of the link's stations."""
        mode = self.link_registers.mode
        # One of another mode is not stored: those before it must have been.
        reads = self.reads_blocks and self._rests_until >= 0 and station != self.link_registers.station
        if reads or (mode is not None and len(image) != MODES[mode].size):
            self.wake(now)

    def wake(self, now: int) -> None:
        """Show what ENDs before now have left, and carry the next one out: something is about to change."""
        if self._depends is not None:
            self._show_end(now - 1)
        if self._rests_until >= 0:
            self._rests_until = -1
            if self.on_wake is not None:
                self.on_wake(now)

    # -- END ---------------------------------------------------------------------------------------

    def image_at(self, now: int) -> bytes:
        """This station's block as its latest END at or before ``now`` left it.

        Before the first END since RUN: the memory at RUN. The same object as long as nothing changed.
        """
        image = self._image
        if image is not None and now < self.image_until:
            return image  # every END so far left the same one
        if self.logic is not None:
            return self._frozen_image()
        end = self.cycle.latest_end(now)
        if image is not None and (end is None or end < self.image_until):
            return image
        if end is not None:
            self._sources.write(self.memory, end)
        block = self.link_registers.block
        fresh = self.memory.block_image(block) if block is not None else b""
        self.image_until = self._sources.next_change(end) if end is not None else -1
        if image is None or fresh != image:
            self._image = fresh
            return fresh
        return image

    def _frozen_image(self) -> bytes:
        """The block as the latest END left it, which the scan under way does not change."""
        assert self.logic is not None  # noqa: S101 - narrows the type; asked for only then
        block = self.link_registers.block
        fresh = self.logic.image(block) if block is not None else b""
        if self._image is None or fresh != self._image:
            self._image = fresh
        self.image_until = NEVER  # until END says otherwise
        return self._image

    def sync(self, now: int) -> None:
        """Bring the memory to what this PLC's latest END at or before ``now`` left in it."""
        # With logic the END of this very tick may be still to come.
        self._show_end(now if self.logic is None else max(now - 1, self._done))

    def _show_end(self, tick: int) -> None:
        if self.state is not PlcState.RUN:
            return
        logic, depends = self.logic, self._depends
        # With logic every END that is not left out is carried out when it happens.
        if (logic is None or depends is not None) and (end := self.cycle.latest_end(tick)) is not None:
            self._refresh(end)
            if logic is not None:
                logic.show_specials(end, self.cycle.times(end))
        self.link_registers.publish()

    def _refresh(self, end: int) -> None:
        """Write sources and received blocks into the memory as of an END, once."""
        self._sources.write(self.memory, end)
        if self.received is not None and end > self._taken:
            since, self._taken = self._taken, end
            self.link_registers.store_blocks(self.received(since, end))

    # -- ENDs that are carried out -----------------------------------------------------------------

    def wanted_end(self, now: int) -> int | None:
        """The next END that matters to some port, not before ``now``; None: none before something happens.

        May be another after every call of a port's engine, and after every change of load.
        """
        if self.state is not PlcState.RUN:
            return None
        if self.every_end:
            told = self.observer is not None and self.observer.takes_ends
            earliest = max(self._done + 1, -1 if told else self._rests_until, now)
            return None if earliest >= NEVER else self.cycle.next_end(earliest, now)
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
        logic, port_registers, observer = self.logic, self.port_registers, self.observer
        if now < self._rests_until and observer is not None and observer.takes_ends:
            observer.ended(now)
            return {}
        if logic is not None and logic.faulted:
            self.record_faults(now)
        if self._stores_blocks:
            self._refresh(now)
        elif self._sources.by_device:
            self._sources.write(self.memory, now)
        shown = self.every_end and self._depends is None
        for each in self._port_list:
            shown = shown or (self._linked and each.shows_memory)
        if shown:
            self.link_registers.publish()
        hints: dict[str, int] = {}
        active = 0
        for name, each in port_registers.items():
            hints[name] = each.at_end(now)
            active += each.active
        extra = active * self.profile.transaction_time
        #: Until when the block is what :meth:`image_at` returned last, unless an END is carried out.
        self.image_until = -1
        if self._observes_specials and self.memory.refresh_specials is not None:
            self.memory.refresh_specials(now)
        if self._observed:
            self.observe(now)
        if observer is not None and observer.takes_ends:
            observer.ended(now)
        if logic is not None:
            logic.freeze()
            extra += logic.scan(now)
        self.cycle.set_load(now, extra)
        if logic is not None and (logic.changes or self._may_expire(extra) or logic.halted):
            following = self.cycle.next_end(now + 1, now)
            logic.check_watchdog(now, following - now)
            if self._depends is not None and logic.halted:
                logic.show_specials(now, self.cycle.times(now))
            self._report_inputs(now, following)
        if self._may_rest:
            self._rests_until = self._rest_after(now, extra)
        return hints

    # -- what is recorded --------------------------------------------------------------------------

    def record_faults(self, now: int) -> None:
        """Report the program's errors since the latest END, without waiting for the next one."""
        if self.logic is not None and self.logic.faulted and self.observer is not None:
            for fault in self.logic.faults():
                self.observer.faulted(fault, now)

    def _report_inputs(self, sampled: int, end: int) -> None:
        if self.logic is not None and self.observer is not None:
            for device, changes in self.logic.changes:
                self.observer.sampled(device, changes, sampled, end)

    def observe(self, now: int) -> None:
        """Report observed devices that have another value; without supply outputs alone, which are off."""
        memory, seen, off = self.memory, self._observed, self.state is PlcState.OFF
        for device, before in seen.items():
            value = memory.get(device) if not off else 0 if device.letter == "Y" else before
            if value != before:
                seen[device] = value
                if self.observer is not None:
                    self.observer.changed(device, value, now)

    def read(self, name: str) -> int:
        """The value of a device by name, as the memory holds it (see :meth:`sync`)."""
        return self.memory.get(parse_device(name))

    @property
    def master(self) -> Master | None:
        """The link's engine if this PLC is a working master."""
        engine = self.link_registers.engine
        return engine if isinstance(engine, Master) else None
