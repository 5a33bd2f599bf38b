"""The instructions: their forms, operands and steps. One table for the parser, the checks and the docs.

Forms (FX programming manual): a D in front makes an applied instruction work on 32 bits (DMOV; of
WAND it is DAND), a P behind makes it work once per rising edge of its condition (MOVP).
"""

from dataclasses import dataclass, replace
from enum import Enum, StrEnum
from typing import Any, Self

from bussim.plc.program.text.operands import Operand


class LadderRole(Enum):
    """What an instruction is in a ladder."""

    CONTACT = "contact"
    BLOCK = "block"  # ANB ORB MPS MRD MPP INV
    OUTPUT = "output"  # needs a condition in front of it
    BARE = "bare"  # stands on the left bus, begins nothing: FEND, FOR, a label, …
    NOTHING = "nothing"  # NOP


class Flow(StrEnum):
    """The instructions that decide which others a scan carries out, or how often, by name.

    ``has_target``: the operand is the label where the program goes on. ``returns``: it leads backwards, or
    elsewhere and back. ``is_vague``: only a run shows what it lets be carried out.
    """

    has_target: bool
    returns: bool
    is_vague: bool

    CJ = "CJ", True, False, True
    CALL = "CALL", True, True, True
    WDT = "WDT", False, False, False  # only resets the watchdog, but at an exact place
    MC = "MC", False, False, True
    MCR = "MCR", False, False, False
    FOR = "FOR", False, True, True
    NEXT = "NEXT", False, False, False  # where FOR leads back from
    SRET = "SRET", False, False, False  # where CALL leads back from
    FEND = "FEND", False, False, False
    END = "END", False, False, False
    STL = "STL", False, False, True  # a step: what follows is carried out while its state is on
    RET = "RET", False, False, False  # the end of the steps
    LABEL = "P", False, False, False

    def __new__(cls, name: str, has_target: bool, returns: bool, is_vague: bool) -> Self:  # noqa: FBT001 - rows
        """A row of the table."""
        member = str.__new__(cls, name)
        member._value_ = name
        member.has_target, member.returns, member.is_vague = has_target, returns, is_vague
        return member


_FLOWS = {flow.value: flow for flow in Flow}

#: What an operand may be, for the commonest operands.
WORDS_TO = ("KnY", "KnM", "KnS", "T", "C", "D", "V", "Z")
WORDS_FROM = ("K", "KnX", *WORDS_TO)
COUNTS = ("K", "D")
BITS_TO = ("Y", "M", "S")
BITS_FROM = ("X", *BITS_TO)
CONTACTS = (*BITS_FROM, "T", "C", "D.b")


@dataclass(frozen=True, slots=True)
class Slot:
    """One operand of an instruction.

    ``takes`` lists the kinds allowed. The instruction touches ``points`` consecutive bits or words (×2
    words in a D form) from the operand on, or as many as the constant of the slot named ``by``.
    ``limits`` bound a constant (both ends included; of a D form where they differ: ``wide_limits``).
    """

    name: str
    takes: tuple[str, ...]
    writes: bool = False
    points: int = 1
    by: str = ""
    limits: tuple[int, int] | None = None
    wide_limits: tuple[int, int] | None = None
    index: bool = True
    always_16: bool = False  # a count: 16 bits in the D form too


@dataclass(frozen=True, slots=True)
class Spec:
    """One instruction in its 16-bit form. ``forms`` holds D and P where those exist.

    ``group`` is the class of its time; ``steps`` the number of program steps (None: 1 + 2 for every
    operand, 4 in the D form).
    """

    name: str
    role: LadderRole
    slots: tuple[Slot, ...] = ()
    forms: str = ""
    wide_name: str = ""
    group: str = "basic"
    steps: int | None = None
    join: str = ""  # of a contact: LD AND OR
    test: str = ""  # of a contact: on off rise fall, or = > < <> <= >=
    fallible: bool = False  # may meet data that it refuses while it runs

    @property
    def is_applied(self) -> bool:
        """Whether it is an applied instruction that the program's course does not depend on."""
        return self.role is LadderRole.OUTPUT and self.group != "basic"

    @property
    def flow(self) -> Flow | None:
        """What it is to the program's course, None where it is nothing to it; a bare one always is."""
        return _FLOWS[self.name] if self.role is LadderRole.BARE else _FLOWS.get(self.name)


@dataclass(frozen=True, slots=True)
class Form:
    """An instruction as it is written: which one, whether 32-bit, whether pulsed."""

    spec: Spec
    wide: bool = False
    pulse: bool = False


@dataclass(frozen=True, slots=True)
class Instruction:
    """One instruction of a program: its number (from 0), its first program step, its position in the text."""

    number: int
    step: int
    line: int
    column: int
    name: str
    form: Form
    operands: tuple[Operand, ...]

    @property
    def spec(self) -> Spec:
        """The instruction's 16-bit form."""
        return self.form.spec


