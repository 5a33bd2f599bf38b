"""A layout proposed from bursts of which it is known who sent them.

Every frame that no party complained of obeys one layout. The sum is the rule among the usual ones, over the
usual ranges, that is right in most frames. The station is what differs by who speaks and by who is asked,
the counter what counts from scan to scan and is the same within one; what never changes before them is the
header. What lies between them, an end character and the sum is data.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise, product
from typing import NamedTuple

from bussim.engines.nn.frames import MODES, LinkSettings
from bussim.live.layout.silences import Polling
from bussim.live.layout.sums import ADDED, DIGITS, FORMS, KINDS, Number, Sum
from bussim.live.layout.value import Layout

#: A rule holds if so many of the frames obey it; noise damages the others.
_NEARLY_ALL, _MOST = 0.95, 0.6
#: Frames by which a rule is tried.
_TRIED = 24
#: Characters at either end of a frame among which station and counter are looked for.
_ENDS = 8
#: Characters left out of the sum at the begin of a frame, and before the sum, the likeliest first.
_LEFT_OUT = tuple(product((1, 0, 2, 3, 4), (0, 1, 2)))
_NUMBERS = tuple(Number(form, size) for size in (2, 1) for form in FORMS)


class _Seen(NamedTuple):
    """A frame: who sent it or is asked, in which scan, and its characters."""

    station: int
    scan: int
    chars: bytes


class _Rule(NamedTuple):
    """A sum, and how many characters it leaves out before and behind; ``tail`` follow the sum."""

    sum: Sum
    before: int
    behind: int
    tail: int

    def right(self, chars: bytes) -> bool:
        """Whether the sum of a frame is right."""
        at = len(chars) - self.tail - self.sum.size
        return at - self.behind > self.before and self.sum.right(
            chars[self.before : at - self.behind], chars[at : at + self.sum.size]
        )


def propose(polling: Polling) -> Layout | None:
    """A layout that the frames of a line obey; None where none of the usual ones is found."""
    polls, data = _alike(_polls(polling)), _alike(_data(polling))
    if not polls or not data:
        return None
    pair = _both_rules(data, polls)
    if pair is None:
        return None
    rule, poll_rule = pair
    stop = len(data[0].chars) - rule.tail - rule.sum.size
    poll_stop = len(polls[0].chars) - poll_rule.tail - poll_rule.sum.size
    for station in _NUMBERS:
        found, asked = _stations(data, station, stop), _stations(polls, station, poll_stop)
        both = [(at, poll_at, master) for master, at in found for other, poll_at in asked if master == other]
        if both:
            at, poll_at, master = both[0]
            break
    else:
        return None
    counter, counter_at, poll_counter_at, modulo = _counter(
        (data, {*range(at, at + station.size)}, stop),
        (polls, {*range(poll_at, poll_at + station.size)}, poll_stop),
    )
    fields, poll_fields = {at: ("station", station.size)}, {poll_at: ("station", station.size)}
    if counter:
        fields[counter_at] = poll_fields[poll_counter_at] = ("counter", counter.size)
    begin, end, form = _data_at(data, fields, stop)
    fields[begin] = ("data", end - begin)
    binary = form == "binary"
    layout = Layout(
        orders={"data": _order(data, fields, rule), "poll": _order(polls, poll_fields, poll_rule)},
        station=station,
        counter=counter,
        sum=rule.sum,
        master=master,
        modulo=modulo,
        data=form,
        data_bytes=end - begin if binary else None,
    )
    behind = {at - end: field for at, field in fields.items() if at >= end}
    return _with_parameters(layout, polling, rule, stop - end, behind)


def _polls(polling: Polling) -> Iterator[_Seen]:
    for number, scan in enumerate(polling.scans):
        for each in scan.attempts:
            if each.station and each.reply is not None and not each.poll.wrong:
                yield _Seen(each.station, number, each.poll.chars)


def _data(polling: Polling) -> Iterator[_Seen]:
    """Frames of the master's data, and replies with which it was content."""
    for number, scan in enumerate(polling.scans):
        if scan.begin is not None and not scan.begin.wrong:
            yield _Seen(0, number, scan.begin.chars)
        for each in scan.attempts:
            if each.station and each.reply is not None and not each.failed and not each.reply.wrong:
                yield _Seen(each.station, number, each.reply.chars)


def _alike(frames: Iterator[_Seen]) -> list[_Seen]:
    """The frames of the commonest length."""
    every = list(frames)
    size = Counter(len(each.chars) for each in every).most_common(1)
    return [each for each in every if len(each.chars) == size[0][0]]


