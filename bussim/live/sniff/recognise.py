"""Finds out the protocol of a line by decoding with all of them."""

from __future__ import annotations

from collections.abc import Callable

from bussim.line.characters import LineTiming
from bussim.live.arrival import Timed
from bussim.live.sniff.heard import Heard, LineProtocol
from bussim.live.sniff.splitters import Splitter, splitter

#: Sound frames that settle it.
ENOUGH = 3
#: Frames and pieces of damage that are kept of each protocol until it is settled.
_KEPT = 2000


class Recogniser:
    """Takes characters and gives the frames of the line's protocol.

    ``protocol`` settles it beforehand; else it is the one of which three sound frames are heard first.
    Until then nothing is given; what was heard meanwhile comes then, if it is not too much.
    """

    def __init__(self, timing: LineTiming, tolerance: int, protocol: LineProtocol | None = None) -> None:
        self._tried: dict[LineProtocol, Splitter] = {
            one: splitter(one, timing, tolerance) for one in ([protocol] if protocol else LineProtocol)
        }
        self._found: dict[LineProtocol, list[Heard]] = {one: [] for one in self._tried}
        self._sound = dict.fromkeys(self._tried, 0)
        #: The protocol of the line, None while that is open.
        self.protocol = protocol

    def chars(self, chars: list[Timed]) -> list[Heard]:
        """Take characters; returns the frames that are known now, in order."""
        return self._of_each(lambda cutter: [heard for char in chars for heard in cutter.character(char)])

    def idle(self, now: int) -> list[Heard]:
        """Nothing was heard up to ``now``."""
        return self._of_each(lambda cutter: cutter.idle(now))

    def _of_each(self, take: Callable[[Splitter], list[Heard]]) -> list[Heard]:
        if self.protocol is not None:
            return take(self._tried[self.protocol])
        for one, cutter in self._tried.items():
            self._keep(one, take(cutter))
        return self._settled(ENOUGH)

    def close(self) -> list[Heard]:
        """Nothing will be heard any more: a single sound frame settles it now."""
        rest = self.idle(1 << 62)
        return rest or self._settled(1)

    def _keep(self, protocol: LineProtocol, heard: list[Heard]) -> None:
        kept = self._found[protocol]
        for one in heard:
            self._sound[protocol] += one.frame is not None
            if len(kept) < _KEPT:
                kept.append(one)

    def _settled(self, enough: int) -> list[Heard]:
        if self.protocol is not None:
            return []
        best = max(self._sound, key=lambda one: self._sound[one])
        if self._sound[best] < enough:
            return []
        self.protocol = best
        return self._found[best]
