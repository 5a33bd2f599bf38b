"""Random programs that are correct: ladders of contacts, blocks and branches, any output, jumps and loops."""

from __future__ import annotations

import random

_ARITHMETIC = ("ADD", "SUB", "MUL", "DIV", "WAND", "WOR", "WXOR")
_WIDE = {"WAND": "DAND", "WOR": "DOR", "WXOR": "DXOR"}
_OPERATORS = ("=", "<>", ">", "<", ">=", "<=")


class Writer:
    """Writes one program. Devices come from small sets, so that its rungs meet each other.

    ``fx3``: of an FX3U, with R, bits of words, contacts with an index and its longer ranges.
    """

    def __init__(self, seed: int, *, fx3: bool = False) -> None:
        self.fx3 = fx3
        self.rng = random.Random(seed)
        self.lines: list[str] = []
        self.size = 0

    def program(self) -> str:
        rng = self.rng
        # Small values in the index registers: most indexed addresses exist, some do not.
        self.add("LD M8002")
        for register in ("Z0", "Z1", "V0"):
            self.add(f"MOV K{rng.choice((-1, 0, 1, 2, 3, 9000))} {register}")
        for number in range(6):
            self.add(f"DMOV K{self.big()} D{2 * number}")
        label = 0
        for _ in range(rng.randint(3, 12)):
            kind = rng.random()
            if kind < 0.1:
                level = 0
                self.condition()
                self.add(f"MC N{level} M{rng.randrange(40)}")
                for _ in range(rng.randint(1, 3)):
                    self.rung()
                if rng.random() < 0.3:
                    self.condition()
                    self.add(f"MC N1 Y{rng.randrange(8)}")
                    self.rung()
                self.add(f"MCR N{level}")
            elif kind < 0.2:
                self.condition()
                self.add(f"CJ{rng.choice(('', 'P'))} P{label}")
                if rng.random() < 0.5:
                    self.output()
                for _ in range(rng.randint(1, 3)):
                    self.rung()
                self.add(f"P{label}")
                label += 1
            elif kind < 0.27:
                self.add(f"FOR {rng.choice(('K2', 'K3', 'K-1', 'Z1' if rng.random() < 0.1 else 'K1'))}")
                self.rung()
                if rng.random() < 0.3:
                    self.add("FOR K2")
                    self.rung()
                    self.add("NEXT")
                self.add("NEXT")
            elif kind < 0.34:
                self.condition()
                self.add(f"CALL{rng.choice(('', 'P'))} P{rng.choice((100, 101))}")
            else:
                self.rung()
        if rng.random() < 0.2:
            self.condition()
            self.add("CJ P63")
            self.rung()
        self.add("FEND")
        for number in (100, 101):
            self.add(f"P{number}")
            self.rung()
            if number == 100 and rng.random() < 0.5:
                self.condition()
                self.add("CALL P101")
            self.rung()
            self.add("SRET")
        self.add("END")
        return "\n".join(self.lines)

    def add(self, line: str) -> None:
        self.lines.append(line)

    # -- conditions ----------------------------------------------------------------------------

    def contact(self) -> str:
        rng = self.rng
        if self.fx3 and (kind := rng.random()) < 0.3:
            word_bit = f"D{rng.randrange(16)}.{rng.randrange(16):X}"
            indexed = (
                f"{rng.choice(('X0', 'M30', 'M7670', 'Y1', 'T250', 'C100'))}{rng.choice(('Z0', 'Z1', 'V0'))}"
            )
            return (
                word_bit if kind < 0.1 else indexed if kind < 0.2 else rng.choice(("M7679", "S4095", "T256"))
            )
        letter = rng.choice("XXXYMMMSTC")
        number = rng.randrange({"X": 8, "Y": 8, "M": 32, "S": 8, "T": 3, "C": 3}[letter])
        if letter == "T":
            number = rng.choice((0, 1, 192, 200, 246, 250))
        if letter == "C":
            number = rng.choice((0, 1, 100, 200, 201))
        if rng.random() < 0.05:
            return rng.choice(("M8000", "M8001", "M8002", "M8011", "M8013", "M8020", "M8022"))
        return f"{letter}{number:o}" if letter in "XY" else f"{letter}{number}"

    def join(self, join: str) -> None:
        rng = self.rng
        kind = rng.random()
        if kind < 0.15:
            wide = rng.random() < 0.4
            name = f"{join}{'D' if wide else ''}{rng.choice(_OPERATORS)}"
            self.add(f"{name} {self.source(wide=wide)} {self.source(wide=wide)}")
        elif kind < 0.3:
            self.add(f"{join}{rng.choice('PF')} {self.contact()}")
        elif kind < 0.5:
            inverted = {"LD": "LDI", "AND": "ANI", "OR": "ORI"}[join]
            self.add(f"{inverted} {self.contact()}")
        else:
            self.add(f"{join} {self.contact()}")

    def block(self, depth: int) -> None:
        """A block, begun with LD, that leaves one value."""
        rng = self.rng
        self.join("LD")
        for _ in range(rng.randrange(4)):
            kind = rng.random()
            if kind < 0.2 and depth < 3:
                self.block(depth + 1)
                self.add(rng.choice(("ANB", "ORB")))
            elif kind < 0.28:
                self.add("INV")
            else:
                self.join(rng.choice(("AND", "OR")))

    def condition(self) -> None:
        self.block(0)

    # -- rungs ---------------------------------------------------------------------------------

    def rung(self) -> None:
        rng = self.rng
        self.condition()
        if rng.random() < 0.25:
            self.branches(0)
            return
        self.output()
        while rng.random() < 0.4:
            kind = rng.random()
            if kind < 0.3:
                self.join("AND")  # further contacts behind an output
            elif kind < 0.4:
                self.block(1)
                self.add("ANB")
            self.output()

    def branches(self, depth: int) -> None:
        rng = self.rng
        self.add("MPS")
        self.branch(depth)
        for _ in range(rng.randrange(3)):
            self.add("MRD")
            self.branch(depth)
        self.add("MPP")
        self.branch(depth)

    def branch(self, depth: int) -> None:
        rng = self.rng
        kind = rng.random()
        if kind < 0.4:
            self.join("AND")
        elif kind < 0.6:
            self.block(1)
            self.add("ANB")
        if depth < 2 and rng.random() < 0.2:
            self.branches(depth + 1)
        else:
            self.output()
            if rng.random() < 0.3:
                self.output()

    # -- operands ------------------------------------------------------------------------------

    def big(self) -> int:
        rng = self.rng
        return rng.choice(
            (
                0,
                1,
                -1,
                5,
                9999,
                32767,
                -32768,
                99_999_999,
                (1 << 31) - 1,
                -(1 << 31),
                rng.randrange(-70_000, 70_000),
            )
        )

    def index(self) -> str:
        return self.rng.choice(("Z0", "Z1", "V0")) if self.rng.random() < 0.12 else ""

    def source(self, *, wide: bool) -> str:
        rng = self.rng
        kind = rng.random()
        if kind < 0.25:
            value = self.big() if wide else rng.choice((0, 1, -1, 5, 100, 9999, 32767, -32768))
            return f"K{value}{self.index()}"
        if kind < 0.32:
            return f"H{rng.choice(('0', '1F', '1234', 'FFFF', '8000'))}{self.index()}"
        if kind < 0.4:
            return f"K{rng.randint(1, 8 if wide else 4)}X{rng.randrange(8):o}{self.index()}"
        return self.target(wide=wide)

    def target(self, *, wide: bool, registers: bool = True) -> str:
        rng = self.rng
        kind = rng.random()
        if self.fx3 and kind < 0.2:
            return rng.choice((f"R{rng.randrange(8)}{self.index()}", "R32760", "D8500", "K4M7664", "K2S4088"))
        if kind < 0.6:
            return f"D{rng.randrange(16)}{self.index()}"
        if kind < 0.8:
            letter, number = rng.choice("YMS"), rng.randrange(16)
            shown = f"{number:o}" if letter == "Y" else str(number)
            return f"K{rng.randint(1, 8 if wide else 4)}{letter}{shown}{self.index()}"
        if kind < 0.86:
            return rng.choice(("T0", "T1", "T192", "T246", "T250"))
        if kind < 0.92:
            return rng.choice(("C200", "C201") if wide else ("C0", "C1", "C100"))
        if registers and kind < 0.94:
            return rng.choice(("Z0", "Z1") if wide else ("Z0", "Z1", "V0"))
        return f"D{rng.randrange(16)}"

    def bit(self, *, index: bool = True) -> str:
        letter = self.rng.choice("YMMS")
        number = self.rng.randrange(8 if letter == "Y" else 24)
        return (f"{letter}{number:o}" if letter == "Y" else f"{letter}{number}") + (
            self.index() if index else ""
        )

    # -- outputs -------------------------------------------------------------------------------

    def output(self) -> None:
        rng = self.rng
        if rng.random() < 0.5:
            self.add(self.basic())
        else:
            self.add(self.applied())

    def basic(self) -> str:
        rng = self.rng
        kind = rng.random()
        if self.fx3 and kind < 0.12:
            word_bit = f"D{rng.randrange(16)}.{rng.randrange(16):X}"
            one = f"{rng.choice(('OUT', 'SET', 'RST'))} {rng.choice((word_bit, word_bit, 'M7679', 'S4095'))}"
            indexed = f"{rng.choice(('OUT', 'SET', 'RST'))} {rng.choice(('M30', 'Y2', 'M7672'))}{rng.choice(('Z0', 'V0'))}"
            return rng.choice(
                (one, one, indexed, "RST R3", f"OUT T256 {rng.choice(('K0', 'K30', 'D1', 'R1'))}")
            )
        if kind < 0.35:
            return f"OUT {self.bit(index=False)}"
        if kind < 0.5:
            timer = rng.choice((0, 1, 192, 200, 246, 250))
            return f"OUT T{timer} {rng.choice(('K0', 'K1', 'K3', 'D1', 'D15'))}"
        if kind < 0.62:
            counter = rng.choice((0, 1, 100))
            return f"OUT C{counter} {rng.choice(('K1', 'K2', 'K3', 'D3', 'D15'))}"
        if kind < 0.7:
            return f"OUT C{rng.choice((200, 201))} {rng.choice(('K2', 'K-2', 'D0', 'D14'))}"
        if kind < 0.75:
            return rng.choice(("SET M8200", "RST M8200", "SET M8201", "RST M8201", "SET M8024", "RST M8024"))
        if kind < 0.83:
            return f"SET {self.bit(index=False)}"
        if kind < 0.93:
            device = rng.choice(
                ("T0", "T192", "T246", "T250", "C0", "C100", "C200", "D3", "Z0", "V0", self.bit(index=False))
            )
            return f"RST {device}"
        letter = rng.choice(("Y3", "M7", "M8", "M9"))
        return f"{rng.choice(('PLS', 'PLF'))} {letter}"

    def applied(self) -> str:
        rng = self.rng
        wide, pulse = rng.random() < 0.35, rng.choice(("", "P"))
        d = "D" if wide else ""
        kind = rng.randrange(14)
        if kind < 2:
            return f"{d}MOV{pulse} {self.source(wide=wide)} {self.target(wide=wide)}"
        if kind == 2:
            name = rng.choice(("CML", "BCD", "BIN"))
            return f"{d}{name}{pulse} {self.source(wide=wide)} {self.target(wide=wide)}"
        if kind == 3:
            return f"{d}XCH{pulse} {self.target(wide=wide)} {self.target(wide=wide)}"
        if kind == 4:
            return self.block_move(pulse)
        if kind in (5, 6, 7):
            name = rng.choice(_ARITHMETIC)
            target = self.target(wide=wide, registers=name not in ("MUL", "DIV"))
            if name in ("MUL", "DIV") and target.startswith("C20"):
                target = "C200"
            full = _WIDE.get(name, f"D{name}") if wide else name
            return f"{full}{pulse} {self.source(wide=wide)} {self.source(wide=wide)} {target}"
        if kind == 8:
            return f"{d}{rng.choice(('INC', 'DEC', 'NEG'))}{pulse} {self.target(wide=wide)}"
        if kind == 9:
            return f"{d}CMP{pulse} {self.source(wide=wide)} {self.source(wide=wide)} {self.three()}"
        if kind == 10:
            sources = " ".join(self.source(wide=wide) for _ in range(3))
            return f"{d}ZCP{pulse} {sources} {self.three()}"
        if kind == 11:
            target = rng.choice((f"D{rng.randrange(12)}{self.index()}", f"K{8 if wide else 4}M4"))
            return f"{d}{rng.choice(('ROR', 'ROL'))}{pulse} {target} K{rng.randint(1, 32 if wide else 16)}"
        if kind == 12:
            length = rng.randint(1, 12)
            step = rng.randint(1, length)
            source = rng.choice((f"X{rng.randrange(4)}", self.bit()))
            return f"{rng.choice(('SFTR', 'SFTL'))}{pulse} {source} {self.bit()} K{length} K{step}"
        return rng.choice(
            (
                f"ALT{pulse} {self.bit()}",
                f"ZRST{pulse} M{rng.randrange(9)} M{rng.randrange(12)}",
                f"ZRST{pulse} D{rng.randrange(9)} D{rng.randrange(12)}",
                f"ZRST{pulse} T0 T1",
                f"ZRST{pulse} C0 C1",
                f"{d}MEAN{pulse} D0{self.index()} {self.target(wide=wide)} {rng.choice(('K3', 'D2'))}",
            )
        )

    def block_move(self, pulse: str) -> str:
        rng = self.rng
        count = rng.choice(("K1", "K3", "K5", "D2"))
        if rng.random() < 0.5:
            groups = rng.randint(1, 4)
            one = rng.choice((f"D{rng.randrange(9)}{self.index()}", f"K{groups}M0", f"K{groups}X0"))
            other = rng.choice(
                (f"D{rng.randrange(9)}{self.index()}", f"K{groups}M{rng.randrange(9)}{self.index()}")
            )
            return f"BMOV{pulse} {one} {other} {count}"
        wide = rng.random() < 0.4
        target = rng.choice((f"D{rng.randrange(9)}{self.index()}", "K2M8"))
        return f"{'D' if wide else ''}FMOV{pulse} {self.source(wide=wide)} {target} {count}"

    def three(self) -> str:
        rng = self.rng
        return rng.choice(
            (f"Y{rng.randrange(5)}", f"M{rng.randrange(20)}{self.index()}", f"S{rng.randrange(5)}")
        )
