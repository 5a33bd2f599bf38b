"""A node of a serial bus as its bus and reporter see it, and the replies that the bus remembers.

The bus and the reporter are written for these classes; the node that completes one
(:class:`bussim.sim.serial.node.SerialNode`) can therefore import both.
"""

from __future__ import annotations

from abc import abstractmethod
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Collection
from typing import NamedTuple

from bussim.engines.free.events import FreeEvent
from bussim.engines.modbus.events import FrameRejected, MasterEvent, PollEvent, SlaveEvent
from bussim.sim.wire.node import Node

#: Replies that are remembered: more than can lie between a reply and the END that takes it over.
_REPLIES = 512
#: Requests that were given up and may still get a reply.
_GIVEN_UP = 64

#: What the engine of a node may report.
SerialEvent = MasterEvent | SlaveEvent | PollEvent | FreeEvent


class Reply(NamedTuple):
    """A slave's reply on the wire: which request it belongs to, and when its values were taken."""

    start: int
    end: int
    asked: int  # first edge of the request
    served: int
    chars: int


class Replies:
    """The latest replies on one bus, and the requests that were given up before theirs.

    ``tell`` takes the master, and the tick, of each response that is known to come too late.
    """

    def __init__(self, tell: Callable[[str, int], None]) -> None:
        self._tell = tell
        self._replies: deque[Reply] = deque(maxlen=_REPLIES)
        self._given_up: dict[int, tuple[str, str]] = {}  # by the request's first edge: its master and poll
        #: Responses that ended after their request had been given up, by master and poll.
        self.late: defaultdict[str, Counter[str]] = defaultdict(Counter)

    def replied(self, reply: Reply) -> None:
        """Record a slave's reply that begins now."""
        self._replies.append(reply)
        given_up = self._given_up.pop(reply.asked, None)
        if given_up is not None:
            self._came_late(*given_up, reply.start)

    def gave_up(self, master: str, poll: str, asked: int, end: int) -> None:
        """A master's timeout was over at ``end``, before a response to its request of ``asked``."""
        begun = self.reply_to(asked)
        if begun is None:
            self._given_up[asked] = master, poll
            if len(self._given_up) > _GIVEN_UP:
                del self._given_up[next(iter(self._given_up))]
        elif begun.end >= end:
            self._came_late(master, poll, end)

    def _came_late(self, master: str, poll: str, tick: int) -> None:
        self.late[master][poll] += 1
        self._tell(master, tick)

    def reply_to(self, asked: int) -> Reply | None:
        """The reply to a request, by its first edge."""
        return next((reply for reply in self._replies if reply.asked == asked), None)

    def reply_at(self, tick: int) -> Reply | None:
        """The reply that was on the wire at a tick; None if none was, or several."""
        found: Reply | None = None
        for reply in reversed(self._replies):
            if reply.end <= tick:
                break  # so are all before it, but for one that began before another and outlasted it
            if reply.start <= tick:
                if found is not None:
                    return None
                found = reply
        return found


class SerialStation(Node):
    """A PLC's port or a device on a serial bus.

    ``kind`` names its frames ("request", "response" or "data"), ``protocol_name`` its protocol
    ("modbus-rtu", "modbus-ascii", "free"): both follow from its engine.
    """

    kind = "data"
    protocol_name = "free"
    #: Characters of the latest request that it sent.
    request_chars = 0
    #: Those of a slave.
    stations: Collection[int] = ()
    #: When its engine began to run.
    engine_since = 0
    #: The latest that it rejected.
    rejected: FrameRejected | None = None
    #: Those of its bus.
    replies: Replies

    @abstractmethod
    def resume_reception(self) -> None:
        """Characters come before the silence is over: the receiver goes on from where the frame ended."""

    @abstractmethod
    def came_sound(self, start: int, peer: SerialStation) -> bool:
        """Whether what it sent from ``start`` on, of late, came to another node as it was sent."""
