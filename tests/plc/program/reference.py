"""An instruction list carried out from its text, line by line, for comparison.

Nothing here is shared with the package: the accumulator and its stacks are lists, the devices a
dictionary by name, every value an int. Written from the definitions of the instructions, not for speed.
"""

from __future__ import annotations

import operator
import re
from collections import defaultdict
from typing import Any

TESTS = {
    "=": operator.eq,
    "<>": operator.ne,
    ">": operator.gt,
    "<": operator.lt,
    ">=": operator.ge,
    "<=": operator.le,
}
LAST = {"X": 255, "Y": 255, "S": 999, "D": 8255, "T": 255, "Z": 7, "V": 7}
LOGIC = {"AND": operator.and_, "OR": operator.or_, "XOR": operator.xor}
UNIT = 720_000  # 10 ms
GOING_ON = {*range(192, 200), *range(246, 250)}
BASES = (
    *(
        "MOV",
        "CML",
        "XCH",
        "BMOV",
        "FMOV",
        "BCD",
        "BIN",
        "ADD",
        "SUB",
        "MUL",
        "DIV",
        "INC",
        "DEC",
        "NEG",
        "WAND",
    ),
    *("WOR", "WXOR", "CMP", "ZCP", "ROR", "ROL", "SFTR", "SFTL", "ALT", "ZRST", "MEAN"),
)


class RefusedError(Exception):
    pass