def _contacts() -> list[Spec]:
    bit = (Slot("device", CONTACTS, index=False),)
    words = (Slot("first", WORDS_FROM), Slot("second", WORDS_FROM))
    found = []
    for join, inverted in (("LD", "LDI"), ("AND", "ANI"), ("OR", "ORI")):
        for name, test, steps in (
            *((join, "on", None), (inverted, "off", None)),
            *((f"{join}P", "rise", 2), (f"{join}F", "fall", 2)),
        ):
            found.append(Spec(name, LadderRole.CONTACT, bit, join=join, test=test, steps=steps))
        for test in ("=", ">", "<", "<>", "<=", ">="):
            wide = f"{join}D{test}"
            compared = Spec(
                f"{join}{test}", LadderRole.CONTACT, words, "D", wide, "comparison", None, join, test
            )
            found.append(compared)
    return found


_S = Slot("source", WORDS_FROM)
_S1, _S2 = replace(_S, name="first source"), replace(_S, name="second source")
_D = Slot("destination", WORDS_TO, writes=True)
_ONE_BIT = Slot("destination", BITS_TO, writes=True, index=False)
_THREE_BITS = Slot("destination", BITS_TO, writes=True, points=3)
_DOUBLE = Slot("destination", tuple(k for k in WORDS_TO if k not in "VZ"), writes=True, points=2)


def _count(name: str, low: int, high: int, *, takes: tuple[str, ...] = COUNTS) -> Slot:
    return Slot(name, takes, limits=(low, high), always_16=True)


_BLOCK_WORDS = ("KnX", "KnY", "KnM", "KnS", "T", "C", "D")
_BLOCK_TO = _BLOCK_WORDS[1:]
_LABEL = (Slot("label", ("P",), index=False),)
_ADDED = (_S1, _S2, _D)
_LIMITS = (replace(_S, name="lower limit"), replace(_S, name="upper limit"))
_LOGIC = ("AND", "OR", "XOR")


def _output(name: str, *slots: Slot, forms: str = "", group: str = "basic", **more: Any) -> Spec:
    return Spec(name, LadderRole.OUTPUT, slots, forms, group=group, **more)


def _shift(name: str) -> Spec:
    source, target = Slot("source", BITS_FROM, by="n2"), Slot("destination", BITS_TO, writes=True, by="n1")
    lengths = (Slot(n, ("K",), limits=(1, 1024), index=False) for n in ("n1", "n2"))
    return _output(name, source, target, *lengths, forms="P", group="block", fallible=True)


def _block(name: str, source: Slot, target: Slot, most: int, forms: str) -> Spec:
    return _output(name, source, target, _count("n", 1, most), forms=forms, group="block", fallible=True)


