"""Records what a PLC's inputs, observed devices and program do."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import TYPE_CHECKING

from bussim.plc.inputs import Change
from bussim.plc.memory import Device
from bussim.plc.plc import Plc
from bussim.plc.program.errors import Fault, Halt, PortRefused
from bussim.trace.records import DeviceValueRecord, InputRecord, NoteRecord
from bussim.trace.sink import Sink
from bussim.units import seconds

if TYPE_CHECKING:
    from bussim.plc.program.program import Program

#: What a PLC does whose program has stopped: an assumption, see :mod:`bussim.plc.program.execution`.
_STANDS_STILL = (
    "its outputs are off until STOP→RUN, its link and ports go on with what memory holds (assumed)"
)


class PlcProbe:
    """The probe of one PLC. ``ends``: it also records every END, as it happens.

    A program's first error of a kind is noted at once; how often it came is a warning at the end
    (:meth:`warnings`).
    """

    def __init__(self, plc: Plc, program: Program | None, sink: Sink, *, ends: bool) -> None:
        self._plc = plc
        self._program = program
        self._sink = sink
        self._faults: dict[Hashable, tuple[str, int]] = {}  # by code: the first one in words, their number
        self.takes_ends = ends
        plc.observer = self

    def ended(self, end: int) -> None:
        """See the observer."""
        self._sink.ends(self._plc.name, (end,))

    def changed(self, device: Device, value: int, now: int) -> None:
        """See the observer."""
        self._sink.take(DeviceValueRecord(now, self._plc.name, str(device), value))

    def sampled(self, device: Device, changes: Sequence[Change], sampled: int, end: int) -> None:
        """See the observer."""
        name, text = self._plc.name, str(device)
        last = changes[-1]
        for change in changes:
            seen = change is last
            self._sink.take(InputRecord(change[0], name, text, change[1], sampled, seen, end))

    def faulted(self, fault: Fault, now: int) -> None:
        """See the observer."""
        name = self._plc.name
        key: Hashable = fault[:2] if isinstance(fault, PortRefused) else fault.code
        detail: dict[str, int | str] = {} if isinstance(fault, PortRefused) else {"code": fault.code}
        text, count = self._faults.get(key, ("", 0))
        if not count:
            if isinstance(fault, Halt):
                kind, note = "program_stopped", fault.text
                # The run, or RUN, may be over before the time that the scan takes.
                stopped = f"stopped at {seconds(fault.tick):.3f} s"
                if fault.tick > now:
                    stopped = f"was at {seconds(now):.3f} s in a scan that it cannot finish"
                text = f"{name}'s program {stopped}: {note}; {_STANDS_STILL}"
            else:
                kind, note = "program_error", fault.text(self._program)
                text = f"{name}'s program met an error in the scan up to {seconds(now):.3f} s: {note}"
            self._sink.take(NoteRecord(now, kind, name, note, detail))
        self._faults[key] = (text, count + (1 if isinstance(fault, Halt) else fault.number))

    def warnings(self, now: int) -> list[str]:
        """The program's errors up to the end of a run at ``now``: one sentence for each code."""
        self._plc.record_faults(now)
        return [
            text if count == 1 else f"{text}; {count:,} times in all" for text, count in self._faults.values()
        ]
