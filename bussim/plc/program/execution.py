"""Carries a program out, scan by scan, on a PLC's memory. All times are ticks of 1/72 MHz.

A scan happens at one tick: the caller has sampled the inputs into X before, and takes Y, the shared
areas and what else leaves the PLC from the memory afterwards. Timers and clocks read the time
of the scan.

Special devices: those that live by themselves (:mod:`bussim.plc.system_devices`); M8061 and D8061 = 6105 when
the watchdog has expired; M8038 is on in the first scan if its contact is the program's first step.

What a PLC does after the watchdog has expired is not public. Assumed: its outputs go off and no program
scan follows until STOP→RUN, while its END goes on serving the link and the ports, with what memory
holds; the scan in which it expired lasts as long as its instructions took until then.

At STOP→RUN the operation error (M8067 M8068, D8067–D8069) and all memories of edges are cleared, but those of
PLS and PLF of latched relays (FX programming manual, 2.16, from memory: assumed). What becomes of devices at
RUN→STOP and at a power loss is the PLC's business (:mod:`bussim.plc.plc`).
"""

from collections.abc import Callable, Sequence
from operator import and_

from bussim.plc.errors import note_errors
from bussim.plc.memory import DeviceRange, Memory
from bussim.plc.program.compiled.build import blocks
from bussim.plc.program.compiled.code import END
from bussim.plc.program.instruction_times import DEFAULT_TIMES, InstructionTimes, ticks_of
from bussim.plc.program.instructions import coils
from bussim.plc.program.machine import (
    CALLS_TOO_DEEP,
    ERROR,
    ERROR_CODE,
    ERROR_LATCH,
    ERROR_STEP,
    LATCHED_STEP,
    Machine,
    Ports,
)
from bussim.plc.program.program import LINK_SETTINGS, Program
from bussim.plc.program.rest import Dependence, rests_until, state_of
from bussim.plc.program.text.catalog import Flow
from bussim.plc.program.text.flow import MAX_CALLS
from bussim.plc.system_devices import WATCHDOG, SystemDevices
from bussim.units import TICKS_PER_MS

#: D8061 when the watchdog has expired.
WATCHDOG_CODE = 6105
#: Blocks that a scan may go through (a program with a WDT in an endless loop would never end).
MAX_BLOCKS = 1_000_000

_NS_PER_MS = 1_000_000


