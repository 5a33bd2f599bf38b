"""Refresh gaps: the times between two arrivals of a source's block at a receiver.

In the ordinary case all receivers take a block, and then they have the same gaps. So each source has one
common histogram, and a receiver that took other blocks is held apart with its own last reception and a
private histogram of corrections (counts may be negative) until it has caught up with the others: a pair's
histogram is the common one plus its private one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bussim.results.meters.histogram import Histogram

#: Stands for every receiver that no sequence of receivers has named yet: it took the blocks that all took
#: and no other. So the number of positions need not be known.
_OTHERS = -1

#: No sequence of receivers equals it.
_NEVER = (_OTHERS,)

_ADDED_AT_ONCE = 512


class _Receiver:
    """What one receiver has apart from the common record of a source."""

    __slots__ = ("joined", "last", "peak", "private")

    def __init__(self) -> None:
        self.private = Histogram()
        self.last: int | None = None  # its own last reception; only meaningful while it is apart
        self.joined = 0  # first section of the common record that counts for it
        self.peak: int | None = None  # its longest gap, without the section that it is in

    def copy(self) -> _Receiver:
        twin = _Receiver()
        twin.private = self.private.copy()
        twin.last, twin.joined, twin.peak = self.last, self.joined, self.peak
        return twin

    def raise_peak(self, gap: int | None) -> None:
        if gap is not None and (self.peak is None or gap > self.peak):
            self.peak = gap

    def take(self, tick: int) -> None:
        """Count a reception of its own; a second one at the same tick does not count."""
        if self.last is not None and self.last != tick:
            gap = tick - self.last
            self.private.add(gap)
            self.raise_peak(gap)
        self.last = tick


@dataclass(frozen=True, slots=True)
class Refresh:
    """Refreshes of one (source, receiver) pair.

    ``gaps`` has the closed gaps from reception to reception (its minimum is None: it is not
    counted). ``last`` is the tick of the last reception, None if there was none.
    """

    gaps: Histogram
    last: int | None


class _Source:
    """One source's common record and the receivers that differ from it.

    Those that are not apart are joined: they had the same receptions since each of them joined.
    """

    __slots__ = ("apart", "common", "gaps", "last", "peak", "peaks", "receivers", "steady")

    def __init__(self) -> None:
        self.common = Histogram()
        self.last: int | None = None
        self.receivers: dict[int, _Receiver] = {_OTHERS: _Receiver()}
        self.apart: dict[int, _Receiver] = {}
        # The common record is cut into sections where a receiver joins, each with its longest gap, so
        # that a pair's maximum is exact although it shares only some of the sections.
        self.peaks: list[int] = []
        self.peak = 0
        # Common gaps not yet in the histogram: many at once are cheaper. A receiver that is apart now
        # was so during all of them.
        self.gaps: list[int] = []
        # The receivers that were named last, if no receiver left or joined with them.
        self.steady: tuple[int, ...] | None = None

    def heard(self, tick: int, listeners: Sequence[int] | None) -> None:
        if self.steady == (listeners if listeners is None else tuple(listeners)):
            # The usual case: exactly those that are joined took it.
            last = self.last
            if last is not None and tick != last:
                gaps = self.gaps
                gaps.append(tick - last)
                if len(gaps) >= _ADDED_AT_ONCE:
                    self.add_gaps()
            self.last = tick
            return
        self.add_gaps()
        if listeners is not None:
            for position in listeners:
                if position not in self.receivers:
                    self.receivers[position] = self.receivers[_OTHERS].copy()
                    if _OTHERS in self.apart:
                        self.apart[position] = self.receivers[position]
        joined = [position for position in self.receivers if position not in self.apart]
        took = joined if listeners is None else [position for position in joined if position in listeners]
        if took and tick != self.last:
            for position in joined:
                if position not in took:
                    self._leave(position)
            if self.last is not None:
                self.gaps.append(tick - self.last)
            self.last = tick
            self.add_gaps()
        for position, receiver in self.apart.items():
            if listeners is None or position in listeners:
                receiver.take(tick)
        self._join_again()
        if listeners is None:
            self.steady = None if not self.apart else _NEVER
        else:
            named = set(listeners)
            self.steady = tuple(listeners) if named == self.receivers.keys() - self.apart.keys() else _NEVER

    def add_gaps(self) -> None:
        """Add the pending common gaps, and correct the histograms of those that had none of them."""
        gaps = self.gaps
        if not gaps:
            return
        self.common.add_all(gaps)
        self.peak = max(self.peak, *gaps)
        if self.apart:
            added = Histogram()
            added.add_all(gaps)
            for receiver in self.apart.values():
                receiver.private.subtract(added)
        gaps.clear()

    def pair(self, receiver: int) -> Refresh:
        """The gaps of one receiver."""
        self.add_gaps()
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

    def _join_again(self) -> None:
        """Join those whose last reception is the common one again."""
        level = [position for position, receiver in self.apart.items() if receiver.last == self.last]
        if not level:
            return
        if self.peak:
            self.peaks.append(self.peak)
            self.peak = 0
        for position in level:
            self.apart.pop(position).joined = len(self.peaks)
        if len(self.peaks) > 4 * len(self.receivers):
            self._merge_sections()

    def _merge_sections(self) -> None:
        """Keep only the cuts at which a receiver joined."""
        joined = [r for position, r in self.receivers.items() if position not in self.apart]
        cuts = sorted({receiver.joined for receiver in joined})
        ends = [*cuts[1:], len(self.peaks)]
        place = {cut: number for number, cut in enumerate(cuts)}
        self.peaks = [
            max(self.peaks[cut:end], default=0) for cut, end in zip(cuts, ends, strict=True) if cut < end
        ]
        for receiver in joined:
            receiver.joined = place[receiver.joined]


class RefreshMeter:
    """Refresh gaps of all pairs of all buses; see :meth:`bussim.trace.records.Sink.refreshed`."""

    def __init__(self) -> None:
        self._buses: dict[str, dict[int, _Source]] = {}

    def refreshed(self, bus: str, source: int, tick: int, heard: Sequence[int] | None) -> None:
        """Count a reception of a source's block at ``tick``; None: by all other stations.

        Ticks of one source never decrease. A receiver counts once at one tick, however often it
        is named.
        """
        try:
            record = self._buses[bus][source]
        except KeyError:
            record = self._buses.setdefault(bus, {}).setdefault(source, _Source())
        record.heard(tick, heard)

    def pair(self, bus: str, source: int, receiver: int) -> Refresh:
        """The refreshes of one position of a bus by another so far."""
        record = self._buses.get(bus, {}).get(source)
        return Refresh(Histogram(), None) if record is None else record.pair(receiver)
