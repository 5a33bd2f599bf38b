"""Special devices that are not simulated: bits that change instructions, or the whole PLC, and all others.

From the FX programming manual's (JY992D88101) table of special devices. A bit matters to a program only
where the program has an instruction that it changes. M8024, which reverses BMOV, is simulated.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from bussim.plc.memory import FIRST_SPECIAL
from bussim.plc.program.text.catalog import Instruction
from bussim.plc.program.text.operand_checks import Extent


class _Bit(NamedTuple):
    """``instructions`` that the bit changes; none: it changes the PLC, whatever the program."""

    effect: str  # follows the bit's name and a comma
    hint: str = ""
    instructions: frozenset[str] = frozenset()
    timers: range = range(0)  # the OUT of which timers it changes


#: By M's address.
SPECIAL_BITS: dict[int, _Bit] = {
    8028: _Bit("which on some PLCs makes T32–T62 timers of 10 ms", timers=range(32, 63)),
    8031: _Bit("which clears what is not latched"),
    8032: _Bit("which clears what is latched"),
    8034: _Bit("which switches all outputs off"),
    8035: _Bit("which with M8036 and M8037 forces RUN and STOP"),
    8036: _Bit("which forces RUN"),
    8037: _Bit("which forces STOP"),
    8039: _Bit("which makes the scan last as long as D8039 says"),
    8160: _Bit("which makes XCH swap bytes", instructions=frozenset(["XCH"])),
    8161: _Bit(
        "the 8-bit mode",
        "RS2 has that of the format word which CPAVL takes",
        instructions=frozenset(["RS2"]),
    ),
}


#: The special devices that do something here: letter, first and last number.
_ALIVE = [
    (span[0], int(span[1:5]), int(span[-4:]))
    for span in [
        *(
            "M8000-8004",
            "M8011-8014",
            "M8020-8022",
            "M8024",
            "M8033",
            "M8038",
            "M8061",
            "M8063",
            "M8067-8068",
        ),
        *(
            "M8179",
            "M8183-8191",
            "M8200-8234",
            "M8438",
            "D8000-8001",
            "D8004",
            "D8010-8019",
            "D8061",
            "D8063",
        ),
        *("D8067-8069", "D8101", "D8121", "D8173-8180", "D8201-8218", "D8438"),
    ]
]


def idle_special(extent: Extent) -> str | None:
    """What a program hardly expects of the special device that it touches first; None where all is well."""
    letter, address = extent.letter, extent.first
    alive = any(letter == each and first <= address <= last for each, first, last in _ALIVE)
    if alive or letter not in "MD" or address < FIRST_SPECIAL or (letter == "M" and address in SPECIAL_BITS):
        return None
    does = "what is written there changes nothing" if extent.writes else "nothing here drives it"
    return f"{letter}{address} is a special device that is not simulated: {does}"


def not_simulated(instructions: Iterable[Instruction]) -> dict[int, str]:
    """The special bits that would change a program with these instructions: M's address, a sentence."""
    names, timers = set[str](), set[int]()
    for at in instructions:
        names.add(at.spec.name)
        if at.spec.name == "OUT" and at.operands[0].kind == "T":
            timers.add(at.operands[0].address)
    found = {}
    for address, bit in SPECIAL_BITS.items():
        anyhow = not (bit.instructions or bit.timers)
        if anyhow or bit.instructions & names or timers.intersection(bit.timers):
            hint = f"; {bit.hint}" if bit.hint else ""
            found[address] = f"M{address}, {bit.effect}, is not simulated: it changes nothing here{hint}"
    return found