class ProgramRun:
    """A program on a memory, from power-on. Made anew when the memory is.

    ``power_on`` is the tick from which the PLC's clocks run. ``ports`` carries out RS2 and CPAVL;
    ValueError if the program has one and there are none. ``kept_pulses``: the relays whose PLS and PLF
    remember their input over STOP, and over a power loss, as their memory then does.
    """

    def __init__(
        self,
        program: Program,
        memory: Memory,
        *,
        times: InstructionTimes = DEFAULT_TIMES,
        ports: Ports | None = None,
        power_on: int = 0,
        kept_pulses: Sequence[DeviceRange] = (),
    ) -> None:
        if ports is None and program.uses_ports:
            raise ValueError(f"{program.name} has RS2 or CPAVL, which need ports")
        self.program = program
        #: Why the program stands still (a code of D8061), 0 while it runs. RUN clears it.
        self.halted = 0
        #: How long after the beginning of the scan in which it stopped, in ticks; and whether that scan
        #: was given up because its jumps had no end.
        self.halted_after = 0
        self.endless = False
        #: The longest time of the latest scan without a WDT, in ns.
        self.unwatched = 0
        self._origin = power_on
        self._machine = Machine(memory, times, ports, size=len(program.instructions), origin=power_on)
        self._keeps = bytes(
            at.name in ("PLS", "PLF") and any(kept.holds(at.operands[0].device) for kept in kept_pulses)
            for at in program.instructions
        )
        self._m, self._d = memory.bits("M"), memory.words("D")
        self._calls: list[int] = []
        self._watched = 0
        #: Until when the scans to come would do what the latest has done, which changed nothing; else -1.
        self.rests_until = -1
        self._depends: Dependence | None = None
        self._system = SystemDevices(memory, power_on)
        self._begun = 0  # the latest scan
        self._times = (0, 0, 0)  # the scan before it, the shortest and the longest since RUN
        self._loops = [0] * len(program.blocks)
        self._blocks = blocks(
            program, self._machine, calls=self._calls, call=self._call, loops=self._loops, watch=self._watch
        )
        first = program.blocks[0].exit
        self._has_masters = any(at.spec.flow is Flow.MC for at in program.instructions)
        self._straight = first is not None and first.flow in (Flow.END, Flow.FEND)
        if not self._d[8000]:
            self._d[8000] = WATCHDOG

    def may_rest(self, depends: Dependence) -> None:
        """From now on tell when scans need not be carried out (:attr:`rests_until`).

        Special devices show no later scan than the second then, unless :meth:`show` is called.
        """
        self._depends = depends
        self._state = state_of(depends, self._machine, self._loops)

    # -- RUN, STOP and scans -----------------------------------------------------------------------

    def run(self, now: int) -> None:
        """STOP→RUN at a tick."""
        machine, m = self._machine, self._m
        machine.now[0] = now - self._origin
        machine.earlier[:] = bytes(map(and_, machine.earlier, self._keeps))
        for memories in (machine.counter_input, machine.saved):
            memories[:] = bytes(len(memories))
        machine.timer_scan[:] = machine.timer_pulse[:] = [0] * 512
        machine.scan[0] = 0
        machine.going.clear()
        for flag in (ERROR, ERROR_LATCH, 8061):
            m[flag] = 0
        for word in (ERROR_CODE, LATCHED_STEP, ERROR_STEP, 8061):
            self._d[word] = 0
        self._times = (0, 0, 0)
        self.rests_until = -1
        self._system.scan(now, self._times)
        m[LINK_SETTINGS] = self.program.sets_link_at_step_0
        self.halted = 0

    def stop(self) -> None:
        """RUN→STOP."""
        self._system.stop()
        self._m[LINK_SETTINGS] = 0

    def on_error(self, failed: Callable[[int, int], None]) -> None:
        """Call ``failed(code, step)`` for every operation error (M8067): D8067 and the program step."""
        self._machine.failed = failed

    def halt(self, code: int = WATCHDOG_CODE) -> None:
        """An error of the PLC itself: M8061 and D8061, outputs off, no further scan until RUN.

        The watchdog has expired D8000 ms after the latest WDT.
        """
        self.halted, self.endless = code, False
        self.halted_after = ticks_of(self._watched) + self._d[8000] * TICKS_PER_MS
        self._m[8061], self._d[8061] = 1, code
        note_errors(self._m, self._d)
        outputs = self._machine.bits["Y"]
        outputs[:] = bytes(len(outputs))

    def scan(self, now: int) -> int:
        """One scan at a tick; returns the time that its instructions take, in ticks.

        0, and nothing happens, once the program stands still (``halted``).
        """
        if self.halted:
            return 0
        machine, m = self._machine, self._m
        machine.now[0] = now - self._origin
        machine.scan[0] = number = machine.scan[0] + 1
        depends = self._depends if self._times[0] else None  # M8002 and M8038 are off by then
        if depends is None and number > 1:
            latest, (_, shortest, longest) = now - self._begun, self._times
            self._times = (latest, min(shortest or latest, latest), max(longest, latest))
        self._begun = now
        if depends is None or depends.clocks:
            self._system.scan(now, self._times)
        before = self._state() if depends is not None else None
        if number == 2:
            m[LINK_SETTINGS] = 0
        if self._has_masters:
            machine.levels[:] = b"\1" * len(machine.levels)
        spent = machine.spent
        if self._straight:
            spent[0] = 0
            self._blocks[0]()
            self.unwatched = spent[0]
        else:
            self._run_blocks()
        if machine.going:
            coils.end(machine)
        total = spent[0]
        if self.unwatched > self._d[8000] * _NS_PER_MS and not self.halted:
            self.halt()
        if depends is not None:
            self.rests_until = rests_until(depends, machine) if self._state() == before else -1
        return ticks_of(total)

    def show(self, end: int, times: tuple[int, int, int]) -> None:
        """Show the special devices as the scan that begins with an END finds them.

        ``times`` are of whole scans, see :meth:`bussim.plc.scan.ScanCycle.times`.
        """
        latest, shortest, longest = times
        _, *first = self._times  # from RUN to the first END
        bounds = min(first[0] or shortest, shortest), max(first[1], longest)
        self._system.scan(end, (latest, *bounds) if latest else self._times)

    def _run_blocks(self) -> None:
        """Carry the blocks out in the order that the program's jumps determine."""
        spent, carry_out = self._machine.spent, self._blocks
        spent[0] = self._watched = self.unwatched = 0
        self._calls.clear()
        at = left = 0
        while at != END:
            at = carry_out[at]()
            left += 1
            if left > MAX_BLOCKS or spent[0] - self._watched > self._d[8000] * _NS_PER_MS:
                self.unwatched = max(self.unwatched, spent[0] - self._watched)
                self.halt()
                if left > MAX_BLOCKS:
                    self.endless, self.halted_after = True, ticks_of(spent[0])
                return
        self.unwatched = max(self.unwatched, spent[0] - self._watched)

    # -- what the blocks call ----------------------------------------------------------------------

    def _call(self, target: int, following: int, step: int) -> int:
        """CALL: the block to go on with."""
        if len(self._calls) >= MAX_CALLS:
            self._machine.fail(CALLS_TOO_DEEP, step)
            return following
        self._calls.append(following)
        return target

    def _watch(self) -> None:
        spent = self._machine.spent[0]
        self.unwatched = max(self.unwatched, spent - self._watched)
        self._watched = spent
