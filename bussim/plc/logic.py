"""A PLC whose scans are carried out one by one: its program, its inputs, and the block that it shares.

The scan from one END to the next is carried out at its beginning: inputs are sampled, the program runs
on the memory, and its instruction times make the scan longer. What it has written takes effect from the
END on that ends the scan: by its own ports, which act before the next scan begins, and by the link, which
takes the image that is frozen at END.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from bussim.plc.inputs import NEVER, Change, Stimulus
from bussim.plc.memory import BlockRange, Device, DeviceRange, Memory, SharedAreas
from bussim.plc.ports.port_instructions import ProgramPorts
from bussim.plc.program.errors import Fault, Halt, OperationFault, PortRefused
from bussim.plc.program.instruction_times import InstructionTimes
from bussim.units import TICKS_PER_MS

if TYPE_CHECKING:
    from bussim.plc.program.execution import ProgramRun
    from bussim.plc.program.program import Program
    from bussim.plc.program.rest import Dependence


class Logic:
    """Program and inputs of one PLC from power-on to power-off. All times are ticks.

    ``memory`` is the PLC's; ``shared_words`` D from D0 on may belong to the link; ``kept_pulses`` see
    :class:`bussim.plc.program.execution.ProgramRun`.
    """

    def __init__(
        self,
        program: Program | None,
        inputs: Mapping[Device, Stimulus],
        memory: Memory,
        shared_words: int,
        times: InstructionTimes,
        ports: ProgramPorts,
        now: int,
        kept_pulses: Sequence[DeviceRange] = (),
    ) -> None:
        self._memory = memory
        self._inputs = dict(inputs)
        self._sampled_at = now
        self._next_change = -1  # when an input changes next; before the first sampling: all are sampled
        self._ports = ports
        self._uses_ports = program is not None and program.uses_ports
        self._run: ProgramRun | None = None
        if program is not None:
            from bussim.plc.program.execution import ProgramRun  # what only a PLC with a program pays

            self._run = ProgramRun(
                program, memory, times=times, ports=self._ports, power_on=now, kept_pulses=kept_pulses
            )
            self._run.on_error(self._failed)
        self._shared = SharedAreas(memory, shared_words)
        self._shown = now  # the END whose special devices the memory shows; NEVER: they stay as they are
        #: The inputs' changes between the latest two samplings.
        self.changes: list[tuple[Device, list[Change]]] = []
        # Not reported yet: operation errors by code, with the first one's step and their number; a stop.
        self._errors: dict[int, tuple[int, int]] = {}
        self._halt: Halt | None = None

    @property
    def halted(self) -> bool:
        """Whether the program stands still (D8061 has the code)."""
        return self._run is not None and self._run.halted > 0

    def may_rest(self, depends: Dependence) -> None:
        """See the program's run."""
        if self._run is not None:
            self._run.may_rest(depends)

    @property
    def rests_until(self) -> int:
        """Until when the scans to come need not be carried out: none before this tick does anything.

        -1: the next one may. The latest one's errors are still to be reported.
        """
        running = self._run is not None and not self._run.halted
        program = self._run.rests_until if self._run is not None and running else NEVER
        return -1 if self.faulted else min(program, self._next_change)

    def show_specials(self, end: int, times: tuple[int, int, int]) -> None:
        """Show the special devices as the scan that begins with an END finds them, if that was not done.

        Those of a program that stands still stay so.
        """
        if self._run is not None and end > self._shown:
            self._shown = NEVER if self._run.halted else end
            self._run.show(end, times)

    # -- errors ------------------------------------------------------------------------------------

    @property
    def faulted(self) -> bool:
        """Whether :meth:`faults` has any."""
        return bool(self._errors or self._ports.refused) or self._halt is not None

    def faults(self) -> list[Fault]:
        """Operation errors (M8067) by code, refused RS2, and the program's stop, since the latest call."""
        found: list[Fault] = [OperationFault(code, *first) for code, first in self._errors.items()]
        found += [PortRefused(*pair, number) for pair, number in self._ports.refused.items()]
        self._ports.refused.clear()
        if self._halt is not None:
            found.append(self._halt)
        self._errors, self._halt = {}, None
        return found

    def _failed(self, code: int, step: int) -> None:
        first, count = self._errors.get(code, (step, 0))
        self._errors[code] = (first, count + 1)

    def _note_halt(self, begun: int) -> None:
        """The scan that began at a tick has stopped the program."""
        run = self._run
        if run is not None:
            watchdog = self._memory.word("D", 8000)
            self._halt = Halt(begun + run.halted_after, run.halted, watchdog, run.endless)

    # -- scans -------------------------------------------------------------------------------------

    def run(self, now: int) -> None:
        """STOP→RUN; the first scan follows (:meth:`scan`).

        What the link sends before the first END is the memory at RUN.
        """
        self._shown = now - 1
        if self._run is not None:
            self._run.run(now)
        self.freeze()

    def stop(self) -> None:
        """RUN→STOP."""
        if self._run is not None:
            self._run.stop()

    def freeze(self) -> None:
        """END: what the link sends from now on is what the memory holds now."""
        self._shared.take()

    def image(self, block: BlockRange) -> bytes:
        """A shared block as the latest END left it."""
        return self._shared.block_image(block)

    def scan(self, now: int) -> int:
        """A scan begins: sample the inputs and carry the program out; returns its instruction time."""
        if self.changes:
            self.changes.clear()
        if now >= self._next_change:
            self._sample(now)
        self._sampled_at = now
        if self._run is None:
            return 0
        before = self.halted
        spent = self._run.scan(now)
        if self._uses_ports:
            self._ports.scan_over(now)
        if self.halted and not before:
            self._note_halt(now)
        return spent

    def _sample(self, now: int) -> None:
        first, ahead = self._next_change < 0, NEVER
        for device, stimulus in self._inputs.items():
            changes = stimulus.changes(self._sampled_at, now)
            if changes:
                self._memory.set(device, changes[-1][1])
                self.changes.append((device, changes))
            elif first:
                self._memory.set(device, stimulus.level(now))
            ahead = min(ahead, stimulus.next_change(now))
        self._next_change = ahead

    def check_watchdog(self, begun: int, duration: int) -> None:
        """Stop the program if the scan that begins exceeds the watchdog (D8000, in ms)."""
        run = self._run
        if run is not None and not run.halted and duration > self._memory.word("D", 8000) * TICKS_PER_MS:
            run.halt()
            self._note_halt(begun)
