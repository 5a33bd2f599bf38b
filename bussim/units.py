"""Simulated time: an integer count of 1/72 MHz ticks, and its text form with units.

72 MHz is the least rate at which a microsecond (72 ticks) and one bit at 4800, 9600, 19200, 38400,
57600 and 115200 bps (15000, 7500, 3750, 1875, 1250 and 625 ticks) are all whole numbers.
Only the edges of the program (YAML in, tables out) know seconds.
"""

import re
from decimal import Decimal
from fractions import Fraction

from bussim.words.language import say
from bussim.words.tables import recognised

TICKS_PER_SECOND = 72_000_000
TICKS_PER_MS = 72_000
TICKS_PER_US = 72

#: Units a time may be written in, in ticks. ``min``, ``h``, ``d`` and ``y`` (365 days) are for
#: durations of runs and missions.
UNIT_TICKS: dict[str, Fraction] = {
    "ns": Fraction(72, 1000),
    "us": Fraction(TICKS_PER_US),
    "µs": Fraction(TICKS_PER_US),
    "ms": Fraction(TICKS_PER_MS),
    "s": Fraction(TICKS_PER_SECOND),
    "min": Fraction(60 * TICKS_PER_SECOND),
    "h": Fraction(3600 * TICKS_PER_SECOND),
    "d": Fraction(86400 * TICKS_PER_SECOND),
    "y": Fraction(365 * 86400 * TICKS_PER_SECOND),
}

_TIME = re.compile(r"\s*([+-]?(?:\d{1,30}\.?\d{0,30}|\.\d{1,30})(?:[eE][+-]?\d{1,2})?)\s*([^\W\d_]*)\s*")
_SHOWN_UNITS = "ns, us, ms, s, min, h, d, y"
#: What other words for units begin with, in small letters.
_WORDS = {"ms": "msec milli 毫", "us": "usec µsec mic mik 微", "ns": "nsec nano 纳", "min": "minu 分"}
_WORDS |= {"ms or min": "m", "s": "se 秒", "h": "hr ho st 小时 时", "d": "day tag 天 日", "y": "ye ja 年"}


def round_half_up(value: Fraction) -> int:
    """Round an exact number of ticks to a whole one, a half upwards."""
    return (2 * value.numerator + value.denominator) // (2 * value.denominator)


def parse_time(text: str, likely: str = "ms") -> int:
    """Ticks of a time written with its unit, such as ``8 ms``, ``50ms``, ``2 s`` or ``100 us``.

    Raises ValueError, with a message for the user, for a bare number (that it may be of the unit ``likely``),
    an unknown unit or anything that is not a time. Negative times are read; whether one is allowed is the
    caller's business.
    """
    return round_half_up(_exact(text, likely))


def parse_nanoseconds(text: str) -> int:
    """Nanoseconds of a time written as :func:`parse_time` reads it, for what is far below a tick's use."""
    return round_half_up(_exact(text) / UNIT_TICKS["ns"])


def _exact(text: str, likely: str = "ms") -> Fraction:
    match = _TIME.fullmatch(text)
    if match is None:
        dotted = re.sub(r"(\d),(\d)", r"\1.\2", text.strip())
        example = dotted if _TIME.fullmatch(dotted) else "8 ms"
        raise ValueError(say("form_not_a_time", text=text, example=example))
    number, unit = match.group(1), match.group(2).replace("μ", "µ")
    if not unit:
        raise ValueError(say("form_no_unit", number=number, units=_SHOWN_UNITS, likely=likely))
    scale = UNIT_TICKS.get(unit)
    if scale is None:
        raise ValueError(say("form_unit", unit=unit, units=_SHOWN_UNITS, meant=_meant(unit.lower())))
    return Fraction(Decimal(number)) * scale


def _meant(word: str) -> str:
    """The end of a message about an unknown unit, in small letters: the one that is meant."""
    units = (unit for unit, begins in _WORDS.items() if word.startswith(tuple(begins.split())))
    meant = word if word in UNIT_TICKS else next(units, None)
    return say("form_meant", meant=recognised(meant, "unit_")) if meant else ""


def format_time(ticks: int) -> str:
    """A short exact text of a time: ``80 ms``, ``7.9999 s``; :func:`parse_time` reads the same ticks."""
    values = {unit: Fraction(ticks) / UNIT_TICKS[unit] for unit in ("s", "ms", "us")}
    for unit, value in values.items():
        if value.denominator == 1 and abs(value) < 10_000:
            return f"{value.numerator} {unit}"
    for unit, value in values.items():  # rather a few decimals than many digits
        if (value * 10_000).denominator == 1 and abs(value) >= 1:
            return f"{Decimal(value.numerator) / value.denominator:f} {unit}"
    # A tick is 13.888… ns: five decimals of a microsecond name each tick uniquely.
    micros = Decimal(ticks) / Decimal(TICKS_PER_US)
    return f"{micros.quantize(Decimal('0.00001')).normalize():f} us"


def format_nanoseconds(nanoseconds: int) -> str:
    """The text of a time that :func:`parse_nanoseconds` reads back: ``80 ns``, ``1.52 us``."""
    if nanoseconds < 1000:
        return f"{nanoseconds} ns"
    return f"{Decimal(nanoseconds).scaleb(-3).normalize():f} us"


def format_ms(ticks: int) -> str:
    """A time in milliseconds with a microsecond's resolution, for messages: ``40.418 ms``."""
    return f"{ticks / TICKS_PER_MS:.3f}".rstrip("0").rstrip(".") + " ms"


def seconds(ticks: int) -> float:
    """Ticks as seconds, for tables and plots."""
    return ticks / TICKS_PER_SECOND


def nanoseconds(ticks: int) -> int:
    """Ticks as the nearest whole number of nanoseconds (a tick is 125/9 ns, so a half never occurs)."""
    return (ticks * 125 + 4) // 9


def milliseconds(ticks: int | float) -> float:
    """Ticks as milliseconds, for tables and plots."""
    return ticks / TICKS_PER_MS
