"""The free protocol's engine: sending, the three ends of a reception, and the flags."""

from __future__ import annotations

import pytest

from bussim.engines.contract import DEADLINE, SERVE, Engine, RxChar, Transmit
from bussim.engines.free.engine import FreeConfig, FreeFrame, FreePort
from bussim.engines.free.events import CharacterDamaged, Ended, FreeEvent, Received, Sent
from bussim.engines.free.packing import unpack
from bussim.engines.free.states import FREE, FreeInput, FreeState
from bussim.engines.modbus.codes import PortError
from bussim.line.characters import CharFormat, LineTiming
from bussim.units import TICKS_PER_MS
from tests.engines.modbus.wire import drain, receive_by_character

MS = TICKS_PER_MS
LINE = LineTiming(9600, CharFormat(8, "N", 1))
CHAR = LINE.characters(1)


def port(expected: int = 4, **config: int) -> FreePort:
    engine = FreePort(FreeConfig(LINE, **{"timeout": 100 * MS, **config}))
    engine.start(0)
    engine.drive(expected, 0)
    return engine


def test_keeps_the_contract() -> None:
    engine: Engine[FreeFrame, FreeEvent] = FreePort(FreeConfig(LINE))
    assert engine.deadline() is None


def test_manuals_example_sends_01_02_03_04_05() -> None:
    engine = port()
    data = unpack([0x0201, 0x0403, 0x0005], 5, eight_bit=False)
    engine.send(data, 10)
    assert engine.waiting
    assert engine.left_to_send(10) == 5
    assert drain(engine) == [Transmit(10)]
    assert engine.begin_transmit(10).chars == bytes((1, 2, 3, 4, 5))
    assert not engine.waiting
    assert [engine.left_to_send(10 + k * CHAR) for k in range(6)] == [5, 4, 3, 2, 1, 0]
    assert engine.left_to_send(10 + CHAR - 1) == 5
    engine.transmit_done(10 + 5 * CHAR)
    assert drain(engine) == [Sent(10, 10 + 5 * CHAR, bytes((1, 2, 3, 4, 5)))]
    assert engine.left_to_send(10 + 5 * CHAR) == 0


def test_start_and_end_characters_are_sent_around_the_data() -> None:
    engine = port(start=0x02, end=0x0D)
    engine.send(b"AB", 0)
    assert engine.begin_transmit(0).chars == b"\x02AB\x0d"


def test_reception_ends_at_the_last_byte() -> None:
    engine = port(4)
    _, end = receive_by_character(engine, bytes((0x11, 0x12, 0x13)), 100, LINE)
    assert engine.receiving
    assert engine.received == 3
    _, end = receive_by_character(engine, b"\x14", end, LINE)
    assert drain(engine) == [Received(end, 100, bytes((0x11, 0x12, 0x13, 0x14)), Ended.COUNT)]
    assert engine.complete
    assert not engine.receiving
    assert engine.deadline() is None


def test_reception_ends_at_the_end_character() -> None:
    engine = port(200, end=0x0D)  # a bar code reader
    _, end = receive_by_character(engine, b"4006381333931\x0d", 0, LINE)
    assert drain(engine) == [Received(end, 0, b"4006381333931", Ended.END_CHARACTER)]


def test_reception_begins_with_the_start_character() -> None:
    engine = port(10, start=0x02, end=0x03)
    receive_by_character(engine, b"noise", 0, LINE)
    assert not engine.receiving
    start = 10 * CHAR
    _, end = receive_by_character(engine, b"\x02AB\x03", start, LINE)
    assert drain(engine) == [Received(end, start, b"AB", Ended.END_CHARACTER)]


def test_start_and_end_character_may_be_kept() -> None:
    engine = port(10, start=0x02, end=0x03, keeps_frame=True)
    _, end = receive_by_character(engine, b"\x02AB\x03", 0, LINE)
    assert drain(engine) == [Received(end, 0, b"\x02AB\x03", Ended.END_CHARACTER)]
    engine.reset_complete(end)
    engine.release(end)
    engine.drive(1, end)
    receive_by_character(engine, b"\x02", end, LINE)
    assert drain(engine)[-1].data == b"\x02"


def test_timeout_counts_from_the_latest_character() -> None:
    engine = port(10)
    _, end = receive_by_character(engine, b"AB", 0, LINE)
    assert engine.deadline() == end + 100 * MS
    hints, end = receive_by_character(engine, b"C", end + 99 * MS, LINE)
    assert hints & DEADLINE
    assert engine.deadline() == end + 100 * MS
    engine.on_deadline(end + 100 * MS)
    assert drain(engine) == [Received(end + 100 * MS, 0, b"ABC", Ended.TIMEOUT)]
    engine.reset_complete(end + 101 * MS)
    assert engine.received == 0


def test_silence_alone_does_not_time_out() -> None:
    assert port(10).deadline() is None


def test_awaits_first_counts_from_the_transmission() -> None:
    engine = port(10, awaits_first=True)
    assert engine.deadline() == 100 * MS
    engine.send(b"?", 50 * MS)
    assert engine.deadline() is None
    engine.begin_transmit(50 * MS)
    engine.transmit_done(60 * MS)
    assert engine.deadline() == 160 * MS
    engine.on_deadline(160 * MS)
    assert drain(engine)[-1] == Received(160 * MS, None, b"", Ended.TIMEOUT)


