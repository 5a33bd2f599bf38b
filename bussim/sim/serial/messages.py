"""What became of each message of the free protocol on one bus, at each node that was to receive it."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from bussim.engines.free.events import Ended, Received
from bussim.sim.serial.contract import SerialStation
from bussim.sim.wire.contract import Transmission
from bussim.trace.records import Outcome

#: Messages and receptions that are remembered: a reception has at most so many bytes.
_REMEMBERED = 256


@dataclass(eq=False, slots=True)
class _Message:
    """A message on the wire, and its receivers' engines with what each was to take of it.

    None: the receiver had no supply, was in STOP (then its engine is None, too) or was not ready.
    """

    tx: Transmission
    receivers: dict[SerialStation, tuple[Any, bytes | None]]
    decided: set[SerialStation] = field(default_factory=set)


class Messages:
    """The latest messages and receptions of one bus; ``tell`` takes receiver, message and outcome.

    A message is decided once the next one begins, or the run ends, and no reception is under way.
    """

    def __init__(self, tell: Callable[[SerialStation, Transmission, Outcome], None]) -> None:
        self._tell = tell
        self._latest: deque[_Message] = deque(maxlen=_REMEMBERED)
        self._receptions: dict[SerialStation, deque[Received]] = {}  # of all that were ever to receive
        self._by_timeout: set[SerialStation] = set()  # whose whole messages end so, too

    def begun(self, tx: Transmission, nodes: Sequence[SerialStation]) -> None:
        """A message begins that is over at ``tx.end``."""
        self.decide(tx.start)
        if tx.frame is None or tx.silent:
            return
        receivers: dict[SerialStation, tuple[Any, bytes | None]] = {}
        for node in nodes:
            if node is tx.sender or node.kind != "data":
                continue
            engine = None if node.jabbering else node.engine
            expected = None if engine is None or node.driving else engine.expects(tx.frame.chars)
            if expected:
                self._receptions.setdefault(node, deque(maxlen=_REMEMBERED))
            if expected or (expected is None and node in self._receptions):
                receivers[node] = engine, expected
        if receivers:
            self._latest.append(_Message(tx, receivers))

    def received(self, node: SerialStation, reception: Received) -> None:
        """A reception of a node is over."""
        if reception.start is not None and node in self._receptions:
            self._receptions[node].append(reception)

    def decide(self, now: int) -> None:
        """Tell what became of messages that are over."""
        for message in self._latest:
            tx = message.tx
            if tx.end > now or len(message.decided) == len(message.receivers):
                continue
            for node in message.receivers:
                if node not in message.decided and not getattr(node.engine, "receiving", False):
                    message.decided.add(node)
                    if not tx.cut:  # its sender's supply went
                        self._tell(node, tx, self._outcome(node, message))

    def _outcome(self, node: SerialStation, message: _Message) -> Outcome:
        engine, expected = message.receivers[node]
        if engine is None or node.engine is not engine:
            return Outcome.AWAY
        if expected is None:
            return Outcome.NOT_READY
        tx = message.tx
        found = [each for each in self._receptions[node] if _meet(tx, each)]
        if not found:
            came = node.receiver.heard_at > tx.start
            return Outcome.DAMAGED if came or tx.collided else Outcome.DEAF
        chars = b"".join(each.chars for each in found)
        # A reception may have several messages, and a message come in several receptions.
        sent = [
            each.receivers[node][1] or b""
            for each in self._latest
            if node in each.receivers and any(_meet(each.tx, reception) for reception in found)
        ]
        damaged = any(each.damaged for each in found)
        timed_out = any(each.ended is Ended.TIMEOUT for each in found)
        if not damaged and chars in (expected, b"".join(sent)):
            if timed_out:
                self._by_timeout.add(node)
            return Outcome.GOOD
        flagged = damaged or (timed_out and node not in self._by_timeout)
        return Outcome.DAMAGED if flagged else Outcome.WRONG


def _meet(tx: Transmission, reception: Received) -> bool:
    return (reception.start or 0) < tx.end and tx.start < reception.tick
