"""The lines of ``trace.jsonl``: every record of :mod:`bussim.trace.records` as a JSON object, and back.

The key ``type`` comes first and names the record; the others are the record's fields by their names,
except that the first tick of what lasts is called ``tick`` where it is always known. Ticks are of
1/72 MHz, bytes are hexadecimal. The baud rate, format and clock error of a frame are written only where
they are not those of its bus in the header, its pauses and the release of its driver only where there
are any.

Lines are made from the annotations of the record types. A new field of a record needs a default: it
stands for the field in traces of earlier versions. Keys and types of lines that are not known here,
those of a later version, are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import cache
from operator import itemgetter
from typing import Any, NamedTuple, TypeVar, get_args, get_type_hints

from bussim.line.characters import CharFormat
from bussim.line.contention import Contention
from bussim.line.protocols import FRAME_PROTOCOLS, BusProtocol
from bussim.line.wave import Pause
from bussim.trace import records
from bussim.trace.blocks import Alike, RecordBlock, in_turn
from bussim.trace.records import Record, TraceBus, TraceHeader
from bussim.units import TICKS_PER_SECOND
from bussim.wording import visible

#: Version of the trace's lines; rises when a key changes its meaning.
TRACE_SCHEMA = 1

Line = dict[str, Any]
V = TypeVar("V")

#: The ``type`` of each record's lines.
_TYPES: dict[type[Record], str] = {
    records.FrameRecord: "frame",
    records.ScanRecord: "scan",
    records.AttemptRecord: "attempt",
    records.TransactionRecord: "transaction",
    records.PollRecord: "poll",
    records.CycleRecord: "cycle",
    records.FreeRecord: "free",
    records.DeviceValueRecord: "value",
    records.InputRecord: "input",
    records.EndsRecord: "ends",
    records.NoteRecord: "note",
}
#: Keys of fields that are not called as the field; by its name and type.
_KEYS: dict[tuple[str, Any], str] = {("start", int): "tick", ("protocol", BusProtocol): "nn"}
#: Fields of a frame that are those of its bus where the line does not have them.
_OF_THE_BUS = ("baud", "format")
#: Fields of a frame that most have not, and that lines have only where they are set.
_SELDOM = ("ppm", "released", "pauses")

# -- values ----------------------------------------------------------------------------------------


def _exactly(kind: type[V], what: str) -> Callable[[Any], V]:
    """A reader that takes values of one type only; ``what`` names it in the message."""

    def read(value: Any) -> V:
        if type(value) is not kind:
            text = repr(value)
            raise ValueError(f"is {text if len(text) <= 60 else f'{text[:59]}…'}, not {what}")
        return value

    return read


def _text(value: Any) -> str:
    return visible(_plain_text(value))


def _int(value: Any) -> int:
    if -_LARGEST < _whole(value) < _LARGEST:
        return int(value)
    raise ValueError("is beyond every run")


#: Ticks and counts are less, by far: 500 years, whose nanoseconds a file of packets still holds in 64 bits.
_LARGEST = 1 << 60
_whole = _exactly(int, "a whole number")
_plain_text = _exactly(str, "a text")
_flag = _exactly(bool, "true or false")
_float = _exactly(float, "a number")
_list = _exactly(list, "a list")
_object = _exactly(dict, "an object")


def _by_name(value: Any) -> dict[str, Any]:
    return {visible(name): each for name, each in _object(value).items()}


def _optional(read: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda value: None if value is None else read(value)


def _ints(value: Any) -> tuple[int, ...]:
    return tuple(map(_int, _list(value)))


#: The key ``nn`` of a bus.
_FLAGS = {BusProtocol.NN: True, BusProtocol.SERIAL: False}
_BY_FLAG = {flag: protocol for protocol, flag in _FLAGS.items()}
#: How a value of each type of field is read. One without an entry raises KeyError on import.
_READERS: dict[Any, Callable[[Any], Any]] = {
    int: _int,
    int | None: _optional(_int),
    str: _text,
    bool: _flag,
    float: lambda value: float(value) if type(value) is int else _float(value),
    BusProtocol: lambda value: _BY_FLAG[_flag(value)],
    Contention: Contention,
    bytes: lambda value: bytes.fromhex(_text(value)),
    tuple[int, ...]: _ints,
    tuple[Pause, ...]: lambda value: tuple((index, ticks) for index, ticks in map(_ints, _list(value))),
    tuple[str, ...]: lambda value: tuple(map(_text, _list(value))),
    dict[str, int]: lambda value: {name: _int(each) for name, each in _by_name(value).items()},
    dict[str, int | str]: lambda value: {
        name: each if isinstance(each, str) else _int(each) for name, each in _by_name(value).items()
    },
    dict[str, tuple[int, ...]]: lambda value: {name: _ints(each) for name, each in _by_name(value).items()},
}


def _between(low: float, high: float, read: Callable[[Any], Any]) -> Callable[[Any], Any]:
    def bounded(value: Any) -> Any:
        found = read(value)
        if low <= found <= high:
            return found
        raise ValueError(f"is {value}, not {low:,} to {high:,}")

    return bounded


def _protocol(value: Any) -> str:
    if value in FRAME_PROTOCOLS:
        return str(value)
    raise ValueError(f"is {_text(value)!r}, not one of {', '.join(FRAME_PROTOCOLS)}")


_known_format = cache(CharFormat.parse)
_instant = _between(0, _LARGEST - 1, _int)
#: How fields of these names and types are read: how a line is driven and by whom, and instants of the run.
_BY_NAME: dict[tuple[str, Any], Callable[[Any], Any]] = {
    ("baud", int): _between(1, 100_000_000, _int),
    ("format", str): lambda value: str(_known_format(_text(value))),
    ("protocol", str): _protocol,
    ("ppm", float): _between(-500_000, 500_000, _READERS[float]),
    **{(name, int): _instant for name in ("start", "end", "tick", "sampled")},
    **{(name, int | None): _optional(_instant) for name in ("start", "end")},
    ("ticks", tuple[int, ...]): lambda value: tuple(map(_instant, _list(value))),
}
#: How a value of a type of field is written where it is not written as it is.
_WRITERS: dict[Any, Callable[[Any], Any]] = {
    BusProtocol: _FLAGS.__getitem__,
    bytes: bytes.hex,
    tuple[int, ...]: list,
    tuple[str, ...]: list,
    dict[str, tuple[int, ...]]: lambda value: {name: list(each) for name, each in value.items()},
}


# -- fields ----------------------------------------------------------------------------------------

_REQUIRED: Any = object()


class _Field(NamedTuple):
    """One field of a record: its key, its position in the record, and its value where the key is missing."""

    name: str
    key: str
    position: int
    read: Callable[[Any], Any]
    write: Callable[[Any], Any] | None  # None: as it is
    default: Any  # _REQUIRED: the key may not be missing


def _fields_of(record: type[Any], apart: str = "") -> list[_Field]:
    """The fields of a record type, without the one that is written apart."""
    hints, defaults = get_type_hints(record), record._field_defaults
    return [
        _Field(
            name,
            _KEYS.get((name, hints[name]), name),
            position,
            _BY_NAME.get((name, hints[name]), _READERS[hints[name]]),
            _WRITERS.get(hints[name]),
            defaults.get(name, _REQUIRED),
        )
        for position, name in enumerate(record._fields)
        if name != apart
    ]


_FIELDS: dict[type[Record], list[_Field]] = {record: _fields_of(record) for record in get_args(Record)}
_RECORDS = {_TYPES[record]: record for record in _FIELDS}
#: What is written of a field: its key, its position in the record, and how it is written (None: as it is).
_Written = tuple[str, int, Callable[[Any], Any] | None]
# What is written of each record, in this order; the rest of a frame only if needed.
_WRITTEN: dict[type[Record], list[_Written]] = {
    record: [
        (field.key, field.position, field.write)
        for field in sorted(fields, key=lambda field: field.key != "tick")
        if record is not records.FrameRecord or field.name not in (*_OF_THE_BUS, *_SELDOM)
    ]
    for record, fields in _FIELDS.items()
}


@cache
def _varying(kind: Any, names: frozenset[str]) -> tuple[list[_Written], Callable[[Record], Any]]:
    """What is written of some fields of a type, and what gets the others of a record (without a dict)."""
    written = [each for each in _WRITTEN[kind] if kind._fields[each[1]] in names]
    others = (at for at, name in enumerate(kind._fields) if name not in (*names, "damaged_at"))
    return written, itemgetter(*others)


#: The format of a value by how it is written.
_FORMATS: dict[Any, str] = {None: "%d", bytes.hex: '"%s"', list: "[%s]"}
_TICKS, _START_AND_END = frozenset(("ticks",)), frozenset(("start", "end"))


class LineTexts:
    """Lines as texts, without a dict and an encoder where all but some numbers has come before."""

    def __init__(self, encode: Callable[[Line], str], buses: Mapping[str, TraceBus]) -> None:
        self._encode = encode
        self._buses = buses
        self._templates: dict[tuple[Any, ...], str] = {}

    def of(self, record: Record) -> str:
        """The text of a record's line."""
        match record:  # the most frequent ones
            case records.EndsRecord(_, ticks):
                return self._template(record, _TICKS) % (("%d," * len(ticks))[:-1] % ticks)
            case records.FrameRecord(_, start, end) if not record.damaged_at:
                return self._template(record, _START_AND_END) % (start, end)
            case _:
                return self._encode(to_line(record, self._buses))

    def of_block(self, block: RecordBlock) -> Iterator[str]:
        """The texts of a block's lines, each with its end."""
        return in_turn(map(self._texts, block))

    def _texts(self, alike: Alike) -> Iterator[str]:
        kind: Any = type(alike.pattern)
        names = frozenset(alike.varying)
        values: list[Iterable[Any]] = []
        for _, at, write in _varying(kind, names)[0]:
            given = alike.varying[kind._fields[at]].tolist()
            values.append(given if write is None else map(write, given))
        template = self._template(alike.pattern, names) + "\n"
        return map(template.__mod__, zip(*values, strict=True))

    def _template(self, record: Record, names: frozenset[str]) -> str:
        """A record's line with formats for the values of some fields."""
        kind: Any = type(record)
        templates = self._templates
        written, others = _varying(kind, names)
        rest = (kind, names, others(record))
        if rest not in templates:
            if len(templates) >= 4096:  # blocks have ever new contents
                templates.clear()
            line = to_line(record, self._buses) | {key: "\0" for key, _, _ in written}
            text = self._encode(line).replace("%", "%%")
            for key, _, write in written:
                text = text.replace(f'"{key}":"\\u0000"', f'"{key}":{_FORMATS[write]}')
            templates[rest] = text
        return templates[rest]


