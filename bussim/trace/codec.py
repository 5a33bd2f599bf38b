"""The lines of ``trace.jsonl``: every record of :mod:`bussim.trace.records` as a JSON object, and back.

The key ``type`` comes first and names the record; the others are the record's fields by their names,
except that the first tick of what lasts is called ``tick`` where it is always known. Ticks are of
1/72 MHz, bytes are hexadecimal. A frame tells its rate, format and clock error only where they are
not those of its bus in the header.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from bussim.line.protocols import BusProtocol
from bussim.trace.records import (
    AttemptRecord,
    CycleRecord,
    DeviceValueRecord,
    EndsRecord,
    FrameRecord,
    FreeRecord,
    InputRecord,
    NoteRecord,
    PollRecord,
    ScanRecord,
    TraceBus,
    TraceHeader,
    TransactionRecord,
)
from bussim.units import TICKS_PER_SECOND

#: Version of the trace's lines; rises when a key changes its meaning.
TRACE_SCHEMA = 1

Record = (
    FrameRecord
    | ScanRecord
    | AttemptRecord
    | TransactionRecord
    | PollRecord
    | CycleRecord
    | FreeRecord
    | DeviceValueRecord
    | InputRecord
    | EndsRecord
    | NoteRecord
)
Line = dict[str, Any]


# -- values ----------------------------------------------------------------------------------------


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:59]}…"


def _check(value: object, fits: bool, what: str) -> None:  # noqa: FBT001 (private)
    if not fits:
        raise ValueError(f"is {_short(value)}, not {what}")


def _int(value: Any) -> int:
    _check(value, type(value) is int, "a whole number")
    return int(value)


def _int_or_none(value: Any) -> int | None:
    return None if value is None else _int(value)


def _text(value: Any) -> str:
    _check(value, isinstance(value, str), "a text")
    return str(value)


def _flag(value: Any) -> bool:
    _check(value, isinstance(value, bool), "true or false")
    return bool(value)


def _number(value: Any) -> float:
    _check(value, type(value) in (int, float), "a number")
    return float(value)


def _bytes(value: Any) -> bytes:
    return bytes.fromhex(_text(value))


def _list(value: Any) -> list[Any]:
    _check(value, isinstance(value, list), "a list")
    return list(value)


def _ints(value: Any) -> tuple[int, ...]:
    return tuple(map(_int, _list(value)))


def _texts(value: Any) -> tuple[str, ...]:
    return tuple(map(_text, _list(value)))


def _by_name(value: Any) -> dict[str, Any]:
    _check(value, isinstance(value, dict), "an object")
    return dict(value)


def _bits_by_name(value: Any) -> dict[str, tuple[int, ...]]:
    return {name: _ints(bits) for name, bits in _by_name(value).items()}


def _detail(value: Any) -> dict[str, int | str]:
    return {name: each if isinstance(each, str) else _int(each) for name, each in _by_name(value).items()}


# -- records ---------------------------------------------------------------------------------------


class _Field(NamedTuple):
    name: str
    read: Callable[[Any], Any]
    key: str = ""  # "": as its name
    write: Callable[[Any], Any] | None = None  # None: as it is


def _lists(bits: Mapping[str, tuple[int, ...]]) -> dict[str, list[int]]:
    return {name: list(each) for name, each in bits.items()}


_BUS, _START = _Field("bus", _text), _Field("start", _int, "tick")

#: Fields of every type of line in the order of the record's own; those of a frame that its bus knows
#: are left to :func:`to_line` and :func:`from_line`.
_FORMS: dict[str, tuple[type[Record], tuple[_Field, ...]]] = {
    "frame": (
        FrameRecord,
        (
            _BUS,
            _START,
            _Field("end", _int),
            _Field("sender", _text),
            _Field("kind", _text),
            _Field("station", _int_or_none),
            _Field("counter", _int_or_none),
            _Field("chars", _bytes, write=bytes.hex),
            _Field("damaged_bits", _ints, write=list),
            _Field("damaged_at", _bits_by_name, write=_lists),
            _Field("collided", _flag),
            _Field("cut", _flag),
            _Field("protocol", _text),
        ),
    ),
    "scan": (
        ScanRecord,
        (
            _BUS,
            _Field("number", _int),
            _START,
            _Field("duration", _int),
            _Field("attempts", _int),
            _Field("failed", _int),
            _Field("stations_in_error", _int),
            _Field("cause", _text),
        ),
    ),
    "attempt": (
        AttemptRecord,
        (
            _BUS,
            _START,
            _Field("end", _int),
            _Field("station", _int),
            _Field("number", _int),
            _Field("outcome", _text),
            _Field("code", _int),
            _Field("turnaround", _int_or_none),
        ),
    ),
    "transaction": (
        TransactionRecord,
        (
            _BUS,
            _Field("master", _text),
            _Field("poll", _text),
            _Field("attempt", _int),
            _Field("station", _int),
            _Field("function", _int),
            _Field("address", _int),
            _Field("quantity", _int),
            _Field("sent", _int_or_none),
            _Field("asked", _int_or_none),
            _Field("answer_start", _int_or_none),
            _Field("answer_end", _int_or_none),
            _Field("end", _int),
            _Field("taken", _int),
            _Field("outcome", _text),
            _Field("error", _int_or_none),
            _Field("exception", _int),
            _Field("served", _int_or_none),
            _Field("mismatched", _flag),
            _Field("chars", _int),
        ),
    ),
    "poll": (
        PollRecord,
        (
            _BUS,
            _Field("master", _text),
            _Field("poll", _text),
            _START,
            _Field("end", _int),
            _Field("attempts", _int),
            _Field("error", _int_or_none),
            _Field("late", _int),
        ),
    ),
    "cycle": (
        CycleRecord,
        (_BUS, _Field("master", _text), _Field("number", _int), _START, _Field("duration", _int)),
    ),
    "free": (
        FreeRecord,
        (
            _BUS,
            _Field("node", _text),
            _Field("poll", _text),
            _Field("direction", _text),
            _Field("start", _int_or_none),
            _Field("end", _int),
            _Field("data", _bytes, write=bytes.hex),
            _Field("ended", _text),
            _Field("damaged", _int),
        ),
    ),
    "value": (
        DeviceValueRecord,
        (
            _Field("tick", _int),
            _Field("plc", _text),
            _Field("device", _text),
            _Field("value", _int),
        ),
    ),
    "input": (
        InputRecord,
        (
            _Field("tick", _int),
            _Field("plc", _text),
            _Field("device", _text),
            _Field("level", _int),
            _Field("sampled", _int),
            _Field("seen", _flag),
            _Field("end", _int),
        ),
    ),
    "ends": (EndsRecord, (_Field("plc", _text), _Field("ticks", _ints, write=list))),
    "note": (
        NoteRecord,
        (
            _Field("tick", _int),
            _Field("kind", _text),
            _Field("where", _text),
            _Field("text", _text),
            _Field("detail", _detail),
        ),
    ),
}
_TYPES = {record: name for name, (record, _) in _FORMS.items()}
# Key, position and writer of every field, and whether the tick is to stand first.
_WRITERS = {
    record: [(field.key or field.name, at, field.write) for at, field in enumerate(fields)]
    for record, fields in _FORMS.values()
}
for _writers in _WRITERS.values():
    _writers.sort(key=lambda writer: writer[0] != "tick")


def type_of(record: type[Record]) -> str:
    """The ``type`` of a record's lines."""
    return _TYPES[record]


