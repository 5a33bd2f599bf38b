"""Responses that a simulated master on a real port took soon after a timeout: they may be late ones."""

from collections import Counter

from bussim.engines.modbus.codes import MEANINGS, PortError
from bussim.engines.modbus.resync import PATIENCE
from bussim.trace.records import TransactionRecord
from bussim.wording import counted


class LateResponses:
    """Watches the masters of some lines, which go on after a timeout as a PLC's port does."""

    def __init__(self, lines: frozenset[str]) -> None:
        self._lines = lines
        # By master, station and function: the request that timed out last.
        self._unanswered: dict[tuple[str, int, int], TransactionRecord] = {}
        self._found: Counter[str] = Counter()  # by master

    def note(self, record: TransactionRecord) -> None:
        """A master's request was decided."""
        if record.bus not in self._lines:
            return
        key = record.master, record.station, record.function
        if record.outcome == MEANINGS[PortError.TIMEOUT]:
            self._unanswered[key] = record
        elif (before := self._unanswered.get(key)) and before.asked and record.answer_end:
            other = (before.address, before.quantity) != (record.address, record.quantity)
            self._found[record.master] += other and record.answer_end - before.asked < PATIENCE

    def warnings(self) -> list[str]:
        """A sentence for each master that took such responses."""
        return [
            f"{master} took {counted(count, 'response')} within a second after a request of the same form "
            "that got none: it may be the response to it, and each that followed the response to the request "
            "before. A PLC's port cannot tell; a longer timeout can"
            for master, count in self._found.items()
            if count
        ]
