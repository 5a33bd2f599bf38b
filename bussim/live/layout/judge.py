"""Whether the layout by which frames are read is that of the line, and what is known of the line if not.

The master is the judge: a reply with which it was content, and a poll that was replied to, are sound. A
layout by which they are not is another one, or the recorder alone heard them damaged.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice, takewhile
from statistics import mode, quantiles

from bussim.engines.nn import codes
from bussim.live.layout.propose import propose
from bussim.live.layout.silences import MOST_BURSTS, Attempt, Burst, Polling, Scan, bursts, polling
from bussim.live.layout.value import ASSUMED, Layout
from bussim.live.recordings.source import LineSetup, Source
from bussim.live.sniff.link import TIMEOUT_UNIT, station_name
from bussim.trace.records import AttemptRecord, LinkTotals, ScanRecord
from bussim.trace.sink import Sink
from bussim.wording import counted

#: More unsound frames than this share, and than so many, are not the recorder's.
_FEW, _LEAST = 0.1, 4
#: A line is polled if so many of its scans are understood, of these most take about the same time.
_UNDERSTOOD, _LEAST_SCANS, _SPREAD = 2 / 3, 5, 0.5


@dataclass(frozen=True, slots=True)
class Misfit:
    """A polled line of another layout: who speaks when on it, and the layout that is proposed for it.

    ``bus`` is the line's name. ``taken`` counts the frames of the ``kind`` of which most are ``unsound`` by
    the layout ``given``; ``sound`` are the ``bursts`` that are sound by the ``proposed`` one, which is None
    where none of the usual ones is found.
    """

    given: Layout
    polling: Polling
    kind: str
    taken: int
    unsound: int
    bus: str
    bursts: int
    characters: int
    busy: int
    proposed: Layout | None
    sound: int

    #: No parameter frame was read.
    settings = None

    @property
    def text(self) -> str:
        """What is wrong with the layout, and what is known all the same."""
        which = "the assumed layout" if self.given == ASSUMED else "the given layout"
        found = "none of the usual layouts fits"
        if self.proposed is not None:
            found = f"by the proposed layout {self.sound} of {self.bursts} frames are sound"
        return (
            f"{which} of N:N frames does not fit: of {self.taken} {self.kind} {self.unsound} are not sound "
            "by it; what is told is known from silences and lengths alone, how many frames were damaged is "
            f"not known; {found}"
        )

    def record(self, sink: Sink) -> None:
        """Record attempts and link scans."""
        bus, number = self.bus, 0
        for scan in self.polling.scans:
            failed: Counter[int] = Counter()
            for each in scan.attempts:
                if each.station:
                    sink.take(_attempt(bus, each))
                    failed[each.station] += each.failed
                    if each.failed:
                        sink.failed(bus, (each.reply or each.poll).end, each.station, _code(each))
            if scan.duration is not None:
                cause = "; ".join(
                    f"station {k}: {counted(n, 'failed attempt')}" for k, n in failed.items() if n
                )
                counts = (len(scan.attempts), failed.total(), len(given_up(scan)))
                sink.take(ScanRecord(bus, number, scan.start, scan.duration, *counts, cause))
                number += 1

    @property
    def scans(self) -> int:
        """Link scans whose time is known."""
        return sum(scan.duration is not None for scan in self.polling.scans)

    def totals(self) -> LinkTotals:
        """Counts of the link. Retries and timeout are what was seen."""
        scans, stations = self.polling.scans, range(1, self.polling.stations + 1)
        attempts = [each for scan in scans for each in scan.attempts if each.station]
        failed: dict[int, Counter[int]] = {}
        for each in attempts:
            if each.failed:
                failed.setdefault(each.station, Counter())[_code(each)] += 1
        most = max((each.number for each in attempts), default=1)
        names = {number: station_name(number) for number in (0, *stations)}
        errors = Counter(station for scan in scans for station in given_up(scan))
        timeout = self.polling.timeout
        return LinkTotals(
            bus=self.bus,
            plc_names=tuple(names.values()),
            station_names=names,
            master=names[0],
            slaves=len(stations),
            mode=None,
            retries=most - 1,
            attempts=most,
            timeout=None if timeout is None else round(timeout / TIMEOUT_UNIT) * TIMEOUT_UNIT,
            polls=sum(each.number == 1 for each in attempts),
            failed_attempts={station: dict(by) for station, by in sorted(failed.items())},
            station_errors={station: errors[station] for station in stations},
            busy=self.busy,
            frames=self.bursts,
            collisions=0,
            undetected=0,
            healthy_at=None,
        )

    @property
    def station_error_onsets(self) -> Counter[int]:
        """How often each station's errors began."""
        count: Counter[int] = Counter()
        before: set[int] = set()
        for scan in self.polling.scans:
            now = given_up(scan)
            count.update(now - before)
            before = now
        return count


