"""The silences of Modbus RTU: what ends a frame and what damages it."""

from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

from bussim.line.characters import LineTiming
from bussim.units import TICKS_PER_US

#: Above this rate the standard's silences are fixed times.
FAST_BAUD = 19200


@dataclass(frozen=True, slots=True)
class GapRule:
    """How a device measures silence between characters; a field of its profile.

    ``end`` characters of silence end a frame, more than ``inner`` inside it damage it. Above 19200
    bps a character counts ``fast_character`` ticks: with the standard's 500 µs, 3.5 and 1.5
    characters are its 1.75 ms and 750 µs. None: a character is a character at every rate.
    """

    end: Fraction = Fraction(7, 2)
    inner: Fraction = Fraction(3, 2)
    fast_character: int | None = 500 * TICKS_PER_US


#: Modbus over serial line, section 2.5.1.1.
STANDARD_GAPS = GapRule()


class Silences(NamedTuple):
    """Two silences in ticks, exact: the longest one inside a frame, and the one that ends it."""

    inner: Fraction
    end: Fraction


def silences(timing: LineTiming, rule: GapRule = STANDARD_GAPS) -> Silences:
    """The silences of a rule at a rate and character format. Parity and stop bits count."""
    character = timing.character
    if timing.baud > FAST_BAUD and rule.fast_character is not None:
        character = Fraction(rule.fast_character)
    return Silences(character * rule.inner, character * rule.end)
