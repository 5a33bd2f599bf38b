"""Finds out the protocol of a port while it is listened to."""

from collections import deque
from collections.abc import Callable, Sequence

from bussim.engines.contract import RxChar
from bussim.line.characters import LineTiming
from bussim.live.arrival import Timed
from bussim.live.recordings.source import Chunk, LineSetup
from bussim.live.sniff.heard import LineProtocol
from bussim.live.sniff.listener import Listener
from bussim.live.sniff.reading import read

#: Characters that are kept until the protocol is known.
_KEPT = 20_000
_FIRST = 16


class Recogniser:
    """Keeps what comes until a protocol is recognised, then hands it to a listener of that.

    ``make`` makes the listener of a protocol; ``protocol`` settles it beforehand.
    """

    def __init__(
        self,
        make: Callable[[LineProtocol], Listener],
        timing: LineTiming,
        tolerance: int,
        protocol: LineProtocol | None = None,
    ) -> None:
        self._make, self._timing, self._tolerance = make, timing, tolerance
        #: What listens, None while the protocol is open.
        self.listener = make(protocol) if protocol is not None else None
        #: Characters by byte of a port that is open with 8N for seven data bits, for protocols of seven.
        self.framed: Sequence[RxChar] | None = None
        self._kept: deque[list[Timed]] = deque()
        self._count = 0
        self._next = _FIRST
        #: Characters so far.
        self.characters = 0

    def chars(self, chars: list[Timed]) -> None:
        """Take in characters."""
        self.characters += len(chars)
        if self.listener is not None:
            self.listener.chars(self._as_read(chars, self.listener.protocol))
            return
        self._kept.append(chars)
        self._count += len(chars)
        if self._count >= self._next:
            self._try()
            self._next = self._count + self._count // 4 + _FIRST
        while self._count > _KEPT:
            self._count -= len(self._kept.popleft())
            self._next = min(self._next, _KEPT)

    def idle(self, now: int) -> None:
        """Nothing was heard up to ``now``."""
        if self.listener is not None:
            self.listener.idle(now)

    def close(self, now: int) -> None:
        """Nothing more will be heard."""
        if self.listener is None:
            self._try()
        if self.listener is not None:
            self.listener.close(now)

    def _as_read(self, chars: list[Timed], protocol: LineProtocol) -> list[Timed]:
        framed = self.framed
        if framed is None or protocol is LineProtocol.RTU:
            return chars
        return [(framed[char.value], start, end) for char, start, end in chars]

    def _try(self) -> None:
        readings = [
            read(
                (Chunk(self._as_read(chars, protocol)) for chars in self._kept),
                LineSetup(self._timing),
                protocol,
                _KEPT + 1,
                exact=False,
                tolerance=self._tolerance,
            )[0]
            for protocol in LineProtocol
        ]
        best = max(readings, key=lambda each: each.score.rank)
        if best.score.recognised and best.protocol is not None:
            self.listener = self._make(best.protocol)
            while self._kept:
                self.listener.chars(self._as_read(self._kept.popleft(), best.protocol))