def given_up(scan: Scan) -> set[int]:
    """The stations whose last attempt in a scan failed."""
    last = {each.station: each.failed for each in scan.attempts if each.station}
    return {station for station, failed in last.items() if failed}


def _code(each: Attempt) -> int:
    if not each.failed:
        return 0
    return codes.NO_REPLY if each.reply is None else codes.DAMAGED


def _attempt(bus: str, each: Attempt) -> AttemptRecord:
    code, reply = _code(each), each.reply
    turnaround = None if reply is None or each.failed else reply.start - each.poll.end
    outcome = codes.MEANINGS[code] if code else "ok"
    end = (reply or each.poll).end
    return AttemptRecord(bus, each.poll.start, end, each.station, each.number, outcome, code, turnaround)


def judge(source: Source, setup: LineSetup, bus: str, limit: int | None = None) -> Misfit | None:
    """What is known of a line whose layout is not the one by which it is read; None where that fits.

    None, too, where silences and lengths show no line that a master polls. ``limit`` is the tick up to which
    the recording is read. Raises RecordingError.
    """
    character = setup.timing.characters(1)
    every = bursts(source.chunks(setup), character)
    found = list(islice(takewhile(lambda one: limit is None or one.end <= limit, every), MOST_BURSTS))
    polled = polling(found, character)
    if polled is None or not _regular(polled):
        return None
    attempts = [
        each for scan in polled.scans for each in scan.attempts if each.station and each.reply is not None
    ]
    taken = {
        "polls with a reply": [each.poll for each in attempts],
        "replies that the master took": [each.reply for each in attempts if not each.failed and each.reply],
    }
    given = setup.layout
    unsound = {kind: sum(given.decode(each.chars) is None for each in every) for kind, every in taken.items()}
    kind = max(unsound, key=lambda one: unsound[one] / max(1, len(taken[one])))
    share = unsound[kind] / max(1, len(taken[kind]))
    own = [scan.begin for scan in polled.scans if scan.begin is not None]
    sent = [each.poll for each in attempts] + own
    if unsound[kind] <= _LEAST or share <= _FEW:
        return None
    # All that the master sends is sound: stations' replies, laid out as its data, are damaged.
    if own and _sound(given, sent) >= (1 - _FEW) * len(sent):
        return None
    proposed = propose(polled)
    sound = 0 if proposed is None else _sound(proposed, found)
    if sound <= _sound(given, found) + _LEAST:
        proposed, sound = None, 0
        if share < 1 - _FEW:
            return None  # frames that are damaged at the recorder alone
    return Misfit(
        given=given,
        polling=polled,
        kind=kind,
        taken=len(taken[kind]),
        unsound=unsound[kind],
        bus=bus,
        bursts=len(found),
        characters=sum(len(burst.chars) for burst in found),
        busy=sum(burst.end - burst.start for burst in found),
        proposed=proposed,
        sound=sound,
    )


def _sound(layout: Layout, found: Sequence[Burst]) -> int:
    return sum(layout.decode(burst.chars) is not None for burst in found)


def _regular(polled: Polling) -> bool:
    """Whether a line is polled in order: scans without failures take about the same time."""
    understood = sum(scan.understood for scan in polled.scans)
    usual = mode(len(scan.attempts) for scan in polled.scans)
    plain = [
        scan.duration for scan in polled.scans if scan.duration is not None and len(scan.attempts) == usual
    ]
    replied = any(each.reply is not None for scan in polled.scans for each in scan.attempts)
    if len(plain) < _LEAST_SCANS or understood < _UNDERSTOOD * len(polled.scans) or not replied:
        return False
    low, middle, high = quantiles(plain, n=4)
    return high - low <= _SPREAD * middle
