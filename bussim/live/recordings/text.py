"""Text files with the bytes of a line: which form they have, their times, and their characters."""

import re
from codecs import getincrementaldecoder
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import TextIO

from bussim.engines.contract import RxChar
from bussim.files import reading
from bussim.live.arrival import PARITY, STOP, Arrivals, Timed, placed
from bussim.live.recordings.errors import RecordingError
from bussim.live.recordings.rows import (
    Row,
    Rows,
    Unreadable,
    bytes_of,
    decimals,
    general,
    is_libmodbus,
    is_socat,
    libmodbus,
    may_have_decimal_comma,
    saleae,
    socat,
)
from bussim.live.recordings.source import PROGRESS_EVERY, Chunk, Facts, LineSetup, Source
from bussim.units import TICKS_PER_SECOND

#: Characters of a line: 64 KiB of bytes, far more than comes at once.
LONGEST_LINE = 200_000
_START = re.compile(r"#\s*time\s*:\s*start\b", re.IGNORECASE)
_SEPARATOR = re.compile(r"[\s,;]")
#: Blanks of other scripts, and those that do not break: bytes and times are written with plain ones.
_BLANK = re.compile(r"[^\S\t\n\v\f\r ]")
_NOT_ASCII = re.compile(rb"[\x80-\xff]+")
#: Lines by which the form is recognised.
_EXAMINED = 200
_BOMS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
_A_MONTH = 30 * 86_400 * TICKS_PER_SECOND
_HALF_A_DAY = 43_200 * TICKS_PER_SECOND
#: Characters that come one by one are handed on at once.
_AT_ONCE = 256
FORMS = (
    'lines "time [direction] bytes" (time in seconds, with a unit, or as a clock), the CSV of Saleae Logic, '
    "what socat -x, esphome's uart_debug, mbpoll -v and libmodbus print"
)