def type_of(record: type[Record]) -> str:
    """The ``type`` of a record's lines."""
    return _TYPES[record]


def to_line(record: Record, buses: Mapping[str, TraceBus]) -> Line:
    """A record as a line; ``buses`` are those of the trace's header."""
    kind = type(record)
    line: Line = {"type": _TYPES[kind]}
    for key, position, write in _WRITTEN[kind]:
        value = record[position]
        line[key] = value if write is None else write(value)
    if isinstance(record, records.FrameRecord):
        bus = buses.get(record.bus)
        if bus is None or record.baud != bus.baud:
            line["baud"] = record.baud
        if bus is None or record.format != bus.format:
            line["format"] = record.format
        line |= {name: value for name in _SELDOM if (value := getattr(record, name))}
    return line


def from_line(line: Line, buses: Mapping[str, TraceBus]) -> Record | None:
    """The record of :func:`to_line`; None for a type of line that a later version has added.

    Raises ValueError, with a message for the user, for anything else.
    """
    record = _RECORDS.get(_read(line, "type", _text))
    if record is None:
        return None
    if record is records.FrameRecord:
        bus = buses.get(_read(line, "bus", _text))
        of_the_bus = {} if bus is None else {"baud": bus.baud, "format": bus.format}
        line = of_the_bus | line
        return records.FrameRecord(**_values(line, _FIELDS[record], required=_OF_THE_BUS))
    return record(**_values(line, _FIELDS[record]))


