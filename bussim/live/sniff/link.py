"""An N:N link as a listener sees it: link scans, attempts, stations in error.

What a listener cannot know is when the master decided: a failed attempt is recorded at the master's
next frame, and its code is what the listener heard (01 nothing, 02 and 03 a frame of another station
or counter, 04 damage).
"""

from collections import Counter
from collections.abc import Mapping
from typing import NamedTuple

from bussim.engines.nn import codes
from bussim.engines.nn.frames import DATA, MODES, PARAMETERS, POLL, Frame, LinkSettings
from bussim.engines.nn.status import STATIONS
from bussim.live.sniff.decoder import Decoder, Line
from bussim.live.sniff.heard import Heard, Verdict
from bussim.trace.records import AttemptRecord, LinkTotals, NoteRecord, ScanRecord
from bussim.trace.sink import Sink
from bussim.wording import counted

#: 10 ms, the unit of D8180, in ticks.
TIMEOUT_UNIT = 720_000
#: Frames of the master less far apart than this many of the shortest link scan have no scan in between.
_ONE_SCAN = 1.5
#: Outcomes of an attempt by its code.
OUTCOMES = {
    0: "ok",
    codes.NO_REPLY: "no_answer",
    codes.WRONG_STATION: "wrong_answer",
    codes.WRONG_COUNTER: "wrong_answer",
    codes.DAMAGED: "damaged",
}


def station_name(number: int) -> str:
    """What a listener calls a station whose name it does not know."""
    return f"station {number}"


class OpenPoll(NamedTuple):
    """A poll whose attempt is not decided yet: first edge and end in ticks, and the station that it asks."""

    start: int
    end: int
    station: int
    counter: int


