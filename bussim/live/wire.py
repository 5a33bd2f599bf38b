"""Bytes on a port that may be lost and come back."""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

from bussim.errors import UsageError
from bussim.line.characters import LineTiming
from bussim.live.arrival import characters_of
from bussim.live.clock import Clock, as_seconds
from bussim.live.endpoints import LOST_ERRORS, Endpoint, open_endpoint, why_not
from bussim.live.options import DEFAULT_OPTIONS, PortOptions
from bussim.units import seconds


@dataclass(slots=True)
class WireCounts:
    """What happened to a port so far."""

    received: int = 0  # bytes
    sent: int = 0  # bytes that the system took
    dropped: int = 0  # bytes that it did not take, or that were sent while the port was lost
    chunks: int = 0  # reads that gave something
    losses: int = 0  # times that the port was lost
    retries: int = 0  # attempts to open it again
    returns: int = 0  # times that it came back
    away_s: float = 0.0  # seconds for which it was lost

    def to_json(self) -> dict[str, float]:
        """Plain data."""
        return asdict(self)


#: What a port may raise that is not back yet.
_NOT_YET: tuple[type[Exception], ...] = (*LOST_ERRORS, UsageError)


class Wire:
    """The bytes of one port. A lost port is reported and tried again, longer and longer apart.

    ``report`` is called with messages for the user: warnings, losses, returns. After a loss
    :attr:`connected` is False until the port is back.
    """

    def __init__(
        self,
        url: str,
        timing: LineTiming,
        options: PortOptions = DEFAULT_OPTIONS,
        *,
        clock: Clock | None = None,
        report: Callable[[str], None] = lambda _text: None,
    ) -> None:
        self.url = url
        self.timing = timing
        self.options = options
        self.clock = clock or Clock()
        self.counts = WireCounts()
        self.report = report
        self._endpoint: Endpoint | None = None
        #: The URL; of a pseudo-terminal, what the other side opens.
        self.name = url
        #: Characters by received byte.
        self.characters = characters_of(timing.format)
        #: Whether received bytes have the bit behind seven data bits.
        self.framed = False
        #: Whether bytes take no time on this wire.
        self.instant = False
        self._warned: set[str] = set()
        self._retry_at = 0
        self._lost_at: int | None = None
        self._wait = options.retry_first

    def open(self) -> None:
        """Open the port for the first time. Raises UsageError if it cannot be opened."""
        try:
            self._take(open_endpoint(self.url, self.timing, self.options))
        except LOST_ERRORS as error:
            raise why_not(self.url, error) from error

    def _take(self, endpoint: Endpoint) -> None:
        self._endpoint = endpoint
        self.name = endpoint.name
        self.framed = endpoint.framed
        self.characters = characters_of(self.timing.format, framed=endpoint.framed)
        self.instant = endpoint.instant if self.options.instant is None else self.options.instant
        for text in endpoint.warnings:
            if text not in self._warned:
                self._warned.add(text)
                self.report(text)

    @property
    def connected(self) -> bool:
        """Whether the port is open."""
        return self._endpoint is not None

    @property
    def handle(self) -> int | None:
        """The file that may be waited for, None where there is none."""
        return self._endpoint.handle if self._endpoint is not None else None

    def has_no_pace(self) -> None:
        """Bytes came sooner than rate and format let them, so that they take no time: said once."""
        self.instant = True
        self.report(
            f"{self.url} is faster than {self.timing.baud} {self.timing.format} can be: "
            "its bytes take no time, and response times are the other side's alone"
        )

    def read(self, until: int) -> bytes:
        """What has come, as soon as something has; empty at the tick ``until`` or when the port is lost."""
        endpoint = self._endpoint
        if endpoint is None:
            self._try_again(until)
            return b""
        try:
            data = endpoint.read(as_seconds(until - self.clock.now()))
        except LOST_ERRORS as error:
            self._lost(error)
            return b""
        if data:
            self.counts.received += len(data)
            self.counts.chunks += 1
        return data

    def write(self, data: bytes) -> None:
        """Send bytes now. What the system does not take is lost and counted."""
        taken = 0
        if self._endpoint is not None:
            try:
                taken = self._endpoint.write(data)
            except LOST_ERRORS as error:
                self._lost(error)
        self.counts.sent += taken
        self.counts.dropped += len(data) - taken

    def close(self) -> None:
        """Close the port. One that is lost stays so from then on."""
        if self._endpoint is not None:
            self._endpoint.close()
            self._endpoint = None
        self._was_away()

    def _was_away(self) -> None:
        if self._lost_at is not None:
            away = seconds(self.clock.now() - self._lost_at)
            self._lost_at = None
            self.counts.away_s = round(self.counts.away_s + away, 3)

    def _lost(self, error: Exception) -> None:
        self.close()
        self.counts.losses += 1
        self._wait = self.options.retry_first
        self._lost_at = self.clock.now()
        self._retry_at = self.clock.now() + self._wait
        self.report(f"{self.url} is lost ({error}); it will be tried again")

    def _try_again(self, until: int) -> None:
        """Wait until a lost port may be tried again, or ``until``, and try."""
        now = self.clock.now()
        time.sleep(as_seconds(min(until, self._retry_at) - now))
        now = self.clock.now()
        if now < self._retry_at:
            return
        self.counts.retries += 1
        try:
            self._take(open_endpoint(self.url, self.timing, self.options))
        except _NOT_YET:
            self._wait = min(2 * self._wait, self.options.retry_last)
            self._retry_at = self.clock.now() + self._wait
            return
        self.counts.returns += 1
        before = self.counts.away_s
        self._was_away()
        self.report(f"after {self.counts.away_s - before:.1f} s {self.url} is back")
