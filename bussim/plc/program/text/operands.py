"""Operands of an instruction list: K and H constants, devices, groups of bits, index registers, labels.

How they are written (FX programming manual): ``K-5``, ``H0081``, ``X017`` (octal), ``D8176``,
``K1M1064`` (one group of four bits, M1064 the lowest), ``D0Z1`` and ``K1M0V`` (the value of Z1 or V0
added to the address), ``P12`` (a label), ``N0`` (a level of MC). Lower case is read as upper case.
"""

import re
from dataclasses import dataclass

from bussim.plc.memory import (
    BIT_RANGES,
    INDEX_REGISTERS,
    PLACES,
    WORD_RANGES,
    Device,
    Family,
    lacking,
    own_ranges,
    range_names,
)
from bussim.wording import shorten
from bussim.words.language import say

#: The label that means END (FX programming manual).
END_LABEL = 63

_INDEX = r"(?:([VZ])([0-9]?))?"
_DECIMAL = re.compile(rf"K([+-]?[0-9]{{1,12}}){_INDEX}", re.ASCII)
_HEX = re.compile(rf"H([0-9A-F]{{1,12}}){_INDEX}", re.ASCII)
_GROUP = re.compile(rf"K([0-9]{{1,2}})([XYMS])([0-9]{{1,5}}){_INDEX}", re.ASCII)
_DEVICE = re.compile(rf"([XYMSTCDRPN])([0-9]{{1,5}}){_INDEX}", re.ASCII)
_WORD_BIT = re.compile(r"D([0-9]{1,5})\.([0-9A-F])", re.ASCII)
_REGISTER = re.compile(r"([VZ])([0-9]{0,5})", re.ASCII)
_OCTAL = "XY"


@dataclass(frozen=True, slots=True)
class Operand:
    """One operand and its position in the file.

    ``kind`` is what instructions accept: K (a constant, K or H), KnX KnY KnM KnS (a group), X Y M S T C
    D V Z (a device; R is of the kind D), D.b (the ``bit`` of a word), P (a label) or N (a level).
    ``address`` is the constant's value or the first device's address; ``groups`` the n of Kn; ``index``
    the register (letter, number) added to it.
    ``hexadecimal`` constants are patterns of bits: HFFFF is -1 to a 16-bit instruction.
    """

    text: str
    column: int
    kind: str
    letter: str
    address: int
    groups: int = 0
    index: tuple[str, int] | None = None
    hexadecimal: bool = False
    bit: int = 0
    family: Family = Family.FX2N  # whose program it is of

    @property
    def device(self) -> Device:
        """The first device."""
        return Device(self.letter, self.address)

    @property
    def constant(self) -> int | None:
        """The value of a constant without index, else None."""
        return self.address if self.kind == "K" and self.index is None else None


def range_of(
    letter: str, address: int, *, word: bool, family: Family = Family.FX2N
) -> tuple[int, int] | None:
    """The range of bits or words that holds an address, both ends included; None if none does."""
    own = own_ranges(letter, family)
    for first, last in own or (WORD_RANGES if word else BIT_RANGES).get(letter) or PLACES.get(letter, ()):
        if first <= address <= last:
            return first, last
    return None


def range_text(letter: str, *, family: Family = Family.FX2N) -> str:
    """The addresses of a letter as a message shows them."""
    if letter == "R" and family is not Family.FX3U:
        return say("program_fx3u_only")
    ranges = own_ranges(letter, family) or PLACES.get(letter) or BIT_RANGES.get(letter)
    return range_names(letter, ranges or WORD_RANGES[letter])


def parse_operand(text: str, column: int, *, family: Family = Family.FX2N, plain: str = "K") -> Operand:
    """The operand that a text names; ``family``: whose devices it may name.

    ``plain``: what a number without its letter probably is.

    Raises ValueError with a message for the user.
    """
    upper = text.upper()
    if match := _GROUP.fullmatch(upper):
        count, letter, digits, *index = match.groups()
        address = _address(text, letter, digits, family=family)
        groups = int(count)
        if not 1 <= groups <= 8:
            raise ValueError(say("program_k", text=shorten(text), groups=groups))
        return Operand(
            text, column, f"Kn{letter}", letter, address, groups, _index(text, *index), family=family
        )
    if match := _DECIMAL.fullmatch(upper):
        number, *index = match.groups()
        return Operand(text, column, "K", "K", int(number), 0, _index(text, *index))
    if match := _HEX.fullmatch(upper):
        number, *index = match.groups()
        value = int(number, 16)
        return Operand(text, column, "K", "H", value, 0, _index(text, *index), hexadecimal=True)
    if match := _REGISTER.fullmatch(upper):
        letter, digits = match.groups()
        return Operand(text, column, letter, letter, _address(text, letter, digits or "0"))
    if family is Family.FX3U and (match := _WORD_BIT.fullmatch(upper)):
        address = _address(text, "D", match[1], family=family)
        return Operand(text, column, "D.b", "D", address, bit=int(match[2], 16), family=family)
    if match := _DEVICE.fullmatch(upper):
        letter, digits, *index = match.groups()
        address = _address(text, letter, digits, family=family)
        kind = "D" if letter == "R" else letter
        return Operand(text, column, kind, letter, address, 0, _index(text, *index), family=family)
    raise ValueError(say("program_no_operand_is", text=shorten(repr(text)), hint=_hint(upper, plain)))


def _address(text: str, letter: str, digits: str, *, family: Family = Family.FX2N) -> int:
    shown = shorten(text)
    octal = letter in _OCTAL
    if octal and not set(digits) <= set("01234567"):
        meant = Device(letter, int(digits))
        raise ValueError(say("program_octal", shown=shown, letter=letter, number=int(digits), meant=meant))
    address = int(digits, 8 if octal else 10)
    if range_of(letter, address, word=letter not in BIT_RANGES, family=family) is None:
        lacks = letter != "R" and lacking(Device(letter, address), family)
        why = (
            say("program_lacks", lacks=lacks)
            if lacks
            else say("program_no_such", letter=letter, digits=digits)
        )
        raise ValueError(say("program_why", shown=shown, why=why, allowed=range_text(letter, family=family)))
    return address


def _index(text: str, letter: str | None, digits: str | None) -> tuple[str, int] | None:
    if letter is None:
        return None
    number = int(digits or 0)
    if number >= INDEX_REGISTERS:
        values = {"letter": letter, "number": number, "allowed": range_text(letter)}
        raise ValueError(say("program_no_register", text=shorten(text), **values))
    return letter, number


def _hint(upper: str, plain: str) -> str:
    """What may have been meant: letters for digits are the commonest slip."""
    if upper.lstrip("+-").isdigit() and upper.isascii():
        return say("program_mean_plain", plain=plain, upper=shorten(upper))
    if len(upper) == 1 and upper in "XYMSTCDPN":
        return say("program_needs_number", upper=upper)
    repaired = upper[:1] + upper[1:].translate(str.maketrans("OIL", "011"))
    for guess in (repaired, repaired.replace("-", ""), repaired.replace("_", "")):
        if guess != upper:
            try:
                parse_operand(guess, 0)
            except ValueError:
                continue
            return say("form_mean", near=shorten(guess))
    if re.fullmatch(r"(?:S[MDBWT]|L|B|W|F|ZR|LC|LT|U)[0-9][0-9A-F]*", upper, re.ASCII):
        return say("program_other_series")
    return say("program_write")
