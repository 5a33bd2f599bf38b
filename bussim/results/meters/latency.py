"""How long changes take from one device to another, from a run's records alone. All times are ticks.

A change of the source goes through stages, and at each a later one may overtake it:

- it is *sampled* at the beginning of its PLC's scan, or was over by then: then it is *unseen*;
- it is *out* at the END of that scan, when what the program made of it can leave; at a later END where the
  program's text takes more scans (``source_scans``);
- it is *carried* by the first data frame of its station that begins then or later and that the target's
  PLC hears; of several changes that are out only the latest is, the others are lost;
- it is *visible* at that PLC's first END at or after the reception, again only the latest one;
- it is *delivered* at the END at which the target follows: takes the change's level, or the other one
  where it is inverted. Only the latest change that had been visible for as many scans as the target's
  program takes can have done that: where its level is not the target's, nothing is matched, nor where
  the target follows late and that level has gone and come again.

A change that leaves the level as the target's side knew it (on, off and on again between two frames)
is lost with the one before. What the target's program takes longer than one scan shows in the last part,
and so does what the source's takes longer than its text says.

Of words the age is measured: whenever the target's PLC begins a scan, the time since the END at which
the source's PLC left the image that the target's PLC holds. Where ``reasons`` say that the image has
nothing to do with the word, nothing is.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

from bussim.results.meters.histogram import BIN_TICKS, Histogram
from bussim.results.meters.latency_record import LatencyRecord, Sample
from bussim.trace.records import DeviceValueRecord, InputRecord

#: Changes that wait at one stage; more than these, and the oldest is given up.
_MOST_WAITING = 1024
_MOST_VISIBLE = 64
#: ENDs of the source that are remembered while its frames are on the wire.
_MOST_ENDS = 1024


class Route(NamedTuple):
    """The path over a link: positions of the two PLCs on its cable, and a data frame's ticks."""

    bus: str
    source: int
    target: int
    frame: int


@dataclass(frozen=True, slots=True)
class LatencySpec:
    """What is measured: an entry of a scenario's ``latency``.

    ``edge`` is "rising", "falling" or "both". ``direct``: the target is a device that the link itself
    writes (or, without a ``route``, one of the source's PLC), so that it may follow at the very END at
    which a change becomes visible; else a scan lies between. ``way`` and ``reasons``: see
    :class:`LatencyRecord`. ``source_scans`` and ``target_scans`` are those that the two programs take
    beyond these; 0 where their texts do not say: then one that takes more may follow an earlier change.
    """

    name: str
    source_plc: str
    source: str
    target_plc: str
    target: str
    edge: str
    inverted: bool
    word: bool
    direct: bool
    route: Route | None  # None: both in one PLC
    way: str = ""
    reasons: tuple[str, ...] = ()
    source_scans: int = 0
    target_scans: int = 0

    def counts(self, level: int) -> bool:
        """Whether a change to this level is one of those to be measured."""
        return self.edge == "both" or (level == 1) == (self.edge == "rising")


class _Change:
    """A change under way; times that it has not come to are 0."""

    __slots__ = ("at", "beside", "heard", "level", "out", "renewed", "sent", "shown", "visible", "waits")

    def __init__(self, at: int, out: int, level: int, waits: int) -> None:
        self.at = at
        self.out = out
        #: ENDs of the source after ``out`` until it is really out.
        self.waits = waits
        self.level = level
        self.sent = self.heard = self.visible = 0
        #: The number of the target's END at which it became visible.
        self.shown = 0
        #: Whether its level went and came again since it was carried, as far as the frames are known.
        self.renewed = False
        #: How long the level in front of it or the one that it began has lasted, the shorter one.
        self.beside: int | None = None


