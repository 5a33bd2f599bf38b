"""Makes records and totals of what the nodes of the serial buses report."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import assert_never

from bussim.engines.free.events import Received, Sent
from bussim.engines.modbus.adu import BROADCAST
from bussim.engines.modbus.codes import MEANINGS, PortError
from bussim.engines.modbus.events import (
    CycleEnded,
    FrameRejected,
    RequestServed,
    SlaveEvent,
    StationRefused,
    TransactionEnded,
)
from bussim.plc.ports.cpavl import refusal
from bussim.plc.ports.events import PortErrorRaised, TurnEnded
from bussim.sim.notes import Notes
from bussim.sim.serial.contract import SerialStation
from bussim.trace.records import CycleRecord, FreeRecord, Outcome, PollRecord, TransactionRecord
from bussim.trace.sink import Sink
from bussim.words.language import say


@dataclass(slots=True)
class SlaveCounts:
    """What one node has counted as a slave."""

    requests: int = 0
    answered: int = 0
    broadcasts: int = 0
    exceptions: Counter[int] = field(default_factory=Counter)
    rejected: Counter[str] = field(default_factory=Counter)


def _request_outcome(node: SerialStation, event: TransactionEnded) -> tuple[str, Outcome]:
    """Which node a master's request was for, and what became of it, by what that node has shown."""
    sent = event.sent or 0
    others = (each for each in node.line.ports if each is not node and isinstance(each, SerialStation))
    peer = next((each for each in others if event.station in each.stations), None)
    name = str(event.station) if peer is None else peer.name
    if event.error is None or event.exception:
        return name, Outcome.GOOD
    if peer is None:
        return name, Outcome.MISSING
    if peer.engine is None or peer.engine_since > sent or peer.jabbering:
        return name, Outcome.AWAY
    reply = node.replies.reply_to(sent)
    if reply is not None and reply.end < event.end:
        damaged = event.error is not PortError.TIMEOUT or node.receiver.heard_at > reply.start
        return name, Outcome.REPLY_DAMAGED if damaged else Outcome.REPLY_LOST
    asked = event.asked or 0
    if reply is not None or sent <= peer.engine.heard_start < asked:
        return name, Outcome.SILENT
    if node.came_sound(sent, peer):
        rejected = peer.rejected
        joined = rejected is not None and rejected.start < asked <= rejected.tick
        return name, Outcome.JOINED if joined else Outcome.SILENT
    return name, Outcome.GARBLED if peer.receiver.heard_at > sent else Outcome.DEAF


