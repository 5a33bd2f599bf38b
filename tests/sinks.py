"""A base of sinks that take single records."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bussim.results.store.rows import ordinary_records
from bussim.trace.records import Record


class OneByOne:
    """Takes what comes many at once one by one."""

    def take(self, record: Record) -> None:
        raise NotImplementedError

    def refreshed(self, bus: str, source: int, tick: int, heard: Sequence[int] | None) -> None:
        raise NotImplementedError

    def ordinary_scans(self, bus: str, number: int, starts: np.ndarray, attempts: int) -> None:
        for record in ordinary_records(bus, number, starts, attempts):
            self.take(record)

    def refreshed_often(self, bus: str, source: int, ticks: np.ndarray, heard: Sequence[int] | None) -> None:
        for tick in ticks.tolist():
            self.refreshed(bus, source, tick, heard)
