"""Checks of single instructions: number, kinds and ranges of operands, and what devices they touch."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from bussim.plc.memory import FIRST_LONG_COUNTER, FIRST_SPECIAL, Device, Family
from bussim.plc.program.text.catalog import CONTACTS, Form, Instruction, LadderRole, Slot
from bussim.plc.program.text.operands import Operand, range_of, range_text
from bussim.words.language import say
from bussim.words.tables import recognised

#: The first counter that counts in hardware, from its own inputs (FX programming manual).
FIRST_FAST_COUNTER = 235
#: Special bits that the PLC drives: a program that writes them achieves nothing.
READ_ONLY_BITS = frozenset((8000, 8001, 8002, 8003, 8011, 8012, 8013, 8014))
#: Coils that an FX3U finds by an index register, too.
INDEXED_COILS = ("OUT", "SET", "RST")
#: Instructions that take T and C for both their contact and their value.
_BOTH = ("OUT", "RST", "ZRST")


@dataclass(frozen=True, slots=True)
class Extent:
    """Devices that an instruction touches: ``first``…``last`` of a letter, as bits or as words."""

    letter: str
    first: int
    last: int
    word: bool
    writes: bool

    def holds(self, letter: str, address: int, *, word: bool) -> bool:
        """Whether a device is among them."""
        return self.letter == letter and self.word is word and self.first <= address <= self.last


def slots_of(form: Form, operands: tuple[Operand, ...]) -> tuple[Slot, ...]:
    """The operands that an instruction takes: a timer's or a counter's OUT has a preset as well."""
    slots = form.spec.slots
    if form.spec.name == "OUT" and operands and operands[0].kind in ("T", "C"):
        long = operands[0].kind == "C" and operands[0].address >= FIRST_LONG_COUNTER
        limits = (-(1 << 31), (1 << 31) - 1) if long else (0, 32767)
        return (*slots, Slot("preset", ("K", "D"), points=2 if long else 1, limits=limits, index=False))
    return slots


def operand_problems(name: str, form: Form, operands: tuple[Operand, ...]) -> list[tuple[int, str]]:
    """Mistakes of one instruction: (number of the operand, or -1 for the mnemonic, message)."""
    slots = slots_of(form, operands)
    if len(operands) != len(slots):
        names = list(map(_slot, slots))
        wanted = (
            say("program_operands", slots=len(slots), names=names) if slots else say("program_no_operand")
        )
        # The first one too many, or the mnemonic that misses some.
        at = len(slots) if len(operands) > len(slots) else -1
        hint = say("program_semicolon") if at >= 0 else ""
        there = len(operands) or say("program_found_none")
        return [(at, say("program_takes", name=name, wanted=wanted, found=there, hint=hint))]
    found: list[tuple[int, str]] = []
    for number, (slot, operand) in enumerate(zip(slots, operands, strict=True)):
        message = _kind_problem(name, slot, operand) or _value_problem(name, form, slot, operand)
        if message is not None:
            found.append((number, message))
    if found:
        return found
    for number, extent in enumerate(_extents(form, operands)):
        message = None if extent is None else _extent_problem(name, operands[number], extent)
        if message is not None:
            found.append((number, message))
    return found or list(_pair_problems(name, form, operands))


def _slot(slot: Slot) -> str:
    return recognised(slot.name, "slot_")


def _kind_problem(name: str, slot: Slot, operand: Operand) -> str | None:
    text, kind = operand.text, operand.kind
    if kind not in slot.takes:
        if name == "OUT" and kind == "X":
            return say("program_out_x", text=text)
        allowed = " ".join("K H" if taken == "K" else taken for taken in slot.takes)
        return say("program_operand", name=name, slot=_slot(slot), text=text, allowed=allowed)
    if operand.letter == "R" and slot.takes == ("D",):
        return say("program_operand_d", name=name, slot=_slot(slot), text=text)
    contact = (
        slot.takes is CONTACTS
        and operand.family is Family.FX3U
        and kind in "XYMTC"
        and operand.address < FIRST_SPECIAL
    )
    # FX3 programming manual, 7.13.
    coil = (
        name in INDEXED_COILS
        and operand.family is Family.FX3U
        and kind in "YM"
        and operand.address < FIRST_SPECIAL
    )
    if operand.index is not None and not (slot.index or contact or coil):
        return say("program_index", name=name, slot=_slot(slot), text=text)
    return None


def _value_problem(name: str, form: Form, slot: Slot, operand: Operand) -> str | None:
    text, kind, address = operand.text, operand.kind, operand.address
    wide = form.wide and not slot.always_16
    if kind == "K":
        return _constant_problem(name, slot, operand, wide=wide)
    if kind.startswith("Kn"):
        most = 8 if wide or (slot.points == 2 and form.spec.name == "MUL") else 4
        if operand.groups > most:
            return say("program_groups", name=name, text=text, bits=4 * operand.groups, most=most)
    elif kind == "V" and wide:
        return say("program_pair", name=name, text=text, address=address)
    elif kind == "C" and address >= FIRST_LONG_COUNTER:
        if _is_word(form, kind) and not wide:
            instead = (
                say("program_d_form")
                if "D" in form.spec.forms
                else say("program_counters", last=FIRST_LONG_COUNTER - 1)
            )
            return say("program_32", name=name, text=text, instead=instead)
    elif name in ("PLS", "PLF") and kind == "M" and address >= 8000:
        return say("program_special_bit", name=name, text=text)
    return None


def _constant_problem(name: str, slot: Slot, operand: Operand, *, wide: bool) -> str | None:
    value = operand.address
    limits = slot.wide_limits if wide and slot.wide_limits else slot.limits
    if operand.hexadecimal and limits is None:
        digits = 8 if wide else 4
        if value >> 4 * digits:
            hint = "" if wide else _wide_hint(name)
            return say("program_digits", name=name, text=operand.text, digits=digits, hint=hint)
        return None
    low, high = limits or ((-(1 << 31), (1 << 31) - 1) if wide else (-32768, 32767))
    if low <= value <= high:
        return None
    hint = "" if wide or limits is not None else _wide_hint(name)
    hint = say("program_below_1") if name == "FOR" else hint
    return say(
        "program_limits", name=name, slot=_slot(slot), text=operand.text, low=low, high=high, hint=hint
    )


def _wide_hint(name: str) -> str:
    from bussim.plc.program.text.catalog import FORMS

    form = FORMS.get(name)
    return say("program_32_d") if form is not None and "D" in form.spec.forms else ""


def _is_word(form: Form, kind: str) -> bool:
    """Whether T and C mean their values to an instruction, not their contacts."""
    if kind in ("T", "C"):
        bitwise = form.spec.role is LadderRole.CONTACT and form.spec.group == "basic"
        return form.spec.name not in _BOTH and not bitwise
    return kind in ("D", "D.b", "V", "Z")


def _extents(form: Form, operands: tuple[Operand, ...]) -> list[Extent | None]:
    slots = slots_of(form, operands)
    return [
        _extent(form, slot, slots, operand, operands) for slot, operand in zip(slots, operands, strict=True)
    ]


def _extent(
    form: Form, slot: Slot, slots: tuple[Slot, ...], operand: Operand, operands: tuple[Operand, ...]
) -> Extent | None:
    kind, first = operand.kind, operand.address
    if kind in ("K", "P", "N"):
        return None
    count = slot.points
    if slot.by:
        named = next(other for other, its in zip(operands, slots, strict=True) if its.name == slot.by)
        count = named.constant or 1  # a register's value is known only when it runs
    if kind.startswith("Kn"):
        bits = 4 * operand.groups * (count if slot.by else 1)
        return Extent(operand.letter, first, first + bits - 1, word=False, writes=slot.writes)
    if not _is_word(form, kind):
        return Extent(operand.letter, first, first + count - 1, word=False, writes=slot.writes)
    paired = (
        form.wide and not slot.always_16 and kind != "Z" and not (kind == "C" and first >= FIRST_LONG_COUNTER)
    )
    last = first + count * (2 if paired else 1) - 1
    return Extent(operand.letter, first, last, word=True, writes=slot.writes)


def _extent_problem(name: str, operand: Operand, extent: Extent) -> str | None:
    letter = extent.letter
    bounds = range_of(letter, extent.first, word=extent.word, family=operand.family)
    if bounds is not None and extent.last > bounds[1]:
        last, allowed = Device(letter, bounds[1]), range_text(letter, family=operand.family)
        return say("program_past", name=name, text=operand.text, last=last, allowed=allowed)
    if extent.writes and letter == "M" and operand.index is None:
        for number in range(extent.first, extent.last + 1):
            if number in READ_ONLY_BITS:
                return say("program_by_plc", name=name, number=number)
    return None


def extents(instruction: Instruction, *, backwards: bool = False) -> list[Extent]:
    """What an instruction touches whose operands have no index; of an indexed one nothing is known.

    ``backwards``: M8024 may make a BMOV write its source.
    """
    found = _extents(instruction.form, instruction.operands)
    if backwards and instruction.spec.name == "BMOV" and found[0] is not None and found[0].letter != "X":
        found[0] = replace(found[0], writes=True)
    kept = [
        extent
        for extent, operand in zip(found, instruction.operands, strict=True)
        if extent is not None and operand.index is None
    ]
    if instruction.spec.name == "ZRST":
        first, last = kept
        words = first.letter in "DR"
        return [Extent(first.letter, first.first, max(first.first, last.first), word=words, writes=True)]
    return kept


def _pair_problems(name: str, form: Form, operands: tuple[Operand, ...]) -> Iterator[tuple[int, str]]:
    spec = form.spec.name
    if spec == "BMOV":
        source, target = operands[0], operands[1]
        if source.groups and target.groups and source.groups != target.groups:
            yield 1, say("program_other_k", name=name, target=target.text, source=source.text)
    elif spec in ("SFTR", "SFTL"):
        length, step = operands[2].constant, operands[3].constant
        if length is not None and step is not None and step > length:
            yield 3, say("program_n2", name=name, step=step, length=length)
    elif spec in ("ROR", "ROL"):
        full = 8 if form.wide else 4
        if operands[0].groups not in (0, full):
            yield 0, say("program_whole_word", name=name, text=operands[0].text, full=full)
    elif spec == "ZRST":
        first, last = operands
        if first.letter != last.letter:
            yield 1, say("program_other_kind", name=name, last=last.text, first=first.text)
        elif first.kind == "C" and (first.address < FIRST_LONG_COUNTER) != (
            last.address < FIRST_LONG_COUNTER
        ):
            yield 1, say("program_apart", name=name, first=first.text, last=last.text)
