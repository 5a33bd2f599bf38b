"""Layouts as files: read with every mistake, and written."""

from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from bussim.engines.nn.frames import KIND_NAMES
from bussim.errors import Problem, ScenarioError, UsageError
from bussim.files import plain, reading
from bussim.forms.fields import choice, fail, one_of, whole
from bussim.forms.form import Model
from bussim.forms.kind import Kind
from bussim.live.layout.sums import ADDED, FORMS, KINDS, Number, Sum
from bussim.live.layout.value import PARTS, UNIQUE, Layout
from bussim.scenario.schema.draft import read_form
from bussim.scenario.yaml.parser import read
from bussim.scenario.yaml.source_map import Report
from bussim.wording import nearest

_MOST_BYTES = 100_000
#: What each kind of frame must have.
_NEEDED = {"data": ("station", "data"), "poll": ("station",), "parameters": ("settings",)}

Order = tuple[tuple[int | str, bool], ...]


def _order(value: object) -> Order:
    """The parts of a frame, in order; those of an inner list are under the sum."""
    if not isinstance(value, list) or not value:
        raise fail("is no list of parts, such as [0x05, [station, counter], sum]")
    if sum(isinstance(part, list) for part in value) > 1:
        raise fail("has two inner lists; the sum is made over one")
    parts: list[tuple[int | str, bool]] = []
    for part in value:
        inner = isinstance(part, list)
        parts += [(_part(each), inner) for each in (part if inner else [part])]
    names = [what for what, _ in parts if what in UNIQUE]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise fail(f"has {twice} twice")
    if ("sum", True) in parts:
        raise fail("has the sum in the inner list, which is what the sum is made over")
    if ("sum" in names) != any(summed for _, summed in parts):
        raise fail("needs both a sum and the inner list over which it is made, or neither")
    return tuple(parts)


def _part(value: object) -> int | str:
    if isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= 255:
        return int(value)
    if isinstance(value, str) and value in PARTS:
        return value
    near = nearest(str(value), PARTS)
    raise fail(
        f"has {value!r}, allowed characters 0x00..0xFF, {', '.join(PARTS)}"
        + (f"; did you mean {near}?" if near else "")
    )


_Order = Annotated[Order, Kind(_order)]


class _FramesIn(Model):
    example = "{data: [0x02, [station, counter, data, 0x03], sum], poll: [0x05, [station, counter], sum]}"
    data: _Order
    poll: _Order
    parameters: _Order | None = None


class _StationIn(Model):
    example = "{form: hex, characters: 1}"
    form: Annotated[str, choice(*FORMS)] = "hex"
    characters: Annotated[int, whole(1, 4)] = 1
    master: Annotated[int, whole(0, 248)] = 0


class _CounterIn(Model):
    example = "{form: hex, characters: 1, modulo: 16}"
    form: Annotated[str, choice(*FORMS)] = "hex"
    characters: Annotated[int, whole(1, 4)] = 1
    modulo: Annotated[int, whole(2, 65536)] | None = None


class _DataIn(Model):
    example = "{form: hex}"
    form: Annotated[str, choice("hex", "hex-lower", "binary")] = "hex"
    bytes: Annotated[int, whole(1, 255)] | None = None


class _SumIn(Model):
    example = "{kind: sum, bits: 8, form: hex}"
    kind: Annotated[str, choice(*KINDS)] = "sum"
    bits: Annotated[int, one_of((7, 8, 16))] = 8
    form: Annotated[str, choice(*FORMS)] = "hex"
    low_first: bool = False
    of: Annotated[str, choice("characters", "bytes")] = "characters"
    start: Annotated[int, whole(0, 65535)] = 0


class _LayoutIn(Model):
    frames: _FramesIn
    station: _StationIn = Field(default_factory=_StationIn)
    counter: _CounterIn | None = None
    data: _DataIn = Field(default_factory=_DataIn)
    sum: _SumIn | None = None


