"""The programs of the PW10 manual: they are read, and the two of its N:N example do what it says."""

from __future__ import annotations

from pathlib import Path

import pytest

from bussim.plc.memory import BlockRange, Memory, block_range, parse_device
from bussim.plc.program.execution import ProgramRun
from bussim.plc.program.program import Program
from bussim.units import TICKS_PER_MS
from tests.plc.program.test_run import Heard

PROGRAMS = Path(__file__).parents[3] / "scenarios" / "programs"


def load(name: str) -> Program:
    return Program.parse((PROGRAMS / name).read_text(encoding="utf-8"), name)


@pytest.mark.parametrize("path", sorted(PROGRAMS.glob("*.il")), ids=lambda path: path.stem)
def test_the_programs_that_come_along_are_right(path: Path) -> None:
    program = load(path.name)
    run = ProgramRun(program, Memory(), ports=Heard())
    run.run(0)
    for scan in range(5):
        assert run.scan(scan * 10 * TICKS_PER_MS) > 0
    assert run.halted == 0


def test_the_slave_drives_y010_twice_and_is_warned() -> None:
    assert [problem.message for problem in load("manual_slave.il").warnings] == [
        "MOV writes Y10, which OUT at line 10 drives; the last one executed wins"
    ]
    assert load("manual_master.il").warnings == ()


@pytest.mark.parametrize(
    ("name", "registers"),
    [
        ("nn_master_setting.il", {"D8176": 0, "D8177": 1, "D8178": 2, "D8179": 5, "D8180": 5, "M8179": 1}),
        ("nn_slave_setting.il", {"D8176": 1, "M8179": 1}),
        ("manual_master.il", {"D8176": 0, "D8177": 1, "D8178": 2, "D8179": 5, "D8180": 5, "M8179": 1}),
        ("manual_slave.il", {"D8176": 1, "M8179": 1}),
        ("modbus_ascii_slave.il", {"D0": 0x81, "D1": 1, "D6": 3}),
        ("modbus_rtu_master.il", {"D20": 0x81, "D26": 0x20, "D29": 10, "D103": 0x0103, "D400": 10}),
        ("free_protocol.il", {"D0": 0x81, "D1": 1, "D6": 0x10, "D9": 10}),
    ],
)
def test_settings_stand_after_the_first_scan(name: str, registers: dict[str, int]) -> None:
    memory = Memory()
    run = ProgramRun(load(name), memory, ports=Heard())
    run.run(0)
    for scan in range(2):
        run.scan(scan * 720_000)
        assert {register: memory.get(parse_device(register)) for register in registers} == registers


class Pair:
    """Master and slave, whose shared blocks are exchanged by hand after every scan, as mode 2 does."""

    PLACES: tuple[BlockRange, BlockRange] = (block_range(0, 64, 8, 32), block_range(1, 64, 8, 32))

    def __init__(self) -> None:
        self.memories = (Memory(), Memory())
        self.runs = [
            ProgramRun(load(name), memory)
            for name, memory in zip(("manual_master.il", "manual_slave.il"), self.memories, strict=True)
        ]
        for run in self.runs:
            run.run(0)
        self.now = 0
        self.linked = True

    def scan(self, count: int = 1) -> None:
        master, slave = self.memories
        for _ in range(count):
            for run in self.runs:
                run.scan(self.now)
            self.now += 10 * TICKS_PER_MS
            master.set(parse_device("M8184"), not self.linked)
            slave.set(parse_device("M8183"), not self.linked)
            for memory in self.memories:
                memory.set(parse_device("M8191"), self.linked)
            if self.linked:
                own, its = self.PLACES
                slave.store_block(own, master.block_image(own))
                master.store_block(its, slave.block_image(its))

    def put(self, station: int, name: str, value: int) -> None:
        self.memories[station].set(parse_device(name), value)

    def bits(self, station: int, first: str, count: int = 4) -> list[int]:
        letter, at = parse_device(first)
        return list(self.memories[station].bits(letter)[at : at + count])

    def word(self, station: int, name: str) -> int:
        return self.memories[station].word(name[0], int(name[1:]))


def test_the_example_device_by_device() -> None:
    pair = Pair()
    pair.scan(2)
    assert pair.word(1, "D1") == 10  # the preset has arrived
    assert pair.bits(0, "Y0", 1) + pair.bits(1, "Y0", 1) == [0, 0]

    # The master's X0–X3 appear on the slave's Y10–Y13, and nowhere else.
    for pattern in ([1, 0, 0, 0], [0, 1, 0, 1], [1, 1, 1, 1], [0, 0, 0, 0], [0, 0, 1, 0]):
        for point, value in enumerate(pattern):
            pair.put(0, f"X{point}", value)
        before = pair.bits(1, "Y10")
        pair.scan()
        assert pair.bits(0, "M1000") == pattern
        assert pair.bits(1, "Y10") == before  # it comes with the exchange after that scan
        pair.scan()
        assert pair.bits(1, "Y10") == pattern
        assert pair.bits(1, "Y14") == [0, 0, 0, 0]

    # The slave's X0–X3 appear on the master's Y11–Y14; Y10 shows the running link.
    for pattern in ([0, 0, 1, 0], [0, 0, 1, 1], [0, 0, 0, 1]):
        for point, value in enumerate(pattern):
            pair.put(1, f"X{point}", value)
        pair.scan(2)
        assert pair.bits(0, "Y11") == pattern
        assert pair.bits(0, "Y10", 1) == [1]


def test_the_counter_takes_its_preset_over_the_link_and_its_contact_comes_back() -> None:
    pair = Pair()
    pair.scan(2)
    for edge in range(1, 11):
        assert pair.bits(0, "Y6", 1) == [0]
        pair.put(1, "X0", 1)
        pair.scan()
        assert pair.word(1, "C1") == edge
        pair.put(1, "X0", 0)
        if edge < 10:
            pair.scan()
    assert pair.bits(1, "Y5", 1) + pair.bits(1, "M1070", 1) == [1, 1]
    pair.scan()
    assert pair.bits(0, "M1070", 1) + pair.bits(0, "Y6", 1) == [1, 1]
    pair.put(1, "X1", 1)
    pair.scan(2)
    assert pair.word(1, "C1") == 0
    assert pair.bits(1, "Y5", 1) + pair.bits(0, "Y6", 1) == [0, 0]


def test_the_copies_stop_while_the_link_is_down() -> None:
    pair = Pair()
    for point in range(4):
        pair.put(0, f"X{point}", 1)
        pair.put(1, f"X{point}", 1)
    pair.scan(3)
    assert pair.bits(1, "Y10") == pair.bits(0, "Y11") == [1, 1, 1, 1]
    pair.linked = False
    pair.scan(2)
    for point in range(4):
        pair.put(0, f"X{point}", 0)
        pair.put(1, f"X{point}", 0)
    pair.scan(5)
    # Both report the other's error; the copies keep what they had, but OUT Y010 is now the last word.
    assert pair.bits(0, "Y0", 1) + pair.bits(1, "Y0", 1) == [1, 1]
    assert pair.bits(0, "Y10", 5) == [0, 1, 1, 1, 1]
    assert pair.bits(1, "Y10") == [0, 1, 1, 1]
    assert pair.bits(1, "M1064") == [1, 1, 1, 1]
    assert pair.bits(0, "M1000") == [0, 0, 0, 0]
    pair.linked = True
    pair.scan(3)
    assert pair.bits(1, "Y10") == pair.bits(0, "Y11") == [0, 0, 0, 0]
    assert pair.bits(0, "Y0", 1) + pair.bits(1, "Y0", 1) == [0, 0]
