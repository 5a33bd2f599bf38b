"""Device memory: X Y M S T C D by address, with the FX's ranges; X and Y are numbered in octal.

T and C name the contacts of timers and counters; an observer of a PLC names their current values TN
and CN, as programming tools do, and the index registers V and Z.
"""

from __future__ import annotations

import re
import sys
from array import array
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from bussim.words.language import say


class Family(StrEnum):
    """Whose devices a PLC has; a PW10 those of an FX2N."""

    FX1S = "FX1S"
    FX2N = "FX2N"
    FX3U = "FX3U"


#: Bit devices and their address ranges (both ends included). T and C are the contacts.
BIT_RANGES: dict[str, tuple[tuple[int, int], ...]] = {
    "X": ((0, 0o377),),
    "Y": ((0, 0o377),),
    "M": ((0, 3071), (8000, 8255)),
    "S": ((0, 999),),
    "T": ((0, 255),),
    "C": ((0, 255),),
}
#: V0–V7 and Z0–Z7.
INDEX_REGISTERS = 8
FIRST_LONG_COUNTER = 200
#: Word devices that a program names. T and C are the current values; C200–C255 have 32 bits and stand alone.
WORD_RANGES: dict[str, tuple[tuple[int, int], ...]] = {
    "D": ((0, 8255),),
    "T": ((0, 255),),
    "C": ((0, FIRST_LONG_COUNTER - 1), (FIRST_LONG_COUNTER, 255)),
    "V": ((0, INDEX_REGISTERS - 1),),
    "Z": ((0, INDEX_REGISTERS - 1),),
}
#: Labels P0–P127, of which P63 means END, and levels of MC (FX programming manual).
PLACES: dict[str, tuple[tuple[int, int], ...]] = {"P": ((0, 127),), "N": ((0, 7),)}
#: What an FX1S has instead, labels among it (FX programming manual, JY992D88101, chapter 4).
FX1S_RANGES: dict[str, tuple[tuple[int, int], ...]] = {
    "X": ((0, 0o17),),
    "Y": ((0, 0o15),),
    "M": ((0, 511), (8000, 8255)),
    "S": ((0, 127),),
    "T": ((0, 63),),
    "TN": ((0, 63),),
    "C": ((0, 31), (235, 255)),
    "CN": ((0, 31), (235, 255)),
    "D": ((0, 255), (8000, 8255)),
    "P": ((0, 63),),
}
#: What an FX3U has more, labels among it (FX3 programming manual, JY997D16601, chapter 4).
FX3_RANGES: dict[str, tuple[tuple[int, int], ...]] = {
    "M": ((0, 7679), (8000, 8511)),
    "S": ((0, 4095),),
    "T": ((0, 511),),
    "TN": ((0, 511),),
    "D": ((0, 8511),),
    "R": ((0, 32767),),
    "P": ((0, 4095),),
}
_OWN_RANGES = {Family.FX1S: FX1S_RANGES, Family.FX2N: {}, Family.FX3U: FX3_RANGES}
#: M8000 and D8000 on are special devices.
FIRST_SPECIAL = 8000
#: Words that can be observed and that nothing but a program sets: current values, index registers.
OBSERVED_RANGES: dict[str, tuple[tuple[int, int], ...]] = {
    "TN": ((0, 255),),
    "CN": ((0, 255),),
    "V": WORD_RANGES["V"],
    "Z": WORD_RANGES["Z"],
}

_NAME = re.compile(r"([XYMSTCDR]|TN|CN|V|Z)([0-9]{1,5})")
_SLIPS = str.maketrans("OIL", "011")  # letters that are taken for digits
_LETTERS = "XYMSTCD"
#: M and D of an FX3U.
_WITH_SPECIALS = 8512
_OCTAL = "XY"
_AS_DIGITS = bytes((0x30, 0x31)) + bytes(254)
#: The eight bits of every byte, lowest first.
_BITS_OF = tuple(bytes(value >> number & 1 for number in range(8)) for value in range(256))


