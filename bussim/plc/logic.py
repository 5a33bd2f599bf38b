"""A PLC whose scans are carried out one by one: its program, its inputs, and what others see of it.

The scan from one END to the next is carried out at its beginning: inputs are sampled, the program runs
on the memory, and its instruction times make the scan longer. What it has written is seen from the END
on that ends the scan: by its own ports, which act before the next scan begins, and by the link, which
takes the image that is frozen at END.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from bussim.plc.inputs import NEVER, Change, Stimulus
from bussim.plc.memory import BlockPlace, Device, Memory, SharedAreas
from bussim.plc.ports.rs2 import Drive, Rs2
from bussim.plc.program.program import Program
from bussim.plc.program.run import ProgramRun
from bussim.plc.program.times import InstructionTimes

#: Carries an RS2 out: the instruction, its operands, the tick, whether it is driven.
DriveRs2 = Callable[[int, Rs2, int, bool], Drive]
SetUpPort = Callable[[int, Device, Device], bool]


class _Ports:
    """RS2 and CPAVL of one program, as its PLC's ports want them."""

    def __init__(self, drive: DriveRs2, set_up: SetUpPort) -> None:
        self._drive = drive
        self._set_up = set_up
        self._driven: dict[int, Rs2] = {}  # in the scan before
        self._now_driven: dict[int, Rs2] = {}

    def drive(self, instruction: int, operands: tuple[Device | int, ...], now: int) -> None:
        """See the program's ports."""
        s, m, d, n, n1 = operands
        if isinstance(s, Device) and isinstance(d, Device):
            rs2 = Rs2(s, m, d, n, n1)
            self._now_driven[instruction] = rs2
            self._drive(instruction, rs2, now, True)  # noqa: FBT003 - the fields' order of DriveRs2

    def cpavl(self, words: Device, bits: Device, port: int) -> None:
        """See the program's ports."""
        self._set_up(port, words, bits)

    def scan_over(self, now: int) -> None:
        """Instructions that this scan did not drive are not driven any more."""
        for instruction, rs2 in self._driven.items():
            if instruction not in self._now_driven:
                self._drive(instruction, rs2, now, False)  # noqa: FBT003 - the fields' order of DriveRs2
        self._driven, self._now_driven = self._now_driven, {}


class Logic:
    """From power-on to power-off of one PLC; ``memory`` is that PLC's. All times are ticks.

    ``shared_words`` D from D0 on may belong to the link.
    """

    def __init__(
        self,
        program: Program | None,
        inputs: Mapping[Device, Stimulus],
        memory: Memory,
        shared_words: int,
        times: InstructionTimes,
        drive: DriveRs2,
        set_up: SetUpPort,
        now: int,
    ) -> None:
        self._memory = memory
        self._inputs = dict(inputs)
        self._sampled_at = now
        self._next_change = -1  # when an input changes next; before the first sampling: look at them all
        self._ports = _Ports(drive, set_up)
        self._run = (
            ProgramRun(program, memory, times=times, ports=self._ports, power_on=now)
            if program is not None
            else None
        )
        self._shared = SharedAreas(memory, shared_words)
        #: What the inputs did between the latest two samplings.
        self.changes: list[tuple[Device, list[Change]]] = []

    @property
    def halted(self) -> int:
        """The code of D8061 with which the program stands still, else 0."""
        return self._run.halted if self._run is not None else 0

    def run(self, now: int) -> int:
        """STOP→RUN and the first scan; returns the time of its instructions.

        What the link sends before the first END is the memory at RUN.
        """
        if self._run is not None:
            self._run.run(now)
        self.freeze()
        return self.scan(now)

    def stop(self) -> None:
        """RUN→STOP."""
        if self._run is not None:
            self._run.stop()

    def freeze(self) -> None:
        """END: what the link sends from now on is what the memory holds now."""
        self._shared.take()

    def image(self, place: BlockPlace) -> bytes:
        """A shared block as the latest END left it."""
        return self._shared.block_image(place)

    def scan(self, now: int) -> int:
        """A scan begins: sample the inputs and carry the program out; returns its instruction time."""
        if self.changes:
            self.changes.clear()
        if now >= self._next_change:
            self._sample(now)
        self._sampled_at = now
        if self._run is None:
            return 0
        spent = self._run.scan(now)
        self._ports.scan_over(now)
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

    def overrun(self, scan: int) -> None:
        """The scan that begins lasts so many ticks: the watchdog (D8000) stops the program if too many."""
        run = self._run
        if run is not None and not run.halted and scan > self._memory.word("D", 8000) * 72_000:
            run.halt()
