"""Waits for whatever comes first on several wires."""

import select
import time
from collections.abc import Sequence

from bussim.live.clock import Clock, as_seconds
from bussim.live.wire import Wire

#: Seconds between two reads where a port cannot be waited for.
_INTERVAL = 0.0005


def wait(wires: Sequence[Wire], clock: Clock, until: int) -> None:
    """Return when something has come on one of the wires, or soon after the tick ``until``.

    It may return earlier: where a port cannot be waited for it is read again and again.
    """
    left = as_seconds(until - clock.now())
    connected = [wire for wire in wires if wire.connected]
    handles = [handle for wire in connected if (handle := wire.handle) is not None]
    if len(handles) < len(connected):
        time.sleep(min(left, _INTERVAL))
    elif handles:
        select.select(handles, (), (), left)
    else:
        time.sleep(left)
