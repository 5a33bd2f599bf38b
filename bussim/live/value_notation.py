"""How the values of registers are written and read on the command line.

========  ==========  ==========================================
format    registers   value
========  ==========  ==========================================
``uint``  1           0…65535
``int16`` 1           -32768…32767
``hex``   1           0…0xFFFF, shown as 0x and four hexadecimal digits
``int``   2           -2147483648…2147483647
``float`` 2           IEEE 754, single precision
========  ==========  ==========================================

The names are mbpoll's (``uint`` is its format without a name). Two registers carry the low word first;
``big`` puts the high word first. Whole numbers are decimal or begin with 0x.
"""

import re
import struct
from collections.abc import Iterable, Sequence
from enum import StrEnum
from typing import assert_never

Value = int | float | str


class Form(StrEnum):
    """A format of values; see the module."""

    UINT = "uint"
    INT16 = "int16"
    HEX = "hex"
    INT = "int"
    FLOAT = "float"

    @property
    def registers(self) -> int:
        """Registers that one value takes."""
        return 2 if self in (Form.INT, Form.FLOAT) else 1


def to_values(words: Sequence[int], form: Form, *, big: bool = False) -> list[Value]:
    """The values that registers hold. What does not fill a value is left out."""
    match form:
        case Form.UINT:
            return list(words)
        case Form.HEX:
            return [f"0x{word:04X}" for word in words]
        case Form.INT16:
            return [word - 0x10000 if word & 0x8000 else word for word in words]
        case Form.INT:
            code = ">i"
        case Form.FLOAT:
            code = ">f"
        case _:
            assert_never(form)
    pairs = zip(words[::2], words[1::2], strict=False)
    raw = (struct.pack(">HH", *(pair if big else pair[::-1])) for pair in pairs)
    return [struct.unpack(code, four)[0] for four in raw]


def to_words(texts: Iterable[str], form: Form, *, big: bool = False) -> list[int]:
    """The registers that hold values as people write them. Raises ValueError, with a message for the user."""
    words: list[int] = []
    for text in texts:
        if form.registers == 1:
            words.append(_word(text, form))
            continue
        try:
            raw = struct.pack(">i", int(text, 0)) if form is Form.INT else struct.pack(">f", float(text))
        except (ValueError, struct.error, OverflowError):
            raise ValueError(f"the value {text!r} is no {form} of 32 bits{_zeros(text)}") from None
        high, low = struct.unpack(">HH", raw)
        words += (high, low) if big else (low, high)
    return words


def _word(text: str, form: Form) -> int:
    low, high = (-0x8000, 0x7FFF) if form is Form.INT16 else (0, 0xFFFF)
    try:
        value = int(text, 0)
    except ValueError:
        raise ValueError(f"the value {text!r} is no whole number such as 100 or 0x64{_zeros(text)}") from None
    if not low <= value <= high:
        raise ValueError(f"the value is {text}, allowed {low}…{high}")
    return value & 0xFFFF


def _zeros(text: str) -> str:
    """What to write for a number with zeros in front, which others read as octal."""
    found = re.fullmatch(r"([+-]?)0+([1-9][0-9]*)", text.strip())
    return f"; write {found[1]}{found[2]}, without zeros in front" if found else ""
