"""Estimates from a recording of an N:N link: times of the master and of each station, loss and bit errors."""

from __future__ import annotations

from array import array
from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import median_low

from bussim.engines.nn.codes import NO_REPLY
from bussim.engines.nn.frames import DATA, MODES, POLL, Frame, LinkSettings
from bussim.line.characters import NN_LINE
from bussim.live.fit.clusters import Attempt
from bussim.live.fit.comparison import Behaviour
from bussim.live.fit.noise import MASTER, FrameLog, MasterReceiver, NoiseEstimate, received
from bussim.live.fit.outages import DAMAGED, REPLIED, SILENT, Losses, Outcomes, losses
from bussim.live.fit.statistics import Estimate, mean, median, proportion
from bussim.live.fit.turnaround import TurnaroundDistribution, distribution_of
from bussim.live.sniff.decoder import Line
from bussim.live.sniff.heard import Heard, Verdict
from bussim.live.sniff.link import TIMEOUT_UNIT, LinkDecoder, OpenPoll
from bussim.trace.sink import Sink

#: The kind of a slave's frame, beside those of the master's.
_REPLY = "reply"
#: The timeout where none is known, in its units.
_TIMEOUT = 5
#: A master that takes no reply repeats at once if it does within so many characters more than its gap: the
#: two that end a frame, and one by which a receiver ends later that took another bit for a start bit.
_AT_ONCE = NN_LINE.characters(3)


@dataclass(frozen=True, slots=True)
class StationEstimate:
    """One slave. ``distribution`` and ``turnaround`` are None where it never replied."""

    station: int
    polls: int
    turnaround: Estimate | None  # ticks
    distribution: TurnaroundDistribution | None
    losses: Losses


@dataclass(frozen=True, slots=True)
class LinkEstimate:
    """One link. Times in ticks; ``settings`` are those of a parameter frame, or what was seen instead."""

    settings: LinkSettings
    settings_received: bool  # in a parameter frame
    master_gap: Estimate | None
    scan_overhead: Estimate | None
    loss: Estimate | None
    noise: NoiseEstimate
    stations: tuple[StationEstimate, ...]
    behaviour: Behaviour  # its times are those of link scans
    damaged: int
    frames: int
    recording: str = ""  # where it was measured


@dataclass(slots=True)
class _Station:
    turnarounds: array[int] = field(default_factory=lambda: array("q"))
    attempts: Outcomes = field(default_factory=Outcomes)