def _values(line: Line, fields: Collection[_Field], required: Collection[str] = ()) -> dict[str, Any]:
    """The values of a record's fields; those named in ``required`` must be there in spite of a default."""
    found: dict[str, Any] = {}
    for name, key, _, read, _, default in fields:
        if key not in line and default is not _REQUIRED and name not in required:
            found[name] = default
            continue
        try:  # as _read: a call for each value would be a fifth of the time of reading
            found[name] = read(line[key])
        except (KeyError, ValueError):
            _read(line, key, read)
    return found


def _read(line: Line, key: str, read: Callable[[Any], Any]) -> Any:
    try:
        value = line[key]
    except KeyError:
        raise ValueError(f"{key} is missing") from None
    try:
        return read(value)
    except ValueError as error:
        raise ValueError(f"{key} {error}") from None


# -- header ----------------------------------------------------------------------------------------

_BUS_FIELDS = _fields_of(TraceBus, apart="name")
# Whether the times are exact is written before the others.
_HEADER_FIELDS = sorted(_fields_of(TraceHeader, apart="buses"), key=lambda field: field.name != "exact")


def header_line(header: TraceHeader) -> Line:
    """The first line of a trace."""
    return {
        "type": "trace",
        "schema": TRACE_SCHEMA,
        "tick_hz": TICKS_PER_SECOND,
        **_written(header, _HEADER_FIELDS),
        "buses": {
            bus.name: _written(bus, [field for field in _BUS_FIELDS if bus[field.position] != field.default])
            for bus in header.buses
        },
    }


def header_of(line: Line) -> TraceHeader:
    """The header of :func:`header_line`; else raises ValueError with a message for the user."""
    if line.get("type") != "trace":
        raise ValueError("is not the header of a trace")
    schema = _read(line, "schema", _int)
    if not 1 <= schema <= TRACE_SCHEMA:
        raise ValueError(f"has schema {schema}; this bussim reads up to {TRACE_SCHEMA}; update bussim")
    if line.get("tick_hz") != TICKS_PER_SECOND:
        raise ValueError(f"counts {line.get('tick_hz')!r} ticks a second, not {TICKS_PER_SECOND}")
    buses = _read(line, "buses", _by_name)
    return TraceHeader(
        buses=tuple(TraceBus(name, **_values(_by_name(bus), _BUS_FIELDS)) for name, bus in buses.items()),
        **_values(line, _HEADER_FIELDS),
    )


def _written(record: tuple[Any, ...], fields: Collection[_Field]) -> Line:
    return {
        field.key: record[field.position] if field.write is None else field.write(record[field.position])
        for field in fields
    }
