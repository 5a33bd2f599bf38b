"""RS against what the FX communication manual says of it, done again here, with random data and settings."""

from __future__ import annotations

import random
from dataclasses import dataclass

import pytest

from bussim.scenario.loader import loads
from tests.sim.build import run
from tests.sim.test_plc_cases import watched

TEXT = """
schema: 1
name: RS
duration: 400 ms
seed: 1
buses: [{{name: b, baud: 9600, format: 8N1}}]
plcs:
  - name: p
    profile: fx2n
    scan: 5 ms
    ports: {{COM3: {{bus: b}}}}
    inputs: {{X0: {{times: [50 ms]}}}}
    program: |
      LD M8002
      MOV H{format:04X} D8120
      MOV H{header:X} D8124
      MOV H{terminator:X} D8125
      LD M8000
      OUT M{eight_bit}
      RS D200 K{m} D500 K{n}
      LDP X0
      {moves}
      SET M8122
      END
devices:
  - {{name: scale, model: free, bus: b, says: [{{text: "{said}", at: 150 ms}}]}}
"""
HEADER, TERMINATOR = ord("<"), ord(">")


@dataclass(frozen=True)
class Case:
    """A program's words and settings, and what the partner says."""

    eight_bit: bool
    headed: bool
    ended: bool
    words: list[int]
    m: int
    n: int
    payload: bytes

    @property
    def text(self) -> str:
        """The scenario; b8 and b9 of D8120 let header and terminator count."""
        before = "XY<" if self.headed else ""
        return TEXT.format(
            format=0x81 | self.headed << 8 | self.ended << 9,
            header=HEADER,
            terminator=TERMINATOR,
            eight_bit=8161 if self.eight_bit else 0,
            m=self.m,
            n=self.n,
            moves="\n      ".join(f"MOV H{word:04X} D{200 + at}" for at, word in enumerate(self.words)),
            said=before + self.payload.decode() + (">" if self.ended else ""),
        )

    @property
    def frame(self) -> bytes:
        """What leaves: in 8-bit mode a low byte a word, else low and high byte of each, m in all."""
        halves = [(word & 0xFF,) if self.eight_bit else (word & 0xFF, word >> 8) for word in self.words]
        data = bytes(byte for pair in halves for byte in pair)[: self.m]
        return bytes([HEADER]) * self.headed + data + bytes([TERMINATOR]) * self.ended

    @property
    def received(self) -> list[int]:
        """D500 and up: what comes behind the header, up to n bytes or the terminator."""
        data = list(self.payload[: self.n])
        if self.eight_bit:
            return data
        return [low | high << 8 for low, high in zip(data[::2], [*data[1::2], 0], strict=False)]


def case(seed: int) -> Case:
    chance = random.Random(seed)
    eight_bit, headed, ended = (chance.random() < 0.5 for _ in range(3))
    words = [chance.randrange(0x10000) for _ in range(6)]
    n = chance.randint(2, 8)
    # With a terminator it is that which ends the reception, without one the number of bytes.
    length = chance.randint(1, n - 1) if ended else chance.randint(n, n + 4)
    payload = bytes(chance.choices(range(ord("A"), ord("Z") + 1), k=length))
    return Case(eight_bit, headed, ended, words, chance.randint(1, 6 if eight_bit else 12), n, payload)


@pytest.mark.parametrize("seed", range(12))
def test_frames_and_data_are_those_of_the_manual(seed: int) -> None:
    drawn = case(seed)
    frames = run(loads(drawn.text)).record.frames
    assert [bytes(frame.chars) for frame in frames if frame.sender.startswith("p")] == [drawn.frame]
    names = [f"D{500 + at}" for at in range(9)]
    found = watched(drawn.text, " ".join(f"p.{name}" for name in (*names, "M8123", "D8123", "M8129")))
    assert found["p.M8123"].values == [1]  # it stays, for no program resets it, and blocks what follows
    assert found["p.M8129"].values == []
    shown = [found[f"p.{name}"].values[-1:] or [0] for name in names]
    expected = drawn.received
    assert [value for (value,) in shown] == expected + [0] * (9 - len(expected))
    assert found["p.D8123"].values[-1] == min(len(drawn.payload), drawn.n)