class _Bits:
    """The stages of one entry whose devices are bits."""

    def __init__(self, spec: LatencySpec) -> None:
        self.spec = spec
        self.record = _record_of(spec)
        self._batch: list[InputRecord] = []  # changes that one sampling shows
        self._sampled: list[_Change] = []  # not out yet, or not carried
        self._carried: list[_Change] = []
        self._visible: list[_Change] = []
        self._latest_carried: _Change | None = None
        self._carried_level: int | None = None
        self._visible_level: int | None = None
        self._last: _Change | None = None  # that the source has made
        self._ends = 0  # of the target, the one that is being recorded included
        self._heard = -1  # when the latest frame was
        self._lasted = Histogram()  # what lies beside the lost changes
        self._new: list[int] = []  # values of the target at the END that is being recorded

    # -- what is recorded ----------------------------------------------------------------------------

    def input(self, record: InputRecord) -> None:
        """The source's wire has changed."""
        spec = self.spec
        self.record.changes += spec.counts(record.level)
        self._batch.append(record)
        if not record.seen:
            return
        batch, self._batch = self._batch, []
        # Levels alternate: an even number of changes leaves what the scan before has seen.
        unseen = batch if len(batch) % 2 == 0 else batch[:-1]
        self.record.unseen += sum(spec.counts(each.level) for each in unseen)
        if len(batch) % 2:
            self._begin(record.tick, record.end, record.level)

    def value(self, record: DeviceValueRecord) -> None:
        """The source or the target has a new value at an END."""
        spec = self.spec
        if record.device == spec.target and record.plc == spec.target_plc:
            if not spec.reasons:  # else nothing leads there: what moves it is something else
                self._new.append(record.value)
        elif record.device == spec.source and record.plc == spec.source_plc and spec.source[0] != "X":
            self.record.changes += spec.counts(record.value)
            self._begin(record.tick, record.tick, record.value)

    def _begin(self, at: int, out: int, level: int) -> None:
        change = _Change(at, out, level, self.spec.source_scans)
        last, self._last = self._last, change
        if last is not None:
            change.beside = change.at - last.at
            last.beside = change.beside if last.beside is None else min(last.beside, change.beside)
        self._sampled.append(change)
        self._give_up(self._sampled, _MOST_WAITING)

    def heard(self, start: int, tick: int) -> None:
        """The target's PLC has heard a data frame of the source's from ``start`` to ``tick``."""
        if self._heard >= 0:
            self.record.longest_gap = max(self.record.longest_gap or 0, tick - self._heard)
        self._heard = tick
        waiting = self._sampled
        number = self._out(start)
        if not number:
            return
        change = self._latest(waiting[:number], self._carried_level)
        del waiting[:number]
        if change is not None:
            self._carried_level = change.level
            change.sent, change.heard = start, tick
            self._latest_carried = change
            self._carried.append(change)
        elif self._latest_carried is not None:
            self._latest_carried.renewed = True

    def end(self, plc: str, tick: int) -> None:
        """An END is over."""
        spec = self.spec
        if plc == spec.source_plc:
            for waiting in self._sampled:
                if waiting.waits and tick > waiting.out:
                    waiting.out = tick
                    waiting.waits -= 1
        if plc != spec.target_plc:
            return
        self._ends += 1
        if spec.route is None:
            self._show_in_one_plc(tick)
        if not spec.direct:
            self._follow(tick)
        if self._carried:
            change = self._latest(self._carried, self._visible_level)
            self._carried.clear()
            if change is not None:
                self._show(change, tick)
            elif self._visible:
                self._visible[-1].renewed = True
        if spec.direct:
            self._follow(tick)

    def close(self) -> LatencyRecord:
        """The record as it is when the run ends now; may be asked for again."""
        counts = self.spec.counts
        last = self._visible[-1:]
        under_way = [*self._sampled, *self._carried, *last]
        self.record.open = sum(counts(change.level) for change in under_way)
        self.record.open += sum(counts(each.level) for each in self._batch)
        left = self._visible[:-1]
        self._visible = list(last)
        self._lose(left)
        if self.record.longest_gap is not None:
            # In bins: one that lasted as long as the gap may have been lost in it as well.
            most = self.record.longest_gap // BIN_TICKS
            self.record.lost_short = sum(n for at, n in self._lasted.bins.items() if at <= most)
        return self.record

    # -- stages ------------------------------------------------------------------------------------

    def _out(self, tick: int) -> int:
        """How many of those that wait are out by then, or overtaken by one that is."""
        waiting = self._sampled
        out = (at for at in range(len(waiting), 0, -1) if not waiting[at - 1].waits)
        return next((at for at in out if waiting[at - 1].out <= tick), 0)

    def _show_in_one_plc(self, tick: int) -> None:
        """Source and target in one PLC: a change is visible as soon as it is out."""
        for _ in range(self._out(tick)):
            change = self._sampled.pop(0)
            change.sent = change.heard = change.out
            self._show(change, change.out)

    def _show(self, change: _Change, tick: int) -> None:
        self._visible_level = change.level
        change.visible, change.shown = tick, self._ends
        self._visible.append(change)
        self._give_up(self._visible, _MOST_VISIBLE)

    def _latest(self, changes: Sequence[_Change], known: int | None) -> _Change | None:
        """The one of these that goes on; None where nothing is new to the next stage."""
        *others, last = changes
        self._lose(others)
        if last.level == known:
            self._lose([last])
            return None
        return last

    def _follow(self, tick: int) -> None:
        """The target's new values at an END: each follows the latest change that can have come to it."""
        shown = self._ends - (not self.spec.direct) - self.spec.target_scans
        for value in self._new:
            number = sum(change.shown <= shown for change in self._visible)
            change = self._visible[number - 1] if number else None
            if change is None or change.level != value ^ self.spec.inverted:
                continue  # something else has moved the target, or one that was overtaken since
            self._lose(self._visible[: number - 1])
            del self._visible[:number]
            if change.renewed and change.shown < shown:
                self._lose([change])  # late: this one or a later one of its level, nothing says which
            elif self.spec.counts(change.level):
                at = (change.at, change.out, change.sent, change.heard, change.visible, tick)
                self.record.add(Sample(change.at, tuple(b - a for a, b in pairwise(at))))
        self._new.clear()

    def _lose(self, changes: Sequence[_Change]) -> None:
        lost = [change for change in changes if self.spec.counts(change.level)]
        self.record.lost += len(lost)
        self._lasted.add_all([change.beside for change in lost if change.beside is not None])

    def _give_up(self, changes: list[_Change], most: int) -> None:
        if len(changes) > most:
            self._lose([changes.pop(0)])