class Reference:
    def __init__(self, text: str, *, fx3: bool = False) -> None:
        self.fx3 = fx3
        self.lines = [line.split() for line in text.split("\n") if line.strip()]
        self.bits: dict[tuple[str, int], int] = defaultdict(int)
        self.words: dict[tuple[str, int], int] = defaultdict(int)
        self.before: dict[Any, int] = defaultdict(int)
        self.timers: dict[int, tuple[int, int]] = {}
        self.presets: dict[int, str] = {}  # of the OUT that was carried out last
        self.held: set[str] = set()  # timers and counters whose latest RST had its contact on
        self.labels = {line[0]: at for at, line in enumerate(self.lines) if re.fullmatch(r"P\d+", line[0])}
        self.scans = 0
        self.second = -1
        self.lasted: list[int] = []

    # -- operands ------------------------------------------------------------------------------

    def split(self, text: str) -> tuple[str, int, int]:
        """Letter, address with index, groups (0: no group)."""
        match = re.fullmatch(r"(?:K(\d)(?=[XYMS]))?([A-Z])(\d+)(?:([VZ])(\d))?", text)
        assert match, text
        groups, letter, digits, register, number = match.groups()
        base = int(digits, 8 if letter in "XY" else 10)
        address = base
        if register:
            address += self.signed(self.words[register, int(number)], 16)
        low, high = self.bounds(letter, base, word=letter in "DRTCVZ" and not groups)
        if not low <= address <= high:
            raise RefusedError
        return letter, address, int(groups or 0)

    def bounds(self, letter: str, base: int, *, word: bool) -> tuple[int, int]:
        if letter == "M" and self.fx3:
            return (0, 7679) if base < 8000 else (8000, 8511)
        if letter in "SDTR" and self.fx3:
            return 0, {"S": 4095, "D": 8511, "T": 511, "R": 32767}[letter]
        if letter == "M":
            return (0, 3071) if base < 8000 else (8000, 8255)
        if letter == "C":
            if not word:
                return 0, 255
            return (0, 199) if base < 200 else (200, 255)
        return 0, LAST[letter]

    @staticmethod
    def signed(pattern: int, size: int) -> int:
        pattern &= (1 << size) - 1
        return pattern - (1 << size) if pattern >> size - 1 else pattern

    def fits(self, letter: str, address: int, count: int, base_text: str, *, word: bool) -> None:
        digits = re.search(r"[A-Z](\d+)", base_text.removeprefix("K")[0 if base_text[0] != "K" else 1 :])
        assert digits
        base = int(digits.group(1), 8 if letter in "XY" else 10)
        if address + count - 1 > self.bounds(letter, base, word=word)[1]:
            raise RefusedError

    def read(self, text: str, size: int) -> int:
        """The signed value of an operand of 16 or 32 bits."""
        constant = re.fullmatch(r"(?:K([+-]?\d+)|H([0-9A-F]+))(?:([VZ])(\d))?", text)
        if constant:
            decimal, hexadecimal, register, number = constant.groups()
            value = int(decimal) if decimal else int(hexadecimal, 16)
            if register:
                value += self.signed(self.words[register, int(number)], 16)
            return self.signed(value, size)
        letter, address, groups = self.split(text)
        if groups:
            self.fits(letter, address, 4 * groups, text, word=False)
            return self.signed(sum(self.bits[letter, address + k] << k for k in range(4 * groups)), size)
        return self.read_at(text, letter, address, size)

    def read_at(self, text: str, letter: str, address: int, size: int) -> int:
        if size == 16:
            return self.signed(self.words[letter, address], 16)
        if letter == "Z":
            return self.signed(self.words["Z", address] | self.words["V", address] << 16, 32)
        if letter == "C" and address >= 200:
            return self.signed(self.words["C", address], 32)
        self.fits(letter, address, 2, text, word=True)
        return self.signed(self.words[letter, address] | self.words[letter, address + 1] << 16, 32)

    def location(self, text: str, size: int, *, items: int = 1) -> Any:
        """Where a result goes, or RefusedError."""
        letter, address, groups = self.split(text)
        if groups:
            self.fits(letter, address, 4 * groups * items, text, word=False)
            return letter, address, groups, size
        each = 1 if size == 16 or (letter == "C" and address >= 200) or letter == "Z" else size // 16
        self.fits(letter, address, each * items, text, word=True)
        return letter, address, 0, size

    def write(self, location: Any, value: int) -> None:
        letter, address, groups, size = location
        if groups:
            for k in range(4 * groups):
                self.bits[letter, address + k] = value >> k & 1
        elif size == 32 and letter == "Z":
            self.words["Z", address], self.words["V", address] = value & 0xFFFF, value >> 16 & 0xFFFF
        elif size == 32 and letter == "C" and address >= 200:
            self.words["C", address] = value & 0xFFFFFFFF
        else:
            for k in range(size // 16):
                self.words[letter, address + k] = value >> 16 * k & 0xFFFF

    def bit_place(self, text: str, count: int = 1) -> tuple[str, int]:
        letter, address, _ = self.split(text)
        self.fits(letter, address, count, text, word=False)
        return letter, address

    # -- one scan ------------------------------------------------------------------------------

    def scan(self, now: int) -> None:
        if self.scans:
            self.lasted.append((now - self.now) // 7200)  # in 0.1 ms
            for number, value in (
                (8010, self.lasted[-1]),
                (8011, min(self.lasted)),
                (8012, max(self.lasted)),
            ):
                self.words["D", number] = value
        self.now = now
        self.scans += 1
        first = self.scans == 1
        for number, value in ((8000, 1), (8001, 0), (8002, first), (8003, not first)):
            self.bits["M", number] = int(value)
        self.note_error()
        if now // 72_000_000 != self.second:
            self.second = now // 72_000_000
            assert self.second < 60
            # The clock begins with 1 January 2000, a Saturday.
            for number, value in enumerate((self.second, 0, 0, 1, 1, 0, 6), 8013):
                self.words["D", number] = value
        for number, period in ((8011, 10), (8012, 100), (8013, 1000), (8014, 60_000)):
            self.bits["M", number] = int(now % (period * 72_000) < period * 36_000)
        self.acc = 0
        self.blocks: list[int] = []
        self.branches: list[int] = []
        self.masters: dict[int, int] = {}
        self.step: tuple[int, list[tuple[str, int]]] = (1, [])
        calls: list[int] = []
        loops: dict[int, int] = {}
        at = 0
        while True:
            line = self.lines[at]
            name = line[0]
            if name in ("END", "FEND"):
                self.end()
                return
            jump = None
            if name == "SRET":
                jump = calls.pop() if calls else len(self.lines) - 1
            elif name == "STL":
                jump = self.begin_step(at, line[1])
            elif name == "RET":
                self.step = (1, [])
            elif name == "FOR":
                loops[at] = max(self.read(line[1], 16), 1)
            elif name == "NEXT":
                start = self.partner(at)
                loops[start] -= 1
                if loops[start] > 0:
                    jump = start + 1
            elif name.removesuffix("P") in ("CJ", "CALL"):
                if self.driven(at, name):
                    target = len(self.lines) - 1 if line[1] == "P63" else self.labels[line[1]]
                    if name.startswith("CALL"):
                        calls.append(at + 1)
                    jump = target
            else:
                self.carry_out(at, line)
            at = at + 1 if jump is None else jump

    def begin_step(self, at: int, state: str) -> int | None:
        """A step; where the program goes on if it is neither active nor just left."""
        place = self.bit_place(state)
        joined = at > 0 and self.lines[at - 1][0] == "STL"
        on = int(self.bits[place] and (not joined or self.step[0]))
        self.step = (on, [*self.step[1], place] if joined else [place])
        before, self.before[at] = self.before[at], on
        self.acc = 1
        if on or before:
            return None
        at += 1
        while self.lines[at][0] != "RET" and (self.lines[at][0] != "STL" or self.lines[at - 1][0] == "STL"):
            at += 1
        return at

    def partner(self, at: int) -> int:
        depth = 0
        for start in range(at, -1, -1):
            depth += {"NEXT": 1, "FOR": -1}.get(self.lines[start][0], 0)
            if depth == 0:
                return start
        raise AssertionError

    def on(self) -> int:
        """The accumulator and the innermost MC."""
        return int(self.acc and self.step[0] and (not self.masters or self.masters[max(self.masters)]))

    def driven(self, at: int, name: str) -> int:
        on = self.on()
        if name.endswith("P"):
            before, self.before[at] = self.before[at], on
            return int(on and not before)
        return on

    def carry_out(self, at: int, line: list[str]) -> None:
        name, *operands = line
        contact = re.fullmatch(r"(LD|AND|ANI|OR|LDI|ORI)([PF]?)|(LD|AND|OR)(D?)([=<>]+)", name)
        if contact and not (name in ("ANDP", "ORP") and len(operands) == 3):
            self.contact(at, contact, operands)
        elif name in ("ANB", "ORB"):
            earlier = self.blocks.pop()
            self.acc = int(self.acc and earlier) if name == "ANB" else int(self.acc or earlier)
        elif name == "INV":
            self.acc = int(not self.acc)
        elif name == "MPS":
            self.branches.append(self.acc)
        elif name == "MRD":
            self.acc = self.branches[-1]
        elif name == "MPP":
            self.acc = self.branches.pop()
        elif name == "MC":
            on = self.on()
            self.masters[int(operands[0][1:])] = on
            self.bits[self.bit_place(operands[1])] = on
        elif name == "MCR":
            self.masters = {level: on for level, on in self.masters.items() if level < int(operands[0][1:])}
        elif name in ("OUT", "SET", "RST", "PLS", "PLF"):
            self.basic(at, name, operands)
        elif name != "NOP" and name[0] != "P":
            self.applied(at, name, operands)

    def contact(self, at: int, match: re.Match[str], operands: list[str]) -> None:
        plain, edge, join, wide, test = match.groups()
        if plain:
            try:
                bit = self.bit(operands[0])
            except RefusedError:
                self.fail()
                edge, bit = "", int(plain in ("LDI", "ANI", "ORI"))  # it does not conduct
            if edge:
                before, self.before[at] = self.before[at], bit
                bit = int(bit and not before) if edge == "P" else int(before and not bit)
            if plain in ("LDI", "ANI", "ORI"):
                bit = 1 - bit
            join = plain[:2]
        else:
            try:
                values = [self.read(operand, 32 if wide else 16) for operand in operands]
                bit = int(TESTS[test](*values))
            except RefusedError:
                self.fail()
                bit = 0
            join = join[:2]
        if join == "LD":
            self.blocks = [*self.blocks, self.acc][-8:]
            self.acc = bit
        elif join == "AN":
            self.acc = int(self.acc and bit)
        else:
            self.acc = int(self.acc or bit)

    def bit(self, text: str) -> int:
        """A bit device, or the bit of a word such as D5.A."""
        word, dot, number = text.partition(".")
        if dot:
            return self.words["D", int(word[1:])] >> int(number, 16) & 1
        return self.bits[self.bit_place(text)]

    def word_bit(self, name: str, text: str, on: int) -> None:
        """OUT, SET or RST of the bit of a word."""
        word, _, number = text.partition(".")
        place, mask = ("D", int(word[1:])), 1 << int(number, 16)
        if name == "OUT" or on:
            self.words[place] = self.words[place] & ~mask | (mask if on and name != "RST" else 0)

    def fail(self) -> None:
        self.bits["M", 8067] = self.bits["M", 8068] = 1
        self.words["D", 8067] = 6706
        self.note_error()

    def note_error(self) -> None:
        on = [number for number in range(8060, 8068) if self.bits["M", number]]
        self.bits["M", 8004], self.words["D", 8004] = int(bool(on)), on[0] if on else 0

    # -- outputs -------------------------------------------------------------------------------

    def basic(self, at: int, name: str, operands: list[str]) -> None:
        on = self.on()
        if "." in operands[0]:
            self.word_bit(name, operands[0], on)
            return
        try:
            letter, address, _ = self.split(operands[0])
        except RefusedError:
            if on or name == "OUT":
                self.fail()
            return
        if name == "OUT" and letter == "T":
            self.timer(address, on, operands[1])
        elif name == "OUT" and letter == "C":
            self.counter(address, on, operands[1])
        elif name in ("OUT", "SET") and letter == "S" and self.step[1]:
            if on:
                for left in self.step[1]:
                    self.bits[left] = 0
                self.bits["S", address] = 1
        elif name == "OUT":
            self.bits[letter, address] = on
        elif name in ("PLS", "PLF"):
            before, self.before[at] = self.before[at], on
            self.bits[letter, address] = int(on and not before) if name == "PLS" else int(before and not on)
        elif name == "SET":
            if on:
                self.bits[letter, address] = 1
        else:
            if letter in "TC":
                (self.held.add if on else self.held.discard)(operands[0])
            if on:
                self.reset(letter, address)

    def reset(self, letter: str, address: int) -> None:
        if letter in "DRVZTC":
            self.words[letter, address] = 0
        if letter not in "DRVZ":
            self.bits[letter, address] = 0
        if letter == "T":
            self.timers.pop(address, None)

    def end(self) -> None:
        """T192–T199 and T246–T249 that are driven go on; only the former close."""
        for number in list(self.timers):
            if number in GOING_ON and not self.bits["T", number]:
                self.advance(number, self.presets[number], closes=number < 200)

    def advance(self, number: int, preset: str, *, closes: bool) -> None:
        pulse, limit = self.pulse(number), self.read(preset, 16)
        reached = self.words["T", number] + pulse - self.timers[number][0]
        self.timers[number] = (pulse, self.scans)
        if reached >= limit:
            reached = max(self.words["T", number], limit, 0)
            self.bits["T", number] = int(closes)
        self.words["T", number] = reached

    def pulse(self, number: int) -> int:
        unit = (
            UNIT // 10
            if 246 <= number <= 249 or number > 255
            else UNIT
            if 200 <= number <= 245
            else 10 * UNIT
        )
        return self.now // unit

    def timer(self, number: int, on: int, preset: str) -> None:
        if not on:
            self.timers.pop(number, None)
            if number < 246 or number > 255:
                self.bits["T", number] = self.words["T", number] = 0
            return
        if f"T{number}" in self.held:
            self.timers.pop(number, None)
            return
        if self.bits["T", number]:
            return
        _, scan = self.timers.get(number, (0, -1))
        if scan < 0 or (scan < self.scans - 1 and number not in GOING_ON):
            self.timers[number] = (self.pulse(number), self.scans)  # it begins, or a jump had left it out
        self.presets[number] = preset
        self.advance(number, preset, closes=True)

    def counter(self, number: int, on: int, preset: str) -> None:
        before, self.before["C", number] = self.before["C", number], on
        if not on or before or f"C{number}" in self.held:
            return
        if number < 200:
            if not self.bits["C", number]:
                self.words["C", number] = min(
                    self.words["C", number] + 1, max(32767, self.words["C", number])
                )
                if self.words["C", number] >= self.read(preset, 16):
                    self.bits["C", number] = 1
            return
        down = self.bits["M", 8000 + number]
        value = self.signed(self.words["C", number] + (-1 if down else 1), 32)
        self.words["C", number] = value & 0xFFFFFFFF
        limit = self.read(preset, 32)
        if down and value == limit - 1:
            self.bits["C", number] = 0
        if not down and value == limit:
            self.bits["C", number] = 1

    # -- applied instructions ------------------------------------------------------------------

    def applied(self, at: int, name: str, operands: list[str]) -> None:
        known = {base: (base, 16) for base in BASES}
        known |= {"D" + base.removeprefix("W"): (base, 32) for base in BASES}
        pulse = name not in known
        base, size = known[name.removesuffix("P") if pulse else name]
        if self.driven(at, "P" if pulse else ""):
            try:
                if base in ("ROR", "ROL"):
                    self.rotate(operands, size, left=base == "ROL")
                elif base in ("SFTR", "SFTL"):
                    self.shift(operands, right=base == "SFTR")
                elif base == "ALT":
                    self.bits[self.bit_place(operands[0])] ^= 1
                elif base == "ZRST":
                    self.reset_zone(operands)
                else:
                    getattr(self, f"do_{base.lower()}")(operands, size)
            except RefusedError:
                self.fail()

    def do_mov(self, ops: list[str], size: int) -> None:
        value = self.read(ops[0], size)
        self.write(self.location(ops[1], size), value)

    def do_cml(self, ops: list[str], size: int) -> None:
        value = ~self.read(ops[0], size)
        self.write(self.location(ops[1], size), value)

    def do_xch(self, ops: list[str], size: int) -> None:
        one, other = (self.read(op, size) for op in ops)
        locations = [self.location(op, size) for op in ops]
        for location, value in zip(locations, (other, one), strict=True):
            self.write(location, value)

    def count(self, text: str, low: int, high: int) -> int:
        number = self.read(text, 16)
        if not low <= number <= high:
            raise RefusedError
        return number

    def row(self, text: str, size: int, count: int) -> list[int]:
        letter, address, groups, _ = self.location(text, size, items=count)
        if groups:
            each = 4 * groups
            return [
                sum(self.bits[letter, address + n * each + k] << k for k in range(each)) for n in range(count)
            ]
        step = 2 if size == 32 and not (letter == "C" and address >= 200) else 1
        return [self.read_at(text, letter, address + step * n, size) for n in range(count)]

    def fill(self, text: str, size: int, values: list[int]) -> None:
        letter, address, groups, _ = self.location(text, size, items=len(values))
        step = 4 * groups or (2 if size == 32 and not (letter == "C" and address >= 200) else 1)
        for n, value in enumerate(values):
            self.write((letter, address + step * n, groups, size), value)

    def do_bmov(self, ops: list[str], size: int) -> None:
        count = self.count(ops[2], 1, 512)
        one, other = ops[:2]
        if self.bits["M", 8024]:
            one, other = other, one
            if re.match(r"K\dX", other):
                raise RefusedError
        self.fill(other, size, self.row(one, size, count))

    def do_fmov(self, ops: list[str], size: int) -> None:
        count = self.count(ops[2], 1, 512)
        self.fill(ops[1], size, [self.read(ops[0], size)] * count)

    def do_mean(self, ops: list[str], size: int) -> None:
        count = self.count(ops[2], 1, 64)
        total = sum(self.signed(value, size) for value in self.row(ops[0], size, count))
        self.write(self.location(ops[1], size), int(abs(total) // count) * (-1 if total < 0 else 1))

    def do_bcd(self, ops: list[str], size: int) -> None:
        value = self.read(ops[0], size)
        if not 0 <= value < 10 ** (size // 4):
            raise RefusedError
        pattern = 0
        for location, digit in enumerate(reversed(str(value))):
            pattern |= int(digit) << 4 * location
        self.write(self.location(ops[1], size), pattern)

    def do_bin(self, ops: list[str], size: int) -> None:
        pattern = self.read(ops[0], size)
        digits = [pattern >> 4 * location & 15 for location in range(size // 4)]
        if any(digit > 9 for digit in digits):
            raise RefusedError
        self.write(
            self.location(ops[1], size), sum(digit * 10**location for location, digit in enumerate(digits))
        )

    def sum(self, ops: list[str], size: int, sign: int) -> None:
        total = self.read(ops[0], size) + sign * self.read(ops[1], size)
        half = 1 << size - 1
        borrow, carry = total < -half, total >= half
        if carry:
            total %= half  # 32767 is followed by 0
        elif borrow:
            total = -((-total - half - 1) % half)  # so is -32768, downwards
        self.write(self.location(ops[2], size), total)
        self.bits["M", 8020], self.bits["M", 8021], self.bits["M", 8022] = (
            int(total == 0),
            int(borrow),
            int(carry),
        )

    def do_add(self, ops: list[str], size: int) -> None:
        self.sum(ops, size, 1)

    def do_sub(self, ops: list[str], size: int) -> None:
        self.sum(ops, size, -1)

    def double(self, text: str, size: int, pattern: int) -> None:
        letter, address, groups = self.split(text)
        if groups:
            self.fits(letter, address, 4 * groups, text, word=False)
            for k in range(4 * groups):
                self.bits[letter, address + k] = pattern >> k & 1
        elif letter == "C" and address >= 200:
            self.fits(letter, address, 2, text, word=True)
            for k in range(2):
                self.words["C", address + k] = pattern >> 32 * k & 0xFFFFFFFF
        else:
            self.fits(letter, address, size // 8, text, word=True)
            for k in range(size // 8):
                self.words[letter, address + k] = pattern >> 16 * k & 0xFFFF

    def do_mul(self, ops: list[str], size: int) -> None:
        self.double(ops[2], size, self.read(ops[0], size) * self.read(ops[1], size))

    def do_div(self, ops: list[str], size: int) -> None:
        dividend, divisor = self.read(ops[0], size), self.read(ops[1], size)
        if divisor == 0 or (divisor == -1 and dividend == -(1 << size - 1)):
            raise RefusedError
        quotient = abs(dividend) // abs(divisor) * (1 if (dividend < 0) == (divisor < 0) else -1)
        remainder = dividend - quotient * divisor
        mask = (1 << size) - 1
        if ops[2][0] == "K":
            self.write(self.location(ops[2], size), quotient)
        else:
            self.double(ops[2], size, quotient & mask | (remainder & mask) << size)

    def do_inc(self, ops: list[str], size: int) -> None:
        self.write(self.location(ops[0], size), self.read(ops[0], size) + 1)

    def do_dec(self, ops: list[str], size: int) -> None:
        self.write(self.location(ops[0], size), self.read(ops[0], size) - 1)

    def do_neg(self, ops: list[str], size: int) -> None:
        self.write(self.location(ops[0], size), -self.read(ops[0], size))

    def logic(self, ops: list[str], size: int, kind: str) -> None:
        one, other = self.read(ops[0], size), self.read(ops[1], size)
        self.write(self.location(ops[2], size), LOGIC[kind](one, other))

    def do_wand(self, ops: list[str], size: int) -> None:
        self.logic(ops, size, "AND")

    def do_wor(self, ops: list[str], size: int) -> None:
        self.logic(ops, size, "OR")

    def do_wxor(self, ops: list[str], size: int) -> None:
        self.logic(ops, size, "XOR")

    def set_bits(self, text: str, *results: bool) -> None:
        letter, address = self.bit_place(text, 3)
        for k, result in enumerate(results):
            self.bits[letter, address + k] = int(result)

    def do_cmp(self, ops: list[str], size: int) -> None:
        one, other = self.read(ops[0], size), self.read(ops[1], size)
        self.set_bits(ops[2], one > other, one == other, one < other)

    def do_zcp(self, ops: list[str], size: int) -> None:
        low, high, value = (self.read(op, size) for op in ops[:3])
        high = max(low, high)
        self.set_bits(ops[3], value < low, low <= value <= high, value > high)

    def rotate(self, ops: list[str], size: int, *, left: bool) -> None:
        pattern = self.read(ops[0], size) % (1 << size)
        bits = [pattern >> k & 1 for k in range(size)]
        location = self.location(ops[0], size)
        carry = 0
        for _ in range(int(ops[1][1:])):
            if left:
                carry = bits.pop()
                bits.insert(0, carry)
            else:
                carry = bits.pop(0)
                bits.append(carry)
        self.write(location, sum(bit << k for k, bit in enumerate(bits)))
        self.bits["M", 8022] = carry

    def shift(self, ops: list[str], *, right: bool) -> None:
        n1, n2 = int(ops[2][1:]), int(ops[3][1:])
        source, start = self.bit_place(ops[0], n2)
        letter, first = self.bit_place(ops[1], n1)
        new = [self.bits[source, start + k] for k in range(n2)]
        row = [self.bits[letter, first + k] for k in range(n1)]
        row = row[n2:] + new if right else new + row[: n1 - n2]
        for k, bit in enumerate(row):
            self.bits[letter, first + k] = bit

    def reset_zone(self, ops: list[str]) -> None:
        letter, first, _ = self.split(ops[0])
        last = max(first, self.split(ops[1])[1])
        for address in range(first, last + 1):
            self.reset(letter, address)
