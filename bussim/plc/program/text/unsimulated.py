"""The instructions of the FX3 family that are not simulated, and what each would do to the link.

Names are those of the FX3 programming manual (JY997D16601), instructions of communication also of the FX
communication manual; forms with D in front or P behind belong to them.
"""

import re

from bussim.plc.memory import Family
from bussim.plc.program.text.catalog import FORMS, SPECS, Form, LadderRole, Spec
from bussim.plc.program.text.operand_checks import FIRST_FAST_COUNTER
from bussim.plc.program.text.operands import Operand
from bussim.words.language import say

#: Stands for an output that is skipped.
SKIPPED = Spec("(skipped)", LadderRole.OUTPUT)
#: The keys of what becomes of the link without them, and their names.
_EFFECTS = {
    "effect_adprw": "ADPRW",
    "effect_inverter": "IVCK IVDR IVRD IVWR IVBWR IVMC EXTR",
    "effect_interrupt": "I EI DI IRET",
    "effect_fast_counter": "HSCS HSCR HSZ",
    "effect_refresh": "REF REFF",
    "effect_module": "FROM TO RD3A WR3A RBFM WBFM",
    "effect_rung": "MEP MEF",
    "effect_other": """
        SMOV PRUN MTR SPD PLSY PWM PLSR IST SER ABSD INCD TTMR STMR RAMP ROTC SORT TKY HKY DSW SEGD SEGL ARWS
        ASC PR ASCI HEX CCD VRRD VRSC PID RCR RCL WSFR WSFL SFWR SFRD DECO ENCO SUM BON ANS ANR SQR FLT
        ZPUSH ZPOP ECMP EZCP EMOV ESTR EVAL EBCD EBIN EADD ESUB EMUL EDIV EXP LOGE LOG10 ESQR ENEG INT
        SIN COS TAN ASIN ACOS ATAN RAD DEG WSUM WTOB BTOW UNI DIS SWAP SORT2 DSZR DVIT TBL ABS ZRN PLSV
        DRVI DRVA TCMP TZCP TADD TSUB HTOS STOH TRD TWR HOUR GRY GBIN COMRD RND DUTY CRC HCMOV BK+ BK-
        BKCMP= BKCMP> BKCMP< BKCMP<> BKCMP<= BKCMP>= STR VAL $+ LEN RIGHT LEFT MIDR MIDW INSTR $MOV FDEL
        FINS POP SFR SFL LIMIT BAND ZONE SCL DABIN BINDA SCL2 HSCT LOADR SAVER INITR LOGR RWER INITER
        FLCRT FLDEL FLWR FLRD FLCMD FLSTRD""",
}
_EFFECT = {name: effect for effect, names in _EFFECTS.items() for name in names.split()}
#: What stands for those that are no outputs.
_STANDS_FOR = {
    **dict.fromkeys(("I", "EI", "DI"), FORMS["NOP"]),
    **dict.fromkeys(("MEP", "MEF"), FORMS["ANI"]),  # of M8000, which is always on
    "IRET": Form(SPECS["SRET"]),
}
_INTERRUPT = re.compile(r"I[0-9]{1,3}:?", re.ASCII)


def effect_of(name: str) -> str | None:
    """What becomes of the link without a known instruction (in capitals); None if it is none of these."""
    key = _EFFECT.get(_base(name))
    return None if key is None else say(key)


def _base(name: str) -> str:
    if _INTERRUPT.fullmatch(name):
        return "I"
    bare = name.removesuffix("P")
    forms = (name, bare, name.removeprefix("D"), bare.removeprefix("D"))
    return next((form for form in forms if form in _EFFECT), "")


def effect_of_operands(name: str, operands: tuple[Operand, ...], family: Family) -> tuple[str, str] | None:
    """What an instruction is whose operands are not simulated, and what becomes of the link without it."""
    counter = name == "OUT" and len(operands) == 2 and operands[0].kind == "C"
    if counter and operands[0].address >= FIRST_FAST_COUNTER:
        what = say("program_hardware", counter=operands[0].text, first=FIRST_FAST_COUNTER)
        return what, say("program_never")
    if name == "RS2" and family is Family.FX3U and len(operands) == 5 and operands[4].constant in (0, 1):
        what = say("program_rs2", text=operands[4].text)
        return what, say("program_rs2_silent")
    return None


def stand_in(name: str) -> Form:
    """What is carried out in place of one that is skipped."""
    return _STANDS_FOR.get(_base(name), Form(SKIPPED))