class LinkObserver(LinkDecoder):
    """Decodes a link, and keeps what the estimates need."""

    def __init__(self, line: Line, sink: Sink, names: Mapping[int, str] | None = None) -> None:
        super().__init__(line, sink, names)
        self._seen: defaultdict[int, _Station] = defaultdict(_Station)
        self._gaps = array("q")  # behind frames of the master or good replies
        self._waits = array("q")  # from the end of a poll without a reply to the repeat
        self._turns = array("q")  # from the last good reply of a scan to the next scan
        self._last_waits = array("q")  # from the last poll of a scan, without a reply, to the next scan
        self._log = FrameLog(NN_LINE.format.bits)
        self._scans = array("q")
        self._blocks: Counter[int] = Counter()
        self._waited: int | None = None  # since the latest poll, which failed without a reply
        self._latest_damage = -1  # number of the latest damaged frame
        self._in_reply = False  # whether it stood for a reply
        self._last_station: int | None = None  # of the latest attempt
        #: A damaged frame of the master whose kind what follows will show: its number, start and end.
        self._unknown: tuple[int, int, int] | None = None
        self._damaged_polls: list[Attempt] = []
        self._reply_bits = 0  # of the latest reply
        self._again: list[
            tuple[int, int]
        ] = []  # pauses between good replies and repeats; bits of the replies

    def heard(self, heard: Heard) -> None:
        """See the base class."""
        frame = heard.frame if isinstance(heard.frame, Frame) else None
        if frame is None:
            if heard.verdict is Verdict.DAMAGED:
                self._hear_damage(heard)
            super().heard(heard)
            return
        before, replies, recorder = self._before, _replies(frame), self.recorder_damage
        if before is not None and self._poll is None and not replies:
            # Behind the last slave's reply comes the overhead, else the master's gap alone.
            turn = _replies(before[1]) and frame.kind != POLL
            if frame.kind == POLL and (frame.station, frame.counter) == self._taken:
                self._again.append((heard.start - before[0], self._reply_bits))
            else:
                (self._turns if turn else self._gaps).append(heard.start - before[0])
        self._resolve(heard.start, frame)
        sender, kind = (frame.station, _REPLY) if replies else (MASTER, frame.kind)
        size = len(heard.chars)
        if replies:
            self._reply_bits = size * NN_LINE.format.bits
        self._log.add(heard.start, heard.end, size, sender, kind, damaged=False)
        self._waited = None
        super().heard(heard)
        if self._waited is not None:
            (self._waits if frame.kind == POLL else self._last_waits).append(self._waited)
        if self.recorder_damage > recorder:
            self._withdraw()

    def _hear_damage(self, heard: Heard) -> None:
        """A damaged frame is the reply to the open poll, or else the master's."""
        self._resolve(heard.start, None)
        poll = self._poll
        replies = poll is not None and not self._pieces and heard.start - poll.end < self._wait()
        sender = poll.station if replies and poll is not None else MASTER
        number = self._log.add(
            heard.start, heard.end, len(heard.chars), sender, _REPLY if replies else DATA, damaged=True
        )
        self._latest_damage, self._in_reply = number, replies
        self._unknown = None if replies else (number, heard.start, heard.end)

    def _resolve(self, now: int, frame: Frame | None) -> None:
        """What follows a damaged frame of the master tells which it was: only a poll is waited for."""
        if self._unknown is None:
            return
        (number, start, end), self._unknown = self._unknown, None
        if now - end >= self._wait():
            self._log.is_of(number, POLL)
            station = frame.station if frame is not None and frame.kind == POLL else None
            self._damaged_polls.append(Attempt(start, station, failed=True))

    def _wait(self) -> int:
        """Surely less than the timeout, and more than any pause but it."""
        timeout = (self.settings.timeout if self.settings else _TIMEOUT) * TIMEOUT_UNIT
        return (self.shortest_wait or timeout) * 9 // 10

    def _withdraw(self) -> None:
        """The latest damaged frame was so at the recorder only."""
        self._log.withdraw(self._latest_damage)
        if self._in_reply and self._last_station is not None:
            self._seen[self._last_station].attempts.outcomes[-1] = REPLIED

    def _attempted(self, poll: OpenPoll, code: int, now: int, turnaround: int | None) -> None:
        super()._attempted(poll, code, now, turnaround)
        station, outcome = self._seen[poll.station], DAMAGED
        self._last_station = poll.station
        if turnaround is not None:
            outcome = REPLIED
            station.turnarounds.append(turnaround)
        elif code == NO_REPLY:
            outcome = SILENT
            self._waited = now - poll.end
        station.attempts.add(outcome, poll.start, poll.end)

    def _scan_begins(self, start: int, counter: int, *, started: bool) -> None:
        scans, begun = self.scans, self._scan
        super()._scan_begins(start, counter, started=started)
        if self.scans > scans and begun is not None:
            self._scans.append(start - begun[0])

    def _refreshed(self, heard: Heard, frame: Frame) -> None:
        super()._refreshed(heard, frame)
        self._blocks[len(frame.data)] += 1

    # -- estimating ----------------------------------------------------------------------------

    def estimate(self, resolution: int = 0) -> LinkEstimate | None:
        """The estimates from times that are exact to ``resolution`` ticks; None where there was no poll."""
        if not self._stations:
            return None
        # A station whose only poll is the last frame has no outcome yet.
        found = losses({number: self._seen[number].attempts for number in sorted(self._stations)})
        gap = median_low(self._gaps) if self._gaps else 0
        overhead = self._overhead(gap)
        stations = []
        for number, lost in found.items():
            turnarounds = self._seen[number].turnarounds
            stations.append(
                StationEstimate(
                    number,
                    len(self._seen[number].attempts.outcomes),
                    mean(turnarounds).widened(resolution) if turnarounds else None,
                    distribution_of(turnarounds) if turnarounds else None,
                    lost,
                )
            )
        trials = sum(lost.trials for lost in found.values())
        attempts = [
            Attempt(start, number, outcome != REPLIED)
            for number, lost in found.items()
            for start, outcome in self._seen[number].attempts.apart_from(lost)
        ]
        noise = self._log.estimate([*attempts, *self._damaged_polls], self._master_receiver(gap + resolution))
        return LinkEstimate(
            settings=self.settings or self._seen_settings(gap),
            settings_received=self.settings is not None,
            master_gap=median(self._gaps).widened(resolution) if self._gaps else None,
            scan_overhead=overhead and overhead.widened(resolution),
            loss=proportion(sum(lost.lost for lost in found.values()), trials) if trials else None,
            noise=noise,
            stations=tuple(stations),
            behaviour=Behaviour(
                times=self._scans,
                distances=self._scans,
                failed=noise.bursts.failures,
                attempts=noise.bursts.attempts,
                again=noise.bursts.p_fail_after_fail,
                station_errors=self.station_errors.total(),
            ),
            damaged=self.damaged,
            frames=self.frames,
        )

    def _seen_settings(self, gap: int) -> LinkSettings:
        """Settings that explain what was seen, where there was no parameter frame."""
        block = self._blocks.most_common(1)[0][0] if self._blocks else 0
        mode = next((number for number, one in enumerate(MODES) if one.size == block), 0)
        timeout = _TIMEOUT
        if self.shortest_wait is not None:
            timeout = min(255, max(_TIMEOUT, round((self.shortest_wait - gap) / TIMEOUT_UNIT)))
        return LinkSettings(max(self._stations), mode, min(10, self.most_attempts - 1), timeout)

    def _overhead(self, gap: int) -> Estimate | None:
        """From the last reply of a scan, or the end of the wait for it, to the next scan, less the gap."""
        if self._turns:
            return median([turn - gap for turn in self._turns])
        if not self._last_waits:
            return None
        wait = median_low(self._waits) if self._waits else None
        if wait is None and self.settings is not None:
            wait = self.settings.timeout * TIMEOUT_UNIT + gap
        return None if wait is None else median([last - wait for last in self._last_waits])

    def _master_receiver(self, gap: int) -> MasterReceiver:
        damaged = Counter(bits for wait, bits in self._again if wait <= gap + _AT_ONCE)
        unheard = Counter(bits for wait, bits in self._again if wait > gap + _AT_ONCE)
        return received(self._log.replies(), damaged, unheard, NN_LINE.format.bits)


def _replies(frame: Frame) -> bool:
    return frame.kind == DATA and frame.station > 0
