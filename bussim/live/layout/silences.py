"""Who speaks when on a polled line, from silences and lengths alone: the layout need not be known.

A master sends its own data, then polls one station after the other; what follows a poll sooner than a timeout
is its reply. Polls are the shortest of the frequent bursts. A link scan begins with a burst that is neither a
poll nor a reply, or, where there is none, with the poll behind a regular long pause. An attempt has failed if
nothing replied, or if the master goes on later than behind others: a damaged frame ends with a silence.
Stations are told apart by their order: attempts are given to them so that every scan has all of them, at the
lowest cost. Where polls that are repeated are alike and others are not, that decides who is asked.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from statistics import median_low
from typing import NamedTuple

from bussim.live.recordings.source import Chunk

#: Bursts that are taken; what a recording has beyond is left out.
MOST_BURSTS = 200_000
#: Characters of a burst at most: more than any frame has.
_LONGEST = 1000
#: Bursts below which nothing is said.
_LEAST = 12
#: A length is frequent if so many bursts have it; a poll that was damaged may be longer than others.
_FREQUENT, _LONGEST_POLL = 0.05, 1.5
#: Bursts of the master's own behind another burst that is no poll: one in three, where there is one slave.
_MOST_OWN = 0.45
#: Stations that are told apart at most.
_MOST_STATIONS = 32
#: Attempts of a scan at most: 11 at each station are what a master's settings allow.
_MOST_ATTEMPTS = 11 * _MOST_STATIONS
#: Of each attempt of a scan whether it was replied to, and whether the next poll is alike (None: not known).
_Pattern = tuple[tuple[str, bool | None], ...]
#: Costs of giving an attempt to the station of the one before, or to the next one. See _costs.
_NEVER, _UNLIKELY, _ODD = 100, 3, 2
#: What a scan adds at most to the cost of a number of stations: something of it may not have been heard.
_MOST_COST = 10


class Burst(NamedTuple):
    """Characters without a silence between them: first edge and last stop bit in ticks.

    ``wrong``: a parity or stop bit is.
    """

    start: int
    end: int
    chars: bytes
    wrong: bool = False


def bursts(chunks: Iterable[Chunk], silence: int) -> Iterator[Burst]:
    """The bursts of a recording; ``silence`` ticks, or another wire, part them."""
    held, begun, last, wire, wrong = bytearray(), 0, 0, 0, False
    for chunk in chunks:
        for (value, parity_ok, stop_ok), start, end in chunk.chars:
            if held and (start - last >= silence or chunk.wire != wire or len(held) >= _LONGEST):
                yield Burst(begun, last, bytes(held), wrong)
                held, wrong = bytearray(), False
            if not held:
                begun, wire = start, chunk.wire
            held.append(value)
            wrong |= not (parity_ok and stop_ok)
            last = end
    if held:
        yield Burst(begun, last, bytes(held), wrong)


@dataclass(slots=True)
class Attempt:
    """A poll and its reply, None where nothing came. ``after`` are the ticks to the master's next burst.

    ``failed``: the master was not content, or there was no reply. ``station`` is 0 where it is not known.
    """

    poll: Burst
    reply: Burst | None = None
    after: int | None = None
    failed: bool = False
    station: int = 0
    number: int = 1


@dataclass(slots=True)
class Scan:
    """A link scan: the master's own burst (None: it has none), what it sent before that, and its attempts.

    ``start`` is the tick at which it begins, ``duration`` None where it was not heard whole.
    """

    start: int
    begin: Burst | None
    before: list[Burst]
    attempts: list[Attempt]
    duration: int | None = None
    understood: bool = True


@dataclass(frozen=True, slots=True)
class Polling:
    """The scans of a polled line. ``timeout`` in ticks is None where no reply was waited for in vain."""

    scans: list[Scan]
    stations: int
    timeout: int | None


def polling(found: Sequence[Burst], character: int) -> Polling | None:
    """How a line is polled; None where its bursts show no such order. ``character`` is one's ticks."""
    lengths = Counter(len(burst.chars) for burst in found)
    frequent = sorted(size for size, count in lengths.items() if count >= _FREQUENT * len(found))
    if len(found) < _LEAST or len(frequent) < 2:
        return None
    # What is shorter than half a poll is a stray, as of a driver that switches off.
    found = [burst for burst in found if 2 * len(burst.chars) > frequent[0]]
    polls = _polls(found, frequent)
    if polls is None:
        return None
    scans = _scans(found, polls, _longest_reply(found, polls))
    if not any(scan.begin for scan in scans):
        scans = _parted(scans)
    if not scans:
        return None
    gaps = sorted(_gaps(scans))
    _judge(scans, gaps, character)
    stations = _assign(scans)
    if not stations:
        return None
    for scan, following in pairwise(scans):
        if scan.understood:
            scan.duration = following.start - scan.start
    _number(scans)
    # Behind a scan's last attempt comes what the master does besides, too.
    waits = _waits(each for scan in scans for each in scan.attempts[:-1])
    waits = waits or _waits(each for scan in scans for each in scan.attempts)
    timeout = median_low(waits) - (gaps[0] if gaps else 0) if waits else None
    return Polling(scans, stations, timeout)