_FIXED_BIT = replace(_ONE_BIT, takes=("Y", "M"))
_ANY_BIT = replace(_ONE_BIT, takes=(*BITS_TO, "D.b"))
_BLOCK_SOURCE = Slot("source", _BLOCK_WORDS, by="n")
_BLOCK_TARGET = Slot("destination", _BLOCK_TO, writes=True, by="n")
_ROTATED = (_D, Slot("n", ("K",), limits=(1, 16), wide_limits=(1, 32), index=False))
_RESET = Slot("device", (*BITS_TO, "D.b", "T", "C", "D", "V", "Z"), writes=True, index=False)
_ZONE = Slot("first device", (*BITS_TO, "T", "C", "D"), writes=True, index=False)
_PORT_REGISTER = Slot("S", ("D",), index=False)
_PORT_COUNT = Slot("m", COUNTS, index=False, limits=(0, 0xFFFF))
_SENT_AND_RECEIVED = (
    _PORT_REGISTER,
    _PORT_COUNT,
    replace(_PORT_REGISTER, name="D"),
    replace(_PORT_COUNT, name="n"),
)
_OUTPUTS = [
    _output("OUT", Slot("device", (*BITS_TO, "T", "C", "D.b"), writes=True, index=False)),
    _output("SET", _ANY_BIT),
    _output("RST", _RESET),
    _output("PLS", _FIXED_BIT, steps=2),
    _output("PLF", _FIXED_BIT, steps=2),
    _output("MC", Slot("level", ("N",), index=False), _FIXED_BIT, steps=3),
    _output("CJ", *_LABEL, forms="P", steps=3),
    _output("CALL", *_LABEL, forms="P", steps=3),
    _output("WDT", forms="P", steps=1),
    *(_output(name, _S, _D, forms="DP", group="move") for name in ("MOV", "CML")),
    _output("XCH", replace(_D, name="first word"), replace(_D, name="second word"), forms="DP", group="move"),
    _block("BMOV", _BLOCK_SOURCE, _BLOCK_TARGET, 512, "P"),
    _block("FMOV", _S, _BLOCK_TARGET, 512, "DP"),
    *(_output(name, _S, _D, forms="DP", group="arithmetic", fallible=True) for name in ("BCD", "BIN")),
    *(_output(name, *_ADDED, forms="DP", group="arithmetic") for name in ("ADD", "SUB")),
    _output("MUL", _S1, _S2, _DOUBLE, forms="DP", group="arithmetic"),
    _output("DIV", _S1, _S2, _DOUBLE, forms="DP", group="arithmetic", fallible=True),
    *(_output(name, _D, forms="DP", group="arithmetic") for name in ("INC", "DEC", "NEG")),
    *(_output(f"W{name}", *_ADDED, forms="DP", wide_name=f"D{name}", group="move") for name in _LOGIC),
    _output("CMP", _S1, _S2, _THREE_BITS, forms="DP", group="arithmetic"),
    _output("ZCP", *_LIMITS, _S, _THREE_BITS, forms="DP", group="arithmetic"),
    *(_output(name, *_ROTATED, forms="DP", group="block") for name in ("ROR", "ROL")),
    _shift("SFTR"),
    _shift("SFTL"),
    _output("ALT", replace(_ONE_BIT, index=True), forms="P", group="move"),
    _output("ZRST", _ZONE, replace(_ZONE, name="last device"), forms="P", group="block"),
    _block("MEAN", _BLOCK_SOURCE, _D, 64, "DP"),
    # PW10 board manual, section 5.
    _output("RS", *_SENT_AND_RECEIVED, group="serial"),
    _output("RS2", *_SENT_AND_RECEIVED, replace(_PORT_COUNT, name="n1", limits=(2, 6)), group="serial"),
    _output(
        "CPAVL",
        replace(_PORT_REGISTER, points=20),
        Slot("D", ("M",), points=20, index=False),
        Slot("M", ("K",), index=False, limits=(2, 6)),
        group="serial",
        steps=11,
    ),
]

_BARE = [
    Spec("MCR", LadderRole.BARE, (Slot("level", ("N",), index=False),), steps=2),
    Spec("STL", LadderRole.BARE, (Slot("state", ("S",), index=False),), steps=1),
    Spec("FOR", LadderRole.BARE, (_count("n", -32768, 32767, takes=WORDS_FROM),), steps=3),
    *(Spec(name, LadderRole.BARE, steps=1) for name in ("NEXT", "SRET", "RET", "FEND", "END")),
]
_BLOCKS = [Spec(name, LadderRole.BLOCK, steps=1) for name in ("ANB", "ORB", "MPS", "MRD", "MPP", "INV")]

#: A label at the head of a line; it has no mnemonic of its own.
LABEL = Spec("P", LadderRole.BARE, _LABEL, steps=1)

SPECS: dict[str, Spec] = {
    spec.name: spec
    for spec in [*_contacts(), *_BLOCKS, Spec("NOP", LadderRole.NOTHING, steps=1), *_OUTPUTS, *_BARE]
}


def _forms() -> dict[str, Form]:
    found: dict[str, Form] = {}
    for spec in SPECS.values():
        found[spec.name] = Form(spec)
        wide = spec.wide_name or f"D{spec.name}"
        if "P" in spec.forms:
            found[f"{spec.name}P"] = Form(spec, pulse=True)
        if "D" in spec.forms:
            found[wide] = Form(spec, wide=True)
        if "D" in spec.forms and "P" in spec.forms:
            found[f"{wide}P"] = Form(spec, wide=True, pulse=True)
    return found


#: Every mnemonic that a program may use.
FORMS: dict[str, Form] = _forms()


def steps_of(form: Form, operands: tuple[Operand, ...]) -> int:
    """How many program steps an instruction takes (FX programming manual).

    Of an FX3U's bits of words, and of its contacts and coils with an index three: from memory, assumed.
    """
    spec = form.spec
    basic = spec.group == "basic" and spec.role in (LadderRole.CONTACT, LadderRole.OUTPUT)
    if basic and operands and (operands[0].kind == "D.b" or operands[0].index):
        return 3
    if spec.steps is not None:
        return spec.steps
    if spec.name in ("OUT", "SET", "RST") and operands:
        first = operands[0]
        if spec.name == "OUT" and first.kind in "TC":
            return 5 if first.kind == "C" and first.address >= 200 else 3
        if first.kind in "DVZ":
            return 3
        return 2 if first.kind in "STC" or (first.kind == "M" and first.address >= 8000) else 1
    if spec.role is LadderRole.CONTACT and spec.group == "basic":
        return 1
    return 1 + (4 if form.wide else 2) * len(spec.slots)
