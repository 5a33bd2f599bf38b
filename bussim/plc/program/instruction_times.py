"""How long a PLC takes over its instructions. All times in nanoseconds.

The FX2N's data sheet gives 0.08 µs for a basic instruction and 1.52 µs to several hundred µs for an
applied one; how its table divides the rest, and what a PW10 takes, is not public. So every figure
here is assumed (the first two: as the FX2N's), and a field that a profile can change.
"""

from dataclasses import dataclass

#: 72 ticks are a microsecond.
_TICKS, _NANOSECONDS = 72, 1000


def ticks_of(nanoseconds: int) -> int:
    """A time in ticks, rounded half up: once for a whole scan, never for one instruction."""
    return (2 * nanoseconds * _TICKS + _NANOSECONDS) // (2 * _NANOSECONDS)


@dataclass(frozen=True, slots=True)
class InstructionTimes:
    """Nanoseconds of each class of instruction; ``others`` overrides them by name (``("MOV", 1520)``).

    An instruction whose condition is off takes ``idle`` (contacts, coils and jumps: their whole time).
    D forms (32 bit) take ``wide`` times as long as their 16-bit form, rounded down.
    """

    basic: int = 80  # contacts, blocks, OUT SET RST PLS PLF of bits, jumps, labels
    timer: int = 1520  # OUT and RST of timers and counters
    comparison: int = 1520  # contacts such as LD=
    idle: int = 80
    move: int = 1520  # MOV CML XCH and bit logic
    arithmetic: int = 20_000  # ADD SUB MUL DIV CMP ZCP INC DEC NEG BCD BIN
    block: int = 20_000  # BMOV FMOV ZRST MEAN, shifts and rotations …
    each: int = 1000  # … and for each device that they touch
    serial: int = 50_000  # RS2 CPAVL
    wide: float = 1.5
    others: tuple[tuple[str, int], ...] = ()

    def of(self, name: str, group: str, *, wide: bool) -> int:
        """Time of an instruction that is executed: its 16-bit form's name and its class."""
        time = dict(self.others).get(name)
        if time is None:
            time = getattr(self, group)
        return int(time * self.wide) if wide else int(time)


#: What the built-in profiles use.
DEFAULT_TIMES = InstructionTimes()