def _waits(attempts: Iterable[Attempt]) -> list[int]:
    """The ticks that the master waited for replies that did not come."""
    return [each.after for each in attempts if each.reply is None and each.after is not None]


def _gaps(scans: Sequence[Scan]) -> Iterator[int]:
    """The ticks from a reply, or from the master's own burst, to its next poll."""
    for scan in scans:
        if scan.begin is not None and scan.attempts:
            yield scan.attempts[0].poll.start - scan.begin.end
        yield from (
            each.after for each in scan.attempts[:-1] if each.reply is not None and each.after is not None
        )


def _polls(found: Sequence[Burst], frequent: Sequence[int]) -> list[bool] | None:
    """Which bursts are polls: the shortest ones, or those of another frequent length; None where none can be.

    Where nothing but polls and replies is sent, replies may be shorter: they come sooner than the next poll.
    """
    border = min((frequent[0] + frequent[1]) / 2, _LONGEST_POLL * frequent[0])
    shortest = [len(burst.chars) < border for burst in found]
    tried = [shortest, *([len(burst.chars) == size for burst in found] for size in frequent)]
    likely: list[tuple[int, list[bool]]] = []
    for polls in tried:
        repeats, replies, rest = list[int](), list[int](), 0
        for at, (one, two) in enumerate(pairwise(found)):
            if polls[at]:
                (repeats if polls[at + 1] else replies).append(two.start - one.end)
            rest += not polls[at] and not polls[at + 1]
        replies.sort()
        # A poll waits in vain for longer than for a reply, if any comes.
        longest = median_low(repeats) if repeats else replies[-1] + 1 if replies else 0
        quick = [wait for wait in replies if 4 * wait < 3 * longest]
        if repeats and quick:  # behind the last poll of a dead station the master sends its own
            rest, replies = rest + len(replies) - len(quick), quick
        late = not repeats or (longest > 2 * median_low(quick) if quick else polls is shortest)
        if replies and late and rest <= _MOST_OWN * len(found):
            if polls is shortest and rest * _MOST_STATIONS > len(found):
                return polls
            likely.append((replies[9 * len(replies) // 10], polls))
    return min(likely, key=lambda one: one[0], default=(0, None))[1]


def _longest_reply(found: Sequence[Burst], polls: Sequence[bool]) -> float:
    """The ticks up to which a burst behind a poll is its reply."""
    repeats: list[int] = []
    waits: list[int] = []
    for at in range(len(found) - 1):
        if polls[at]:
            (repeats if polls[at + 1] else waits).append(found[at + 1].start - found[at].end)
    waits.sort()
    if repeats:
        return 3 * median_low(repeats) / 4
    # Without a repeat, timeouts are what is far longer than all other waits.
    steps = [(high / max(low, 1), low, high) for low, high in pairwise(waits)]
    ratio, low, high = max(steps, default=(0, 0, 0))
    return (low + high) / 2 if ratio > 4 else float("inf")


def _scans(found: Sequence[Burst], polls: Sequence[bool], longest: float) -> list[Scan]:
    """The bursts as scans: what is no poll and no reply begins one."""
    scans = [Scan(0, None, [], [])]
    own: list[Burst] = []  # bursts of the master's that are no polls, since the latest attempt
    attempt: Attempt | None = None
    for burst, poll in zip(found, polls, strict=True):
        if (
            attempt is not None
            and not poll
            and attempt.reply is None
            and burst.start - attempt.poll.end < longest
        ):
            attempt.reply = burst
            continue
        if attempt is not None and attempt.after is None:
            attempt.after = burst.start - (attempt.reply or attempt.poll).end
        if not poll:
            own.append(burst)
            attempt = attempt if attempt is None or attempt.after is not None else None
            continue
        if own:
            scans.append(Scan(own[-1].start, own[-1], own[:-1], []))
            own = []
        attempt = Attempt(burst)
        scans[-1].attempts.append(attempt)
    if attempt is not None and attempt.reply is None and attempt.after is None:
        scans[-1].attempts.pop()  # the recording ends before it is decided
    if own:
        scans.append(Scan(own[-1].start, own[-1], own[:-1], []))
    # What is heard first is no whole scan, unless the master's own burst began it.
    return scans[1:] if scans[0].begin is None and len(scans) > 1 else scans


def _parted(scans: Sequence[Scan]) -> list[Scan]:
    """Scans of a master that sends nothing of its own: each begins behind a pause longer than most.

    Without such a pause it begins with the poll that is like the first one; if none is, there are no scans.
    """
    attempts = [attempt for scan in scans for attempt in scan.attempts]
    usual = min((each.after or 0 for each in attempts[:-1] if each.reply is not None), default=0)
    lost = min(_waits(attempts), default=0) - usual
    gaps = [(each.after or 0) - (lost if each.reply is None else 0) for each in attempts]
    ordered = sorted(gaps[:-1])
    least = max(1, ordered[len(ordered) // 10]) if ordered else 1
    steps = [(high / max(low, least), high) for low, high in pairwise(ordered)]
    ratio, pause = max(steps, default=(0, 0))
    contents = {each.poll.chars for each in attempts}
    paused = ratio >= 2 and sum(gap >= pause for gap in ordered) * _MOST_STATIONS >= len(ordered)
    if not paused and len(contents) > _MOST_STATIONS:
        return []
    found: list[Scan] = []
    for at, each in enumerate(attempts):
        if paused:
            begins = at == 0 or gaps[at - 1] >= pause
        else:
            begins = each.poll.chars == attempts[0].poll.chars and (
                at == 0 or len(contents) == 1 or attempts[at - 1].poll.chars != each.poll.chars
            )
        if begins:
            found.append(Scan(each.poll.start, None, [], []))
        found[-1].attempts.append(each)
    return found


def _judge(scans: Sequence[Scan], gaps: Sequence[int], character: int) -> None:
    """Say which attempts failed; ``gaps`` are what the master waits behind what it has heard, sorted."""
    usual = gaps[len(gaps) // 10] if gaps else 0
    # Only where gaps are of two kinds do longer ones tell something.
    between = sum(usual + 0.5 * character < gap < usual + 1.5 * character for gap in gaps)
    longest = usual + character if between <= 0.02 * len(gaps) else float("inf")
    for scan in scans:
        for at, each in enumerate(scan.attempts):
            last = at == len(scan.attempts) - 1
            each.failed = each.reply is None or (not last and each.after is not None and each.after > longest)


def _pattern(scan: Scan, *, telling: bool) -> _Pattern:
    """What the costs of a scan depend on: of each attempt its reply, and whether the next poll is alike.

    ``x``: no reply; ``u``: a reply with which the master was not content; ``o``: a good one.
    """
    codes = ["x" if each.reply is None else "u" if each.failed else "o" for each in scan.attempts]
    alike: list[bool | None] = [
        (each.poll.chars == after.poll.chars if telling else None) for each, after in pairwise(scan.attempts)
    ]
    return tuple(zip(codes, [*alike, None], strict=False))


def _assign(scans: Sequence[Scan]) -> int:
    """Give the attempts of all scans to stations; returns how many there are, 0 where none is seen."""
    pairs = [pair for scan in scans for pair in pairwise(scan.attempts)]
    good = [one.poll.chars != two.poll.chars for one, two in pairs if not one.failed]
    bad = [one.poll.chars == two.poll.chars for one, two in pairs if one.failed]
    telling = bool(bad) and sum(good) >= 0.9 * len(good) and 3 * sum(bad) >= len(bad)
    patterns = [_pattern(scan, telling=telling) for scan in scans]
    counts = Counter(pattern for pattern in patterns[:-1] or patterns if pattern)
    if not counts:
        return 0
    # A station that fails equally often in most scans is dead; how often is what a master repeats.
    runs = Counter(_longest_run(pattern) for pattern in patterns)
    run = max((run for run, count in runs.items() if 2 * count > len(scans)), default=0)
    most = min(_MOST_STATIONS, max(map(len, counts)))
    total: Counter[int] = Counter()
    for pattern, count in counts.items():
        paths = _paths(pattern, most, run)
        for number in range(1, most + 1):
            total[number] += count * min(_MOST_COST, paths[number].cost if number in paths else _NEVER)
    stations = min(total, key=lambda number: (total[number], number))
    known: dict[_Pattern, list[int]] = {}
    for scan, pattern in zip(scans, patterns, strict=True):
        last = scan is scans[-1]  # it may not have been heard to its end
        if last or pattern not in known:
            known[pattern] = _path(_paths(pattern, stations, run), stations, partly=last)
        path = known[pattern]
        scan.understood = bool(path)
        for each, station in zip(scan.attempts, path, strict=False):
            each.station = station
    return stations


def _longest_run(pattern: _Pattern) -> int:
    """The most attempts without a reply in a row that another station's follow."""
    return max(map(len, "".join(code for code, _ in pattern).replace("u", "o").split("o")), default=0)


class _Step(NamedTuple):
    """An attempt that is given to a station: what it costs with those before it."""

    cost: int
    station: int
    before: _Step | None


def _paths(pattern: _Pattern, most: int, run: int) -> dict[int, _Step]:
    """The last steps of the cheapest ways to give attempts to stations 1 to N in order, by N."""
    best = {1: _Step(0, 1, None)} if 0 < len(pattern) <= _MOST_ATTEMPTS else {}
    silent = 0
    for code, alike in pattern[:-1]:
        silent = silent + 1 if code == "x" else 0
        same, onward = _costs(code, alike=alike, dead=bool(run and silent) and not silent % run)
        grown: dict[int, _Step] = {}
        for step in best.values():
            for station, more in ((step.station, same), (step.station + 1, onward)):
                cost = step.cost + more
                if station <= most and (station not in grown or cost < grown[station].cost):
                    grown[station] = _Step(cost, station, step)
        best = grown
    return best


def _path(paths: dict[int, _Step], stations: int, *, partly: bool) -> list[int]:
    """The stations of a scan's attempts, none where not known; ``partly``: not all need be polled."""
    ends = [step for number, step in paths.items() if partly or number == stations]
    step = min(ends, key=lambda step: step.cost, default=None)
    path: list[int] = []
    if step is not None and step.cost < _NEVER:
        while step is not None:
            path.append(step.station)
            step = step.before
    return path[::-1]


def _costs(code: str, *, alike: bool | None, dead: bool) -> tuple[int, int]:
    """The costs of the same station and of the next one behind an attempt; ``dead``: a dead one's last."""
    same, onward = {"o": (_NEVER, 0), "u": (0, _UNLIKELY), "x": (0, _ODD)}[code]
    if dead:
        same, onward = 1, 0
    if alike is not None:
        return (same, onward + _NEVER) if alike else (same + _UNLIKELY, onward)
    return same, onward


def _number(scans: Sequence[Scan]) -> None:
    """Number the attempts of each exchange; one that is repeated has failed."""
    for scan in scans:
        for one, two in pairwise(scan.attempts):
            if one.station and one.station == two.station:
                two.number, one.failed = one.number + 1, True