class SerialReporter(Notes):
    """Writes the records of all serial buses."""

    def __init__(self, sink: Sink) -> None:
        super().__init__(sink)
        self._slaves: dict[str, SlaveCounts] = {}
        #: Port errors of PLCs by node and code.
        self.errors: dict[str, Counter[int]] = {}

    def counts(self, node: str) -> SlaveCounts:
        """What a node has counted as a slave so far."""
        found = self._slaves.get(node)
        if found is None:
            found = self._slaves[node] = SlaveCounts()
        return found

    # -- slaves ------------------------------------------------------------------------------------

    def slave_event(self, node: SerialStation, event: SlaveEvent) -> None:
        """Record an event of a slave's engine."""
        counts = self.counts(node.name)
        match event:
            case RequestServed(broadcast=True):
                counts.broadcasts += 1
            case RequestServed():
                counts.requests += 1
                if event.exception:
                    counts.exceptions[event.exception] += 1
            case FrameRejected():
                node.rejected = event
                counts.rejected[event.reason.value] += 1
            case StationRefused(tick, station):
                text = say("note_outside", number=station)
                self.note(tick, "refused", node.name, text)
                self.warn(f"{node.name}: {text}")
            case _:
                assert_never(event)

    def replied(self, node: SerialStation) -> None:
        """A slave's reply begins."""
        self.counts(node.name).answered += 1

    # -- masters -----------------------------------------------------------------------------------

    def transaction(
        self, node: SerialStation, event: TransactionEnded, poll: str, attempt: int, taken: int
    ) -> None:
        """The outcome of a master's transaction was taken over at ``taken``."""
        request = event.request
        reply = None if event.answer_start is None else node.replies.reply_at(event.answer_start)
        mismatched = reply is not None and reply.asked != event.sent
        if event.error is None:
            outcome = "ok"
        elif event.exception:
            outcome = "exception"
        else:
            outcome = MEANINGS[event.error]
        true = reply is not None and not mismatched and event.error is None
        taken_for_own = mismatched and outcome in ("ok", "exception")
        self._sink.take(
            TransactionRecord(
                bus=node.line.name,
                master=node.name,
                poll=poll,
                attempt=attempt,
                station=event.station,
                function=request.function,
                address=request.address,
                quantity=request.quantity,
                sent=event.sent,
                asked=event.asked,
                answer_start=event.answer_start,
                answer_end=event.answer_end,
                end=event.end,
                taken=taken,
                outcome=outcome,
                error=None if event.error is None else int(event.error),
                exception=event.exception,
                served=reply.served if reply is not None and true else None,
                mismatched=taken_for_own,
                chars=(node.request_chars if event.sent is not None else 0) + (reply.chars if reply else 0),
            )
        )
        if event.sent is not None and event.station != BROADCAST and not taken_for_own:
            peer, became = _request_outcome(node, event)
            if mismatched:  # what its own response would have been is not known
                became = Outcome.UNKNOWN
            self._sink.exchanged(node.line.name, node.name, peer, event.sent, became)
        if event.error is PortError.TIMEOUT and event.sent is not None:
            node.replies.gave_up(node.name, poll, event.sent, event.end)
        if taken_for_own:
            text = say("note_mismatched", number=event.station)
            self.note(event.end, "mismatched", node.name, text, station=event.station)

    def turn(self, node: SerialStation, turn: TurnEnded) -> None:
        """A poll's turn is over, and its last response taken over."""
        code = None if turn.error is None else int(turn.error)
        self._sink.take(
            PollRecord(
                node.line.name, node.name, turn.poll, turn.start, turn.end, turn.attempts, code, turn.late
            )
        )

    def cycle(self, node: SerialStation, cycle: CycleEnded) -> None:
        """Every poll of a list has had its turn."""
        begun = cycle.tick - cycle.duration
        self._sink.take(CycleRecord(node.line.name, node.name, cycle.number, begun, cycle.duration))

    def port_error(self, node: SerialStation, event: PortErrorRaised) -> None:
        """A PLC's port has set M8063 and D8063 = 7xyy."""
        errors = self.errors.setdefault(node.name, Counter())
        code = int(event.error)
        errors[code] += 1
        if event.text:
            text = refusal(node.name, event.text, event.code)
            self.note(event.tick, "refused", node.name, text.removeprefix(f"{node.name} "), D8063=event.code)
            self.warn(text)
        elif errors[code] == 1:
            text = say("note_port_error", code=event.code, meaning=MEANINGS[code])
            self.note(event.tick, "port_error", node.name, text, code=code)

    # -- free protocol -----------------------------------------------------------------------------

    def sent(self, node: SerialStation, sent: Sent, poll: str) -> None:
        """A node has sent bytes in the free protocol."""
        self._sink.take(
            FreeRecord(node.line.name, node.name, poll, "sent", sent.start, sent.end, sent.chars, "", 0)
        )

    def received(self, node: SerialStation, received: Received, poll: str) -> None:
        """A PLC's port has received bytes."""
        start, end, data, ended = received.start, received.tick, received.data, received.ended.value
        bus, damaged = node.line.name, received.damaged
        self._sink.take(FreeRecord(bus, node.name, poll, "received", start, end, data, ended, damaged))
