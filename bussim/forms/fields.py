"""The kinds of values that a scenario's keys take, each with its message for a wrong one.

Every validator raises with a predicate that follows the value's name: "is 12, allowed 0..10".
"""

import re
from collections.abc import Callable, Iterable, Sequence
from decimal import Decimal
from fractions import Fraction
from typing import Annotated, Any, NamedTuple, cast

from pydantic_core import PydanticCustomError

from bussim.engines.free.engine import MAX_BYTES
from bussim.engines.modbus.pdu import FUNCTIONS
from bussim.forms.kind import FORMAT_FORM, NAME_PATTERN, TEXT_FORM, TIME_FORM, UNREAD_FORM, Form, Kind
from bussim.forms.meant import readings, unread
from bussim.line.characters import BAUDS, CharFormat
from bussim.plc.memory import Device, DeviceRange, parse_device, parse_range
from bussim.units import TICKS_PER_SECOND, format_nanoseconds, format_time, parse_nanoseconds, parse_time
from bussim.wording import RawFloat, RawInt, nearest
from bussim.words.language import say
from bussim.words.values import show

#: The error type of our own messages.
OWN = "bussim"
#: The longest time that a scenario may name: ten years of 365 days.
LONGEST = 10 * 365 * 86400 * TICKS_PER_SECOND

_NAME = re.compile(r"(?!-)(?=.*[^\W\d_])[\w-]{1,64}")
_NODE = re.compile(r"(?!-)(?=.*[^\W\d_])[\w-]{1,64}(\.COM[1-6])?")
_CALLABLE = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*")
_HEX = re.compile(r"(?:0x)?([0-9a-fA-F]{2})")


class _Empty:
    """Stands for a key without a value, so that no field can take it for "not given"."""


EMPTY = _Empty()


def fail(predicate: str, at: str | None = None) -> PydanticCustomError:
    """The error to raise: ``predicate`` about the value, or about its key ``at``."""
    return PydanticCustomError(OWN, "{text}", {"text": predicate, "at": at})


def _found(value: object) -> str:
    return say("form_empty") if value is EMPTY else say("form_is", found=show(value))


