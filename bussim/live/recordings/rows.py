"""Lines of a text file with the bytes of a line: the general form, and that of loggers known by name.

::

    # seconds  bytes in hexadecimal
    0.000000   01 03 00 00 00 0A C5 CD
    2026-01-05 08:00:01.008 Rx: 01-03-14-00

A row is a time, an optional direction, and bytes, in this order; blanks, tabs, commas and semicolons
separate them. ``bussim guide wires`` lists the forms.
"""

import csv
import re
from collections.abc import Iterable, Iterator
from datetime import date
from typing import NamedTuple

from bussim.live.arrival import PARITY, STOP
from bussim.units import TICKS_PER_SECOND

_DAY = 86_400 * TICKS_PER_SECOND
#: Units of times, and words for them in headings: how many are a second.
_UNITS = {"s": 1, "ms": 1_000, **dict.fromkeys(("us", "µs", "μs"), 1_000_000), "ns": 1_000_000_000}
_WORDS = {"毫秒": 1_000, "milli": 1_000, "微秒": 1_000_000, "micro": 1_000_000, "纳秒": 1_000_000_000}
_HEX = "[0-9A-Fa-f]{2}"
_SPACES = r"[\s,;]*"
#: Words for directions, and whether they mean what is sent.
_DIRECTIONS = {
    **dict.fromkeys(("tx", "send", "req", ">", ">>>", "->", "发送", "发→◇", "发"), 0),
    **dict.fromkeys(("rx", "recv", "rsp", "<", "<<<", "<-", "接收", "收←◆", "收"), 1),
}
_CLOCK = (
    r"(?:(?P<date>\d{4}[-/]\d\d[-/]\d\d)[T ])?(?P<clock>\d\d?:\d\d:\d\d)(?:[.,](?P<part>\d{1,18}))?"
    r"(?:\s?(?P<zone>Z|[+-]\d\d:?\d\d)(?!\S))?"
)
_NUMBER = (
    r"(?P<seconds>\d{{1,12}})(?:[.{comma}](?P<fraction>\d{{1,18}}))?(?:\s?(?P<unit>s|ms|us|µs|μs)(?![\w]))?"
)
_REST = (
    rf"(?(open)\])(?=[\s,;\[发收]|:\s):?{_SPACES}(?:\[(?!{_HEX}\])[^\]]*\]:?{_SPACES})*"
    rf"(?:(?P<direction>(?:tx|rx|send|recv|req|rsp|>>>|<<<|->|<-|>|<(?!{_HEX}>))(?![0-9A-Za-z])"
    rf"|发送|接收|发→◇|收←◆|发|收)\s*(?::|：|->|<-)?{_SPACES})?"
    r"(?P<data>\S.*)"
)
_ROWS = {
    comma: re.compile(
        rf"(?P<open>\[)?(?:{_CLOCK}|{_NUMBER.format(comma=',' if comma else '')}){_REST}", re.IGNORECASE
    )
    for comma in (False, True)
}
#: The ways to write bytes that Python does not read by itself, one in a line.
_BYTES = [
    re.compile(pattern)
    for pattern in (
        *(rf"{_HEX}(?:\s?{separator}\s?{_HEX})*" for separator in (":", "-", ",", ";")),
        r"0[xX][0-9A-Fa-f]{1,2}(?:[\s,;:-]+0[xX][0-9A-Fa-f]{1,2})*",
        rf"\[{_HEX}\](?:\s?\[{_HEX}\])*",
        rf"<{_HEX}>(?:\s?<{_HEX}>)*",
    )
]
_BYTE = re.compile(r"(?:0[xX])?([0-9A-Fa-f]{1,2})")
_COMMA_TIME = re.compile(r"\d+,\d+[\s;,]+\S")


class Row(NamedTuple):
    """Bytes that came at once, in a line. ``tick`` is their time, None where the file has none.

    ``wire`` is their sender where the file does, else None; ``flag`` is what was wrong with a single
    character; ``bare``: the time is no date, clock or epoch, and stays as it is.
    """

    line: int
    tick: int | None
    data: bytes
    wire: int | None = None
    flag: int = 0
    bare: bool = True


class Unreadable(NamedTuple):
    """A line that cannot be read, and why."""

    line: int
    reason: str


#: What the lines of a file become; None: nothing that counts (comments, headings, known chatter).
Rows = Iterator[Row | Unreadable | None]


