"""RS2 in the free protocol against the words of the PW10 manual, sections 5 and 6, reckoned again here.

Random words, counts, modes and end characters; the words of CPAVL are written as the manual numbers them.
"""

from __future__ import annotations

import random

import pytest

from bussim.scenario.loader import loads
from tests.sim.build import run
from tests.sim.test_plc_cases import watched

TEXT = """
schema: 1
name: RS2
duration: 400 ms
seed: 1
buses: [{{name: b, baud: 9600, format: 8N1}}]
plcs:
  - name: p
    scan: 5 ms
    ports: {{COM{port}: {{bus: b}}}}
    inputs: {{X0: {{times: [50 ms]}}}}
    program: |
      LD M8002
      MOV H{format:04X} D100
      MOV H{start:X} D104
      MOV H{end:X} D105
      MOV H10 D106
      MOV K{count} D300
      MOV K{n} D301
      MOV K{port} D302
      LD M8000
      CPAVL D100 M100 K{port}
      RS2 D200 {m} D500 {operand_n} {n1}
      LDP X0
      {moves}
      SET M102
      END
devices:
  - {{name: scale, model: free, bus: b, says: [{{text: "{said}", at: 150 ms}}]}}
"""


@pytest.mark.parametrize("seed", range(12))
def test_frames_and_data_are_those_of_the_manual(seed: int) -> None:
    chance = random.Random(seed)
    eight_bit, started, ended, in_registers = (chance.random() < 0.5 for _ in range(4))
    port, n = chance.randint(2, 6), chance.randint(2, 8)
    words = [chance.randrange(0x10000) for _ in range(6)]
    m = chance.randint(1, 6 if eight_bit else 12)
    # Reception ends at n bytes, or before them at the end character.
    length = chance.randint(1, n - 1) if ended else chance.randint(n, n + 4)
    payload = bytes(chance.choices(range(ord("A"), ord("Z") + 1), k=length))
    moves = [f"MOV H{word:04X} D{200 + at}" for at, word in enumerate(words)]
    text = TEXT.format(
        port=port,
        format=0x81 | eight_bit << 15,
        start=ord("<") if started else 0,
        end=ord(">") if ended else 0,
        # m, n and n1 are constants or registers
        m="D300" if in_registers else f"K{m}",
        count=m,
        n=n,
        operand_n="D301" if in_registers else f"K{n}",
        n1="D302" if in_registers else f"K{port}",
        moves="\n      ".join(moves),
        said="XY" * started + "<" * started + payload.decode() + ">" * ended,
    )
    # 16-bit mode: two bytes a word, low byte first; 8-bit mode: one byte a word.
    halves = [(word & 0xFF,) if eight_bit else (word & 0xFF, word >> 8) for word in words]
    data = bytes(byte for pair in halves for byte in pair)[:m]
    sent = [bytes(frame.chars) for frame in run(loads(text)).record.frames if frame.sender.startswith("p")]
    assert sent == [b"<" * started + data + b">" * ended]
    names = [f"D{500 + at}" for at in range(9)]
    found = watched(text, " ".join(f"p.{name}" for name in (*names, "D102", "D103", "M102", "M103", "M109")))
    received = list(payload[:n])
    if not eight_bit:
        received = [low | high << 8 for low, high in zip(received[::2], [*received[1::2], 0], strict=False)]
    shown = [(found[f"p.{name}"].values[-1:] or [0])[0] for name in names]
    assert shown == received + [0] * (9 - len(received))
    assert found["p.D103"].values[-1] == min(length, n)  # +3: bytes received
    assert found["p.D102"].values[-1] == 0  # +2: none is left to send
    assert found["p.M103"].values == [1]  # +3 stays until the program resets it
    assert found["p.M102"].values == [1, 0]  # +2 resets itself after sending
    assert found["p.M109"].values == []  # no timeout