def parse_layout(text: bytes | str, name: str) -> Layout:
    """The layout of a text; ``name`` is that of its file. Raises ScenarioError with every mistake."""
    data, source_map, problems = read(text, name)
    report = Report(source_map, problems)
    form, pruned = read_form(_LayoutIn, data, (), report)
    if form is not None and not pruned:
        _check(form, report)
    if report.errors or form is None:
        raise ScenarioError(report.errors or [Problem(name, 0, 0, "is empty")])
    counter, made = form.counter, form.sum
    number = None if counter is None else Number(counter.form, counter.characters)
    return Layout(
        orders={kind: order for kind, order in form.frames if order is not None},
        station=Number(form.station.form, form.station.characters),
        counter=number,
        sum=None if made is None else Sum(**dict(made)),
        master=form.station.master,
        modulo=(counter and counter.modulo) or (1 if number is None else number.values),
        data=form.data.form,
        data_bytes=form.data.bytes,
    )


def _check(form: _LayoutIn, report: Report) -> None:
    orders: dict[str, Order] = form.frames.given()
    for kind, order in orders.items():
        names = {what for what, _ in order}
        for name in _NEEDED[kind]:
            if name not in names:
                report.error(("frames", kind), f"has no {name}")
        for name in ("counter", "sum"):
            if name in names and getattr(form, name) is None:
                report.error(("frames", kind), f"has a {name}, but {name} is missing")
        if wrong := names & {"data", "settings"} - set(_NEEDED[kind]):
            report.error(("frames", kind), f"has {wrong.pop()}, which such a frame does not carry")
    counter, made = form.counter, form.sum
    if counter is not None:
        values = Number(counter.form, counter.characters).values
        if counter.modulo is not None and counter.modulo > values:
            report.error(("counter", "modulo"), f"is {counter.modulo}, allowed 2..{values}")
    if made is not None:
        bits = KINDS[made.kind][1]
        if made.bits not in bits:
            report.error(
                ("sum", "bits"), f"is {made.bits}, allowed for {made.kind}: {', '.join(map(str, bits))}"
            )
        if made.start and made.kind not in ADDED:
            report.error(("sum", "start"), f"is {made.start}, allowed for {made.kind}: 0")
        if made.low_first and made.bits != 16:
            report.error(("sum", "low_first"), f"is true, allowed for 16 bits, not for {made.bits}")


def load_layout(path: Path) -> Layout:
    """The layout of a file. Raises UsageError where it cannot be read, ScenarioError where it is wrong."""
    with reading(path), plain(path).open("rb") as file:
        text = file.read(_MOST_BYTES + 1)
    if len(text) > _MOST_BYTES:
        raise UsageError(f"{path} has more than {_MOST_BYTES:,} bytes: it is no layout")
    return parse_layout(text, str(path))


def to_text(layout: Layout, comment: str) -> str:
    """A layout as a file; ``comment`` is its first line."""
    station, counter, made = layout.station, layout.counter, layout.sum
    kinds = filter(layout.orders.__contains__, KIND_NAMES)
    lines = [f"# {comment}", "frames:", *(f"  {kind}: {_shown(layout.orders[kind])}" for kind in kinds)]
    lines.append(f"station: {{form: {station.form}, characters: {station.size}, master: {layout.master}}}")
    if counter is not None:
        lines.append(
            f"counter: {{form: {counter.form}, characters: {counter.size}, modulo: {layout.modulo}}}"
        )
    size = "" if layout.data_bytes is None else f", bytes: {layout.data_bytes}"
    lines.append(f"data: {{form: {layout.data}{size}}}")
    if made is not None:
        values: dict[str, Any] = made._asdict() | {"low_first": str(made.low_first).lower()}
        lines.append("sum: {" + ", ".join(f"{key}: {value}" for key, value in values.items()) + "}")
    return "\n".join(lines) + "\n"


def _shown(order: Order) -> str:
    """The parts of a frame as a list, those under the sum in a list of their own."""
    parts = []
    for summed, group in groupby(order, key=itemgetter(1)):
        inner = ", ".join(f"0x{what:02X}" if isinstance(what, int) else what for what, _ in group)
        parts.append(f"[{inner}]" if summed else inner)
    return f"[{', '.join(parts)}]"
