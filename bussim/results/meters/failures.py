"""Why exchanges of an N:N link failed, judged by what its stations and its bus showed while they did.

An exchange's failure begins with its first failed attempt and ends with a good reply, or with the master's
work. Each is judged by itself; only counts and times by station and cause are kept. Times are ticks.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import NamedTuple

from bussim.results.meters.refresh import RefreshMeter
from bussim.trace.records import AFTER_FRAME, IN_FRAME, JABBER, WITHOUT_FRAME
from bussim.units import TICKS_PER_SECOND

#: From this share of failed attempts on, what showed with them is their cause.
_MOSTLY = 0.5
#: Codes of failed attempts (FX communication manual JY992D69901, chapter 4).
_NO_REPLY, _WRONG_STATION, _WRONG_COUNTER, _DAMAGED = 1, 2, 3, 4
#: What a node's driver does to the exchanges of all.
_OF_ALL = (JABBER, WITHOUT_FRAME, AFTER_FRAME)


class Cause(StrEnum):
    """What stations and bus showed while exchanges with a station failed; keys ``cause_…`` of the catalogue.

    Of ``STOPPED`` and ``SHOWN`` (a node's driver disturbed the bus) the verdict speaks where it names the PLC
    that was not in RUN, and that node.
    """

    MISSING = "missing"
    REFUSED = "refused"
    STOPPED = "stopped"
    SHOWN = "shown"
    CUT = "cut"
    FORMAT = "format"
    MASTER = "master"
    RECEIVER = "receiver"
    DAMAGED = "damaged"
    MISTAKEN = "mistaken"
    NO_REPLY = "no_reply"


class LinkMember(NamedTuple):
    """A PLC on a link: its name, its position on the cable and its station number."""

    name: str
    position: int
    number: int


@dataclass(slots=True)
class Times:
    """How often something was, from when to when, for how long in all, and when it lasted longest."""

    number: int = 0
    first: int = 0
    last: int = 0
    total: int = 0
    longest: int = 0
    at: int = 0

    def add(self, start: int, end: int) -> None:
        """Count a time from ``start`` to ``end``."""
        self.join(Times(1, start, end, end - start, end - start, start))

    def join(self, other: Times) -> None:
        """Count the times of another one, too."""
        if not self.number or other.longest > self.longest:
            self.longest, self.at = other.longest, other.at
        self.first = min(self.first, other.first) if self.number else other.first
        self.last = max(self.last, other.last)
        self.number += other.number
        self.total += other.total


@dataclass(slots=True)
class Irregular:
    """How often something came now and then, as a node's driver disturbs a bus, and when for the last time.

    What comes less than a second after what was before belongs to the same time: ``since`` when the latest
    began; ``past`` are those before it.
    """

    number: int = 0
    last: int = 0
    since: int = 0
    past: Times = field(default_factory=Times)

    @classmethod
    def noted(cls, found: Irregular | None, tick: int) -> Irregular:
        """What was found so far, if anything, with what came at ``tick``."""
        if found is None:
            found = cls(since=tick)
        elif tick - found.last >= TICKS_PER_SECOND:
            found.past.add(found.since, found.last)
            found.since = tick
        found.number += 1
        found.last = tick
        return found

    def times(self) -> Times:
        """The times in which it did, the latest included."""
        found = replace(self.past)
        found.add(self.since, self.last)
        return found


#: By node and by one of :data:`bussim.trace.records.IRREGULAR`.
Irregulars = dict[tuple[str, str], Irregular]


@dataclass(slots=True)
class Failures:
    """Failed exchanges by station number and cause.

    ``errors``: in which the station's flag went on, and for how long it was; ``codes``: their failed attempts
    by station and code; ``repeated``: the failed attempts that a good reply followed, likewise;
    ``undecided``: in which neither had come when the run, or the master's work, ended.
    """

    errors: dict[tuple[int, Cause], Times] = field(default_factory=dict)
    codes: dict[int, Counter[int]] = field(default_factory=dict)
    repeated: dict[int, Counter[int]] = field(default_factory=dict)
    undecided: dict[tuple[int, Cause], Times] = field(default_factory=dict)


@dataclass(slots=True)
class _Open:
    """An exchange that fails: since when, and what had been counted at the beginning of its link scan.

    ``irregular`` is what had been counted at the latest attempt, ``met`` in how many attempts it had grown.
    """

    since: int
    scan_start: int
    scans: int
    irregular: Counter[tuple[str, str]]
    met: Counter[tuple[str, str]] = field(default_factory=Counter)
    refused: bool = False
    stopped: bool = False
    listening: frozenset[int] = frozenset()  # the stations that received the data frame of that scan
    heard: dict[int, int] = field(default_factory=dict)  # the master's blocks received so far, by receiver
    taken: dict[int, int] = field(default_factory=dict)  # the station's own blocks received so far
    codes: Counter[int] = field(default_factory=Counter)
    garbled: int = 0  # attempts in which characters came to the station that were no sound frame
    flagged: int | None = None


class FailureMeter:
    """Judges the failed exchanges of one link; of a recording's stations (no ``members``) by codes alone."""

    def __init__(
        self, bus: str, members: Sequence[LinkMember], refresh: RefreshMeter, irregular: Irregulars
    ) -> None:
        self._bus, self._refresh, self._irregular = bus, refresh, irregular
        self._by_number: dict[int, LinkMember] = {}
        for member in members:
            self._by_number.setdefault(member.number, member)
        self._slaves = [member for number, member in self._by_number.items() if number]
        self._masters = [member for member in members if not member.number]
        self._found = Failures()
        self._open: dict[int, _Open] = {}
        self._scans = self._scan_start = 0
        self._before: Counter[tuple[str, str]] = Counter()  # irregular at the scan's beginning
        self._away: set[str] = set()
        self._back: dict[str, int] = {}
        self._refused: set[str] = set()
        # By slave: until when its flag of the master was on for a damaged frame; None: it is.
        self._damaged: dict[str, int | None] = {}

    # -- what stations showed ------------------------------------------------------------------------

    @property
    def master(self) -> LinkMember | None:
        """The first PLC with the number 0 that has not refused its parameters."""
        return next((each for each in self._masters if each.name not in self._refused), None)

    def is_master(self, name: str) -> bool:
        """Whether a PLC is the link's master."""
        return self.master is not None and self.master.name == name

    def away(self, name: str) -> bool:
        """Whether a PLC is without supply or in STOP."""
        return name in self._away

    def was_away(self, name: str) -> bool:
        """Whether a PLC went to RUN during the run: before, it was without supply or in STOP."""
        return name in self._back

    def state(self, name: str, tick: int, *, running: bool) -> None:
        """A PLC went to RUN, or left it; a master's failed exchanges end with its work."""
        if running:
            self._away.discard(name)
            self._back[name] = tick
            return
        self._away.add(name)
        self._refused.discard(name)
        for station in list(self._open) if self.is_master(name) else ():
            self._close(station, tick, replied=False)

    def refused(self, name: str) -> None:
        """A PLC refused its parameters."""
        self._refused.add(name)

    def master_damaged(self, name: str, until: int | None) -> None:
        """A slave's flag of the master went on for a damaged frame (code 14), or off at a tick."""
        self._damaged[name] = until

    # -- exchanges -----------------------------------------------------------------------------------

    def failed(self, station: int, code: int, tick: int, *, garbled: bool = False) -> None:
        """An attempt failed; ``garbled``: meanwhile the station had characters that were no sound frame."""
        if station not in self._open:
            self._open[station] = self._begin(station, tick)
        self._open[station].codes[code] += 1
        self._open[station].garbled += garbled
        if self._irregular:
            self._look(self._open[station])

    def flag(self, station: int, tick: int, *, on: bool) -> None:
        """A station's flag at the master changed."""
        if not on:
            self._close(station, tick, replied=True)
        elif station in self._open:
            self._open[station].flagged = tick

    def scan(self, end: int, *, flagged: bool) -> None:
        """A link scan ended; without a flag on, every exchange has ended well."""
        for station, each in list(self._open.items()):
            if each.flagged is None or not flagged:
                self._close(station, end, replied=True)
        self.ordinary_scans(1, end)

    def ordinary_scans(self, number: int, end: int) -> None:
        """So many link scans without errors ended, the last at ``end``; no exchange was failing."""
        self._scans += number
        self._scan_start = end
        if self._irregular:
            self._before = self._counted()

    def finish(self, duration: int) -> Failures:
        """All failures of a run of ``duration`` ticks."""
        for station, each in list(self._open.items()):
            reply = self._last_reply(station)
            self._close(station, duration, replied=each.flagged is None and (reply or 0) > each.since)
        return self._found

    def _look(self, each: _Open) -> None:
        """Note what drivers did since an exchange's latest attempt."""
        now = self._counted()
        each.met.update((now - each.irregular).keys())
        each.irregular = now

    def _counted(self) -> Counter[tuple[str, str]]:
        return Counter({key: each.number for key, each in self._irregular.items()})

    def _received(self, source: LinkMember, receiver: LinkMember) -> int:
        return self._refresh.received(self._bus, source.position, receiver.position)[0]

    def _last_reply(self, station: int) -> int | None:
        me, master = self._by_number.get(station), self.master
        if me is None or master is None:
            return None
        return self._refresh.received(self._bus, me.position, master.position)[1]

    def _begin(self, station: int, tick: int) -> _Open:
        me, master = self._by_number.get(station), self.master
        found = _Open(tick, self._scan_start, self._scans, self._before)
        if me is None or master is None:
            return found
        found.refused = me.name in self._refused
        # Its latest reply was before it left RUN: what it had of the master's parameters is lost.
        back = self._back.get(me.name)
        found.stopped = me.name in self._away or (
            back is not None and back >= (self._last_reply(station) or 0)
        )
        found.listening = frozenset(
            slave.number
            for slave in self._slaves
            if (self._refresh.received(self._bus, master.position, slave.position)[1] or 0) > self._scan_start
        )
        found.heard = {each.number: self._received(master, each) for each in self._slaves}
        found.taken = {each.number: self._received(me, each) for each in self._slaves if each is not me}
        return found

    def _close(self, station: int, tick: int, *, replied: bool) -> None:
        each = self._open.pop(station, None)
        if each is None:
            return
        if each.flagged is None and replied:
            self._found.repeated.setdefault(station, Counter()).update(each.codes)
            return
        key = station, self._cause(station, each, replied=replied)
        if each.flagged is not None:
            self._found.codes.setdefault(station, Counter()).update(each.codes)
            self._found.errors.setdefault(key, Times()).add(each.flagged, tick)
        else:
            self._found.undecided.setdefault(key, Times()).add(each.since, tick)

    # -- the cause -----------------------------------------------------------------------------------

    def _cause(self, station: int, each: _Open, *, replied: bool) -> Cause:
        me, codes, attempts = self._by_number.get(station), each.codes, each.codes.total()
        enough = _MOSTLY * attempts
        if me is None or not each.heard:  # of a recording, or without a master whose frames could be heard
            return Cause.MISSING if self._by_number and me is None else self._by_codes(codes)
        if each.refused or each.stopped:
            return Cause.REFUSED if each.refused else Cause.STOPPED
        self._look(each)
        shown = {key for key, number in each.met.items() if number >= enough and key[1] != IN_FRAME}
        # What another slave does to an exchange is seldom silence.
        names = {me.name, *(master.name for master in self._masters)}
        if any(what in _OF_ALL or node in names for node, what in shown) or (
            shown and codes[_NO_REPLY] < enough
        ):
            return Cause.SHOWN
        # The frame with which a station is found again is not of the time in which it failed.
        last = int(replied and each.flagged is not None)
        deaf = {number for number in each.heard if self._deaf(number, each, last)}
        working = {slave.number for slave in self._slaves if slave.name not in self._away | self._refused}
        damaged = {
            slave.number
            for slave in self._slaves
            if (until := self._damaged.get(slave.name, -1)) is None or until >= each.scan_start
        }
        if station in deaf:
            if len(working) > 1 and deaf >= working:
                return Cause.MASTER
            return Cause.FORMAT if each.garbled >= enough else Cause.CUT
        taken = max(
            (self._received(me, s) - each.taken[s.number] for s in self._slaves if s is not me), default=0
        )
        if taken - last >= max(enough, 1):
            return Cause.RECEIVER
        found = self._by_codes(codes)
        all_damaged = len(working) > 1 and damaged >= working
        return Cause.MASTER if found is Cause.NO_REPLY and all_damaged else found

    def _deaf(self, number: int, each: _Open, last: int) -> bool:
        """Whether a slave received nothing of the master after the failure began."""
        master = self.master
        assert master is not None  # noqa: S101 - narrows the type; only with a master something is heard
        if self._scans - each.scans <= last:
            return number not in each.listening
        return self._received(master, self._by_number[number]) - each.heard[number] <= last

    @staticmethod
    def _by_codes(codes: Counter[int]) -> Cause:
        enough = _MOSTLY * codes.total()
        if codes[_DAMAGED] >= enough:
            return Cause.DAMAGED
        return Cause.MISTAKEN if codes[_WRONG_STATION] + codes[_WRONG_COUNTER] >= enough else Cause.NO_REPLY
