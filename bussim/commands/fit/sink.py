"""What ``bussim fit`` gathers while a recording is read."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bussim.live.fit.link import LinkEstimate, LinkObserver
from bussim.live.fit.modbus import BusEstimate, BusObserver
from bussim.live.sniff.heard import Heard, Protocol
from bussim.results.collector import Collector
from bussim.trace.records import Record, TransactionRecord

if TYPE_CHECKING:
    from bussim.line.characters import LineTiming


class FitSink(Collector):
    """Collects link scans for the comparison, and hands frames and transactions to the observers."""

    def __init__(self, line: LineTiming, master: str, bus: str) -> None:
        super().__init__(bus_of={master: bus})
        self._line = line
        self._seen_link: LinkObserver | None = None
        self._seen_bus: BusObserver | None = None
        self._transactions: list[TransactionRecord] = []

    def heard(self, frames: list[Heard]) -> None:
        """Take in frames, after the listener has reported what follows from them."""
        for heard in frames:
            if heard.protocol is Protocol.NN:
                if self._seen_link is None:
                    self._seen_link = LinkObserver()
                self._seen_link.heard(heard)
                continue
            if self._seen_bus is None:
                self._seen_bus = BusObserver(
                    heard.protocol,
                    baud=self._line.baud,
                    fmt=str(self._line.format),
                    bits=self._line.format.bits,
                )
            self._seen_bus.heard(heard)
        if self._seen_bus is not None:
            for record in self._transactions:
                self._seen_bus.transaction(record)
            self._transactions.clear()

    def take(self, record: Record) -> None:
        """Count a record; a transaction is kept until its frames are handed over."""
        if isinstance(record, TransactionRecord):
            self._transactions.append(record)
        else:
            super().take(record)

    def estimates(self) -> tuple[LinkEstimate | None, BusEstimate | None]:
        """The estimates from all of it."""
        return (
            None if self._seen_link is None else self._seen_link.estimate(),
            None if self._seen_bus is None else self._seen_bus.estimate(),
        )
