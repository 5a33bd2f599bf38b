"""Whether anything leads from one device to another: through programs, shared blocks, other stations, ports.

What the programs' texts tell (:mod:`bussim.scenario.signals.program_signals`) and what the link's refresh mode shares,
without carrying anything out. Whoever is told that *nothing* leads somewhere must be able to rely on it:
where ports, index registers, jumps, flags or special devices might, the answer is :attr:`Lead.UNKNOWN`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import lru_cache
from itertools import product

from bussim.engines.nn.frames import MODES
from bussim.plc.memory import BlockPlace, Device, block_place
from bussim.plc.program.program import Program
from bussim.scenario.signals.program_signals import Key, Point, Signals

#: Special bits that follow nothing but the clock and RUN (FX programming manual).
_BY_ITSELF = frozenset((8000, 8001, 8002, 8003, 8011, 8012, 8013, 8014))
_FIRST_SPECIAL = 8000
_LETTERS = "XYMSTCDVZ"
#: Devices that a hint names.
_MOST_MEANT = 3
#: Devices of a program that are tried for a hint.
_MOST_TRIED = 48


class Lead(StrEnum):
    """How one device leads to another."""

    DIRECT = "direct"  # within one PLC, or over the source's own block
    ROUND = "over other stations"
    UNKNOWN = "unknown"  # what no text tells might
    NONE = "none"


@dataclass(frozen=True, slots=True)
class Station:
    """A PLC. ``number`` is that of its block on the net's link, None for one that is not on it.

    ``spacing`` is between the stations' words, ``modes`` those that it has, ``buses`` what else it is wired
    to.
    """

    name: str
    number: int | None
    spacing: int
    modes: tuple[int, ...]
    program: Program | None
    buses: frozenset[str]


@dataclass(frozen=True, slots=True)
class Net:
    """All PLCs, and the link between some: None for ``mode`` without a working master."""

    stations: tuple[Station, ...]
    bus: str = ""
    mode: int | None = None
    slaves: int = 0

    def named(self, name: str) -> int:
        """The place of a PLC among the stations."""
        return next(place for place, each in enumerate(self.stations) if each.name == name)

    def block(self, owner: int, keeper: int) -> BlockPlace | None:
        """Where one station keeps the block of another or its own, None if it never comes there."""
        number, mode = self.stations[owner].number, self.mode
        at = self.stations[keeper]
        if mode is None or number is None or at.number is None or number > self.slaves:
            return None
        if mode not in self.stations[owner].modes or mode not in at.modes:
            return None
        return block_place(number, MODES[mode].bits, MODES[mode].words, at.spacing)


@dataclass(frozen=True, slots=True)
class Finding:
    """How one device leads to another, and if it does not: why, what may be meant.

    ``end`` is "from" or "to", the one to be looked at; empty where the link itself is in the way.
    """

    lead: Lead
    why: str = ""
    meant: str = ""
    end: str = ""


@lru_cache(maxsize=32)
def signals_of(program: Program | None) -> Signals:
    """The steps that signals take through a program."""
    return Signals(program)


#: A device; a rung, by its place in the program; any device of a letter.
_Item = Key | int | str


class _Steps(dict[Key | int, tuple[Key | int, ...]]):
    """What follows from a device or a rung of one program next: looked up once."""

    def __init__(self, program: Program | None) -> None:
        super().__init__()
        self._signals = signals_of(program)

    def __missing__(self, item: Key | int) -> tuple[Key | int, ...]:
        point = Point(None, item, 0) if isinstance(item, int) else Point(item, -1, 0)
        ends = (step.to for step in self._signals.steps(point))
        found = dict.fromkeys(to.number if to.key is None else to.key for to in ends)
        if isinstance(item, Key) and item.letter in ("T", "C"):  # contact and current value go together
            found[item._replace(word=not item.word)] = None
        return self.setdefault(item, tuple(found))


_steps_of = lru_cache(maxsize=32)(_Steps)


@dataclass(frozen=True, slots=True)
class Question:
    """From ``start`` of one station (its place in the net) to ``end`` of another or the same one."""

    net: Net
    source: int
    start: Key
    target: int
    end: Key

    # -- where it leads --------------------------------------------------------------------------------

    def reached(self, *, others: bool = False, loose: bool = False) -> list[set[_Item]]:
        """All that the start leads to, by station.

        ``others``: over blocks of other stations than the source's as well; ``loose``: and by whatever no
        text tells.
        """
        seen: list[set[_Item]] = [set() for _ in self.net.stations]
        seen[self.source].add(self.start)
        opened: set[int] = set()
        waiting: list[tuple[int, _Item]] = [(self.source, self.start)]
        while waiting:
            place, item = waiting.pop()
            found = [*self._next(place, item, others=others)]
            if loose:
                signals = signals_of(self.net.stations[place].program)
                found += [(place, key) for key in signals.writes] if item in signals.steering else ()
                found += self._loosely(place) if place not in opened else ()
                opened.add(place)
            for each in found:
                if each[1] not in seen[each[0]]:
                    seen[each[0]].add(each[1])
                    waiting.append(each)
        return seen

    def arrives(self, seen: list[set[_Item]]) -> bool:
        """Whether the end is among what was reached."""
        return self.end in seen[self.target] or self.end.letter in seen[self.target]

    def _next(self, place: int, item: _Item, *, others: bool) -> Iterator[tuple[int, _Item]]:
        program = self.net.stations[place].program
        if isinstance(item, str):
            yield from ((place, key) for key in signals_of(program).reads if key.letter == item)
            own = self.net.block(place, place)
            if own is not None and item in "MD":
                first, count = (own.bit, own.bits) if item == "M" else (own.word, own.words)
                for address in range(first, first + count):
                    yield from self._over(place, Key(item, address, item == "D"), others=others)
            return
        yield from ((place, each) for each in _steps_of(program)[item])
        if isinstance(item, Key):
            yield from self._over(place, item, others=others)

    def _over(self, place: int, key: Key, *, others: bool) -> Iterator[tuple[int, Key]]:
        """What a device is in the other stations."""
        own = self.net.block(place, place)
        if own is None or key.word is not (key.letter == "D") or not own.holds(key.device):
            return
        for other in range(len(self.net.stations)):
            there = self.net.block(place, other)
            if there is not None and other != place and (others or (place, other) == self.ends):
                yield other, key._replace(address=key.address + (there.word - own.word) * key.word)

    @property
    def ends(self) -> tuple[int, int]:
        """The places of source and target."""
        return self.source, self.target

    def _loosely(self, place: int) -> Iterator[tuple[int, _Item]]:
        """What may follow from anything in a PLC and is in no program's text."""
        station = self.net.stations[place]
        ends = {self.end} if place == self.target else set()
        for key in signals_of(station.program).reads | ends:
            # Flags, times, errors: of anything that the program does.
            if key.letter in "MD" and key.address >= _FIRST_SPECIAL and key.address not in _BY_ITSELF:
                yield place, key
        for at in station.program.instructions if station.program is not None else ():
            if any(operand.index is not None for operand in at.operands):
                for operand, slot in zip(at.operands, at.spec.slots, strict=False):
                    if slot.writes and operand.letter in _LETTERS:
                        yield place, operand.letter
        for other, each in enumerate(self.net.stations):
            if station.buses & each.buses:
                yield from product((other,), _LETTERS)

    # -- what to say about it --------------------------------------------------------------------------

    def answer(self) -> Finding:
        """How it leads there, and if nothing does, why."""
        lead = self._lead()
        return Finding(lead) if lead is not Lead.NONE else self._nothing()

    def _lead(self) -> Lead:
        if self.arrives(self.reached()):
            return Lead.DIRECT
        if self.arrives(self.reached(others=True)):
            return Lead.ROUND
        return Lead.UNKNOWN if self.arrives(self.reached(others=True, loose=True)) else Lead.NONE

    def _nothing(self) -> Finding:
        net, start, end = self.net, self.start, self.end
        a, b = (net.stations[place].name for place in self.ends)
        seen = self.reached()
        if self.source == self.target:
            if not _goes_on(seen[self.source], start):
                return self._stuck(f"the program of {a} does not read {start}")
            return self._short(seen, f"nothing in {a} makes {end} of it")
        if net.mode is None:
            return Finding(Lead.NONE, f"no master polls on {net.bus}")
        if net.block(self.source, self.source) is None:
            return Finding(Lead.NONE, f"{a} is never heard on {net.bus}")
        if net.block(self.target, self.target) is None and net.block(self.source, self.target) is None:
            return Finding(Lead.NONE, f"{b} hears nothing on {net.bus}")
        other = self._other_mode()
        if other is not None:
            stuck = str(start) if self._own(replace(net, mode=other)) else f"what {start} leads to in {a}"
            why = f"{stuck} is in no shared block of mode {net.mode} ({self._sent()})"
            return Finding(Lead.NONE, why, f"refresh mode {other} (D8178) would share it", "from")
        if not seen[self.target]:
            if _goes_on(seen[self.source], start):
                return self._stuck(
                    f"what the program of {a} makes of {start} is in no shared block of mode {net.mode} "
                    f"({self._sent()})"
                )
            bare = net.stations[self.source].program is None
            whose = f"{a} has no program" if bare else f"the program of {a} does not read {start}"
            if start.letter in "MD":
                return self._stuck(
                    f"{start} is in no shared block of mode {net.mode} ({self._sent()}), and {whose}"
                )
            return self._stuck(whose)
        there = self._same()
        if there is not None:
            return self._short(
                seen, f"the link takes {start} to {there}, and nothing in {b} makes {end} of it"
            )
        if not signals_of(net.stations[self.target].program).written(end) and not self.foreign:
            return self._short(seen, f"nothing in {b} writes {end}")
        return self._short(seen, f"what {b} has in {end} does not come from {start}")

    def _own(self, net: Net) -> bool:
        own = net.block(self.source, self.source)
        return own is not None and self.start.letter in "MD" and own.holds(self.start.device)

    def _same(self) -> Device | None:
        """What the link itself makes of the start."""
        return next((key.device for _, key in self._over(self.source, self.start, others=False)), None)

    @property
    def foreign(self) -> bool:
        """Whether the end is in the block of another station."""
        others = (place for place in range(len(self.net.stations)) if place != self.target)
        blocks = [self.net.block(place, self.target) for place in others]
        return any(block is not None and block.holds(self.end.device) for block in blocks)

    def _other_mode(self) -> int | None:
        """The first refresh mode in which it would lead there."""
        common = [mode for mode in self.net.stations[self.source].modes if mode != self.net.mode]
        tried = (replace(self, net=replace(self.net, mode=mode)) for mode in common)
        return next((each.net.mode for each in tried if each.arrives(each.reached())), None)

    def _sent(self) -> str:
        own = self.net.block(self.source, self.source)
        if own is None:
            return "it sends nothing"
        bits = f"M{own.bit} to M{own.bit + own.bits - 1} and " if own.bits else "no bits, "
        name = self.net.stations[self.source].name
        return f"{name} sends {bits}D{own.word} to D{own.word + own.words - 1}"

    def _stuck(self, why: str) -> Finding:
        """It is the start that leads nowhere."""
        return Finding(Lead.NONE, why, self._meant((), self._starts()), "from")

    def _short(self, seen: list[set[_Item]], why: str) -> Finding:
        """The end is not reached, others are."""
        reached = (item for item in seen[self.target] if isinstance(item, Key))
        ends = [
            key
            for key in reached
            if _alike(key, self.end) and (self.target, key) != (self.source, self.start)
        ]
        return Finding(Lead.NONE, why, self._meant(ends, self._starts()), "to")

    def _starts(self) -> Iterator[Key]:
        """Devices of the source that do lead to the end: of the program, or the end's like."""
        signals = signals_of(self.net.stations[self.source].program)
        own, there = self.net.block(self.source, self.source), self.net.block(self.source, self.target)
        known = {key for key in signals.reads | signals.writes if key.word is self.start.word}
        if own is not None and there is not None and there.holds(self.end.device):
            known.add(self.end._replace(address=self.end.address + (own.word - there.word) * self.end.word))
        for key in _nearest(known, self.start, _MOST_TRIED):
            if key.address < _FIRST_SPECIAL and (self.source, key) != (self.target, self.end):
                asked = replace(self, start=key)
                if asked.arrives(asked.reached()):
                    yield key

    def _meant(self, ends: Iterable[Key], starts: Iterable[Key]) -> str:
        source, target = (self.net.stations[place].name for place in self.ends)
        found = [f"{target}.{key}" for key in _nearest(ends, self.end, _MOST_MEANT)]
        others = [f"{source}.{key}" for key in _nearest(starts, self.start, _MOST_MEANT)]
        asked = [" or ".join(found)] if found else []
        asked += [f"{' or '.join(others)} as from"] if others else []
        return f"did you mean {', or '.join(asked)}?" if asked else ""


def _goes_on(seen: set[_Item], start: Key) -> bool:
    """Whether a device leads to anything in its own PLC."""
    return any(isinstance(item, int) or not _same_device(item, start) for item in seen)


def _same_device(item: _Item, start: Key) -> bool:
    return isinstance(item, Key) and item[:2] == start[:2]


def _alike(key: Key, other: Key) -> bool:
    return key.letter == other.letter and key.word is other.word and key != other


def _nearest(keys: Iterable[Key], to: Key, most: int) -> list[Key]:
    """Some of these: those of the same letter first, then by their addresses."""
    order = sorted(set(keys), key=lambda key: (key.letter != to.letter, abs(key.address - to.address), key))
    return order[:most]
