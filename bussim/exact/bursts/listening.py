"""What a listening slave remembers of the link's frames, which decides whether it takes a reply.

The rules are those of :mod:`bussim.engines.nn.slave` and its monitor. While a poll is open, of which the
listener has heard no reply, it takes that poll's reply only; while none is open, any with the counter of the
latest master frame. So a reply is refused although it is undamaged if its own poll was missed, and with it
the frame that would have closed an older poll or brought the scan's counter.

Neglected: a counter that is stale by sixteen scans, or a multiple, is right again. Of the replies that
follow sixteen scans in which a listener heard no frame of the master, one in sixteen may then be taken
earlier than is worked out, so that gaps are on the long side.
"""

from dataclasses import dataclass

import numpy as np

from bussim.exact.bursts.channel import Matrix
from bussim.exact.link import MASTER, LinkModel

#: No poll is open and the counter is the scan's; nor is one, and it is not; another station's poll or one
#: of an earlier scan is open; the exchange's own poll is open.
_READY, _STALE, _BLOCKED, _POLLED = range(4)


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """Matrices over what a receiver remembers, of size 1 where nothing matters.

    ``polled``, ``data``, ``parameters``: it hears that frame; ``takes``, ``refuses``: a whole reply is there;
    ``replies``: it replies itself; ``over``: an exchange, and ``turned``: a scan is over.
    """

    polled: Matrix
    takes: Matrix
    refuses: Matrix
    replies: Matrix
    over: Matrix
    turned: Matrix
    parameters: Matrix
    data: Matrix


def _moving(**moves: int) -> Matrix:
    """The matrix that moves each named state to another one and leaves the rest where they are."""
    names = ("ready", "stale", "blocked", "polled")
    return np.eye(4)[[moves.get(name, place) for place, name in enumerate(names)]]


_ACCEPTING = np.diag([1.0, 0.0, 0.0, 1.0])
_ONE = np.ones((1, 1))
NOTHING = Memory(_ONE, _ONE, 0 * _ONE, _ONE, _ONE, _ONE, _ONE, _ONE)
_SLAVE = Memory(
    polled=_moving(ready=_POLLED, stale=_POLLED, blocked=_POLLED),
    takes=_ACCEPTING @ _moving(polled=_READY),
    refuses=np.eye(4) - _ACCEPTING,
    replies=_moving(polled=_READY),
    over=_moving(polled=_BLOCKED),
    turned=_moving(ready=_STALE),
    parameters=_moving(stale=_READY),
    data=_moving(stale=_READY, blocked=_READY),
)


def memory_of(model: LinkModel, receiver: int) -> Memory:
    """What a receiver remembers that decides on replies.

    Where no receiver has noise of its own, a reply tells that every slave has heard its poll.
    """
    slaves = {receiver, *(station.number for station in model.alive)}
    noisy = any(model.noise.in_receiver(number) for number in slaves - {MASTER})
    return _SLAVE if receiver != MASTER and noisy else NOTHING