def test_a_complete_reception_blocks_the_next_until_reset() -> None:
    engine = port(2)
    _, end = receive_by_character(engine, b"ABCD", 0, LINE)
    assert [type(event) for event in drain(engine)] == [Received]
    engine.reset_complete(end)
    _, again = receive_by_character(engine, b"EF", end, LINE)
    assert drain(engine) == [Received(again, end, b"EF", Ended.COUNT)]


def test_zero_bytes_receives_nothing() -> None:
    engine = port(0)
    assert receive_by_character(engine, b"ABC", 0, LINE)[0] == 0
    assert engine.deadline() is None
    # Nothing is awaited then, so that nothing times out.
    assert port(0, awaits_first=True).deadline() is None


@pytest.mark.parametrize(
    ("char", "error"),
    [
        (RxChar(0x41, parity_ok=False), PortError.RECEPTION),
        (RxChar(0x41, stop_ok=False), PortError.FRAMING),
        (RxChar(0x41, parity_ok=False, stop_ok=False), PortError.FRAMING),
    ],
)
def test_damaged_characters_are_reported_and_kept(char: RxChar, error: PortError) -> None:
    engine = port(2)
    engine.receive(char, 0, CHAR)
    engine.receive(RxChar(0x42), CHAR, 2 * CHAR)
    assert drain(engine) == [
        CharacterDamaged(CHAR, error, 0x41),
        Received(2 * CHAR, 0, b"AB", Ended.COUNT),
    ]


def test_a_damaged_end_character_does_not_end() -> None:
    engine = port(10, end=0x0D)
    engine.receive(RxChar(0x0D, parity_ok=False), 0, CHAR)
    assert engine.receiving
    assert engine.received == 1


def test_whole_is_the_same_as_one_by_one() -> None:
    one, whole = port(200, end=0x0D), port(200, end=0x0D)
    _, end = receive_by_character(one, b"1234\x0d", 7, LINE)
    whole.receive_frame(FreeFrame(b"1234\x0d"), 7, end)
    assert drain(one) == drain(whole)


def test_not_driven_it_receives_nothing_and_forgets() -> None:
    engine = port(10)
    receive_by_character(engine, b"AB", 0, LINE)
    engine.release(3 * CHAR)
    assert engine.received == 0
    assert engine.deadline() is None
    assert receive_by_character(engine, b"CD", 4 * CHAR, LINE)[0] == 0
    with pytest.raises(RuntimeError, match="no RS2 is driven"):
        engine.send(b"X", 6 * CHAR)
    engine.drive(2, 6 * CHAR)
    receive_by_character(engine, b"EF", 7 * CHAR, LINE)
    assert drain(engine)[-1].data == b"EF"


def test_limits() -> None:
    engine = port(256)
    with pytest.raises(ValueError, match="257 bytes to send, allowed 0…256"):
        engine.send(bytes(257), 0)
    engine.send(bytes(256), 0)
    with pytest.raises(RuntimeError, match="the port is sending"):
        engine.send(b"x", 1)
    other = FreePort(FreeConfig(LINE))
    other.start(0)
    with pytest.raises(ValueError, match="257 bytes to receive, allowed 0…256"):
        other.drive(257, 0)


def test_what_a_driver_may_call_without_effect() -> None:
    engine = port(10)
    assert engine.line_idle(5) == 0
    assert engine.on_deadline(5) == 0
    assert engine.transmit_done(5) == 0
    with pytest.raises(RuntimeError, match="nothing waits to be sent"):
        engine.begin_transmit(5)


def test_released_it_does_not_send_what_waited() -> None:
    engine = port(10)
    engine.send(b"AB", 5)
    engine.release(5)
    assert drain(engine) == []
    assert not engine.waiting


def test_released_while_sending_it_sends_to_the_end() -> None:
    engine = port(10)
    engine.send(b"AB", 5)
    engine.begin_transmit(5)
    engine.release(6)
    engine.transmit_done(5 + 2 * CHAR)
    assert drain(engine) == [Sent(5, 5 + 2 * CHAR, b"AB")]


def test_nothing_to_send_is_sent_at_once() -> None:
    engine = port()
    engine.send(b"", 5)
    assert drain(engine) == [Sent(5, 5, b"")]


def test_stop_forgets_everything() -> None:
    engine = port(10)
    receive_by_character(engine, b"AB", 0, LINE)
    engine.stop(3 * CHAR)
    assert engine.deadline() is None
    assert receive_by_character(engine, b"CD", 4 * CHAR, LINE)[0] == 0
    assert drain(engine) == []


def test_table_of_states_is_closed() -> None:
    assert set(FREE.values()) == set(FreeState)
    for state in FreeState:
        assert FREE[state, FreeInput.STOP] is FreeState.STOPPED


def test_the_first_character_of_a_reception_is_reported_once() -> None:
    engine = port(4)
    hints = [engine.receive(RxChar(0x41), number * CHAR, (number + 1) * CHAR) for number in range(3)]
    assert [bool(hint & SERVE) for hint in hints] == [True, False, False]
    assert all(hint & DEADLINE for hint in hints)
