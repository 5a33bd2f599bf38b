"""Random programs that are correct: ladders of contacts, blocks and branches, any output, jumps and loops."""

from __future__ import annotations

import random

_ARITHMETIC = ("ADD", "SUB", "MUL", "DIV", "WAND", "WOR", "WXOR")
_WIDE = {"WAND": "DAND", "WOR": "DOR", "WXOR": "DXOR"}
_OPERATORS = ("=", "<>", ">", "<", ">=", "<=")


class Writer:
    """Writes one program. Devices come from small sets, so that its rungs meet each other."""

    def __init__(self, seed: int) -> None:
        self.luck = random.Random(seed)
        self.lines: list[str] = []
        self.size = 0

    def program(self) -> str:
        luck = self.luck
        # Small values in the index registers: most indexed addresses exist, some do not.
        self.add("LD M8002")
        for register in ("Z0", "Z1", "V0"):
            self.add(f"MOV K{luck.choice((-1, 0, 1, 2, 3, 9000))} {register}")
        for number in range(6):
            self.add(f"DMOV K{self.big()} D{2 * number}")
        label = 0
        for _ in range(luck.randint(3, 12)):
            kind = luck.random()
            if kind < 0.1:
                level = 0
                self.condition()
                self.add(f"MC N{level} M{luck.randrange(40)}")
                for _ in range(luck.randint(1, 3)):
                    self.rung()
                if luck.random() < 0.3:
                    self.condition()
                    self.add(f"MC N1 Y{luck.randrange(8)}")
                    self.rung()
                self.add(f"MCR N{level}")
            elif kind < 0.2:
                self.condition()
                self.add(f"CJ{luck.choice(('', 'P'))} P{label}")
                if luck.random() < 0.5:
                    self.output()
                for _ in range(luck.randint(1, 3)):
                    self.rung()
                self.add(f"P{label}")
                label += 1
            elif kind < 0.27:
                self.add(f"FOR {luck.choice(('K2', 'K3', 'K-1', 'Z1' if luck.random() < 0.1 else 'K1'))}")
                self.rung()
                if luck.random() < 0.3:
                    self.add("FOR K2")
                    self.rung()
                    self.add("NEXT")
                self.add("NEXT")
            elif kind < 0.34:
                self.condition()
                self.add(f"CALL{luck.choice(('', 'P'))} P{luck.choice((100, 101))}")
            else:
                self.rung()
        if luck.random() < 0.2:
            self.condition()
            self.add("CJ P63")
            self.rung()
        self.add("FEND")
        for number in (100, 101):
            self.add(f"P{number}")
            self.rung()
            if number == 100 and luck.random() < 0.5:
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
        luck = self.luck
        letter = luck.choice("XXXYMMMSTC")
        number = luck.randrange({"X": 8, "Y": 8, "M": 32, "S": 8, "T": 3, "C": 3}[letter])
        if letter == "T":
            number = luck.choice((0, 1, 192, 200, 246, 250))
        if letter == "C":
            number = luck.choice((0, 1, 100, 200, 201))
        if luck.random() < 0.05:
            return luck.choice(("M8000", "M8001", "M8002", "M8011", "M8013", "M8020", "M8022"))
        return f"{letter}{number:o}" if letter in "XY" else f"{letter}{number}"

    def join(self, join: str) -> None:
        luck = self.luck
        kind = luck.random()
        if kind < 0.15:
            wide = luck.random() < 0.4
            name = f"{join}{'D' if wide else ''}{luck.choice(_OPERATORS)}"
            self.add(f"{name} {self.source(wide=wide)} {self.source(wide=wide)}")
        elif kind < 0.3:
            self.add(f"{join}{luck.choice('PF')} {self.contact()}")
        elif kind < 0.5:
            inverted = {"LD": "LDI", "AND": "ANI", "OR": "ORI"}[join]
            self.add(f"{inverted} {self.contact()}")
        else:
            self.add(f"{join} {self.contact()}")

    def block(self, depth: int) -> None:
        """A block, begun with LD, that leaves one value."""
        luck = self.luck
        self.join("LD")
        for _ in range(luck.randrange(4)):
            kind = luck.random()
            if kind < 0.2 and depth < 3:
                self.block(depth + 1)
                self.add(luck.choice(("ANB", "ORB")))
            elif kind < 0.28:
                self.add("INV")
            else:
                self.join(luck.choice(("AND", "OR")))

    def condition(self) -> None:
        self.block(0)

    # -- rungs ---------------------------------------------------------------------------------

    def rung(self) -> None:
        luck = self.luck
        self.condition()
        if luck.random() < 0.25:
            self.branches(0)
            return
        self.output()
        while luck.random() < 0.4:
            kind = luck.random()
            if kind < 0.3:
                self.join("AND")  # further contacts behind an output
            elif kind < 0.4:
                self.block(1)
                self.add("ANB")
            self.output()

    def branches(self, depth: int) -> None:
        luck = self.luck
        self.add("MPS")
        self.branch(depth)
        for _ in range(luck.randrange(3)):
            self.add("MRD")
            self.branch(depth)
        self.add("MPP")
        self.branch(depth)

    def branch(self, depth: int) -> None:
        luck = self.luck
        kind = luck.random()
        if kind < 0.4:
            self.join("AND")
        elif kind < 0.6:
            self.block(1)
            self.add("ANB")
        if depth < 2 and luck.random() < 0.2:
            self.branches(depth + 1)
        else:
            self.output()
            if luck.random() < 0.3:
                self.output()

    # -- operands ------------------------------------------------------------------------------

    def big(self) -> int:
        luck = self.luck
        return luck.choice(
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
                luck.randrange(-70_000, 70_000),
            )
        )

    def index(self) -> str:
        return self.luck.choice(("Z0", "Z1", "V0")) if self.luck.random() < 0.12 else ""

    def source(self, *, wide: bool) -> str:
        luck = self.luck
        kind = luck.random()
        if kind < 0.25:
            value = self.big() if wide else luck.choice((0, 1, -1, 5, 100, 9999, 32767, -32768))
            return f"K{value}{self.index()}"
        if kind < 0.32:
            return f"H{luck.choice(('0', '1F', '1234', 'FFFF', '8000'))}{self.index()}"
        if kind < 0.4:
            return f"K{luck.randint(1, 8 if wide else 4)}X{luck.randrange(8):o}{self.index()}"
        return self.target(wide=wide)

    def target(self, *, wide: bool, registers: bool = True) -> str:
        luck = self.luck
        kind = luck.random()
        if kind < 0.6:
            return f"D{luck.randrange(16)}{self.index()}"
        if kind < 0.8:
            letter, number = luck.choice("YMS"), luck.randrange(16)
            shown = f"{number:o}" if letter == "Y" else str(number)
            return f"K{luck.randint(1, 8 if wide else 4)}{letter}{shown}{self.index()}"
        if kind < 0.86:
            return luck.choice(("T0", "T1", "T250"))
        if kind < 0.92:
            return luck.choice(("C200", "C201") if wide else ("C0", "C1", "C100"))
        if registers and kind < 0.94:
            return luck.choice(("Z0", "Z1") if wide else ("Z0", "Z1", "V0"))
        return f"D{luck.randrange(16)}"

    def bit(self, *, index: bool = True) -> str:
        letter = self.luck.choice("YMMS")
        number = self.luck.randrange(8 if letter == "Y" else 24)
        return (f"{letter}{number:o}" if letter == "Y" else f"{letter}{number}") + (
            self.index() if index else ""
        )

    # -- outputs -------------------------------------------------------------------------------

    def output(self) -> None:
        luck = self.luck
        if luck.random() < 0.5:
            self.add(self.basic())
        else:
            self.add(self.applied())

    def basic(self) -> str:
        luck = self.luck
        kind = luck.random()
        if kind < 0.35:
            return f"OUT {self.bit(index=False)}"
        if kind < 0.5:
            timer = luck.choice((0, 1, 192, 200, 246, 250))
            return f"OUT T{timer} {luck.choice(('K0', 'K1', 'K3', 'D1', 'D15'))}"
        if kind < 0.62:
            counter = luck.choice((0, 1, 100))
            return f"OUT C{counter} {luck.choice(('K1', 'K2', 'K3', 'D3', 'D15'))}"
        if kind < 0.7:
            return f"OUT C{luck.choice((200, 201))} {luck.choice(('K2', 'K-2', 'D0', 'D14'))}"
        if kind < 0.75:
            return luck.choice(("SET M8200", "RST M8200", "SET M8201", "RST M8201", "SET M8024", "RST M8024"))
        if kind < 0.83:
            return f"SET {self.bit(index=False)}"
        if kind < 0.93:
            device = luck.choice(
                ("T0", "T250", "C0", "C100", "C200", "D3", "Z0", "V0", self.bit(index=False))
            )
            return f"RST {device}"
        letter = luck.choice(("Y3", "M7", "M8", "M9"))
        return f"{luck.choice(('PLS', 'PLF'))} {letter}"

    def applied(self) -> str:
        luck = self.luck
        wide, pulse = luck.random() < 0.35, luck.choice(("", "P"))
        d = "D" if wide else ""
        kind = luck.randrange(14)
        if kind < 2:
            return f"{d}MOV{pulse} {self.source(wide=wide)} {self.target(wide=wide)}"
        if kind == 2:
            name = luck.choice(("CML", "BCD", "BIN"))
            return f"{d}{name}{pulse} {self.source(wide=wide)} {self.target(wide=wide)}"
        if kind == 3:
            return f"{d}XCH{pulse} {self.target(wide=wide)} {self.target(wide=wide)}"
        if kind == 4:
            return self.block_move(pulse)
        if kind in (5, 6, 7):
            name = luck.choice(_ARITHMETIC)
            target = self.target(wide=wide, registers=name not in ("MUL", "DIV"))
            if name in ("MUL", "DIV") and target.startswith("C20"):
                target = "C200"
            full = _WIDE.get(name, f"D{name}") if wide else name
            return f"{full}{pulse} {self.source(wide=wide)} {self.source(wide=wide)} {target}"
        if kind == 8:
            return f"{d}{luck.choice(('INC', 'DEC', 'NEG'))}{pulse} {self.target(wide=wide)}"
        if kind == 9:
            return f"{d}CMP{pulse} {self.source(wide=wide)} {self.source(wide=wide)} {self.three()}"
        if kind == 10:
            sources = " ".join(self.source(wide=wide) for _ in range(3))
            return f"{d}ZCP{pulse} {sources} {self.three()}"
        if kind == 11:
            target = luck.choice((f"D{luck.randrange(12)}{self.index()}", f"K{8 if wide else 4}M4"))
            return f"{d}{luck.choice(('ROR', 'ROL'))}{pulse} {target} K{luck.randint(1, 32 if wide else 16)}"
        if kind == 12:
            length = luck.randint(1, 12)
            step = luck.randint(1, length)
            source = luck.choice((f"X{luck.randrange(4)}", self.bit()))
            return f"{luck.choice(('SFTR', 'SFTL'))}{pulse} {source} {self.bit()} K{length} K{step}"
        return luck.choice(
            (
                f"ALT{pulse} {self.bit()}",
                f"ZRST{pulse} M{luck.randrange(9)} M{luck.randrange(12)}",
                f"ZRST{pulse} D{luck.randrange(9)} D{luck.randrange(12)}",
                f"ZRST{pulse} T0 T1",
                f"ZRST{pulse} C0 C1",
                f"{d}MEAN{pulse} D0{self.index()} {self.target(wide=wide)} {luck.choice(('K3', 'D2'))}",
            )
        )

    def block_move(self, pulse: str) -> str:
        luck = self.luck
        count = luck.choice(("K1", "K3", "K5", "D2"))
        if luck.random() < 0.5:
            groups = luck.randint(1, 4)
            one = luck.choice((f"D{luck.randrange(9)}{self.index()}", f"K{groups}M0", f"K{groups}X0"))
            other = luck.choice(
                (f"D{luck.randrange(9)}{self.index()}", f"K{groups}M{luck.randrange(9)}{self.index()}")
            )
            return f"BMOV{pulse} {one} {other} {count}"
        wide = luck.random() < 0.4
        target = luck.choice((f"D{luck.randrange(9)}{self.index()}", "K2M8"))
        return f"{'D' if wide else ''}FMOV{pulse} {self.source(wide=wide)} {target} {count}"

    def three(self) -> str:
        luck = self.luck
        return luck.choice(
            (f"Y{luck.randrange(5)}", f"M{luck.randrange(20)}{self.index()}", f"S{luck.randrange(5)}")
        )