def _is_int(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _those(
    fits: Callable[[Any], bool],
    wanted: str | Callable[[Any], str],
    hint: Callable[[Any], str] = lambda _: "",
    *,
    form: Form,
    made: Callable[[Any], Any] = lambda value: int(value) if _is_int(value) else value,
) -> Kind:
    """Values that fit. To another one the message says what is ``wanted``, and a hint: else what is meant.

    ``made`` is what becomes of one. A text that is wanted, always the same, is given by its key.
    """

    def check(value: Any) -> Any:
        if fits(value):
            return made(value)
        meant = (one if isinstance(one, str) else show(one) for one in readings(value) if fits(one))
        shown = hint(value) or next((say("form_meant", meant=one) for one in meant), "")
        said = say(wanted) if isinstance(wanted, str) else wanted(value)
        raise fail(say("form_found", found=_found(value), wanted=said, shown=shown))

    return Kind(check, form=form)


def _matching(
    pattern: re.Pattern[str], form: str, wanted: str, hint: Callable[[Any], str] = lambda _: ""
) -> Kind:
    return _those(
        lambda value: isinstance(value, str) and len(value) <= 200 and pattern.fullmatch(value) is not None,
        wanted,
        hint,
        form={"type": "string", "pattern": f"^{form}$"},
    )


def _parsed(parse: Callable[[str], object], expected: str, form: Form) -> Kind:
    """What ``parse`` makes of a text; it raises ValueError with a message for the user.

    ``expected`` is the key of what is said of another value.
    """

    def check(value: object) -> object:
        value = unread(value)
        if not isinstance(value, str):
            raise fail(say("form_expected", found=_found(value), expected=say(expected)))
        try:
            return parse(value[:100])
        except ValueError as error:
            raise fail(error.args[0]) from None

    return Kind(check, str, form)


def _line(most: int) -> Kind:
    def check(value: object) -> str:
        value = unread(value)
        if not isinstance(value, str) or not value.strip():
            raise fail(say("form_line", found=_found(value)))
        if len(value) > most or not value.isprintable():
            raise fail(say("form_one_line", found=_found(value), most=most))
        return value

    return Kind(check, form={**UNREAD_FORM, "pattern": r"\S", "maxLength": most})


def whole(low: int, high: int) -> Kind:
    """A whole number from ``low`` to ``high``."""
    return _those(
        lambda value: _is_int(value) and low <= value <= high,
        lambda value: say("form_range" if _is_int(value) else "form_whole_range", low=low, high=high),
        form={"type": "integer", "minimum": low, "maximum": high},
    )


#: A whole number whose bounds depend on something else.
any_whole = _those(_is_int, "form_whole", form={"type": "integer"})


def number(low: float, high: float) -> Kind:
    """A number from ``low`` to ``high``."""

    def is_number(value: object) -> bool:
        return isinstance(value, int | float) and not isinstance(value, bool)

    return _those(
        lambda value: is_number(value) and low <= value <= high,
        lambda value: say(
            "form_range" if is_number(value) else "form_number_range", low=f"{low:g}", high=f"{high:g}"
        ),
        form={"type": "number", "minimum": low, "maximum": high},
        made=float,
    )


def time(low: int = 0, high: int = LONGEST, likely: str = "ms") -> Kind:
    """A time with its unit, from ``low`` to ``high`` ticks; a bare number may be of the unit ``likely``."""

    def check(value: object) -> int:
        value = _time_text(value)
        try:
            ticks = parse_time(value, likely)
        except ValueError as error:
            raise fail(error.args[0]) from None
        if low <= ticks <= high:
            return ticks
        if low <= 1 and high == LONGEST:
            raise fail(say("form_up_to", value=value.strip(), least=say("form_more_than_0") if low else "0"))
        least = say("form_more_than_0") if low == 1 else format_time(low)
        most = "10 y" if high == LONGEST else format_time(high)
        raise fail(say("form_between", value=value.strip(), least=least, most=most))

    return Kind(check, format_time, TIME_FORM)


def _time_text(value: object) -> str:
    """A time as the file has it; a bare number is left for the parser to complain of."""
    if isinstance(value, RawInt | RawFloat):
        value = value.raw
    elif isinstance(value, int | float) and not isinstance(value, bool):
        value = show(value)
    if not isinstance(value, str):
        raise fail(say("form_time", found=_found(value)))
    return value[:100]


def none_or(known: Kind) -> Kind:
    """A value of another kind, or the word none."""

    def write(value: object) -> object:
        return known.write(value) if known.write and value != "none" else value

    form = {"anyOf": [{"const": "none"}, known.form]}
    return Kind(lambda value: value if value == "none" else known.read(value), write, form)


def characters_or_time(low: float, high: float) -> Kind:
    """A number of characters from ``low`` to ``high``, a float, or a time with its unit in ticks, an int."""
    characters, ticks = number(low, high), time(1)

    def check(value: object) -> object:
        return (ticks if isinstance(value, str) else characters).read(value)

    form = {"anyOf": [characters.form, ticks.form]}
    return Kind(check, lambda value: value if isinstance(value, float) else format_time(value), form)


def nanoseconds(low: int, high: int) -> Kind:
    """A time with its unit as whole nanoseconds, from ``low`` to ``high`` of them."""

    def check(value: object) -> int:
        text = _time_text(value)
        try:
            found = parse_nanoseconds(text)
        except ValueError as error:
            raise fail(error.args[0]) from None
        if not low <= found <= high:
            least, most = format_nanoseconds(low), format_nanoseconds(high)
            raise fail(say("form_between", value=text.strip(), least=least, most=most))
        return found

    return Kind(check, format_nanoseconds, TIME_FORM)


def choice(*options: str) -> Kind:
    """One of some words."""

    def hint(value: object) -> str:
        near = nearest(f"COM{value}" if _is_int(value) else str(value), options)
        return say("form_meant", meant=near) if near else ""

    form = {"enum": list(map(str, options))}
    return _those(
        lambda value: isinstance(value, str) and value in options, _allowed(options), hint, form=form
    )


def one_of(options: Sequence[int]) -> Kind:
    """One of some whole numbers."""
    form = {"enum": list(options)}
    return _those(lambda value: _is_int(value) and value in options, _allowed(options), form=form)


def _allowed(options: Iterable[object]) -> Callable[[object], str]:
    return lambda _: say("form_allowed", options=", ".join(map(str, options)))


_LINK_PORTS = choice("COM3", "COM4")


def _link_port(value: object) -> str:
    if value in ("COM5", "COM6"):
        raise fail(say("form_cannot_select", value=value))
    return cast("str", _LINK_PORTS.read(value))


class PlcPoint(NamedTuple):
    """A device of one PLC: ``press1.D8201``."""

    plc: str
    device: Device

    def __str__(self) -> str:
        return f"{self.plc}.{self.device}"


def _plc_device(value: object) -> PlcPoint:
    plc, dot, device = value.partition(".") if isinstance(value, str) else ("", "", "")
    if not dot or not _NAME.fullmatch(plc):
        raise fail(say("form_plc_device", found=_found(value)))
    try:
        return PlcPoint(plc, parse_device(device[:100], observed=True))
    except ValueError as error:
        raise fail(say("form_whose_device", value=value, error=error.args[0])) from None


def _is_file_name(value: object) -> bool:
    return isinstance(value, str) and 0 < len(value.strip()) <= len(value) <= 1000 and value.isprintable()


def characters(most: int) -> Kind:
    """A text as the bytes that go over the line, 1 to ``most``; Latin-1, escapes by YAML's quotes."""

    def check(value: object) -> bytes:
        value = unread(value)
        if not isinstance(value, str) or not value:
            raise fail(say("form_text_such", found=_found(value)))
        try:
            data = value.encode("latin-1")
        except UnicodeEncodeError as error:
            strange = value[error.start]
            raise fail(say("form_no_byte", strange=strange)) from None
        return _sized(data, most)

    form = {**UNREAD_FORM, "minLength": 1, "maxLength": most}
    return Kind(check, lambda data: data.decode("latin-1"), form)


def hexadecimal(most: int) -> Kind:
    """Bytes as pairs of hexadecimal digits with spaces between, 1 to ``most``."""

    def check(value: object) -> bytes:
        value = unread(value)
        pairs = value.split() if isinstance(value, str) else []
        found = [_HEX.fullmatch(pair) for pair in pairs]
        if not pairs or None in found:
            raise fail(say("form_hex", found=_found(value)))
        return _sized(bytes(int(match.group(1), 16) for match in found if match is not None), most)

    pair = "(0x)?[0-9a-fA-F]{2}"
    form = {**UNREAD_FORM, "pattern": rf"^\s*{pair}(\s+{pair})*\s*$"}
    return Kind(check, lambda data: data.hex(" ").upper(), form)


def _sized(data: bytes, most: int) -> bytes:
    if len(data) > most:
        raise fail(say("form_bytes", data=len(data), most=most))
    return data


_CHARACTER_CODE = _those(
    lambda value: _is_int(value) and 0 <= value <= 0xFF,
    "form_character",
    form={"type": ["integer", "string"], "minimum": 0, "maximum": 0xFF, "minLength": 1, "maxLength": 1},
)


def _character(value: object) -> int:
    if isinstance(value, str) and len(value) == 1 and ord(value) <= 0xFF:
        return ord(value)
    return cast("int", _CHARACTER_CODE.read(value))


def exact(value: float) -> Fraction:
    """The decimal number that a float prints as: 1.1 is eleven tenths."""
    return Fraction(Decimal(repr(value)))


#: Letters, digits, _ and - (not as the first), at least one letter, at most 64 characters.
Name = Annotated[
    str,
    _matching(
        _NAME,
        NAME_PATTERN,
        "form_not_a_name",
        lambda value: (
            say("form_no_dash")
            if str(value).startswith("-")
            else say("form_names_in_quotes")
            if isinstance(value, bool)
            else ""
        ),
    ),
]
#: The name of a node of a bus: a PLC, one of its ports (press1.COM3), a device.
NodeName = Annotated[str, _matching(_NODE, rf"{NAME_PATTERN}(\.COM[1-6])?", "form_node_name")]
#: A line of free text, 1 to 200 characters.
Title = Annotated[str, _line(200)]
Sentence = Annotated[str, _line(2000)]
Time = Annotated[int, time()]
Positive = Annotated[int, time(low=1)]
#: When something of a run is, and how long it lasts.
Moment = Annotated[int, time(likely="s")]
Duration = Annotated[int, time(low=1, likely="s")]
Probability = Annotated[float, number(0, 1)]
Flag = Annotated[bool, _those(lambda value: isinstance(value, bool), "form_flag", form={"type": "boolean"})]
Times = Annotated[int, whole(1, 1_000_000_000)]
Baud = Annotated[int, one_of(BAUDS)]
#: A character format such as 7E1, which YAML may have read as a number.
Format = Annotated[CharFormat, _parsed(CharFormat.parse, "form_format", FORMAT_FORM)]
#: A device of a PLC's memory, such as D400; one of a PLC that can be observed, such as press1.D8201.
DeviceName = Annotated[Device, _parsed(parse_device, "form_device", TEXT_FORM)]
Range = Annotated[DeviceRange, _parsed(parse_range, "form_devices", TEXT_FORM)]
PlcDevice = Annotated[PlcPoint, Kind(_plc_device, str, {"type": "string", "pattern": r"^[^.]+\.."})]
#: The port of an N:N link.
LinkPort = Annotated[str, Kind(_link_port, form=_LINK_PORTS.form)]
#: The name of a file, with folders or without.
FileName = Annotated[
    str, _those(_is_file_name, "form_file_name", form={"type": "string", "pattern": r"\S", "maxLength": 1000})
]
#: A Modbus function that is known here.
FunctionCode = Annotated[
    int,
    _those(
        lambda value: _is_int(value) and value in FUNCTIONS,
        "form_function",
        lambda value: say("form_meant", meant="0x10") if value == 10 else "",
        form={"enum": sorted(FUNCTIONS)},
    ),
]
#: A Python function as ``module:function``.
CallableName = Annotated[str, _matching(_CALLABLE, r"[^\s:]+:[^\s:]+", "form_callable")]
#: One character: its code 0 to 255, or itself in quotes.
Character = Annotated[int, Kind(_character, form=_CHARACTER_CODE.form)]
Text = Annotated[bytes, characters(MAX_BYTES)]
Hex = Annotated[bytes, hexadecimal(MAX_BYTES)]
