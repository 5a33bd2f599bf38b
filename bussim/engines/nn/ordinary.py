"""Link scans in which nothing goes wrong: every slave replies to its first poll, and all receive every frame.

When such scans happen, and what they leave in the engines of the master
(:meth:`bussim.engines.nn.master.Master.pass_scans`) and of slaves
(:meth:`bussim.engines.nn.slave.Slave.pass_scans`), follows from the engines' own settings; a test passes the
same frames one by one. Times are ticks, in arrays of numpy.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

    from bussim.engines.nn.master import MasterConfig


@dataclass(frozen=True)
class OrdinaryScans:
    """When some link scans in a row happen. Slave ``k`` has row ``k - 1``, each scan a column.

    ``starts`` has one entry more: the first edge of the master's data frame after the last scan.
    """

    counter: int  # of the first scan
    slaves: int
    poll: int  # how long a poll lasts, and a data frame
    data: int
    starts: np.ndarray
    polled: np.ndarray  # ends of the polls
    replies: np.ndarray  # first edges of the replies
    replied: np.ndarray  # their ends

    @property
    def number(self) -> int:
        """How many they are."""
        return len(self.starts) - 1

    @property
    def latest(self) -> int:
        """The counter of the last one."""
        return (self.counter + self.number - 1) & 15

    @cached_property
    def measured(self) -> tuple[int, int, int] | None:
        """Of all scans but the last: the longest, when it ended, and the latest; None where it is alone."""
        durations = self.starts[1:-1] - self.starts[:-2]
        if not len(durations):
            return None
        longest = int(durations.argmax())
        return int(durations[longest]), int(self.starts[longest + 1]), int(durations[-1])

    @cached_property
    def end(self) -> int:
        """When the last reply has been received."""
        return int(self.replied[-1, -1])

    def first(self, number: int) -> OrdinaryScans:
        """The first ones of them."""
        parts = (times[:, :number] for times in (self.polled, self.replies, self.replied))
        return OrdinaryScans(
            self.counter, self.slaves, self.poll, self.data, self.starts[: number + 1], *parts
        )


def ordinary_scans(
    config: MasterConfig, counter: int, start: int, turnarounds: np.ndarray, poll: int, data: int
) -> OrdinaryScans:
    """When a master's ordinary scans happen, the first from ``start`` on; frames last ``poll`` and ``data``.

    ``turnarounds`` has the slaves' in rows, each scan in a column.
    """
    import numpy as np

    rows, number = turnarounds.shape
    replied = np.cumsum(turnarounds + (config.gap + poll + data), axis=0) + data
    starts = np.empty(number + 1, np.int64)
    starts[0] = start
    np.cumsum(replied[-1] + (config.overhead + config.gap), out=starts[1:])
    starts[1:] += start
    replied += starts[:-1]
    replies = replied - data
    return OrdinaryScans(counter, rows, poll, data, starts, replies - turnarounds, replies, replied)