class _Words:
    """The age of one word."""

    def __init__(self, spec: LatencySpec) -> None:
        self.spec = spec
        self.record = _record_of(spec)
        self._ends: deque[int] = deque(maxlen=_MOST_ENDS)  # of the source
        self._held: tuple[int, int, int] | None = None  # END, start and reception of the image

    def input(self, record: InputRecord) -> None:
        """Inputs are bits."""

    def value(self, record: DeviceValueRecord) -> None:
        """The source has a new value at an END."""
        self.record.changes += record.device == self.spec.source and record.plc == self.spec.source_plc

    def heard(self, start: int, tick: int) -> None:
        """The target's PLC has heard a data frame of the source's from ``start`` to ``tick``."""
        ends = self._ends
        while len(ends) > 1 and ends[1] <= start:
            ends.popleft()
        if ends and ends[0] <= start:
            self._held = (ends[0], start, tick)

    def end(self, plc: str, tick: int) -> None:
        """A scan begins."""
        if plc == self.spec.source_plc:
            self._ends.append(tick)
        elif plc == self.spec.target_plc and self._held is not None and not self.spec.reasons:
            end, start, heard = self._held
            self.record.add(Sample(tick, (0, start - end, heard - start, tick - heard, 0)))

    def close(self) -> LatencyRecord:
        """The record so far."""
        return self.record


def _record_of(spec: LatencySpec) -> LatencyRecord:
    return LatencyRecord(
        f"{spec.source_plc}.{spec.source}",
        f"{spec.target_plc}.{spec.target}",
        spec.edge,
        spec.inverted,
        spec.word,
        way=spec.way,
        reasons=spec.reasons,
    )


class LatencyMeter:
    """All entries of a run. Records must come in the order in which they happen."""

    def __init__(self, specs: Sequence[LatencySpec]) -> None:
        self._entries = {spec.name: _Words(spec) if spec.word else _Bits(spec) for spec in specs}
        # By PLC and device: the values that are new since its latest END, and what they were at that one.
        self._new: dict[tuple[str, str], DeviceValueRecord] = {}
        self._known: dict[tuple[str, str], int] = {}
        #: Whose ENDs are wanted.
        self.plcs = frozenset(plc for spec in specs for plc in (spec.source_plc, spec.target_plc))

    def input(self, record: InputRecord) -> None:
        """An input's wire has changed."""
        for entry in self._entries.values():
            if (record.plc, record.device) == (entry.spec.source_plc, entry.spec.source):
                entry.input(record)

    def value(self, record: DeviceValueRecord) -> None:
        """An observed device has a new value; what counts is the one at the next END."""
        self._new[record.plc, record.device] = record

    def refreshed(self, bus: str, source: int, tick: int, heard: Sequence[int] | None) -> None:
        """A block was received, its last bit at ``tick``."""
        for entry in self._entries.values():
            route = entry.spec.route
            if route is None or (route.bus, route.source) != (bus, source):
                continue
            if heard is None or route.target in heard:
                entry.heard(tick - route.frame, tick)

    def ends(self, plc: str, ticks: Sequence[int]) -> None:
        """ENDs of a PLC, each recorded after what it changed."""
        for key in [key for key in self._new if key[0] == plc]:
            record = self._new.pop(key)
            if record.value != self._known.get(key, 0):
                self._known[key] = record.value
                for entry in self._entries.values():
                    entry.value(record._replace(tick=ticks[0]))
        for entry in self._entries.values():
            for tick in ticks:
                entry.end(plc, tick)

    def records(self) -> dict[str, LatencyRecord]:
        """What was measured so far, by entry."""
        return {name: entry.close() for name, entry in self._entries.items()}
