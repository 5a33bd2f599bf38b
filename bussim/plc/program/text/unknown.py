"""What is said of a word that is no instruction: what was probably meant."""

import re

from bussim.plc.program.text.catalog import FORMS, Spec
from bussim.plc.program.text.unsimulated import effect_of
from bussim.wording import nearest, shorten
from bussim.words.language import say

#: Names that others give to instructions.
_ELSEWHERE = {
    **dict.fromkeys(("TMR", "CNT", "TIM", "TON", "CTU", "ST", "="), "OUT"),
    **dict.fromkeys(("LDN", "LDNOT", "STR"), "LDI"),
    **dict.fromkeys(("ANDI", "ANDN", "AN"), "ANI"),
    **dict.fromkeys(("ORN", "ON"), "ORI"),
    "A": "AND",
    "O": "OR",
    "NOT": "INV",
    "JMP": "CJ",
    "S": "SET",
    "R": "RST",
}
#: What most lines of most programs begin with, from the commonest on: of two that are as like a mistake as
#: each other the earlier one is meant.
_COMMON_NAMES = """
    LD LDI AND ANI OR ORI OUT SET RST MOV END LDP LDF ANDP ANDF ORP ORF ANB ORB MPS MRD MPP PLS PLF
    INV MOVP DMOV BMOV FMOV ADD SUB MUL DIV INC INCP DEC DECP CMP ZCP CJ CALL FEND SRET NOP CPAVL
    RS2
"""
_COMMON = _COMMON_NAMES.split()


def unknown(word: str) -> str:
    """Why a word is no instruction here, and which one may be meant."""
    shown = shorten(repr(word))
    upper = word.upper()
    if re.fullmatch(r"FNC\(?\d*\)?", upper, re.ASCII):
        return say("program_fnc", shown=shown)
    if effect := effect_of(upper):
        return say("program_fx3", shown=shown, skip=say("effect_skip"), effect=effect)
    # A known instruction in a form that it does not have says more than the nearest name.
    for base in (
        upper,
        upper.removesuffix("P"),
        upper.removeprefix("D"),
        upper.removeprefix("D").removesuffix("P"),
    ):
        if base in FORMS and base != upper and not FORMS[base].wide:
            return say("program_forms", shown=shown, base=base, forms=_forms(FORMS[base].spec))
    near = _ELSEWHERE.get(upper) or _nearest(upper)
    if near is not None:
        return say("program_no_instruction_mean", shown=shown, near=near)
    return say("program_no_instruction", shown=shown)


def _nearest(upper: str) -> str | None:
    """The instruction that was meant: with its letters swapped, a common one, else any that is very like."""
    letters = sorted(upper)
    swapped = next((name for name in _COMMON if sorted(name) == letters), None)
    return swapped or nearest(upper, _COMMON) or nearest(upper, list(FORMS), cutoff=0.75)


def _forms(spec: Spec) -> str:
    wide = spec.wide_name or f"D{spec.name}"
    match spec.forms:
        case "":
            return say("program_no_forms")
        case "P":
            return say("program_form_p", spec=spec.name)
        case "D":
            return say("program_form_d", spec=spec.name, wide=wide)
        case _:
            return say("program_form_all", spec=spec.name, wide=wide)
