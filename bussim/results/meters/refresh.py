"""Time between refreshes of every receiver's copy of every source's block.

In the ordinary case everybody takes a block, and then all receivers of a source have the same
gaps. So each source has one common histogram, and a receiver that took something else is held
apart with its own last reception and a private histogram of corrections (counts may be negative)
until it has caught up with the others: a pair's histogram is the common one plus its private one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bussim.results.meters.histogram import Histogram

#: Stands for every receiver that no sequence of listeners has named yet: it took all that
#: everybody took and nothing else. So the number of seats need not be known.
_OTHERS = -1

#: No sequence of listeners equals it.
_NEVER = (_OTHERS,)

_BOOKED_AT_ONCE = 512


class _Receiver:
    """What one receiver has apart from the common record of a source."""

    __slots__ = ("joined", "last", "peak", "private")

    def __init__(self) -> None:
        self.private = Histogram()
        self.last: int | None = None  # its own last reception; only meaningful while it is apart
        self.joined = 0  # first stretch of the common record that counts for it
        self.peak: int | None = None  # its longest gap, the stretch that it is in left out

    def copy(self) -> _Receiver:
        twin = _Receiver()
        twin.private = self.private.copy()
        twin.last, twin.joined, twin.peak = self.last, self.joined, self.peak
        return twin

    def raise_peak(self, gap: int | None) -> None:
        if gap is not None and (self.peak is None or gap > self.peak):
            self.peak = gap

    def hear(self, tick: int) -> None:
        """Count a reception of its own; the second one of the same instant is none."""
        if self.last is not None and self.last != tick:
            gap = tick - self.last
            self.private.add(gap)
            self.raise_peak(gap)
        self.last = tick


@dataclass(frozen=True, slots=True)
class Refresh:
    """Refreshes of one (source, receiver) pair.

    ``gaps`` has the closed gaps from reception to reception (its minimum is None: nobody asks for
    it). ``last`` is the tick of the last reception, None if there was none.
    """

    gaps: Histogram
    last: int | None


class _Source:
    """One source's common record and the receivers that differ from it.

    Those that are not apart are together: the same receptions since each of them joined.
    """

    __slots__ = ("apart", "common", "gaps", "last", "peak", "peaks", "receivers", "steady")

    def __init__(self) -> None:
        self.common = Histogram()
        self.last: int | None = None
        self.receivers: dict[int, _Receiver] = {_OTHERS: _Receiver()}
        self.apart: dict[int, _Receiver] = {}
        # The common record is cut into stretches where a receiver joins, each with its longest
        # gap, so that a pair's maximum is exact although it shares only some of the stretches.
        self.peaks: list[int] = []
        self.peak = 0
        # Common gaps not yet booked: many at once are cheaper. Whoever is apart now
        # was so during all of them.
        self.gaps: list[int] = []
        # The listeners that changed nothing about who is together when they were last named.
        self.steady: tuple[int, ...] | None = None

    def heard(self, tick: int, listeners: Sequence[int] | None) -> None:
        if self.steady == (listeners if listeners is None else tuple(listeners)):
            # The hot path: exactly those that are together took it.
            last = self.last
            if last is not None and tick != last:
                gaps = self.gaps
                gaps.append(tick - last)
                if len(gaps) >= _BOOKED_AT_ONCE:
                    self.book()
            self.last = tick
            return
        self.book()
        if listeners is not None:
            for position in listeners:
                if position not in self.receivers:
                    self.receivers[position] = self.receivers[_OTHERS].copy()
                    if _OTHERS in self.apart:
                        self.apart[position] = self.receivers[position]
        together = [position for position in self.receivers if position not in self.apart]
        took = together if listeners is None else [position for position in together if position in listeners]
        if took and tick != self.last:
            for position in together:
                if position not in took:
                    self._leave(position)
            if self.last is not None:
                self.gaps.append(tick - self.last)
            self.last = tick
            self.book()
        for position, receiver in self.apart.items():
            if listeners is None or position in listeners:
                receiver.hear(tick)
        self._join_level()
        if listeners is None:
            self.steady = None if not self.apart else _NEVER
        else:
            named = set(listeners)
            self.steady = tuple(listeners) if named == self.receivers.keys() - self.apart.keys() else _NEVER

    def book(self) -> None:
        """Enter the pending common gaps, and their correction for those that had none of them."""
        gaps = self.gaps
        if not gaps:
            return
        self.common.add_all(gaps)
        self.peak = max(self.peak, *gaps)
        if self.apart:
            news = Histogram()
            news.add_all(gaps)
            for receiver in self.apart.values():
                receiver.private.take_back(news)
        gaps.clear()

    def pair(self, receiver: int) -> Refresh:
        """The gaps of one receiver."""
        self.book()
        own = self.receivers.get(receiver, self.receivers[_OTHERS])
        gaps = self.common.copy()
        gaps.merge(own.private)
        is_apart = self.apart.get(receiver if receiver in self.receivers else _OTHERS) is own
        peaks = [own.peak or 0] if is_apart else [own.peak or 0, self.peak, *self.peaks[own.joined :]]
        gaps.minimum, gaps.maximum = None, max(peaks) or None
        return Refresh(gaps, own.last if is_apart else self.last)

    def _leave(self, position: int) -> None:
        receiver = self.receivers[position]
        receiver.last = self.last
        receiver.raise_peak(max((self.peak, *self.peaks[receiver.joined :])) or None)
        self.apart[position] = receiver

    def _join_level(self) -> None:
        """Take back those that are level with the common record."""
        level = [position for position, receiver in self.apart.items() if receiver.last == self.last]
        if not level:
            return
        if self.peak:
            self.peaks.append(self.peak)
            self.peak = 0
        for position in level:
            self.apart.pop(position).joined = len(self.peaks)
        if len(self.peaks) > 4 * len(self.receivers):
            self._merge_stretches()

    def _merge_stretches(self) -> None:
        """Keep only the cuts at which somebody joined."""
        together = [r for position, r in self.receivers.items() if position not in self.apart]
        cuts = sorted({receiver.joined for receiver in together})
        ends = [*cuts[1:], len(self.peaks)]
        place = {cut: number for number, cut in enumerate(cuts)}
        self.peaks = [
            max(self.peaks[cut:end], default=0) for cut, end in zip(cuts, ends, strict=True) if cut < end
        ]
        for receiver in together:
            receiver.joined = place[receiver.joined]


class RefreshMeter:
    """Gaps between refreshes for all pairs of all buses; see :meth:`bussim.trace.records.Sink.refreshed`."""

    def __init__(self) -> None:
        self._buses: dict[str, dict[int, _Source]] = {}

    def refreshed(self, bus: str, source: int, tick: int, heard: Sequence[int] | None) -> None:
        """Count a reception of a source's block at ``tick``; None: by everybody else.

        Ticks of one source never decrease. A receiver counts once at one tick, however often it
        is named.
        """
        try:
            record = self._buses[bus][source]
        except KeyError:
            record = self._buses.setdefault(bus, {}).setdefault(source, _Source())
        record.heard(tick, heard)

    def pair(self, bus: str, source: int, receiver: int) -> Refresh:
        """What happened between two seats of a bus so far."""
        record = self._buses.get(bus, {}).get(source)
        return Refresh(Histogram(), None) if record is None else record.pair(receiver)