def _constant(frames: Sequence[_Seen], at: int) -> int | None:
    """The character that nearly all frames have at an index, None where it changes."""
    char, count = Counter(each.chars[at] for each in frames).most_common(1)[0]
    return char if count >= _NEARLY_ALL * len(frames) else None


# -- sums --------------------------------------------------------------------------------------


def _both_rules(data: Sequence[_Seen], polls: Sequence[_Seen]) -> tuple[_Rule, _Rule] | None:
    """The rules of data frames and of polls: of one sum, right in most, the likeliest of equal ones."""
    pairs: dict[tuple[_Rule, _Rule], tuple[float, bool]] = {}
    rules = _rules(data, None)
    most = max(rules.values(), default=0)
    for rule, count in rules.items():
        if count >= _NEARLY_ALL * most:
            for other, right in _rules(polls, rule).items():
                pairs[rule, other] = (count / len(data) + right / len(polls), other.before == rule.before)
    best = max((total for total, _ in pairs.values()), default=0.0)
    alike = [pair for pair, (total, same) in pairs.items() if total >= best - 1 + _NEARLY_ALL and same]
    return next(iter(alike or pairs), None)


def _rules(frames: Sequence[_Seen], like: _Rule | None) -> dict[_Rule, int]:
    """Rules that most frames obey, and how many do, the likeliest first; ``like``: those of the same sum."""
    contents = [each.chars for each in frames]
    tried = list(dict.fromkeys(contents))[:_TRIED]
    tails = [0]
    while len(tails) < 4 and _constant(frames, -len(tails)) is not None:
        tails.append(len(tails))
    if like is not None:
        tails.sort(key=lambda tail: tail != like.tail)
    sums = list(_sums()) if like is None else [like.sum]
    ranges = _LEFT_OUT if like is None else ((like.before, 0), *_LEFT_OUT)
    rules = [
        _Rule(made, before, behind, tail) for made, tail, (before, behind) in product(sums, tails, ranges)
    ]
    found = [rule for rule in rules if _right(rule, tried)]
    if not found and like is None:  # what no range explains may be a number that is added
        found = [one for rule in rules if rule.sum.kind in ADDED and (one := _started(rule, tried))]
    return {rule: right for rule in found if (right := _right(rule, contents))}


def _right(rule: _Rule, contents: Sequence[bytes]) -> int:
    """In how many frames the sum is right, 0 where not in most."""
    most_wrong = (1 - _MOST) * len(contents)
    wrong = 0
    for chars in contents:
        wrong += not rule.right(chars)
        if wrong > most_wrong:
            return 0
    return len(contents) - wrong


def _sums() -> Iterator[Sum]:
    """The usual sums, the likeliest first."""
    for of, (kind, (_, sizes)), form in product(("characters", "bytes"), KINDS.items(), FORMS):
        for bits in sizes:
            yield Sum(kind, bits, form, of=of)
            if bits == 16 and form != "decimal":
                yield Sum(kind, bits, form, low_first=True, of=of)


def _started(rule: _Rule, contents: Sequence[bytes]) -> _Rule | None:
    """The rule with the number that is added to the sum in most frames; None where there is none."""
    starts: Counter[int] = Counter()
    for chars in contents:
        at = len(chars) - rule.tail - rule.sum.size
        sent = rule.sum.sent(chars[at : at + rule.sum.size]) if at > 0 else None
        value = rule.sum.value(chars[rule.before : at - rule.behind])
        if sent is not None and value is not None:
            starts[(sent - value) % (1 << rule.sum.bits)] += 1
    start, count = max(starts.items(), key=lambda item: item[1], default=(0, 0))
    return rule._replace(sum=rule.sum._replace(start=start)) if count >= _MOST * len(contents) else None


# -- fields ------------------------------------------------------------------------------------


def _places(size: int, stop: int) -> list[int]:
    """Where a field of so many characters may stand before the sum: at either end of a frame."""
    return [at for at in range(stop - size + 1) if at < _ENDS or at > stop - _ENDS]


def _stations(frames: Sequence[_Seen], number: Number, stop: int) -> list[tuple[int, int]]:
    """Where the number of a station may stand, each with what the master's is then."""
    found = []
    for at in _places(number.size, stop):
        masters: Counter[int] = Counter()
        for each in frames:
            value = number.read(each.chars[at : at + number.size])
            if value is not None:
                masters[value - each.station] += 1
        if masters:
            master, count = masters.most_common(1)[0]
            if master >= 0 and count >= _NEARLY_ALL * len(frames):
                found.append((master, at))
    return found


_Frames = tuple[list[_Seen], set[int], int]