class Device(NamedTuple):
    """A device: its letter and its address as a plain number (X10 is ("X", 8))."""

    letter: str
    address: int

    def __str__(self) -> str:
        return f"{self.letter}{self.address:o}" if self.letter in _OCTAL else f"{self.letter}{self.address}"

    @property
    def is_word(self) -> bool:
        """Whether the name means a word (D R TN CN V Z); T and C mean their contact."""
        return self.letter not in BIT_RANGES

    @property
    def width(self) -> int:
        """Its bits: 1, 16, or the 32 of C200–C255's values."""
        if not self.is_word:
            return 1
        return 32 if self.letter == "CN" and self.address >= FIRST_LONG_COUNTER else 16


def own_ranges(letter: str, family: Family) -> tuple[tuple[int, int], ...] | None:
    """The ranges of a letter that a family has in place of the FX2N's; None where it has the same."""
    return _OWN_RANGES[family].get(letter)


def _ranges_of(letter: str, family: Family) -> tuple[tuple[int, int], ...]:
    if (own := own_ranges(letter, family)) is not None:
        return own
    return next((of[letter] for of in (BIT_RANGES, OBSERVED_RANGES, WORD_RANGES, PLACES) if letter in of), ())


def parse_device(name: str, *, observed: bool = False, family: Family = Family.FX3U) -> Device:
    """The device of a name such as ``D8201``, ``M1064`` or ``X17`` (octal), in capitals or not.

    ``observed``: also TN, CN, V and Z. ``family``: whose devices they are. Raises ValueError with a
    message for the user.
    """
    letters = " ".join((*_LETTERS, *OBSERVED_RANGES)) if observed else " ".join(_LETTERS)
    match = _NAME.fullmatch(name.upper() if name.isascii() else name)
    if match is None:
        near = _near(name, observed=observed)
        hint = say("form_meant", meant=near) if near else say("memory_write", letters=letters)
        raise ValueError(say("memory_no_device", name=name, hint=hint))
    letter, digits = match.groups()
    if letter in OBSERVED_RANGES and not observed:
        raise ValueError(say("memory_observed", name=name, letters=letters))
    if letter in _OCTAL and not set(digits) <= set("01234567"):
        point = Device(letter, int(digits))
        raise ValueError(say("memory_octal", name=name, letter=letter, number=int(digits), point=point))
    device = Device(letter, int(digits, 8 if letter in _OCTAL else 10))
    ranges = _ranges_of(letter, family)
    if not _lies_in(device, ranges):
        allowed = range_names(letter, ranges)
        lacks = lacking(device, family)
        if not lacks:
            raise ValueError(say("memory_allowed", name=name, allowed=allowed))
        more = say("memory_and_allowed", allowed=allowed) if allowed else ""
        raise ValueError(say("memory_lacks", name=name, lacks=lacks, more=more))
    return device


def range_names(letter: str, ranges: Iterable[tuple[int, int]]) -> str:
    """Ranges of a letter as a message shows them."""
    return ", ".join(f"{Device(letter, first)}–{Device(letter, last)}" for first, last in ranges)


def lacking(device: Device, family: Family) -> str:
    """Why a family lacks a device that others have: ``only an FX3U has``; empty where none has it."""
    letter = device.letter
    if family is Family.FX1S and _lies_in(device, _ranges_of(letter, Family.FX2N)):
        return say("memory_fx1s")
    return say("memory_fx3u") if _lies_in(device, own_ranges(letter, Family.FX3U) or ()) else ""


def _lies_in(device: Device, ranges: tuple[tuple[int, int], ...]) -> bool:
    return any(first <= device.address <= last for first, last in ranges)


def _near(name: str, *, observed: bool) -> str | None:
    """The device that a name may mean: small letters, letters for digits, a programming tool's TS."""
    upper = "".join(name.split()).upper()
    contact = re.sub("^([TC])S", r"\1", upper)
    repaired = [text[:at] + text[at:].translate(_SLIPS) for text in (upper, contact) for at in (1, 2)]
    for guess in (upper, contact, *repaired):
        if guess != name and _NAME.fullmatch(guess):
            try:
                return str(parse_device(guess, observed=observed))
            except ValueError:
                continue
    return None


