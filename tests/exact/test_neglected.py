"""What the distribution neglects, measured on the real receiver."""

from __future__ import annotations

import random

import pytest

from bussim.engines.nn.frames import STX, Frame, encode_data
from bussim.line.characters import NN_LINE
from bussim.line.uart import Sampled, Uart
from bussim.line.wave import Wave, low_intervals

UART = Uart(NN_LINE)
CHARACTER = NN_LINE.characters(1)


def frames(count: int, seed: int) -> list[Frame]:
    rng = random.Random(seed)
    return [encode_data(rng.randint(1, 7), rng.randint(0, 15), rng.randbytes(24)) for _ in range(count)]


def characters(frame: Frame, inverted: tuple[int, ...]) -> list[Sampled]:
    wave = Wave([low_intervals(frame.chars, NN_LINE, 0, inverted)])
    found, ready = [], 0
    while (character := UART.next_character(wave, ready)) is not None:
        found.append(character)
        ready = character.ready
    return found


def clean_stx(character: Sampled) -> bool:
    return character.value == STX and character.parity_ok and character.stop_ok


@pytest.mark.slow
def test_a_header_where_there_was_none() -> None:
    # Any single hit in the first character damages it; in 1 % another STX is read further on.
    spurious = tries = 0
    for frame in frames(400, 1):
        for bit in range(10):
            heard = characters(frame, (bit,))
            assert not clean_stx(heard[0])
            spurious += any(map(clean_stx, heard))
            tries += 1
    assert spurious / tries < 0.02


@pytest.mark.slow
def test_where_a_torn_reply_seems_to_end() -> None:
    # Any single hit later leaves the first character alone and moves the last one by less than a character.
    off = moved = tries = 0
    for frame in frames(40, 2):
        end = len(frame.chars) * CHARACTER
        for bit in range(10, 10 * len(frame.chars)):
            heard = characters(frame, (bit,))
            assert clean_stx(heard[0])
            away = abs(heard[-1].end - end)
            assert away < CHARACTER
            off += away > 0
            moved += away
            tries += 1
    assert off / tries < 0.03
    assert moved / tries < 5 * 72  # 5 µs


@pytest.mark.slow
def test_every_single_hit_damages_a_frame() -> None:
    for frame in frames(10, 3):
        sent = [(value, True, True) for value in frame.chars]
        for bit in range(10 * len(frame.chars)):
            heard = [(c.value, c.parity_ok, c.stop_ok) for c in characters(frame, (bit,))]
            assert heard != sent
