"""Which blocks each station of a link has received, without writing them down for each of them.

Nearly always everybody hears a block, so one common history per station number serves all; a
receiver that missed one, or heard one alone, has a history of its own until it hears with the others
again. A history reaches back as far as some PLC's latest END can lie behind.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator

#: Histories are cut back only when they have grown past this.
_SLACK = 16

Entry = tuple[int, bytes]  # when it was received, the image


class _Histories:
    """Of one station number: the common history and those of the receivers apart from it."""

    __slots__ = ("apart", "before", "common")

    def __init__(self) -> None:
        self.common: deque[Entry] = deque()
        self.apart: dict[int, deque[Entry]] = {}
        # Of receivers that joined late: since when the common history is theirs, and what was before.
        self.before: dict[int, tuple[int, tuple[Entry, ...]]] = {}

    def split(self, position: int) -> deque[Entry]:
        """The history of a receiver that is apart from now on."""
        own = self.apart.get(position)
        if own is None:
            since, earlier = self.before.pop(position, (0, ()))
            own = self.apart[position] = deque(earlier)
            own.extend(entry for entry in self.common if entry[0] >= since)
        return own

    def entries(self, position: int) -> Iterator[Entry]:
        """What a receiver had, the newest first."""
        own = self.apart.get(position)
        if own is not None:
            yield from reversed(own)
            return
        since, earlier = self.before.get(position, (0, ()))
        for entry in reversed(self.common):
            if entry[0] >= since:
                yield entry
        yield from reversed(earlier)


class BlockHistory:
    """Histories of a link's blocks; ``horizon`` is the longest PLC scan on it in ticks."""

    def __init__(self, horizon: int) -> None:
        self._horizon = horizon
        self._stations: dict[int, _Histories] = {}
        #: When anybody received a block last.
        self.latest = -1

    def heard(self, station: int, tick: int, image: bytes, missed: Collection[int] = ()) -> None:
        """Every position but ``missed`` (and the sender, which ignores it) received a station's block."""
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
        if histories.apart and len(histories.apart) > len(missed):
            for position in [position for position in histories.apart if position not in missed]:
                own = histories.apart.pop(position)
                self._prune(own, tick)
                histories.before[position] = (tick, tuple(own))

    def heard_alone(self, station: int, tick: int, image: bytes, position: int) -> None:
        """One position received a block that the others did not (or not as a whole frame)."""
        self.latest = tick
        own = self._stations.setdefault(station, _Histories()).split(position)
        own.append((tick, image))
        if len(own) > _SLACK:
            self._prune(own, tick)

    def _prune(self, history: deque[Entry], tick: int) -> None:
        while len(history) > 1 and history[1][0] <= tick - self._horizon:
            history.popleft()

    def forget(self, position: int) -> None:
        """A PLC lost its memory: nothing received so far reaches it any more."""
        for histories in self._stations.values():
            histories.before.pop(position, None)
            histories.apart[position] = deque()

    def visible(self, position: int, end: int, since: int = -1) -> Iterator[tuple[int, bytes]]:
        """The newest block of each station that a position received after ``since``, by its END at ``end``."""
        for station, histories in self._stations.items():
            if not histories.apart and histories.common[-1][0] <= since:
                continue  # nothing since, whoever it is
            for tick, image in histories.entries(position):
                if tick <= end:
                    if tick > since:
                        yield station, image
                    break