class DeviceRange(NamedTuple):
    """Devices of one letter, both ends included; of T and C the contact, the value and the hold of RST."""

    letter: str
    first: int
    last: int

    def __str__(self) -> str:
        return f"{self.letter}{self.first}-{self.letter}{self.last}"

    def holds(self, device: Device) -> bool:
        """Whether a device lies in it."""
        return self.letter == device.letter and self.first <= device.address <= self.last


def device_ranges(text: str) -> tuple[DeviceRange, ...]:
    """The ranges of a text such as ``M500-3071 D200-7999 M8033``, whether a PLC has them or not."""
    return tuple(
        DeviceRange(letter, int(first), int(last or first))
        for letter, first, last in re.findall(r"([A-Z])(\d+)-?(\d*)", text)
    )


#: What a program uses: all devices but inputs and special ones.
OWN_DEVICES = device_ranges("Y0-255 M0-7999 S0-7999 T0-999 C0-999 D0-7999 V0-7 Z0-7 R0-32767")


def parse_range(text: str) -> DeviceRange:
    """The range of a text such as ``M500-M3071``. Raises ValueError with a message for the user."""
    found = re.fullmatch(r"([MSTCDR])(\d{1,5}) *[-–] *\1(\d{1,5})", text, re.ASCII)
    last = FIRST_SPECIAL if found and found[1] in "MD" else 32768
    if found is None or not int(found[2]) <= int(found[3]) < last:
        raise ValueError(say("memory_range", text=text))
    return DeviceRange(found[1], int(found[2]), int(found[3]))


def latched_problem(kept: DeviceRange, family: Family) -> str | None:
    """Why a family cannot keep a range of devices: it does not have them all; None where it can."""
    letter, first, last = kept
    ranges = [pair for pair in _ranges_of(letter, family) if pair[0] < FIRST_SPECIAL]
    if any(low <= first and last <= high for low, high in ranges):
        return None
    ranges = [(low, min(high, FIRST_SPECIAL - 1)) if letter in "MD" else (low, high) for low, high in ranges]
    allowed = range_names(letter, ranges) or say("memory_none", letter=letter)
    return say("memory_kept", kept=kept, allowed=allowed)


@dataclass(frozen=True, slots=True)
class BlockRange:
    """Where a station's shared block lies: ``bits`` M points from ``bit``, ``words`` D from ``word``."""

    bit: int
    bits: int
    word: int
    words: int

    def holds(self, device: Device) -> bool:
        """Whether a device lies in it."""
        if device.letter == "D":
            return self.word <= device.address < self.word + self.words
        return device.letter == "M" and self.bit <= device.address < self.bit + self.bits


def block_range(station: int, bits: int, words: int, spacing: int) -> BlockRange:
    """The block of a station: M(1000 + 64s) and D(spacing × s) on (PW10, section 7.2)."""
    return BlockRange(1000 + 64 * station, bits, spacing * station, words)