def to_line(record: Record, buses: Mapping[str, TraceBus]) -> Line:
    """A record as a line; ``buses`` are those of the trace's header."""
    kind = type(record)
    line: Line = {"type": _TYPES[kind]}
    for key, at, write in _WRITERS[kind]:
        value = record[at]
        line[key] = value if write is None else write(value)
    if isinstance(record, FrameRecord):
        bus = buses.get(record.bus)
        if bus is None or record.baud != bus.baud:
            line["baud"] = record.baud
        if bus is None or record.format != bus.format:
            line["format"] = record.format
        if record.ppm:
            line["ppm"] = record.ppm
    return line


def from_line(line: Line, buses: Mapping[str, TraceBus]) -> Record | None:
    """The record of :func:`to_line`; None for a type of line that a later version has added.

    Raises ValueError, with a message for the user, for anything else.
    """
    form = _FORMS.get(_read(line, "type", _text))
    if form is None:
        return None
    record, fields = form
    values = [_read(line, field.key or field.name, field.read) for field in fields]
    if record is FrameRecord:
        bus = buses.get(values[0])
        values.append(bus.baud if bus and "baud" not in line else _read(line, "baud", _int))
        values.append(bus.format if bus and "format" not in line else _read(line, "format", _text))
        values.append(_read(line, "ppm", _number) if "ppm" in line else 0.0)
    return record(*values)


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


def header_line(header: TraceHeader) -> Line:
    """The first line of a trace."""
    return {
        "type": "trace",
        "schema": TRACE_SCHEMA,
        "tick_hz": TICKS_PER_SECOND,
        "exact": header.exact,
        "scenario": header.scenario,
        "seed": header.seed,
        "duration": header.duration,
        "buses": {
            bus.name: {
                "nn": bus.protocol is BusProtocol.NN,
                "baud": bus.baud,
                "format": bus.format,
                "nodes": list(bus.nodes),
                "stations": bus.stations,
            }
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
    return TraceHeader(
        buses=tuple(_bus(name, _by_name(bus)) for name, bus in _read(line, "buses", _by_name).items()),
        scenario=_read(line, "scenario", _text),
        seed=_read(line, "seed", _int_or_none),
        duration=_read(line, "duration", _int_or_none),
        exact=_read(line, "exact", _flag),
    )


def _bus(name: str, data: Line) -> TraceBus:
    return TraceBus(
        name,
        BusProtocol.NN if _read(data, "nn", _flag) else BusProtocol.SERIAL,
        _read(data, "baud", _int),
        _read(data, "format", _text),
        _read(data, "nodes", _texts),
        {node: _int(station) for node, station in _read(data, "stations", _by_name).items()},
    )
