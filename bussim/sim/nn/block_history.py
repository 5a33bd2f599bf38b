"""Which blocks each station of a link has received, without a list for each of them.

A PLC takes over, at its END, the newest block of each station that it has received by then; the simulation
works that out when some END asks, which is long after. Nearly always all stations receive a block alike,
so one common history for each station number serves all of them; a receiver that missed a block, or
received one that others did not, has a history of its own until it receives one with the others again. A
history reaches back as far as some PLC's latest END can lie behind.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator
from itertools import chain

#: Histories are pruned only when they have grown past this.
_SLACK = 16

Entry = tuple[int, bytes]  # when it was received, the image


class _Histories:
    """The blocks of one station number: the common history and those of single receivers."""

    __slots__ = ("before", "common", "own")

    def __init__(self) -> None:
        self.common: deque[Entry] = deque()
        self.own: dict[int, deque[Entry]] = {}
        # By receiver that has joined the common history late: since when it applies, and what was before.
        self.before: dict[int, tuple[int, tuple[Entry, ...]]] = {}

    def split(self, position: int) -> deque[Entry]:
        """The receiver's own history from now on, begun with what it has received so far."""
        own = self.own.get(position)
        if own is None:
            since, earlier = self.before.pop(position, (0, ()))
            own = self.own[position] = deque(earlier)
            own.extend(entry for entry in self.common if entry[0] >= since)
        return own

    def entries(self, position: int) -> Iterable[Entry]:
        """The blocks that a receiver has received, the newest first."""
        own = self.own.get(position)
        if own is not None:
            return reversed(own)
        if position not in self.before:
            return reversed(self.common)
        since, earlier = self.before[position]
        return chain((entry for entry in reversed(self.common) if entry[0] >= since), reversed(earlier))


class BlockHistory:
    """Histories of a link's blocks. ``horizon`` is the longest PLC scan on the link in ticks."""

    def __init__(self, horizon: int = 0) -> None:
        self.horizon = horizon
        self._stations: dict[int, _Histories] = {}
        #: When some station received a block last.
        self.latest = -1
        #: Called with a station, its block and the tick where another one came than the one before.
        self.on_news: list[Callable[[int, bytes, int], None]] = []

    def is_news(self, station: int, image: bytes) -> bool:
        """Whether some receiver may have got another block of a station last than this one."""
        histories = self._stations.get(station)
        return (
            histories is None
            or bool(histories.own)
            or not histories.common
            or histories.common[-1][1] != image
        )

    def received(self, station: int, tick: int, image: bytes, missed: Collection[int] = ()) -> None:
        """Every position but ``missed`` (and the sender, which ignores it) received a station's block."""
        if self.on_news and self.is_news(station, image):
            for news in self.on_news:
                news(station, image, tick)
        self.latest = tick
        histories = self._stations.get(station)
        if histories is None:
            histories = self._stations[station] = _Histories()
        for position in missed:
            histories.split(position)
        common = histories.common
        common.append((tick, image))
        if len(common) > _SLACK:
            self._prune(common, tick)
        if histories.own and len(histories.own) > len(missed):
            for position in [position for position in histories.own if position not in missed]:
                own = histories.own.pop(position)
                self._prune(own, tick)
                histories.before[position] = (tick, tuple(own))

    def received_by(self, position: int, station: int, tick: int, image: bytes) -> None:
        """One position received a block that the others did not (or not as a whole frame)."""
        for news in self.on_news:
            news(station, image, tick)
        self.latest = tick
        own = self._stations.setdefault(station, _Histories()).split(position)
        own.append((tick, image))
        if len(own) > _SLACK:
            self._prune(own, tick)

    def _prune(self, history: deque[Entry], tick: int) -> None:
        while len(history) > 1 and history[1][0] <= tick - self.horizon:
            history.popleft()

    def forget(self, position: int) -> None:
        """A PLC has stopped: nothing received so far reaches it any more."""
        for histories in self._stations.values():
            histories.before.pop(position, None)
            histories.own[position] = deque()

    def visible(self, position: int, end: int, since: int = -1) -> Iterator[tuple[int, bytes]]:
        """Each station's newest block that a position received after ``since`` and by its END at ``end``."""
        for station, histories in self._stations.items():
            if not histories.own and histories.common[-1][0] <= since:
                continue  # no receiver has got one since
            for tick, image in histories.entries(position):
                if tick <= end:
                    if tick > since:
                        yield station, image
                    break
