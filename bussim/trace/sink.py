"""What takes a run's records while it goes on."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Protocol

from bussim.trace.blocks import RecordBlock
from bussim.trace.records import CycleRecord, OrdinaryTurns, Outcome, Record

if TYPE_CHECKING:
    import numpy as np


class Sink(Protocol):
    """What takes a run's records. Ticks of one type never decrease; of refreshes those of one source."""

    #: Whether attempts and frames are wanted; they cost time and memory.
    traced: bool
    #: Whether records of several masters must come in the order of their ticks.
    in_order: bool

    def take(self, record: Record) -> None:
        """Take a record: attempts and frames only if :attr:`traced`, an input's change when it is sampled."""

    def take_many(self, block: RecordBlock, breaks: Iterable[int] = ()) -> None:
        """Take records, as if each of them came by itself; link scans among them are without errors.

        ``breaks`` are the indexes of those before which other records come: these do when, after the
        records before such an index, the next index is asked for. A sink that keeps records in order asks.
        """

    def failed(self, bus: str, tick: int, station: int, code: int, *, garbled: bool = False) -> None:
        """An attempt of the bus's (first) master failed with an error code.

        ``garbled``: characters that were no sound frame came to the station meanwhile.
        """

    def ends(self, plc: str, ticks: Sequence[int]) -> None:
        """ENDs of a PLC, in order.

        Those of a PLC that a latency is measured of come one by one as they happen, each after what it
        changed (values) and before the scan that begins with it (inputs). Those of other
        PLCs come only if :attr:`traced`, in blocks, later than they happen.
        """

    def refreshed(self, bus: str, source: int, tick: int, heard: Sequence[int] | None) -> None:
        """The block of a source arrived, complete and valid, at ``tick``.

        ``source`` and the entries of ``heard`` are positions among the bus's PLCs
        (:attr:`bussim.trace.records.LinkTotals.plc_names`). ``heard`` is None when every other station that
        is switched to the link took it, which is the ordinary case; else the positions of those that did.
        """

    def refreshed_often(self, bus: str, source: int, ticks: np.ndarray, heard: Sequence[int] | None) -> None:
        """Take refreshes of a source at some ticks, in order, each as of :meth:`refreshed`."""

    def switched(self, bus: str, position: int, tick: int, fresh: int | None) -> None:
        """A PLC of a link goes to RUN, or (``fresh`` None) leaves it, at ``tick``.

        Blocks of it that are complete before ``fresh`` have what its memory held before RUN.
        """

    def ordinary_turns(self, turns: Sequence[OrdinaryTurns], cycles: Sequence[CycleRecord]) -> None:
        """Take a master's turns without errors and the cycles of its list; only unless :attr:`in_order`."""

    def irregular(self, bus: str, node: str, tick: int, what: str) -> None:
        """A node did at ``tick`` what disturbs or shows: one of :data:`bussim.trace.records.IRREGULAR`."""

    def exchanged(self, bus: str, node: str, peer: str, start: int, outcome: Outcome) -> None:
        """What became of a message of ``peer`` at ``node``, or of a request of ``node`` to ``peer``.

        Beside the links only. ``peer`` is a node, or a station number that no node of the bus has; ``start``
        is the first edge. Requests come in order, messages once it is known what became of them.
        """
