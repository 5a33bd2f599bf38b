"""What is read of damaged replies, against the real receiver and reader with bits inverted one by one."""

from __future__ import annotations

import math
import random
from collections import Counter

import numpy as np
import pytest

from bussim.engines.nn.frames import ETX, STX, Frame, FrameReader
from bussim.exact.bursts.reading import ENDS, Reading, read
from bussim.line.characters import NN_LINE
from bussim.line.uart import Uart
from bussim.line.wave import Wave, low_intervals
from tests.selection import quick

UART = Uart(NN_LINE)
BIT = 1875
HEX = b"0123456789ABCDEF"


def law(rate: float, characters: int, *, zeros: bool = True) -> Reading:
    return read(np.full((1, 1), 1 - rate), np.full((1, 1), rate), characters, zeros=zeros)


def heard(chars: bytes, inverted: list[int]) -> tuple[str, int]:
    """How the master's engine takes a reply, and in which bit after its end the last character ends."""
    wave = Wave([low_intervals(chars, NN_LINE, 0, inverted)])
    reader, ready, end, header = FrameReader(), 0, 0, False
    while (char := UART.next_character(wave, ready)) is not None:
        found = reader.character((char.value, char.parity_ok, char.stop_ok), char.start)
        header |= not isinstance(found, Frame) and found is not None and found.header == STX
        ready, end = char.ready, char.end
    damage = reader.quiet()
    header |= damage is not None and damage.header == STX
    return ("torn" if header else "headless"), round(end / BIT) - 10 * len(chars)


def a_reply(rng: random.Random, characters: int, *, zeros: bool) -> bytes:
    data = (b"0" if zeros else rng.choices(HEX, k=1) for _ in range(characters - 6))
    station, counter, high, low = rng.choices(HEX, k=4)
    return bytes((STX, station, counter, *(digit for digits in data for digit in digits), ETX, high, low))


@pytest.mark.parametrize("zeros", [True, False])
@pytest.mark.parametrize("rate", quick(0.03, (0.003, 0.03, 0.1, 0.3)))
def test_replies_drawn_bit_by_bit(rate: float, zeros: bool) -> None:
    rng, tries, characters = random.Random(3), 3_000, 22
    seen: Counter[str] = Counter()
    ends: Counter[int] = Counter()
    for _ in range(tries):
        inverted = [bit for bit in range(10 * characters) if rng.random() < rate]
        if not inverted:
            seen["clean"] += 1
            continue
        how, end = heard(a_reply(rng, characters, zeros=zeros), inverted)
        if how == "torn":
            how = "torn" if end == 0 else "shifted"
            ends[max(end, ENDS[0])] += 1
        seen[how] += 1
    expected = law(rate, characters, zeros=zeros)
    pairs = [(seen[name], getattr(expected, name)[0, 0]) for name in ("clean", "torn", "shifted", "headless")]
    pairs += [(ends[end], expected.ends[0, index]) for index, end in enumerate(ENDS)]
    for count, chance in pairs:
        assert abs(count - tries * chance) < 4.5 * math.sqrt(tries * chance * (1 - chance) + 1)


def test_nothing_else_can_become_of_a_reply() -> None:
    for rate in (0.0, 1e-12, 1e-4, 0.2, 0.7, 1.0):
        found = law(rate, 54)
        assert sum(float(matrix[0, 0]) for matrix in found[:4]) == pytest.approx(1, rel=1e-12)
        assert found.ends.sum() == pytest.approx(found.torn[0, 0] + found.shifted[0, 0], rel=1e-12)
        assert found.clean[0, 0] == pytest.approx((1 - rate) ** 540, rel=1e-11)


def test_a_single_hit_in_the_header_of_zeros_is_read_as_another_header_now_and_then() -> None:
    # Of all bits of the first character, one at a time, with each pair of digits behind it.
    rng = random.Random(1)
    found = sum(
        heard(a_reply(rng, 22, zeros=True), [bit])[0] == "torn" for bit in range(10) for _ in range(200)
    )
    rare = 1e-9
    chance = 1 - float(law(rare, 22).headless[0, 0]) / (10 * rare)
    assert found / 2_000 == pytest.approx(chance, abs=4.5 * math.sqrt(chance * (1 - chance) / 2_000))
    assert 0.1 < chance < 0.3
    assert 0 < 1 - float(law(rare, 22, zeros=False).headless[0, 0]) / (10 * rare) < 0.03
