"""Responses that a simulated master on a real port took soon after a timeout: they may be late ones."""

from __future__ import annotations

from bussim.engines.modbus.codes import MEANINGS, PortError
from bussim.engines.modbus.resync import PATIENCE
from bussim.trace.records import TransactionRecord
from bussim.units import format_ms, seconds
from bussim.wording import counted


class LateResponses:
    """Watches the masters of some lines, which go on after a timeout as a PLC's port does."""

    def __init__(self, lines: frozenset[str]) -> None:
        self._lines = lines
        # By master, station and function: the request that timed out last.
        self._unanswered: dict[tuple[str, int, int], TransactionRecord] = {}
        #: By master how many, and the first of them with the request that it may answer.
        self._found: dict[str, tuple[int, TransactionRecord, TransactionRecord]] = {}

    def note(self, record: TransactionRecord) -> None:
        """A master's request was decided."""
        if record.bus not in self._lines or record.asked is None:
            return
        key = record.master, record.station, record.function
        if record.outcome == MEANINGS[PortError.TIMEOUT]:
            self._unanswered[key] = record
            return
        earlier = self._unanswered.get(key)
        if earlier is None or record.answer_end is None or earlier.asked is None:
            return
        other = (earlier.address, earlier.quantity) != (record.address, record.quantity)
        if other and record.answer_end - earlier.asked < PATIENCE:
            count, *first = self._found.get(record.master, (0, record, earlier))
            self._found[record.master] = (count + 1, first[0], first[1])

    def warnings(self) -> list[str]:
        """A sentence for each master that took such responses."""
        sentences = []
        for master, (count, first, earlier) in self._found.items():
            after = format_ms(first.end - (earlier.asked or 0))
            sentences.append(
                f"{master} took {counted(count, 'response')} within a second after a request of the same "
                f"form that got none, the first at {seconds(first.end):.3f} s, {after} after that request: "
                "it may be the response to it, and each that followed the response to the request before. "
                "A PLC's port cannot tell; a longer timeout can"
            )
        return sentences
