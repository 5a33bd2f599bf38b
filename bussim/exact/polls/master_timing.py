"""How a master spends its time between what happens on the wire: in whole PLC scans, or at once.

All times are ticks. A transaction *needs* the time from the first edge of its request until the master has
decided it. What that costs depends on the master:

* A PLC sends at an END, takes the outcome over at the first END after it was decided, and sends the next
  request at an END after that one, once the interval since the decision is over (PW10 board manual, sections
  5 and 6.2.2). The scans from sending to taking over, the *active* ones, are longer than the *idle* ones by
  the execution time of a transaction.
* An HMI takes over at once, and sends again when the interval is over.
"""

from __future__ import annotations

from dataclasses import dataclass

from bussim.exact.polls.whole_scans import mean_whole_scans


@dataclass(frozen=True, slots=True)
class Span:
    """A time that lies between two bounds, both included."""

    least: int
    most: int

    def __add__(self, other: Span) -> Span:
        return Span(self.least + other.least, self.most + other.most)

    def times(self, count: int) -> Span:
        """So many of them, one after the other."""
        return Span(self.least * count, self.most * count)

    @property
    def fixed(self) -> bool:
        """Whether it is always the same."""
        return self.least == self.most


def exactly(ticks: int) -> Span:
    """A time that is always the same."""
    return Span(ticks, ticks)


class Direct:
    """A master without scans. ``interval`` is the time that it keeps after a decision.

    ``taken`` is from sending to taking over, ``gap`` from there to sending the next request, if there is one
    (without a need: whatever it was), ``turn`` their sum, which may be known better than they are; ``mean``
    are the means of the first two, the need being uniform over its span.
    """

    #: Whether a turn begins after the interval, which is then no part of any turn.
    begins_late = True
    #: From a poll's turn to its request, where nothing holds it up.
    entry = exactly(0)
    #: The longest time that a turn which has come due waits for a master without anything to do.
    idle = 0
    #: The longest time from a decision to its taking over.
    late = 0

    def __init__(self, interval: int) -> None:
        self.interval = interval

    def with_interval(self, interval: int) -> Direct:
        """The same master with another interval."""
        return Direct(interval)

    def taken(self, need: Span) -> Span:
        """At once."""
        return need

    def gap(self, need: Span | None = None) -> Span:
        """The interval."""
        return exactly(self.interval)

    def turn(self, need: Span) -> Span:
        """Both."""
        return need + self.gap()

    def mean(self, need: Span) -> tuple[float, float] | None:
        """The middle, and the interval."""
        return (need.least + need.most) / 2, float(self.interval)

    def mean_entry(self) -> float:
        """None is lost."""
        return 0.0


class Scans:
    """A PLC: a scan is uniform over ``scan``, an active one ``execution`` longer; else as :class:`Direct`.

    ``others`` is by how much other ports' transactions may lengthen any of them; then there is no mean.
    """

    begins_late = False

    def __init__(self, scan: Span, execution: int, others: int, interval: int) -> None:
        self.interval = interval
        self._scan = scan
        self._execution = execution
        self._others = others
        self._idle = Span(scan.least, scan.most + others)
        self._active = self._idle + exactly(execution)
        self.entry = self._idle
        self.idle = self._idle.most
        self.late = self._active.most - 1

    def with_interval(self, interval: int) -> Scans:
        """The same PLC with another interval."""
        return Scans(self._scan, self._execution, self._others, interval)

    def taken(self, need: Span) -> Span:
        """To the first END at or after the decision: at least one scan."""
        shortest, longest = self._active.least, self._active.most
        least = max(-(-need.least // longest) * shortest, need.least)
        # All but the last of the scans are over before the decision.
        before = (need.most - 1) // shortest
        return Span(least, min(before * longest, need.most - 1) + longest)

    def gap(self, need: Span | None = None) -> Span:
        """At least one scan; more where the interval, which began up to a scan earlier, is longer."""
        shortest, longest = self._idle.least, self._idle.most
        least_late, most_late = 0, self.late
        if need is not None:
            taken = self.taken(need)
            least_late = max(least_late, taken.least - need.most)
            most_late = min(most_late, taken.most - need.least)
        left = max(0, self.interval - most_late)
        least = max(shortest * max(1, -(-left // longest)), left)
        room = max(0, self.interval - least_late - 1)
        return Span(least, min(room // shortest * longest, room) + longest)

    def turn(self, need: Span) -> Span:
        """To the first END after taking over that the interval allows."""
        taken, over = self.taken(need), need + exactly(self.interval)
        shortest, longest = self._idle.least, self._idle.most
        left = over.least - taken.most if need.fixed else self.interval - self.late
        scans = max(1, -(-left // longest))
        least = max(taken.least + scans * shortest, over.least)
        most = taken.most + longest
        before = max(0, over.most - 1 - taken.least if need.fixed else self.interval - 1) // shortest
        if before > 0:
            most = max(most, min(taken.most + before * longest, over.most - 1) + longest)
        return Span(least, most)

    def mean(self, need: Span) -> tuple[float, float] | None:
        """Exact up to a millionth or so of a scan."""
        if self._others:
            return None
        width = self._scan.most - self._scan.least
        idle = self._scan.least
        return mean_whole_scans(
            need.least, need.most - need.least, idle + self._execution, idle, width, self.interval
        )

    def mean_entry(self) -> float:
        """A scan."""
        return (self._scan.least + self._scan.most) / 2


#: What a master's own time adds.
MasterTiming = Direct | Scans
