"""What a sweep varies: ``--vary key.path=…`` as a list of values, and the grid of several of them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal, localcontext
from fractions import Fraction
from itertools import product
from math import floor, prod

from bussim.errors import UsageError
from bussim.scenario.yaml.overrides import Override
from bussim.scenario.yaml.parser import read
from bussim.units import UNIT_TICKS, format_time, parse_time
from bussim.wording import RawFloat, RawInt, shorten

#: Most runs of a sweep: points times repeats.
MAX_RUNS = 100_000

_FORMS = "expected key.path=a:b:step, key.path=a:b:logN or key.path=value,value,…"
_PART = re.compile(r"\s*([+-]?(?:\d{1,30}\.?\d{0,30}|\.\d{1,30})(?:[eE][+-]?\d{1,2})?)\s*([A-Za-zµμ]*)\s*")
_LOG = re.compile(r"\s*log\s*(\d{1,9})\s*")
_NESTED = frozenset("[]{}\"'")
#: Significant digits of the values of a logarithmic range.
_LOG_DIGITS = 6


@dataclass(frozen=True, slots=True)
class Value:
    """One value of a key: ``text`` as it is set, and ``same``, equal for equal values (50ms, 50 ms).

    ``number`` is its amount in ``unit`` (of a plain number: ""), None for a text or a flag.
    """

    text: str
    same: str
    number: int | float | None = None
    unit: str = ""

    @property
    def canonical(self) -> str:
        """The text that equal values share."""
        ticks, _, is_time = self.same.partition(" ")
        if is_time == "ticks" and ticks.isdigit():
            return format_time(int(ticks))
        return self.text if self.number is None else self.same


@dataclass(frozen=True, slots=True)
class Axis:
    """A key and the values that it takes, all different. ``given`` is the text of the user.

    ``unit`` is that of all values, "" for plain numbers, None where they are not all numbers or
    not all times.
    """

    key: str
    values: tuple[Value, ...]
    given: str
    unit: str | None

    @classmethod
    def parse(cls, text: str) -> Axis:
        """The axis of a ``--vary`` text. Raises UsageError for one that cannot be understood.

        ``a:b:step`` has the values a, a + step and so on up to b, which is one of them if the steps
        meet it; ``a:b:logN`` has N values from a to b, each the same multiple of the one before,
        rounded to 6 digits. Both may be times with units.
        """
        label = _label(text)
        key, equals, given = text.partition("=")
        key = key.strip()
        if not equals or not key:
            raise UsageError(f"{label}: {_FORMS}, such as plcs.press1.nn.retries=0:5:1")
        parts = given.split(":")
        if len(parts) == 3 and "," not in given and not _NESTED & set(given):
            values = _range(parts, label)
        else:
            values = [_value(item, label) for item in _items(given, label)]
        seen: dict[str, str] = {}
        for value in values:
            if value.same in seen:
                known = seen[value.same]
                again = "there twice" if known == value.text else f"the same as {shorten(known)}"
                raise UsageError(f"{label}: {shorten(value.text)} is {again}")
            seen[value.same] = value.text
        in_one, unit = _one_unit(values)
        return cls(key, in_one, text, unit)

    @property
    def column(self) -> str:
        """The heading of its column in tables: the key, with the unit of times."""
        return f"{self.key}_{self.unit}" if self.unit else self.key

    def override(self, value: Value, *, as_given: bool = False) -> Override:
        """What sets a value; messages call it by the value, or by the whole text of the user."""
        label = _label(self.given if as_given else f"{self.key}={value.text}")
        return Override(self.key, value.text, label)


#: A point of the grid: a value for every axis.
Point = tuple[Value, ...]


def parse_axes(texts: Iterable[str], taken: Iterable[str] = ()) -> tuple[Axis, ...]:
    """The axes of all ``--vary`` texts; ``taken`` are keys that are set to one value beside them.

    Raises UsageError with every mistake.
    """
    axes: list[Axis] = []
    mistakes: list[str] = []
    used = set(taken)
    for text in texts:
        try:
            axis = Axis.parse(text)
        except UsageError as error:
            mistakes.append(str(error))
            continue
        if axis.key in used:
            other = "varied twice" if any(axis.key == known.key for known in axes) else "varied and set"
            mistakes.append(f"{_label(text)}: {shorten(axis.key)} is {other}")
        used.add(axis.key)
        axes.append(axis)
    if not axes and not mistakes:
        mistakes.append(f"a sweep needs a key to vary, --vary; {_FORMS}")
    if mistakes:
        raise UsageError("\n".join(mistakes))
    return tuple(axes)


def grid(axes: Sequence[Axis], repeat: int) -> list[Point]:
    """Every combination of values, the last axis changing fastest.

    Raises UsageError for more than MAX_RUNS runs, ``repeat`` at every point.
    """
    if repeat < 1:
        raise UsageError(f"--repeat is {repeat}, allowed 1..{MAX_RUNS}")
    sizes = [len(axis.values) for axis in axes]
    runs = prod(sizes) * repeat
    if runs > MAX_RUNS:
        counts = " × ".join(f"{size:,}" for size in sizes)
        repeats = f" with {repeat:,} repeats each" if repeat > 1 else ""
        raise UsageError(
            f"{counts} points{repeats} are {_shown(runs)} runs, allowed {MAX_RUNS:,}; take fewer values or "
            "repeats"
        )
    return list(product(*(axis.values for axis in axes)))


def _label(text: str) -> str:
    return f"--vary {shorten(text)}"


def _items(given: str, label: str) -> list[str]:
    """The items of a list, split at the commas that are outside of brackets and quotes."""
    items, depth, quote, start = [], 0, "", 0
    for index, char in enumerate(given):
        if quote:
            quote = "" if char == quote else quote
        elif char in "\"'":
            quote = char
        elif char in "[{":
            depth += 1
        elif char in "]}":
            depth -= 1
        elif char == "," and depth == 0:
            items.append(given[start:index])
            start = index + 1
            _check_count(len(items), label)
    items.append(given[start:])
    if any(not item.strip() for item in items):
        raise UsageError(f"{label}: a value is missing; {_FORMS}")
    return [item.strip() for item in items]


def _check_count(count: int, label: str) -> None:
    if count > MAX_RUNS:
        raise UsageError(f"{label}: {_shown(count)} values, allowed {MAX_RUNS:,}")


def _shown(count: int) -> str:
    return f"{count:,}" if count <= 10**12 else "more than 10^12"


def _value(text: str, label: str) -> Value:
    """A value of a list, read as the scenario will read it."""
    data, _, problems = read(text, label)
    if problems:
        raise UsageError(f"{label}: {problems[0].message}")
    if isinstance(data, RawInt):
        return Value(text, str(int(data)), int(data))
    if isinstance(data, RawFloat):
        number = float(data)
        return Value(text, str(int(number)) if number.is_integer() else repr(number), number)
    if isinstance(data, str):
        try:
            ticks = parse_time(data)
        except ValueError:
            return Value(text, f"text {data}")
        amount, unit = _split(data)
        return _time(amount, unit, ticks, text)
    return Value(text, f"data {data!r}")


def _split(text: str) -> tuple[Decimal, str]:
    """Number and unit of a text that has them."""
    match = _PART.fullmatch(text)
    if match is None:
        raise ValueError(text)
    return Decimal(match.group(1)), match.group(2).replace("μ", "µ").replace("µs", "us")


def _time(amount: Decimal, unit: str, ticks: int, text: str | None = None) -> Value:
    return Value(text or f"{_plain(amount)} {unit}", f"{ticks} ticks", _number(amount), unit)


def _number(amount: Decimal) -> int | float:
    return int(amount) if amount == amount.to_integral_value() else float(amount)


def _range(parts: Sequence[str], label: str) -> list[Value]:
    """The values of a:b:step or a:b:logN."""
    log = _LOG.fullmatch(parts[2])
    limits, unit = _in_one_unit(parts[:2] if log else parts, label)
    if log:
        amounts = _logarithmic(limits[0], limits[1], int(log.group(1)), label)
    else:
        amounts = _linear(limits[0], limits[1], limits[2], label)
    values = []
    for amount in amounts:
        if unit:
            values.append(_time(amount, unit, parse_time(f"{_plain(amount)} {unit}")))
        else:
            number = _number(amount)
            same = str(number) if isinstance(number, int) else repr(number)
            values.append(Value(_plain(amount), same, number))
    return values


def _in_one_unit(parts: Sequence[str], label: str) -> tuple[list[Decimal], str]:
    """Numbers with units, in the smallest of these units ("" for plain numbers)."""
    amounts: list[Decimal] = []
    units: list[str] = []
    for part in parts:
        try:
            amount, unit = _split(part)
        except ValueError:
            shown = shorten(part.strip()) or "nothing"
            raise UsageError(f"{label}: {shown} is not a number or a time; {_FORMS}") from None
        if unit and unit not in UNIT_TICKS:
            raise UsageError(f"{label}: {shorten(part)} has the unit {unit!r}; allowed are {_units()}")
        amounts.append(amount)
        units.append(unit)
    if len(set(units)) > 1 and "" in units:
        bare = shorten(parts[units.index("")].strip())
        raise UsageError(f"{label}: {bare} has no unit, other values have; allowed are {_units()}")
    smallest = min(units, key=lambda unit: UNIT_TICKS.get(unit, Fraction(0)))
    if not smallest:
        return amounts, ""
    # Every unit is a whole multiple of each smaller one.
    factors = [int(UNIT_TICKS[unit] / UNIT_TICKS[smallest]) for unit in units]
    return [amount * factor for amount, factor in zip(amounts, factors, strict=True)], smallest


def _units() -> str:
    return ", ".join(unit for unit in UNIT_TICKS if unit != "µs")


def _linear(first: Decimal, last: Decimal, step: Decimal, label: str) -> list[Decimal]:
    if step == 0:
        raise UsageError(f"{label}: the step is 0")
    # As fractions: the digits of a Decimal's quotient are limited.
    steps = (Fraction(last) - Fraction(first)) / Fraction(step)
    if steps < 0:
        raise UsageError(f"{label}: steps of {_plain(step)} from {_plain(first)} never reach {_plain(last)}")
    count = floor(steps) + 1
    _check_count(count, label)
    with localcontext() as context:
        context.prec = 100
        return [first + number * step for number in range(count)]


def _logarithmic(first: Decimal, last: Decimal, count: int, label: str) -> list[Decimal]:
    if count < 2:
        raise UsageError(f"{label}: log{count} is no range; N of logN is at least 2")
    _check_count(count, label)
    if first <= 0 or last <= 0:
        raise UsageError(f"{label}: a logarithmic range begins and ends above 0")
    with localcontext() as context:
        context.prec = 40
        ratio = last / first
        inner = [first * ratio ** (Decimal(number) / (count - 1)) for number in range(1, count - 1)]
        context.prec = _LOG_DIGITS
        return [first, *(+value for value in inner), last]


def _plain(amount: Decimal) -> str:
    """A number as YAML reads it: 0.01, 50, 1e-4, 3.16228e-6."""
    amount = amount.normalize()
    return f"{amount:f}" if -4 < amount.adjusted() < 15 else f"{amount:e}".replace("e+", "e")


def _one_unit(values: Sequence[Value]) -> tuple[tuple[Value, ...], str | None]:
    """The values with their numbers in one unit, where they all are times or all plain numbers."""
    units = {value.unit for value in values}
    if any(value.number is None for value in values) or ("" in units and len(units) > 1):
        return tuple(Value(value.text, value.same) for value in values), None
    if len(units) == 1:
        return tuple(values), units.pop()
    smallest = min(units, key=UNIT_TICKS.__getitem__)
    scaled = []
    for value in values:
        factor = int(UNIT_TICKS[value.unit] / UNIT_TICKS[smallest])
        amount = _split(value.text.strip("\"'"))[0] * factor
        scaled.append(Value(value.text, value.same, _number(amount), smallest))
    return tuple(scaled), smallest