class LinkDecoder(Decoder):
    """Records what happens on one N:N link, from the frames that are received.

    ``names`` are those of stations that are known; the others have their number as name.
    """

    def __init__(self, line: Line, sink: Sink, names: Mapping[int, str] | None = None) -> None:
        super().__init__(line, sink)
        self._bus = line.bus
        self._names = {number: station_name(number) for number in range(STATIONS)} | dict(names or {})
        self.settings: LinkSettings | None = None
        self._block: int | None = None  # bytes of a data frame
        self.scans = 0
        #: Link scans of which one end was not heard: they have no time.
        self.scans_unmeasured = 0
        self.polls = 0
        self.healthy_at: int | None = None
        #: Ticks from a failed poll's end to the master's next frame, the shortest: timeout and gap.
        self.shortest_wait: int | None = None
        self._shortest_gap: int | None = None
        self.most_attempts = 0
        self.failed: dict[int, Counter[int]] = {}
        self.station_errors: Counter[int] = Counter()
        self.station_error_onsets: Counter[int] = Counter()
        self._stations: set[int] = set()
        self._replied: set[int] = set()
        self._flagged: set[int] = set()
        self._scan: tuple[int, int, int] | None = None  # start, counter, attempts so far
        self._scan_failed: list[tuple[int, int]] = []
        self._counters = line.counters  # link scans after which the counter begins again, as far as is known
        self._shortest_scan = 0
        self._poll: OpenPoll | None = None
        self._attempt = 0
        self._code = codes.NO_REPLY
        self._last_failed: int | None = None  # station whose latest attempt failed, until it is decided
        self._taken: tuple[int, int] | None = None  # station and counter of the latest good reply
        self._pieces = 0  # damaged frames since the latest sound frame of the master
        self._pieces_of_failed = 0
        self._before: tuple[int, Frame] | None = None  # end of the sound frame right before
        self._last_end = 0  # of the latest sound frame
        self._latest = 0  # the station polled last in this scan
        self._missed = False  # where frames have no counter: whether a scan's begin was missed

    def heard(self, heard: Heard) -> None:
        """See the base class."""
        frame = heard.frame
        if not isinstance(frame, Frame):
            self._count(heard, heard.verdict.value, "unknown")
            if heard.verdict is Verdict.DAMAGED:
                self._pieces += 1
                self._before = None
                if self._poll is not None:
                    self._code = codes.DAMAGED
            return
        before, self._before = self._before, (heard.end, frame)
        last, self._last_end = self._last_end, heard.end
        of_master = frame.kind != DATA or frame.station == 0
        self._count(heard, frame.kind_name, self._names[0 if of_master else frame.station])
        if not of_master:
            self._reply(heard, frame, before)
            return
        if frame.kind == POLL and before is not None and self._poll is None:
            gap = heard.start - before[0]
            self._shortest_gap = gap if self._shortest_gap is None else min(gap, self._shortest_gap)
        if frame.kind == PARAMETERS:
            self.settings = frame.settings
        self._after_silence(heard.start - last, frame)
        self._decide_failed(heard.start)
        if self._line.counters == 1 and frame.kind == POLL:
            unseen = before is None and self._taken == (frame.station, 0) and self._pieces > 0
            if frame.station < self._latest or (frame.station == self._latest and unseen):
                self._missed, self._taken = True, None
        self._pieces = 0
        if frame.kind == POLL:
            self._latest = frame.station
            self._polled(heard, frame)
            return
        self._given_up(heard.start, None)
        if frame.kind == DATA:
            self._block = len(frame.data)
            started = before is not None and before[1].kind == PARAMETERS  # perhaps after STOP
            self._scan_begins(heard.start, frame.counter, started=started)
            self._refreshed(heard, frame)

    def close(self) -> None:
        """See the base class."""
        self.outcomes["undecided"] += self._poll is not None

    # -- exchanges -----------------------------------------------------------------------------

    def _polled(self, heard: Heard, frame: Frame) -> None:
        station = frame.station
        self._given_up(heard.start, station)
        again = (station, frame.counter) == self._taken
        if self._last_failed == station or again:
            self._attempt += 1
        else:
            self._attempt = 1
            self.polls += 1
        self._last_failed = None
        self._stations.add(station)
        self.most_attempts = max(self.most_attempts, self._attempt)
        self._poll = OpenPoll(heard.start, heard.end, station, frame.counter)
        self._code = codes.NO_REPLY
        if self._scan is not None:
            start, counter, attempts = self._scan
            self._scan = (start, counter, attempts + 1)

    def _reply(self, heard: Heard, frame: Frame, before: tuple[int, Frame] | None) -> None:
        poll = self._poll
        if poll is None:
            self.unasked += 1
            # The poll before it was damaged at the recorder alone: the station has heard it.
            self.recorder_damage += before is None and self._pieces > 0
            return
        station = poll.station
        if frame.station != station:
            self._code = codes.WRONG_STATION
            return
        if frame.counter != poll.counter:
            self._code = codes.WRONG_COUNTER
            return
        self._poll, self._taken = None, (station, frame.counter)
        self._attempted(poll, 0, heard.end, heard.start - poll.end)
        self._refreshed(heard, frame)
        self._replied.add(station)
        if station in self._flagged:
            self._flagged.discard(station)
            self._note(heard.end, "recovered", f"station {station} replies again", station=station)
        if self.healthy_at is None and self._healthy():
            self.healthy_at = heard.end
            self._note(heard.end, "healthy", "every slave replies")

    def _healthy(self) -> bool:
        slaves = self.settings.slaves if self.settings else len(self._stations)
        whole = self.settings is not None or self.scans > 0
        return whole and len(self._replied) == slaves and not self._flagged

    def _decide_failed(self, now: int) -> None:
        """The master goes on: an attempt without a reply has failed."""
        poll, self._poll = self._poll, None
        if poll is None:
            return
        station, code = poll.station, self._code
        self._pieces_of_failed = self._pieces
        self._sink.failed(self._bus, now, station, code)
        self._attempted(poll, code, now, None)
        self.failed.setdefault(station, Counter())[code] += 1
        self._scan_failed.append((station, code))
        self._last_failed = station
        if code == codes.NO_REPLY:
            wait = now - poll.end
            self.shortest_wait = wait if self.shortest_wait is None else min(wait, self.shortest_wait)

    def _attempted(self, poll: OpenPoll, code: int, now: int, turnaround: int | None) -> None:
        """Record an attempt: replied to after a turnaround (code 0), or failed."""
        self.outcomes[OUTCOMES[code]] += 1
        poll_of = self._bus, poll.start, now, poll.station, self._attempt
        self._sink.take(AttemptRecord(*poll_of, codes.MEANINGS[code] if code else "ok", code, turnaround))

    def _given_up(self, now: int, next_station: int | None) -> None:
        """The master turns to another station: the one that failed is in error."""
        station = self._last_failed
        if station is None or station == next_station:
            return
        self._last_failed = None
        attempts = self.settings.retries + 1 if self.settings else 1
        damaged = self._scan_failed and self._scan_failed[-1] == (station, codes.DAMAGED)
        single = self._pieces_of_failed < 2 and station not in self._flagged
        if damaged and self._attempt < attempts and single:
            # A master that does not repeat has taken the reply: it was damaged at the recorder alone.
            self.recorder_damage += 1
            return
        self.station_errors[station] += 1
        if station not in self._flagged:
            self._flagged.add(station)
            self.station_error_onsets[station] += 1
            code = self._scan_failed[-1][1] if self._scan_failed else self._code
            text = f"station {station}: code {code:02X}, {codes.MEANINGS[code]}"
            self._note(now, "station_error", text, station=station, code=code)

    # -- link scans ----------------------------------------------------------------------------

    def _after_silence(self, silence: int, frame: Frame) -> None:
        """Forget the scan that a STOP of the master has cut off, or whose end was not heard for certain.

        After STOP a master begins with its parameters, else it sends them when the last slave is done with.
        Where as many scans fit into a silence as counters count, these do not tell whether it was one scan.
        """
        settings, waits = self.settings, self._poll is not None
        scans = self._line.counters
        if frame.kind == PARAMETERS and settings is not None:
            done = self._latest == settings.slaves and (not waits or self._attempt >= self.most_attempts)
            if not (done or self._pieces):
                self._scan = None
            scans = 1
        if waits:
            silence -= settings.timeout * TIMEOUT_UNIT if settings else silence
        if 0 < self._shortest_scan * scans < silence:
            self._scan = None

    def _scan_begins(self, start: int, counter: int, *, started: bool) -> None:
        """The master's data frame begins a scan; the one before has a time if their counters follow."""
        begun, before, attempts = self._scan or (start, counter, 0)
        if self._line.counters == 1:
            scans = 2 if self._missed else 1
            self._missed, self._taken = False, None
        else:
            if max(counter, before) >= self._counters:
                self._counters = self._line.counters
            if counter == 0 and not started and start - begun < _ONE_SCAN * self._shortest_scan:
                self._counters = before + 1  # no scan fits in between: so far this line counts
            scans = (counter - before - 1) % self._counters + 1
        if self._scan is not None and scans != 1:
            self.scans_unmeasured += scans
        elif self._scan is not None:
            self._shortest_scan = min(start - begun, self._shortest_scan or start - begun)
            counts = attempts, len(self._scan_failed), len(self._flagged)
            self._sink.take(ScanRecord(self._bus, self.scans, begun, start - begun, *counts, self._cause()))
            self.scans += 1
        self._scan, self._latest = (start, counter, 0), 0
        self._scan_failed = []

    def _cause(self) -> str:
        failed: dict[int, list[str]] = {}
        for station, code in self._scan_failed:
            failed.setdefault(station, []).append(f"{code:02X}")
        return "; ".join(
            f"station {station}: {counted(len(found), 'failed attempt')}, {', '.join(found)}"
            for station, found in failed.items()
        )

    def _refreshed(self, heard: Heard, frame: Frame) -> None:
        self._sink.refreshed(self._bus, frame.station, heard.end, None)

    # -- records -------------------------------------------------------------------------------

    def _note(self, tick: int, kind: str, text: str, **detail: int | str) -> None:
        # Flags are the master's, whose view this is; that all is well concerns the bus.
        where = self._bus if kind == "healthy" else self._names[0]
        self._sink.take(NoteRecord(tick, kind, where, text, dict(detail)))

    def totals(self) -> LinkTotals:
        """Counts so far. Attempts and timeout are what was seen where there was no parameter frame."""
        settings = self.settings
        slaves = settings.slaves if settings else max(self._stations, default=0)
        mode = next((n for n, block in enumerate(MODES) if block.size == self._block), None)
        attempts, timeout = self.most_attempts or 1, None
        if settings:
            mode, attempts, timeout = settings.mode, settings.retries + 1, settings.timeout
        elif self.shortest_wait is not None:
            timeout = round((self.shortest_wait - (self._shortest_gap or 0)) / TIMEOUT_UNIT)
        names = {station: self._names[station] for station in range(slaves + 1)}
        return LinkTotals(
            bus=self._bus,
            plc_names=tuple(names.values()),
            station_names=names,
            master=names[0],
            slaves=slaves,
            mode=mode,
            retries=attempts - 1,
            attempts=attempts,
            timeout=None if timeout is None else timeout * TIMEOUT_UNIT,
            polls=self.polls,
            failed_attempts={station: dict(by) for station, by in sorted(self.failed.items())},
            station_errors={k: self.station_errors[k] for k in range(1, slaves + 1)},
            busy=self.busy,
            frames=self.frames,
            collisions=0,
            undetected=0,
            healthy_at=self.healthy_at,
        )
