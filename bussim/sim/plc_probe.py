"""Tells a run's sink what a PLC's inputs, observed devices and program do."""

from __future__ import annotations

from collections.abc import Sequence

from bussim.plc.inputs import Change
from bussim.plc.memory import Device
from bussim.plc.plc import Plc
from bussim.plc.program.faults import Halt, OperationFault
from bussim.plc.program.program import Program
from bussim.trace.records import DeviceValueRecord, InputRecord, NoteRecord, Sink
from bussim.units import seconds

#: What a PLC does whose program has stopped: an assumption, see :mod:`bussim.plc.program.run`.
_STANDS_STILL = (
    "its outputs are off until STOP→RUN, its link and ports go on with what memory holds (assumed)"
)


class PlcProbe:
    """Of one PLC. ``ends``: also every END of it, as it happens.

    Of what its program meets the first of a kind is told at once, how often it came afterwards
    (:meth:`warnings`).
    """

    def __init__(self, plc: Plc, program: Program | None, sink: Sink, *, ends: bool) -> None:
        self._plc = plc
        self._program = program
        self._sink = sink
        self._met: dict[int, tuple[str, int]] = {}  # by code: the first one in words, their number
        plc.faulted = self._faulted
        plc.changed = self._changed
        plc.sampled = self._sampled
        if ends:
            plc.ended = self._ended

    def _ended(self, end: int) -> None:
        self._sink.ends(self._plc.name, (end,))

    def _changed(self, device: Device, value: int, end: int) -> None:
        self._sink.value(DeviceValueRecord(end, self._plc.name, str(device), value))

    def _sampled(self, device: Device, changes: Sequence[Change], sampled: int, end: int) -> None:
        name, text = self._plc.name, str(device)
        last = changes[-1]
        for change in changes:
            seen = change is last
            self._sink.input(InputRecord(change[0], name, text, change[1], sampled, seen, end))

    def _faulted(self, fault: OperationFault | Halt, now: int) -> None:
        name, code = self._plc.name, fault.code
        text, count = self._met.get(code, ("", 0))
        if not count:
            if isinstance(fault, Halt):
                kind, told = "program_stopped", fault.text
                text = f"{name}'s program stopped at {seconds(fault.tick):.3f} s: {told}; {_STANDS_STILL}"
            else:
                kind, told = "program_error", fault.text(self._program)
                text = f"{name}'s program met an error in the scan up to {seconds(now):.3f} s: {told}"
            self._sink.note(NoteRecord(now, kind, name, told, {"code": code}))
        self._met[code] = (text, count + (fault.number if isinstance(fault, OperationFault) else 1))

    def warnings(self, now: int) -> list[str]:
        """What its program met, for the end of a run at ``now``: one sentence for each code."""
        self._plc.record_faults(now)
        return [
            text if count == 1 else f"{text}; {count:,} times in all" for text, count in self._met.values()
        ]