def bytes_of(text: str) -> bytes | None:
    """Bytes in hexadecimal, in one of the ways to write them; None for anything else."""
    try:
        return bytes.fromhex(text)
    except ValueError:
        for pattern in _BYTES:
            if pattern.fullmatch(text):
                return bytes(int(digits, 16) for digits in _BYTE.findall(text))
    return None


def _ticks(whole: str, part: str | None, per_second: int = 1) -> int:
    part = part or ""
    ticks: int = int(whole + part) * TICKS_PER_SECOND // (per_second * 10 ** len(part))
    return ticks


def _tick(found: re.Match[str], per_second: int = 1) -> int | None:
    """The time of a row, in ticks; None if there is no such time of a day."""
    if found["clock"] is None:
        unit = found["unit"]
        return _ticks(found["seconds"], found["fraction"], _UNITS[unit.lower()] if unit else per_second)
    return _clock(found["date"], found["clock"], found["part"], found["zone"])


def _clock(day: str | None, clock: str, part: str | None, zone: str | None = None) -> int | None:
    hours, minutes, seconds = map(int, clock.split(":"))
    if hours > 23 or minutes > 59 or seconds > 60:
        return None
    ticks = _ticks(str(3600 * hours + 60 * minutes + seconds), part)
    if day is not None:
        try:
            ticks += date.fromisoformat(day.replace("/", "-")).toordinal() * _DAY
        except ValueError:
            return None
    if zone and zone[0] in "+-":
        offset = (int(zone[1:3]) * 60 + int(zone[-2:])) * 60 * TICKS_PER_SECOND
        ticks -= offset if zone[0] == "+" else -offset
    return ticks


def general(lines: Iterable[str], heading: str, *, decimal_comma: bool) -> Rows:
    """Rows of the general form. ``heading`` is the name of the first column, "" where columns have none."""
    match, per_second = _ROWS[decimal_comma].match, _unit_of(heading)
    for number, line in enumerate(lines, 1):
        text = line.partition("#")[0].strip(" \t\r\n,;\ufeff")
        if not text:
            yield None
            continue
        found = match(text)
        if found is None:
            yield (None if heading else Unreadable(number, f"{text[:40]!r} has no time, or no bytes"))
            heading = ""
            continue
        data = bytes_of(found["data"])
        if data is None:
            yield Unreadable(number, f"{found['data'][:40]!r} are no bytes in hexadecimal")
            continue
        tick = _tick(found, per_second)
        if tick is None:
            yield Unreadable(number, f"{text[:30]!r} is no time of a day")
            continue
        word = found["direction"]
        wire = None if word is None else _DIRECTIONS[word.lower()]
        yield Row(number, tick, data, wire, bare=found["clock"] is None)


def _unit_of(heading: str) -> int:
    """How many of the units of a column's name are a second: "time_ms" has 1000."""
    found = re.search(r"(?<![a-z])(ms|us|µs|μs|ns)(?![a-z])|" + "|".join(_WORDS), heading.lower())
    return (_UNITS | _WORDS)[found[0]] if found else 1


def decimals(line: str, heading: str, decimal_comma: bool) -> int:  # noqa: FBT001 - a form of times
    """Decimals of a line's time in seconds."""
    found = _ROWS[decimal_comma].match(line.strip())
    if found is None:
        other = re.search(r"\d\.(\d+)", line)  # of a logger that is known by name
        return len(other[1]) if other else 0
    unit = _UNITS[found["unit"].lower()] if found["unit"] else _unit_of(heading)
    return len(found["part"] or found["fraction"] or "") + (len(str(unit)) - 1 if found["seconds"] else 0)


# -- Saleae Logic ----------------------------------------------------------------------------------------


def saleae(lines: Iterable[str], heading: list[str]) -> Rows:
    """The CSV of Saleae Logic 1 or 2: a character a line, with its first edge."""
    at = {name: index for index, name in reversed(list(enumerate(heading)))}
    time_at = at.get("start_time", 0)
    data_at = at.get("data", at.get("value", 1))
    errors = [(index, PARITY if "parity" in name else STOP) for name, index in at.items() if "error" in name]
    wires: dict[str, int] = {}
    begun = False
    for number, line in enumerate(lines, 1):
        if not begun or not line.strip():
            begun = begun or not line.startswith("#")
            yield None
            continue
        try:
            fields = next(csv.reader((line.strip(),)))
        except csv.Error as error:
            yield Unreadable(number, str(error))
            continue
        if "type" in at and len(fields) > at["type"] and fields[at["type"]] != "data":
            yield None
            continue
        found, value = None, None
        if len(fields) > max(time_at, data_at):
            # Times before the trigger are negative.
            found, value = _ROWS[False].match(f"{fields[time_at].lstrip('-')} 00"), _value(fields[data_at])
        tick = None if found is None else _tick(found)
        if found is None or tick is None or value is None:
            yield Unreadable(number, f"{line.strip()[:40]!r} has no time and value")
            continue
        tick = -tick if fields[time_at].startswith("-") else tick
        flag = 0
        for index, wrong in errors:
            if index < len(fields) and fields[index].strip():
                flag |= STOP if "framing" in fields[index].lower() else wrong
        wire = wires.setdefault(fields[at["name"]], len(wires)) if "name" in at else None
        yield Row(number, tick, bytes((value,)), wire, flag, bare=found["clock"] is None)


