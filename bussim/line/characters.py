"""Character formats of an asynchronous serial line and their exact timing."""

from __future__ import annotations

import re
from dataclasses import dataclass
from fractions import Fraction
from functools import cache

from bussim.units import TICKS_PER_SECOND, round_half_up
from bussim.words.language import say

#: Rates of the PLC ports' format word (PW10 board manual, section 6 "format").
BAUDS = (4800, 9600, 19200, 38400, 57600, 115200)

_FORMAT = re.compile(r"\s*([78])\s*-?\s*([NEOneo])\s*-?\s*([12])\s*")


@dataclass(frozen=True, slots=True)
class CharFormat:
    """Start bit, data bits (7 or 8, least significant first), parity (N, E, O) and stop bits (1, 2)."""

    data_bits: int
    parity: str
    stop_bits: int

    @classmethod
    def parse(cls, text: str) -> CharFormat:
        """``7E1``, ``8N1``, ``8-O-2``… Raises ValueError with a message for the user."""
        match = _FORMAT.fullmatch(text)
        if match is None:
            if number := re.fullmatch(r"([78])(00?)(\.0)?", text):  # some programs write 8E1 as the number 80
                meant = f"{number[1]}E{len(number[2])}"
                raise ValueError(say("form_format_number", text=text, meant=meant))
            raise ValueError(say("form_no_format", text=text))
        return cls(int(match.group(1)), match.group(2).upper(), int(match.group(3)))

    def __str__(self) -> str:
        return f"{self.data_bits}{self.parity}{self.stop_bits}"

    @property
    def bits(self) -> int:
        """Bits of one character on the wire, the start, parity and stop bits included."""
        return 1 + self.data_bits + (self.parity != "N") + self.stop_bits

    def parity_bit(self, value: int) -> int:
        """The parity bit that goes with a value (meaningless for format N)."""
        ones = value.bit_count()
        return (ones & 1) if self.parity == "E" else 1 - (ones & 1)

    def encode(self, value: int) -> tuple[int, ...]:
        """Levels of one character on the wire, bit by bit: 0 is the start bit's level, 1 idle."""
        return _encoded(self)[value & ((1 << self.data_bits) - 1)]


@cache
def _encoded(fmt: CharFormat) -> tuple[tuple[int, ...], ...]:
    table = []
    for value in range(1 << fmt.data_bits):
        data = tuple(value >> i & 1 for i in range(fmt.data_bits))
        parity = () if fmt.parity == "N" else (fmt.parity_bit(value),)
        table.append((0, *data, *parity, *(1,) * fmt.stop_bits))
    return tuple(table)


@dataclass(frozen=True, slots=True)
class LineTiming:
    """Rate and character format of one transmitter or receiver, with its clock's error.

    ``baud`` is in bits per second, ``ppm`` the deviation of the bit clock in parts per million
    (positive: fast clock, short bits). Durations are exact fractions of ticks and are rounded half
    up once, from the first edge of a frame; they are never added up from rounded parts.
    """

    baud: int
    format: CharFormat
    ppm: Fraction = Fraction(0)

    @property
    def bit(self) -> Fraction:
        """Ticks of one bit, exact."""
        return _bit(self.baud, self.ppm)

    @property
    def character(self) -> Fraction:
        """Ticks of one character, exact."""
        return self.bit * self.format.bits

    def bits(self, count: int) -> int:
        """Ticks from an edge to the ``count``-th bit boundary after it."""
        return round_half_up(self.bit * count)

    def characters(self, count: int | Fraction) -> int:
        """Ticks of ``count`` characters, which need not be whole (gaps of 3.5, 1.5, 4.5)."""
        return round_half_up(self.character * count)


@cache
def _bit(baud: int, ppm: Fraction) -> Fraction:
    return Fraction(TICKS_PER_SECOND, baud) / (1 + ppm / 1_000_000)


#: The N:N line: 38400 bps, 7 data bits, even parity, 1 stop bit; 10 bits a character, one bit
#: 1875 ticks (PW10 board manual, section 7.3).
NN_LINE = LineTiming(38400, CharFormat(7, "E", 1))
