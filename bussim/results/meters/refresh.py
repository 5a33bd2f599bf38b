"""Refresh gaps: the times between two arrivals of a source's block at a receiver; and stale data."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from itertools import chain, pairwise
from typing import TYPE_CHECKING

from bussim.results.meters.histogram import Histogram
from bussim.results.meters.plain_data import FLAT, LATER
from bussim.results.meters.timeline import Span

if TYPE_CHECKING:
    import numpy as np

#: Receptions that are counted at once: many are cheaper than one by one.
_COUNTED_AT_ONCE = 512


@dataclass(slots=True)
class Refresh:
    """Refreshes of one (source, receiver) pair.

    ``gaps`` has the closed gaps from reception to reception (its minimum is None: it is not
    counted). ``last`` is the tick of the last reception, None if there was none. ``stale`` is when the
    receiver worked on what it had received before one of the two was in STOP or without supply.
    """

    last: int | None = None
    gaps: Histogram = field(default_factory=Histogram, metadata=FLAT)
    stale: list[Span] = field(default_factory=list, metadata=LATER)

    def take(self, ticks: Iterable[int]) -> None:
        """Count receptions in order; a second one at the same tick does not count."""
        ticks = [*ticks] if self.last is None else [self.last, *ticks]
        self.gaps.add_all([tick - before for before, tick in pairwise(ticks) if tick != before])
        self.gaps.minimum = None
        self.last = ticks[-1] if ticks else None

    def take_array(self, ticks: np.ndarray) -> None:
        """Count receptions as :meth:`take` does."""
        import numpy as np

        before = ticks[0] if self.last is None else self.last
        gaps = ticks - np.concatenate(([before], ticks[:-1]))
        self.gaps.add_array(gaps[gaps > 0])
        self.gaps.minimum = None
        self.last = int(ticks[-1])


class _Source:
    """The refreshes by one source.

    A receiver that no sequence of receivers has named yet took the blocks that all took and no other:
    ``others`` stands for every one of these, so that the number of positions need not be known.
    """

    def __init__(self) -> None:
        self.others = Refresh()
        self.named: dict[int, Refresh] = {}
        # Receptions that are not counted yet: the tick of one, or those of many; and by which receivers.
        self._pending: list[tuple[int | np.ndarray, Sequence[int] | None]] = []
        self._waiting = 0  # how many these are
        self._listed = False  # whether some have receivers listed
        # Receivers whose data are from before they or this source were away: since when, and until now.
        self._old: dict[int, int] = {}
        self._spans: defaultdict[int, list[Span]] = defaultdict(list)
        #: Blocks that arrive earlier are from before this source's latest RUN.
        self.fresh = 0

    def heard(self, ticks: int | np.ndarray, number: int, receivers: Sequence[int] | None) -> None:
        self._pending.append((ticks, receivers if receivers is None else tuple(receivers)))
        self._waiting += number
        self._listed |= receivers is not None
        if len(self._pending) >= _COUNTED_AT_ONCE or self._waiting >= 8 * _COUNTED_AT_ONCE:
            self._count()

    def received(self, receiver: int) -> tuple[int, int | None]:
        """How many blocks a receiver received, and when the latest (None: none)."""
        if self._listed:
            self._count()
        pair = self.named.get(receiver, self.others)
        last = pair.last
        if self._pending:
            ticks = self._pending[-1][0]
            last = ticks if isinstance(ticks, int) else int(ticks[-1])
        return pair.gaps.count + (pair.last is not None) + self._waiting, last

    def switched(self, receivers: Iterable[int], tick: int, *, working: bool) -> None:
        """What receivers have is old from now on, if they have any; or they work no longer."""
        self._count()
        for receiver in receivers:
            if not working:
                self._renewed(receiver, tick)
            elif self.named.get(receiver, self.others).last is not None:
                self._old.setdefault(receiver, tick)

    def _renewed(self, receiver: int, tick: int) -> None:
        if receiver in self._old:
            self._spans[receiver].append(Span(self._old.pop(receiver), tick))

    def _count(self) -> None:
        """Count what waits; nearly always all others have received it."""
        import numpy as np

        if self._pending and not (self._listed or self._old):
            together = np.hstack([ticks for ticks, _ in self._pending])
            for pair in (*self.named.values(), self.others):
                pair.take_array(together)
        else:
            self._count_listed(
                [
                    (tick, heard)
                    for ticks, heard in self._pending
                    for tick in ((ticks,) if isinstance(ticks, int) else ticks.tolist())
                ]
            )
        self._pending.clear()
        self._waiting, self._listed = 0, False

    def _count_listed(self, receptions: Sequence[tuple[int, Sequence[int] | None]]) -> None:
        for receiver in list(self._old):
            new = (at for at, by in receptions if at >= self.fresh and (by is None or receiver in by))
            for tick in new:
                self._renewed(receiver, tick)
        for position in set(chain.from_iterable(heard for _, heard in receptions if heard is not None)):
            if position not in self.named:
                self.named[position] = deepcopy(self.others)
        for position, pair in self.named.items():
            pair.take(tick for tick, heard in receptions if heard is None or position in heard)
        self.others.take(tick for tick, heard in receptions if heard is None)

    def pair(self, receiver: int) -> Refresh:
        """The gaps of one receiver."""
        self._count()
        pair = self.named.get(receiver, self.others)
        still = [Span(self._old[receiver], None)] if receiver in self._old else []
        stale = self._spans.get(receiver, []) + still
        return replace(pair, stale=stale) if stale else pair


class RefreshMeter:
    """Refresh gaps of all pairs of all buses; see :meth:`bussim.trace.sink.Sink.refreshed`."""

    def __init__(self) -> None:
        self._sources: defaultdict[tuple[str, int], _Source] = defaultdict(_Source)
        self._running: defaultdict[str, set[int]] = defaultdict(set)

    def refreshed(self, bus: str, source: int, tick: int, heard: Sequence[int] | None) -> None:
        """Count a reception of a source's block at ``tick``; None: by all other stations.

        Ticks of one source never decrease. A receiver counts once at one tick, however often it
        is named.
        """
        self._sources[bus, source].heard(tick, 1, heard)

    def refreshed_often(self, bus: str, source: int, ticks: np.ndarray, heard: Sequence[int] | None) -> None:
        """Count receptions at some ticks, as of :meth:`refreshed`."""
        self._sources[bus, source].heard(ticks, len(ticks), heard)

    def received(self, bus: str, source: int, receiver: int) -> tuple[int, int | None]:
        """How many blocks of one position another received, and when the latest (None: none)."""
        return self._sources[bus, source].received(receiver)

    def switched(self, bus: str, position: int, tick: int, fresh: int | None) -> None:
        """A position goes to RUN, or leaves it; see :meth:`bussim.trace.sink.Sink.switched`."""
        running = self._running[bus]
        (running.discard if fresh is None else running.add)(position)
        for source, refreshes in [(at, each) for (name, at), each in self._sources.items() if name == bus]:
            if source != position:
                refreshes.switched([position], tick, working=fresh is not None)
            elif fresh is None:
                refreshes.switched(running, tick, working=True)
            else:
                refreshes.fresh = fresh

    def pair(self, bus: str, source: int, receiver: int) -> Refresh:
        """The refreshes of one position of a bus by another so far."""
        return self._sources[bus, source].pair(receiver)
