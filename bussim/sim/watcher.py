"""Tells a run's sink what a PLC's inputs and observed devices do."""

from __future__ import annotations

from collections.abc import Sequence

from bussim.plc.inputs import Change
from bussim.plc.memory import Device
from bussim.plc.plc import Plc
from bussim.trace import DeviceValueRecord, InputRecord, Sink


class Watcher:
    """Of one PLC. ``ends``: also every END of it, as it happens."""

    def __init__(self, plc: Plc, sink: Sink, *, ends: bool) -> None:
        self._plc = plc
        self._sink = sink
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