class Memory:
    """One PLC's devices. Bits are 0/1, words 0…65535, C200–C255 0…2³²−1."""

    def __init__(self) -> None:
        self._bits = {letter: bytearray(ranges[-1][1] + 1) for letter, ranges in BIT_RANGES.items()}
        self._bits |= {"M": bytearray(_WITH_SPECIALS), "S": bytearray(4096), "T": bytearray(512)}
        self._words = {
            "D": array("H", bytes(2 * _WITH_SPECIALS)),
            "R": array("H", bytes(2 * 32768)),
            "T": array("H", bytes(2 * 512)),
            "C": array("L" if array("L").itemsize == 4 else "I", bytes(4 * 256)),
            "V": array("H", bytes(2 * INDEX_REGISTERS)),
            "Z": array("H", bytes(2 * INDEX_REGISTERS)),
        }
        self._words |= {"TN": self._words["T"], "CN": self._words["C"]}
        #: Called with an END before others read a special device; None: special devices are current.
        self.refresh_specials: Callable[[int], None] | None = None
        #: Of each timer and counter: whether an RST holds it.
        self.held = {letter: bytearray(512) for letter in "TC"}
        #: The condition that each instruction of the program had when it was last carried out.
        self.earlier = bytearray()

    def bits(self, letter: str) -> bytearray:
        """All bits of a letter by address, 0 or 1 each: the memory itself, where speed matters.

        Addresses between the ranges of M exist in it and mean nothing.
        """
        return self._bits[letter]

    def words(self, letter: str) -> array[int]:
        """All words of a letter (D V Z; T or TN, C or CN) by address: the memory itself."""
        return self._words[letter]

    def get(self, device: Device) -> int:
        """The value of a bit (of T and C: the contact) or of a word (D TN CN V Z)."""
        letter, address = device
        bits = self._bits.get(letter)
        return self._words[letter][address] if bits is None else bits[address]

    def set(self, device: Device, value: int) -> None:
        """Set a bit (any value but 0 is 1) or a word (its low bits)."""
        letter, address = device
        bits = self._bits.get(letter)
        if bits is None:
            self._words[letter][address] = value & ((1 << device.width) - 1)
        else:
            bits[address] = 1 if value else 0

    def word(self, letter: str, address: int) -> int:
        """A word device: D, or the current value of T or C."""
        return self._words[letter][address]

    def set_word(self, letter: str, address: int, value: int) -> None:
        """Set a word device to the value's low 16 bits (C200–C255: 32)."""
        long = letter == "C" and address >= FIRST_LONG_COUNTER
        self._words[letter][address] = value & (0xFFFFFFFF if long else 0xFFFF)

    def keep(self, other: Memory, latched: Iterable[DeviceRange]) -> None:
        """Take over what another memory holds of some devices; those that there are not are passed over."""
        for letter, first, last in latched:
            for shelf in ("_bits", "_words", "held"):
                mine, others = getattr(self, shelf), getattr(other, shelf)
                if letter in mine:
                    mine[letter][first : last + 1] = others[letter][first : last + 1]

    def block_image(self, block: BlockRange) -> bytes:
        """A shared block as its frame carries it: M low byte first, then D words high byte first."""
        return _block_image(self._bits["M"], self._words["D"], block)

    def store_block(self, block: BlockRange, image: bytes) -> None:
        """Write a received block."""
        size = block.bits // 8
        self._bits["M"][block.bit : block.bit + block.bits] = b"".join(
            map(_BITS_OF.__getitem__, image[:size])
        )
        words = array("H")
        words.frombytes(image[size:])
        if sys.byteorder == "little":
            words.byteswap()
        self._words["D"][block.word : block.word + block.words] = words


class SharedAreas:
    """A copy of what the link can share of a memory: M up to station 7's block, and ``words`` D."""

    __slots__ = ("_bits", "_copied", "_memory", "_words")

    def __init__(self, memory: Memory, words: int) -> None:
        self._memory = memory
        self._copied = words
        self._bits = bytearray()
        self._words = array("H")
        self.take()

    def take(self) -> None:
        """Copy what the memory holds now."""
        self._bits = self._memory.bits("M")[:_SHARED_BITS]
        self._words = self._memory.words("D")[: self._copied]

    def block_image(self, block: BlockRange) -> bytes:
        """A shared block of the copy; see :meth:`Memory.block_image`."""
        return _block_image(self._bits, self._words, block)


#: M1511 is the last M of station 7.
_SHARED_BITS = 1512


def _block_image(m: bytearray, d: array[int], block: BlockRange) -> bytes:
    bits = m[block.bit : block.bit + block.bits]
    # The lowest M is bit 0: as a binary number it is written last.
    packed = int(bits[::-1].translate(_AS_DIGITS), 2) if bits else 0
    words = d[block.word : block.word + block.words]
    if sys.byteorder == "little":
        words.byteswap()
    return packed.to_bytes(block.bits // 8, "little") + words.tobytes()
