"""The rules by which the sum of a frame is made, and the forms in which numbers stand in it."""

from collections.abc import Callable
from functools import reduce
from operator import xor
from typing import Final, NamedTuple

from fastcrc import crc8 as _crc8
from fastcrc import crc16 as _crc16

#: Kinds of sums: what each makes of characters, and the bits that it may have, most first.
KINDS: Final[dict[str, tuple[Callable[[bytes], int], tuple[int, ...]]]] = {
    "sum": (sum, (16, 8, 7)),
    "negative": (lambda data: -sum(data), (16, 8, 7)),  # the two's complement, as the LRC of Modbus ASCII
    "inverted": (lambda data: ~sum(data), (16, 8, 7)),
    "xor": (lambda data: reduce(xor, data, 0), (8, 7)),
    "crc16-modbus": (_crc16.modbus, (16,)),
    "crc16-arc": (_crc16.arc, (16,)),
    "crc16-ccitt": (_crc16.ibm_3740, (16,)),
    "crc16-xmodem": (_crc16.xmodem, (16,)),
    "crc16-kermit": (_crc16.kermit, (16,)),
    "crc16-x25": (_crc16.ibm_sdlc, (16,)),
    "crc8": (_crc8.smbus, (8,)),
    "crc8-maxim": (_crc8.maxim_dow, (8,)),
}
#: Kinds to whose values a number may be added.
ADDED: Final = ("sum", "negative", "inverted")


class Number(NamedTuple):
    """How a number stands in a frame: its form and its characters."""

    form: str
    size: int

    def read(self, chars: bytes) -> int | None:
        """The number that characters are; None where they are none of this form."""
        if self.form == "binary":
            return int.from_bytes(chars)
        if not DIGITS[self.form].issuperset(chars):
            return None
        return int(chars, 10 if self.form == "decimal" else 16)

    @property
    def values(self) -> int:
        """How many numbers can be written."""
        base = {"binary": 256, "decimal": 10}.get(self.form, 16)
        return int(base**self.size)


#: Forms of numbers whose characters are digits.
DIGITS: Final = {
    "hex": frozenset(b"0123456789ABCDEF"),
    "hex-lower": frozenset(b"0123456789abcdef"),
    "decimal": frozenset(b"0123456789"),
}
FORMS: Final = (*DIGITS, "binary")
#: Characters of a number of so many bits, by form.
_SIZES: Final[dict[str, Callable[[int], int]]] = {
    "hex": lambda bits: (bits + 3) // 4,
    "hex-lower": lambda bits: (bits + 3) // 4,
    "decimal": lambda bits: len(str((1 << bits) - 1)),
    "binary": lambda bits: (bits + 7) // 8,
}


class Sum(NamedTuple):
    """How the sum of a frame is made.

    ``bits`` are those of it that are sent. ``low_first``: its low byte is sent first. ``of`` is what is added
    up: "characters", or the "bytes" that pairs of hexadecimal digits are. ``start`` is added to it.
    """

    kind: str
    bits: int = 8
    form: str = "hex"
    low_first: bool = False
    of: str = "characters"
    start: int = 0

    @property
    def size(self) -> int:
        """Characters of the sum."""
        return _SIZES[self.form](self.bits)

    def value(self, covered: bytes) -> int | None:
        """The sum of the characters that it covers; None where they are no digits of bytes."""
        if self.of == "bytes":
            try:
                covered = bytes.fromhex(covered.decode("ascii"))
            except ValueError:
                return None
        return (KINDS[self.kind][0](covered) + self.start) & ((1 << self.bits) - 1)

    def sent(self, chars: bytes) -> int | None:
        """The sum that stands in a frame; None where the characters are no number of its form."""
        if self.low_first:
            half = len(chars) // 2
            chars = chars[half:] + chars[:half]
        return Number(self.form, len(chars)).read(chars)

    def right(self, covered: bytes, chars: bytes) -> bool:
        """Whether characters are the sum of others."""
        value = self.sent(chars)
        return value is not None and value == self.value(covered)