class TextFile(Source):
    """A text file as a recording. Its times are what a program knew; those of Saleae Logic are exact."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.facts = Facts()
        with self._opened() as file:
            head = list(islice(_lines(file), _EXAMINED))
        rows = [line for line in head if line.strip() and not line.lstrip().startswith("#")]
        self._heading = _heading(rows[0]) if rows else []
        self._from_start = any(_START.match(line) for line in head)
        names = [name.lower() for name in self._heading]
        self._saleae = names[:3] == ["name", "type", "start_time"] or names[1:2] == ["value"]
        if self._saleae:
            self._heading, self._from_start = names, True
        self._socat = any(map(is_socat, rows))
        self._libmodbus = sum(map(is_libmodbus, rows)) > sum(line[:1].isdigit() for line in rows)
        body = rows[bool(self._heading) :]
        #: Whether times may have a decimal comma.
        self.decimal_comma = (
            10 * sum(map(may_have_decimal_comma, body)) >= 9 * len(body) > 0 and not self._saleae
        )
        self.exact, self.tolerant = self._saleae, not self._libmodbus
        self.times = "none" if self._libmodbus else "exact" if self._saleae else "system"
        first = [row for row in self._rows(head, decimal_comma=False) if isinstance(row, Row)]
        wires = {row.wire for row in first if row.wire is not None}
        #: Wires of the line: one for each direction that is given.
        self.wires = 1 + max(wires) if len(wires) > 1 else 1
        #: Whether programs write directions.
        self.directions = self.wires > 1 and not self._saleae
        ticks = [row.tick or 0 for row in first]
        falling = ticks != sorted(ticks) or (len(ticks) > 1 and ticks[0] == ticks[-1])
        if falling and self.times == "system" and all(bytes_of(line.strip()) for line in body):
            raise RecordingError(f"{path}: its lines are bytes without times; readable are {FORMS}")
        name = self._heading[0] if self._heading else ""
        self._digits = [
            max((decimals(row, name, comma) for row in body), default=0) for comma in (False, True)
        ]
        self.resolution = 0  # once it is known how times are written

    def _opened(self) -> TextIO:
        with reading(self._path):
            with self._path.open("rb") as file:
                begin = file.read(65_536)
            encoding = next((name for bom, name in _BOMS.items() if begin.startswith(bom)), "utf-8")
            try:
                getincrementaldecoder(encoding)().decode(begin)
            except UnicodeDecodeError:
                # What programs write that do not write UTF-8: Chinese has pairs of bytes, Latin single ones.
                runs = [len(run) % 2 for run in _NOT_ASCII.findall(begin)]
                encoding = "cp1252" if 2 * sum(runs) >= len(runs) else "gb18030"
            return self._path.open(encoding=encoding, errors="replace")

    def _rows(self, lines: Iterable[str], *, decimal_comma: bool) -> Rows:
        if self._saleae:
            return saleae(lines, self._heading)
        if self._socat:
            return socat(lines)
        if self._libmodbus:
            return libmodbus(lines)
        return general(lines, self._heading[0] if self._heading else "", decimal_comma=decimal_comma)

    def chunks(self, setup: LineSetup) -> Iterator[Chunk]:
        """See the source of a recording. Raises RecordingError if most lines cannot be read."""
        self.facts = facts = Facts()
        self.resolution = TICKS_PER_SECOND // 10 ** min(9, self._digits[setup.decimal_comma])
        arrivals, readable, lost = Arrivals(setup.timing), 0, False
        before: int | None = None
        base: int | None = None
        batch: list[Timed] = []
        wire = 0
        with self._opened() as file:
            size = self._path.stat().st_size
            for count, found in enumerate(self._rows(_lines(file), decimal_comma=setup.decimal_comma)):
                if not count % PROGRESS_EVERY:
                    self.progress("reading", file.buffer.tell(), size)
                if found is None:
                    continue
                if isinstance(found, Unreadable):
                    facts.cannot_read(f"{self._path}:{found.line}: {found.reason}")
                    lost = True
                    continue
                tick, data = found.tick, found.data
                if tick is None:  # no times: lines are far enough apart to be different frames
                    tick = arrivals.busy_until + setup.timing.characters(len(data) + _APART)
                elif base is None:
                    length = 0 if self._from_start else setup.timing.characters(len(data))
                    base = 0 if found.bare and 0 <= tick < _A_MONTH else tick - length
                    tick -= base
                else:
                    tick -= base
                    if not found.bare and before is not None and before - tick > _HALF_A_DAY:
                        tick += 2 * _HALF_A_DAY  # over midnight
                        base -= 2 * _HALF_A_DAY
                    if before is not None and tick < before:
                        if before - tick > TICKS_PER_SECOND:
                            facts.cannot_read(f"{self._path}:{found.line}: its time is before that above")
                            lost = True
                            continue
                        facts.time_steps += 1
                        tick = before
                before = tick
                readable += 1
                if self._saleae:
                    char, flag = placed(data, tick, setup.timing)[0], found.flag
                    if flag:
                        char = (RxChar(data[0], not flag & PARITY, not flag & STOP), char[1], char[2])
                    own = min(found.wire or 0, self.wires - 1)
                    if batch and (own != wire or len(batch) >= _AT_ONCE):
                        yield Chunk(batch, wire, lost)
                        batch, lost = [], False
                    wire = own
                    batch.append(char)
                    continue
                chars = placed(data, tick, setup.timing) if self._from_start else arrivals.chunk(data, tick)
                yield Chunk(chars, min(found.wire or 0, self.wires - 1), lost)
                lost = False
        if batch:
            yield Chunk(batch, wire)
        if not readable and not facts.unreadable_lines:
            raise RecordingError(f"{self._path} has no line with bytes; readable are {FORMS}")
        if facts.unreadable_lines > readable:
            first = "; ".join(facts.unreadable)
            raise RecordingError(
                f"{first} - more than half of the lines cannot be read; readable are {FORMS}"
            )


#: Characters that lie between two lines that have no times.
_APART = 10


def _lines(file: TextIO) -> Iterator[str]:
    """Lines; what is longer than any is cut, and cannot be read then."""
    while line := file.readline(LONGEST_LINE):
        if len(line) == LONGEST_LINE and not line.endswith("\n"):
            while (rest := file.readline(LONGEST_LINE)) and not rest.endswith("\n"):
                pass
            line = "longer than any line: " + line[:20]
        yield line if line.isascii() else _BLANK.sub(" ", line)


def _heading(line: str) -> list[str]:
    """The names of columns, where a line has no digit before its first separator; else nothing."""
    text = line.strip().lstrip("\ufeff")
    if text[:1] in "[<>" or any(map(str.isdigit, _SEPARATOR.split(text)[0])):
        return []
    return [name.strip(' "') for name in re.split(r"[,;\t]", text)]