def _counter(data: _Frames, polls: _Frames) -> tuple[Number | None, int, int, int]:
    """The counter that both kinds of frames have: how it is written, where in each, and its modulo."""
    for number in _NUMBERS:
        both = [_counts(*frames, number) for frames in (data, polls)]
        if both[0] and both[1]:
            (at, modulo), (poll_at, _) = both[0], both[1]
            return number, at, poll_at, modulo or number.values
    return None, 0, 0, 1


def _counts(frames: Sequence[_Seen], taken: set[int], stop: int, number: Number) -> tuple[int, int] | None:
    """Where a number counts the scans, and how many values it has; 0: it was not seen to begin again."""
    for at in _places(number.size, stop):
        places = range(at, at + number.size)
        if taken.intersection(places) or _constant(frames, at) is not None:
            continue
        values: dict[int, Counter[int | None]] = {}
        for each in frames:
            values.setdefault(each.scan, Counter())[number.read(each.chars[at : at + number.size])] += 1
        usual = {scan: counts.most_common(1)[0] for scan, counts in values.items()}
        if sum(count for _, count in usual.values()) < _NEARLY_ALL * len(frames):
            continue
        steps: Counter[int] = Counter()
        for (scan, (value, _)), (after, (following, _)) in pairwise(sorted(usual.items())):
            if after == scan + 1:
                steps[0 if value is None or following is None else following - value] += 1
        back = [-step for step in steps if step < 0]
        again = max(back, key=lambda step: steps[-step], default=0)
        if steps and steps[1] + steps[-again] * (again > 0) >= _NEARLY_ALL * sum(steps.values()):
            return at, again + 1 if again else 0
    return None


def _data_at(frames: Sequence[_Seen], fields: dict[int, tuple[str, int]], stop: int) -> tuple[int, int, str]:
    """Where data begin and end, and their form: between the fields at the begin and those at the end."""
    half = stop // 2
    begin = max((at + size for at, (_, size) in fields.items() if at < half), default=0)
    end = min((at for at in fields if at >= half), default=stop)

    def form_of(first: int, last: int) -> str:
        for form in ("hex", "hex-lower"):
            digits = DIGITS[form]
            if sum(digits.issuperset(each.chars[first:last]) for each in frames) >= _MOST * len(frames):
                return form
        return "binary"

    ends = (0x20, 0x7F) if form_of(begin, end - 1) == "binary" else (0x30, 0x80)
    while end > begin and (char := _constant(frames, end - 1)) is not None:
        if not 0 < char < ends[0] and char < ends[1]:
            break
        end -= 1
    form = form_of(begin, end)
    digits = 1 if form == "binary" else 2
    sizes = {digits * block.size for block in MODES}
    # What stands before a block of a mode is no part of it.
    more = next((extra for extra in range(_ENDS) if end - begin - extra in sizes), (end - begin) % digits)
    return begin + more, end, form


def _order(
    frames: Sequence[_Seen], fields: dict[int, tuple[str, int]], rule: _Rule
) -> tuple[tuple[int | str, bool], ...]:
    """The parts of a frame, those under the sum marked."""
    size = len(frames[0].chars)
    stop = size - rule.tail - rule.sum.size
    fields = fields | {stop: ("sum", rule.sum.size)}
    order: list[tuple[int | str, bool]] = []
    at = 0
    while at < size:
        summed = rule.before <= at < stop - rule.behind
        name, length = fields.get(at, ("", 1))
        char = _constant(frames, at)
        order.append((name or ("any" if char is None else char), summed))
        at += length
    return tuple(order)


def _with_parameters(
    layout: Layout, polling: Polling, rule: _Rule, end: int, behind: dict[int, tuple[str, int]]
) -> Layout:
    """The layout with the frame that carries the settings, if one was heard that can be read.

    ``end`` are the characters between its settings and the sum, ``behind`` the fields there, as behind data.
    """
    for scan in polling.scans:
        for burst in scan.before:
            chars = burst.chars
            stop = len(chars) - rule.tail - rule.sum.size
            settings = stop - end - len(LinkSettings._fields) * layout.digits
            counter = layout.counter.size if layout.counter and not behind else 0
            if settings - counter < 1:
                continue
            fields = {stop - end + at: field for at, field in behind.items()}
            fields[settings] = ("settings", stop - end - settings)
            if counter:
                fields[settings - counter] = ("counter", counter)
            order = _order([_Seen(0, 0, chars)], fields, rule)
            found = replace(layout, orders={**layout.orders, "parameters": order})
            frame = found.decode_as(found.frames[-1], chars)
            if frame is not None and frame.settings and frame.settings.slaves == polling.stations:
                return found
    return layout
