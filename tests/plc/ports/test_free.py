"""A port under the free protocol: RS2 by a program, bit by bit, and the list that takes its place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from bussim.engines.contract import RxChar
from bussim.engines.free.events import Ended
from bussim.line.characters import CharFormat, LineTiming
from bussim.plc.memory import Device
from bussim.plc.ports.cpavl import (
    COMPLETE,
    FORMAT,
    RECEIVED,
    RECEIVING,
    SEND_REQUEST,
    TIMED_OUT,
    TO_SEND,
    WAITING,
    default_devices,
)
from bussim.plc.ports.events import FreeReceived, FreeSent
from bussim.plc.ports.rs2 import Drive, Rs2
from bussim.plc.ports.spec import FreeSpec
from bussim.plc.profiles import PROFILES
from tests.plc.ports.bench import LINE, MS, PHASE, SCAN, Bench

D = {number: Device("D", number) for number in (200, 500, 600, 8255)}
CHAR = LINE.characters(1)
BITS = default_devices("COM3")[1].address
RECEIVER = FreeSpec("code", "COM3", device=D[500], count=20)


def rs2(send: int = 5, receive: int = 4) -> Rs2:
    return Rs2(D[200], send, D[500], receive, 3)


def set_bit(bench: Bench, offset: int, value: int) -> None:
    bench.plc.memory.set(Device("M", BITS + offset), value)


def flags(bench: Bench) -> dict[str, int]:
    names = {
        "wait": WAITING,
        "send": SEND_REQUEST,
        "complete": COMPLETE,
        "receiving": RECEIVING,
        "time": TIMED_OUT,
    }
    return {name: 1 for name, offset in names.items() if bench.bit(offset)}


class Program:
    """RS2 driven while ``on``; what is to be done at an END is a table of actions by its millisecond."""

    def __init__(self, operands: Rs2, actions: dict[int, Callable[[Bench], None]]) -> None:
        self.operands = operands
        self.actions = actions
        self.on = True
        self.seen: dict[int, dict[str, int]] = {}
        self.words: dict[int, tuple[int, int]] = {}

    def __call__(self, bench: Bench, now: int) -> None:
        """What a scan sees of the port, then what it does."""
        at = now // MS
        self.seen[at] = flags(bench)
        self.words[at] = (bench.word(TO_SEND), bench.word(RECEIVED))
        action = self.actions.get(at)
        if action is not None:
            action(bench)
        bench.program_ports.rs2("X1", self.operands, now, driven=self.on)


def send(bench: Bench) -> None:
    set_bit(bench, SEND_REQUEST, 1)


def reset(bench: Bench) -> None:
    set_bit(bench, COMPLETE, 0)


MANUAL = {"D200": 0x0201, "D201": 0x0403, "D202": 0x0005}


# -- by a program ------------------------------------------------------------------------------------


def test_the_manuals_example_sends_01_02_03_04_05() -> None:
    program = Program(rs2(), {20: send})
    bench = Bench("COM3", "free", program=program, registers=MANUAL)
    bench.run(100 * MS)
    # The request set in the scan that ends at 20 ms goes out at that END.
    assert bench.requests() == [(20 * MS, bytes((1, 2, 3, 4, 5)))]
    # Five characters of 1.042 ms: over before 30 ms, and seen there.
    assert program.seen[20] == {}
    assert program.seen[30] == {"send": 1}
    assert program.words[30][0] == 5
    assert program.seen[40] == {}
    assert program.words[40][0] == 0
    assert [(item.poll, item.sent.chars) for item in bench.of(FreeSent)] == [("", bytes((1, 2, 3, 4, 5)))]


def test_eight_bit_mode_sends_one_byte_a_word() -> None:
    program = Program(rs2(3), {20: send})
    registers = {f"D{default_devices('COM3')[0].address + FORMAT}": 0x8081, **MANUAL}
    bench = Bench("COM3", "free", program=program, registers=registers)
    bench.run(100 * MS)
    assert bench.requests()[0][1] == bytes((1, 3, 5))


def test_start_and_end_character_frame_what_is_sent() -> None:
    program = Program(rs2(2), {20: send})
    bench = Bench("COM3", "free", program=program, registers=MANUAL, w4=2, w5=13)
    bench.run(100 * MS)
    assert bench.requests()[0][1] == b"\x02\x01\x02\x0d"


def test_bytes_left_to_send_count_down_at_end() -> None:
    program = Program(rs2(20), {20: send})
    bench = Bench("COM3", "free", program=program)
    bench.run(100 * MS)
    # 20 characters take 20.8 ms from 20 ms on; what a scan sees is of the END before it.
    assert {at: left for at, (left, _) in program.words.items() if left} == {30: 20, 40: 11, 50: 1}
    assert program.seen[50] == {"send": 1}
    assert program.seen[60] == {}


def test_the_manuals_reception() -> None:
    """11 12 13 14 lie in D500 and D501, low byte first."""
    program = Program(rs2(5, 4), {70: reset})
    bench = Bench("COM3", "free", program=program)
    bench.wire.receive(bytes((0x11, 0x12)), 22 * MS)
    bench.wire.receive(bytes((0x13, 0x14)), 31 * MS)
    bench.run(100 * MS)
    assert program.seen[30] == {}
    assert program.seen[40] == {"receiving": 1}  # as of the END at 30
    assert program.words[40][1] == 2
    assert program.seen[50] == {"complete": 1}
    assert program.words[50][1] == 4
    assert (bench.plc.read("D500"), bench.plc.read("D501")) == (0x1211, 0x1413)
    assert program.seen[70] == {"complete": 1}
    assert program.seen[80] == {}
    received = bench.of(FreeReceived)
    assert [(item.poll, item.received.ended, item.received.damaged) for item in received] == [
        ("", Ended.COUNT, 0)
    ]


def test_complete_blocks_reception_until_the_program_resets_it() -> None:
    program = Program(rs2(5, 2), {70: reset})
    bench = Bench("COM3", "free", program=program)
    bench.wire.receive(b"ab", 22 * MS)
    bench.wire.receive(b"cd", 50 * MS)  # lost
    bench.wire.receive(b"ef", 71 * MS)
    bench.run(200 * MS)
    assert [item.received.data for item in bench.of(FreeReceived)] == [b"ab", b"ef"]
    assert bench.plc.read("D500") == int.from_bytes(b"ef", "little")


def test_a_timeout_ends_a_reception_and_sets_its_flag() -> None:
    program = Program(rs2(5, 10), {100: reset})
    bench = Bench("COM3", "free", program=program, w9=3)
    bench.wire.receive(b"abc", 22 * MS)
    bench.run(200 * MS)
    # 30 ms after the last character, which ends at 25.1 ms: seen at the END at 60.
    assert program.seen[60] == {"receiving": 1}
    assert program.seen[70] == {"complete": 1, "time": 1}
    assert program.seen[110] == {}
    assert bench.plc.read("D501") == ord("c")
    assert bench.errors() == []


def test_a_send_request_waits_while_something_is_received() -> None:
    program = Program(rs2(5, 10), {30: send})
    bench = Bench("COM3", "free", program=program, registers=MANUAL, w9=3)
    bench.wire.receive(b"abc", 28 * MS)
    bench.run(300 * MS)
    assert program.seen[40] == {"wait": 1, "send": 1, "receiving": 1}
    # Over 30 ms after 31.1 ms; the END at 70 takes it over and sends.
    assert bench.requests() == [(70 * MS, bytes((1, 2, 3, 4, 5)))]
    assert program.seen[80] == {"send": 1, "complete": 1, "time": 1}


def test_an_instruction_that_is_off_neither_sends_nor_receives() -> None:
    def off(_: Bench) -> None:
        program.on = False

    program = Program(rs2(5, 2), {50: off, 70: send})
    bench = Bench("COM3", "free", program=program, registers=MANUAL)
    bench.wire.receive(b"ab", 61 * MS)
    bench.run(200 * MS)
    assert (bench.requests(), bench.of(FreeReceived)) == ([], [])
    assert bench.plc.read("D500") == 0


def test_complete_left_on_blocks_the_next_instruction_too() -> None:
    def off(_: Bench) -> None:
        program.on = False

    def on(_: Bench) -> None:
        program.on = True

    program = Program(rs2(5, 2), {50: off, 70: on, 100: reset})
    bench = Bench("COM3", "free", program=program)
    bench.wire.receive(b"ab", 22 * MS)
    bench.wire.receive(b"cd", 81 * MS)  # lost
    bench.wire.receive(b"ef", 101 * MS)
    bench.run(200 * MS)
    assert [item.received.data for item in bench.of(FreeReceived)] == [b"ab", b"ef"]


def test_one_instruction_at_a_time() -> None:
    found = []

    def program(bench: Bench, now: int) -> None:
        found.append(bench.program_ports.rs2("one", rs2(5, 2), now, driven=now < 40 * MS))
        found.append(bench.program_ports.rs2("other", rs2(5, 3), now, driven=True))

    bench = Bench("COM3", "free", program=program)
    bench.run(50 * MS)
    assert found == [Drive.RUNNING, Drive.BUSY] * 3 + [Drive.OFF, Drive.RUNNING] * 2


@pytest.mark.parametrize(("stop_ok", "code"), [(True, 7305), (False, 7308)])
def test_damaged_characters_raise_5_or_8_until_the_next_sound_reception(*, stop_ok: bool, code: int) -> None:
    program = Program(rs2(5, 2), {50: reset})
    bench = Bench("COM3", "free", program=program)
    bench.wire.receive([RxChar(0x61), RxChar(0x62, parity_ok=False, stop_ok=stop_ok)], 22 * MS)
    bench.wire.receive(b"cd", 62 * MS)
    bench.run(55 * MS)
    assert (bench.plc.read("M8063"), bench.plc.read("D8063")) == (1, code)
    assert bench.of(FreeReceived)[0].received.damaged == 1
    bench.run(100 * MS)
    assert (bench.plc.read("M8063"), bench.plc.read("D8063")) == (0, code)
    assert bench.of(FreeReceived)[1].received.damaged == 0


@pytest.mark.parametrize(
    ("operands", "code"),
    [
        (Rs2(D[200], 257, D[500], 2, 3), 7306),
        (Rs2(D[8255], 4, D[500], 2, 3), 7302),
        (Rs2(D[200], 4, D[500], 257, 3), 7306),
    ],
)
def test_what_rs2_cannot_do(operands: Rs2, code: int) -> None:
    bench = Bench("COM3", "free", program=Program(operands, {20: send}))
    bench.run(100 * MS)
    assert bench.errors() == [code]
    assert len(bench.requests()) == (operands.n == 257)
    assert not bench.bit(SEND_REQUEST)


def test_received_bytes_beyond_the_memory_are_lost() -> None:
    bench = Bench("COM3", "free", program=Program(Rs2(D[200], 0, D[8255], 4, 3), {}))
    bench.wire.receive(b"abcd", 22 * MS)
    bench.run(100 * MS)
    assert bench.errors() == [7302]
    assert bench.plc.read("D8255") == 0


def test_stop_reports_what_was_sent_and_forgets_what_was_received() -> None:
    program = Program(rs2(5, 2), {20: send})
    bench = Bench("COM3", "free", program=program, registers=MANUAL)
    bench.wire.receive(b"ab", 22 * MS)
    bench.run(29 * MS)
    bench.stop_plc()
    assert len(bench.of(FreeSent)) == 1
    assert bench.of(FreeReceived) == []
    assert flags(bench) == {}


# -- by a list -------------------------------------------------------------------------------------


def test_a_barcode_reader_with_an_end_character() -> None:
    bench = Bench("COM3", "free", [RECEIVER], w5=13)
    for number in range(3):
        bench.wire.receive(b"40063813%d\x0d" % number, (50 + 60 * number) * MS)
    bench.run(400 * MS)
    received = [item.received.data for item in bench.of(FreeReceived)]
    assert received == [b"400638130", b"400638131", b"400638132"]
    assert {item.poll for item in bench.of(FreeReceived)} == {"code"}
    assert {item.received.ended for item in bench.of(FreeReceived)} == {Ended.END_CHARACTER}
    assert bench.plc.read("D504") == ord("2")
    assert flags(bench) == {}


def test_complete_shows_for_a_scan_and_the_port_receives_nothing_until_it_is_reset() -> None:
    bench = Bench("COM3", "free", [RECEIVER], w5=13)
    bench.wire.receive(b"abc\x0d", 22 * MS)
    bench.run(35 * MS)
    assert flags(bench) == {"complete": 1}
    bench.wire.receive(b"d\x0d", 36 * MS)  # before the END at 40, which sees the flag reset
    bench.run(45 * MS)
    assert flags(bench) == {}
    bench.wire.receive(b"e\x0d", 46 * MS)
    bench.run(100 * MS)
    assert [item.received.data for item in bench.of(FreeReceived)] == [b"abc", b"e"]


def test_a_reception_makes_the_scans_longer_while_it_lasts() -> None:
    bench = Bench("COM3", "free", [RECEIVER], profile=PROFILES["pw10"], w5=13)
    bench.wire.receive(b"x" * 19 + b"\x0d", 12 * MS)  # until 32.8 ms
    longer = SCAN + MS // 5
    bench.run(200 * MS)
    # Seen at 20; so the scans to 30.2 and 40.4 are longer, and there it is taken over.
    assert bench.ends[1:4] == [20 * MS, 20 * MS + 2 * longer, 30 * MS + 2 * longer]
    assert bench.of(FreeReceived)[0].received.ended is Ended.END_CHARACTER


def test_a_listener_has_its_time_and_number() -> None:
    spec = FreeSpec("code", "COM3", device=D[500], count=2, at=35 * MS, times=2)
    bench = Bench("COM3", "free", [spec])
    for number in range(6):
        bench.wire.receive(b"a%d" % number, (12 + 40 * number) * MS)
    bench.run(400 * MS)
    assert [item.received.data for item in bench.of(FreeReceived)] == [b"a1", b"a2"]
    assert bench.plc.wanted_end(400 * MS) is None


def test_turns_that_send() -> None:
    spec = FreeSpec("go", "COM3", send=D[200], send_count=3, data=b"GO!", every=100 * MS, at=15 * MS, times=2)
    bench = Bench("COM3", "free", [spec], w5=13)
    bench.run(500 * MS)
    # Due at 15 and 115: seen by the scans from 20 and 120 on, sent at their END.
    assert bench.requests() == [(30 * MS, b"GO!\r"), (130 * MS, b"GO!\r")]
    assert [(item.poll, item.sent.start) for item in bench.of(FreeSent)] == [
        ("go", 30 * MS),
        ("go", 130 * MS),
    ]
    assert bench.plc.read("D200") == int.from_bytes(b"GO", "little")
    assert bench.plc.wanted_end(500 * MS) is None


def test_turns_without_registers_send_their_data() -> None:
    bench = Bench("COM3", "free", [FreeSpec("go", "COM3", send_count=2, data=b"GO!", times=1)])
    bench.run(100 * MS)
    assert bench.requests() == [(PHASE, b"GO")]


def test_a_turn_with_a_reply() -> None:
    ask = FreeSpec("ask", "COM3", send=D[200], send_count=1, data=b"?", device=D[600], count=2)
    bench = Bench("COM3", "free", [ask])
    bench.wire.receive(b"42", 15 * MS)
    bench.wire.receive(b"43", 55 * MS)
    bench.run(90 * MS)
    # Sent at 10; reply at 17.1, taken over at 20; the next one's turn begins there: at 30, …
    assert [start for start, _ in bench.requests()][:2] == [10 * MS, 30 * MS]
    assert [item.received.data for item in bench.of(FreeReceived)] == [b"42", b"43"]
    assert bench.plc.read("D600") == int.from_bytes(b"43", "little")


def test_a_turn_without_a_reply_is_given_up_after_the_ports_timeout() -> None:
    ask = FreeSpec("ask", "COM3", send=D[200], send_count=1, data=b"?", device=D[600], count=2)
    bench = Bench("COM3", "free", [ask], w9=3)
    bench.run(90 * MS)
    # One character from 10 ms on, 30 ms of waiting: over at 41.04, seen at 50, asked again at 60.
    assert [start for start, _ in bench.requests()] == [10 * MS, 60 * MS]
    (vain,) = bench.of(FreeReceived)
    assert (vain.poll, vain.received.tick, vain.received.data, vain.received.ended) == (
        "ask",
        50 * MS,
        b"",
        Ended.TIMEOUT,
    )
    assert flags(bench) == {}


def test_a_listener_between_turns() -> None:
    go = FreeSpec("go", "COM3", send_count=2, data=b"GO", every=100 * MS)
    bench = Bench("COM3", "free", [go, RECEIVER], w5=13)
    bench.wire.receive(b"one\x0d", 42 * MS)
    bench.wire.receive(b"two\x0d", 98 * MS)  # goes on when the next turn is due at 100
    bench.wire.receive(b"three\x0d", 152 * MS)
    bench.run(200 * MS)
    assert [item.received.data for item in bench.of(FreeReceived)] == [b"one", b"two", b"three"]
    # The second turn waits for the reception's end at 102 (the END at 110), then goes out at 120.
    assert [start for start, _ in bench.requests()] == [10 * MS, 120 * MS]


def test_stop_begins_the_list_anew() -> None:
    bench = Bench("COM3", "free", [FreeSpec("go", "COM3", send_count=2, data=b"GO", times=1)])
    bench.run(100 * MS)
    bench.stop_plc()
    bench.run_plc()
    bench.run(200 * MS)
    assert [start for start, _ in bench.requests()] == [100 * MS + PHASE]


def test_two_that_only_receive_cannot_share_a_port() -> None:
    other = FreeSpec("other", "COM3", device=D[600], count=2)
    with pytest.raises(ValueError, match="code, other only receive; one port can drive one of them"):
        Bench("COM3", "free", [RECEIVER, other])


def test_awaiting_the_first_character_is_a_profiles_choice() -> None:
    profile = replace(PROFILES["pw10"], transaction_time=0, free_awaits_first=True, free_keeps_frame=True)
    bench = Bench("COM3", "free", program=Program(rs2(5, 4), {}), profile=profile, w9=3, w4=2)
    bench.run(60 * MS)
    assert flags(bench) == {"complete": 1, "time": 1}
    bench = Bench("COM3", "free", program=Program(rs2(5, 4), {}), profile=profile, w9=3, w4=2)
    bench.wire.receive(b"\x02abc", 12 * MS)
    bench.run(60 * MS)
    assert bench.of(FreeReceived)[0].received.data == b"\x02abc"


def test_7_data_bits() -> None:
    line = LineTiming(9600, CharFormat(7, "E", 1))
    bench = Bench("COM3", "free", [RECEIVER], line=line, w5=13)
    bench.wire.receive(b"abc\x0d", 22 * MS)
    bench.run(100 * MS)
    assert bench.of(FreeReceived)[0].received.data == b"abc"
