"""A base of sinks that take single records."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from bussim.trace.blocks import RecordBlock, in_turn, pieces
from bussim.trace.records import CycleRecord, OrdinaryTurns, Outcome, PollRecord, Record


class OneByOne:
    """Takes what comes many at once one by one."""

    in_order = False

    def take(self, record: Record) -> None:
        raise NotImplementedError

    def refreshed(self, bus: str, source: int, tick: int, heard: Sequence[int] | None) -> None:
        raise NotImplementedError

    def exchanged(self, bus: str, node: str, peer: str, start: int, outcome: Outcome) -> None:
        raise NotImplementedError

    def ordinary_turns(self, turns: Sequence[OrdinaryTurns], cycles: Sequence[CycleRecord]) -> None:
        for first, peer, *columns in turns:
            for sent, begun, taken, driven, late in zip(*columns, strict=True):
                assert None not in (first.sent, first.answer_start)
                later, response = sent - (first.sent or 0), begun - (first.answer_start or 0)
                self.take(
                    first._replace(
                        sent=sent,
                        asked=(first.asked or 0) + later,
                        served=(first.served or 0) + later,
                        answer_start=begun,
                        answer_end=(first.answer_end or 0) + response,
                        end=first.end + response,
                        taken=taken,
                    )
                )
                self.exchanged(first.bus, first.master, peer, sent, Outcome.GOOD)
                self.take(PollRecord(first.bus, first.master, first.poll, driven, taken, 1, None, late))
        for cycle in cycles:
            self.take(cycle)

    def take_many(self, block: RecordBlock, breaks: Iterable[int] = ()) -> None:
        for records in pieces(in_turn(each.records() for each in block), breaks):
            for record in records:
                self.take(record)

    def refreshed_often(self, bus: str, source: int, ticks: np.ndarray, heard: Sequence[int] | None) -> None:
        for tick in ticks.tolist():
            self.refreshed(bus, source, tick, heard)