def _value(text: str) -> int | None:
    """A character's value: hexadecimal with 0x, else decimal."""
    try:
        value = int(text, 16) if text.lower().startswith("0x") else int(text)
    except ValueError:
        return None
    return value if 0 <= value <= 0xFF else None


# -- socat -x, -x -v -------------------------------------------------------------------------------------

_SOCAT = re.compile(
    r"([<>])\s+(\d{4}/\d\d/\d\d)\s(\d\d:\d\d:\d\d)(?:\.(\d+))?\s+length=(\d+)\s+from=\d+\s+to=\d+"
)
_SOCAT_LINE = re.compile(rf"\s(?:{_HEX}(?:\s(?={_HEX}\b))?)+")
_SOCAT_CHATTER = re.compile(r"--$|\d{4}/\d\d/\d\d \d\d:\d\d:\d\d socat\[")


def socat(lines: Iterable[str]) -> Rows:
    """What ``socat -x`` prints, with ``-v`` or without: a header with the length, then bytes."""
    head: re.Match[str] | None = None
    data, missing, begun = b"", 0, 0
    for number, line in enumerate(lines, 1):
        text = line.rstrip()
        found = _SOCAT.match(text)
        if found or (missing and text == "--"):
            if missing:
                yield Unreadable(begun, f"{missing} of its bytes are missing")
            head, data, missing, begun = found, b"", int(found[5]) if found else 0, number
            continue
        if missing and head is not None:
            part = _SOCAT_LINE.match(line)
            if part is None:
                yield Unreadable(begun, "its bytes are missing")
                missing = 0
                continue
            data += bytes.fromhex(part[0])[:missing]
            missing = int(head[5]) - len(data)
            if not missing:
                tick = _clock(head[2], head[3], head[4])
                yield (
                    Row(begun, tick, data, int(head[1] == "<"), bare=False)
                    if tick
                    else Unreadable(begun, "no time")
                )
        elif not text or _SOCAT_CHATTER.match(text):
            yield None
        else:
            yield Unreadable(number, f"{text[:40]!r} belongs to no header")
    if missing:
        yield Unreadable(begun, f"{missing} of its bytes are missing")


def is_socat(line: str) -> bool:
    """Whether a line is a header of socat."""
    return _SOCAT.match(line) is not None


# -- mbpoll -v and libmodbus ------------------------------------------------------------------------------

_LIBMODBUS = re.compile(rf"(?:\[{_HEX}\])+|(?:<{_HEX}>)+")
_LIBMODBUS_CHATTER = re.compile(
    r"mbpoll|Copyright|This (?:program|is free)|under certain|Opening|Protocol|Slave|Communication|Data type"
    r"|start reference|t/o|-- Polling|\[\d+\]:|Waiting|Bytes|Sending|ERROR|CRC|LRC|Message|Read|Writ|Request"
    r"|Closing|Quit|Set |Confirmation|Exception|Invalid|The |Connection"
)


def libmodbus(lines: Iterable[str]) -> Rows:
    """What ``mbpoll -v`` and other programs with libmodbus print: ``[ ]`` is sent, ``< >`` received."""
    for number, line in enumerate(lines, 1):
        text = line.strip()
        if _LIBMODBUS.fullmatch(text):
            yield Row(number, None, bytes_of(text) or b"", int(text[0] == "<"))
        elif not text or text.startswith("#") or _LIBMODBUS_CHATTER.match(text):
            yield None
        else:
            yield Unreadable(number, f"{text[:40]!r} is no message of libmodbus")


def is_libmodbus(line: str) -> bool:
    """Whether a line is bytes as libmodbus prints them."""
    return _LIBMODBUS.fullmatch(line.strip()) is not None


def may_have_decimal_comma(line: str) -> bool:
    """Whether a line begins with digits, comma, digits, and something behind another separator."""
    return _COMMA_TIME.match(line.strip()) is not None
