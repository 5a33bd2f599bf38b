"""D8063 = 7xyy: every code of the manual's table by the event that defines it, on every port."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from bussim.engines.contract import RxChar
from bussim.engines.modbus.adu import RTU_MAX
from bussim.engines.modbus.codes import PortError
from bussim.engines.modbus.framing import Framing
from bussim.engines.modbus.pdu import Response, encode_exception, encode_response
from bussim.plc.errors import SerialErrors
from bussim.plc.memory import Device, Memory
from bussim.plc.ports.cpavl import COMMUNICATION_ERROR, TIMED_OUT
from bussim.plc.ports.spec import PollSpec
from bussim.plc.profiles import PROFILES
from tests.plc.ports.bench import LINE, MS, PHASE, Bench

RTU = Framing.rtu(LINE)
PORTS = ["COM2", "COM3", "COM4", "COM5", "COM6"]
GOOD = RTU.encode(1, encode_response(Response(3, 0, 2, (5, 6)))).chars

Received = bytes | Sequence[RxChar]


def poll(port: str, function: int = 3, address: int = 0, count: int = 2, **more: object) -> PollSpec:
    fields = {"device": Device("D", 500), "every": 10_000 * MS, "station": 1} | more
    return PollSpec(name="p", port=port, function=function, address=address, count=count, **fields)


def refused(code: int) -> bytes:
    return RTU.encode(1, encode_exception(3, code)).chars


def damaged(**flags: bool) -> list[RxChar]:
    chars = [RxChar(value) for value in GOOD]
    chars[4] = RxChar(GOOD[4], **flags)
    return chars


def asked(port: str, received: Received, **more: object) -> Bench:
    """The port has asked once, at the first END, and hears a response 5 ms after its request.

    The timeout is 500 ms: 257 characters take 268 ms.
    """
    bench = Bench(port, "modbus-rtu-master", [poll(port, **more)], w9=50)
    bench.run(PHASE + 1)
    if received:
        bench.wire.receive(received, PHASE + LINE.characters(8) + 5 * MS)
    bench.run(1000 * MS)
    return bench


RECEIVED = [
    pytest.param(
        1, RTU.encode(1, encode_response(Response(3, 0, 1, (5,)))).chars, id="shorter than its function says"
    ),
    pytest.param(1, RTU.encode(1, encode_response(Response(3, 0, 3, (5, 6, 7)))).chars, id="longer"),
    pytest.param(1, GOOD[:-1], id="torn off"),
    pytest.param(2, refused(2), id="exception 02"),
    pytest.param(3, GOOD[:-1] + bytes((GOOD[-1] ^ 1,)), id="CRC wrong"),
    pytest.param(4, refused(1), id="exception 01"),
    pytest.param(5, damaged(parity_ok=False), id="parity"),
    pytest.param(6, refused(3), id="exception 03"),
    pytest.param(7, b"\x01\x03" + bytes(RTU_MAX - 1), id="more than 256 bytes"),
    pytest.param(8, damaged(stop_ok=False), id="framing"),
    pytest.param(9, b"", id="nothing"),
]


@pytest.mark.parametrize("port", PORTS)
@pytest.mark.parametrize(("code", "received"), RECEIVED)
def test_what_a_response_raises(port: str, code: int, received: Received) -> None:
    bench = asked(port, received)
    assert bench.errors() == [7000 + 100 * int(port[3:]) + code]
    assert bench.outcomes() == [PortError(code)]
    assert (bench.plc.read("M8063"), bench.plc.read("D8063")) == (1, bench.errors()[0])
    assert (bench.bit(COMMUNICATION_ERROR), bench.bit(TIMED_OUT)) == (1, int(code == 9))
    assert bench.plc.read("D500") == 0


@pytest.mark.parametrize("port", PORTS)
def test_a_good_response_raises_nothing(port: str) -> None:
    bench = asked(port, GOOD)
    assert bench.errors() == []
    assert bench.outcomes() == [None]
    assert (bench.plc.read("D500"), bench.plc.read("D501")) == (5, 6)
    assert (bench.plc.read("M8063"), bench.bit(COMMUNICATION_ERROR)) == (0, 0)


UNSENT = [
    pytest.param(0, {"station": 248}, id="station over 247"),
    pytest.param(2, {"address": 65535, "count": 2}, id="address beyond 65535"),
    pytest.param(2, {"device": Device("D", 8255), "count": 2}, id="data beyond D8255"),
    pytest.param(2, {"device": Device("M", 3071), "function": 1, "count": 2}, id="data beyond M3071"),
    pytest.param(2, {"device": Device("X", 0), "function": 1, "count": 2}, id="data in X"),
    pytest.param(2, {"device": Device("M", 0), "function": 3, "count": 2}, id="registers in M"),
    pytest.param(4, {"function": 0x17}, id="unknown function"),
    pytest.param(4, {"station": 0}, id="a broadcast read"),
    pytest.param(6, {"count": 126}, id="126 registers"),
    pytest.param(6, {"count": 0}, id="no registers"),
    pytest.param(
        6, {"function": 5, "count": 2, "device": Device("M", 0)}, id="more than one coil for function 05"
    ),
    pytest.param(6, {"function": 16, "count": 2, "device": None}, id="a write without values"),
]


@pytest.mark.parametrize("port", PORTS)
@pytest.mark.parametrize(("code", "more"), UNSENT)
def test_what_rs2_cannot_send(port: str, code: int, more: dict[str, object]) -> None:
    bench = asked(port, b"", **more)
    assert bench.requests() == []
    assert bench.errors() == [7000 + 100 * int(port[3:]) + code]
    # It is decided at the END at which it would have left, and costs that scan.
    assert [
        (item.taken, item.ended.sent, item.ended.end) for item in bench.reported if hasattr(item, "ended")
    ] == [(PHASE, None, PHASE)]


def test_a_request_that_cannot_be_sent_keeps_no_other_waiting() -> None:
    polls = [poll("COM4", 0x17, every=0), poll("COM4", 3, every=0)]
    bench = Bench("COM4", "modbus-rtu-master", polls)
    bench.run(PHASE + 10 * MS + 1)
    assert [start for start, _ in bench.requests()] == [PHASE + 10 * MS]


BAD_WORDS = [
    pytest.param(0, "modbus-rtu-slave", {"w1": 0}, id="station 0"),
    pytest.param(0, "modbus-ascii-slave", {"w1": 248}, id="station 248"),
    pytest.param(6, "free", {"w6": 0x11}, id="unknown protocol"),
    pytest.param(6, "modbus-rtu-master", {"w0": 0x0080}, id="7 data bits under RTU"),
    pytest.param(6, "free", {"w0": 0x00F1}, id="no such rate"),
]


@pytest.mark.parametrize("port", PORTS)
@pytest.mark.parametrize(("code", "protocol", "words"), BAD_WORDS)
def test_what_bad_words_raise(port: str, code: int, protocol: str, words: dict[str, int]) -> None:
    number = {"registers": {"D8121": words["w1"]}} if port == "COM2" and "w1" in words else {}
    bench = Bench(port, protocol, [], **number, **words)
    assert bench.port_registers.engine is None
    assert bench.port_registers.settings is None
    assert bench.errors() == [7000 + 100 * int(port[3:]) + code]
    assert (bench.plc.read("M8063"), bench.plc.read("D8063")) == (1, bench.errors()[0])
    assert bench.plc.wanted_end(0) is None
    # Good words at the next STOP→RUN put it right.
    bench.stop_plc()
    first = bench.port_registers.spec.words.address
    bench.plc.memory.set_word("D", first, 0)
    bench.plc.memory.set_word("D", first + 1, 5)
    bench.plc.memory.set_word("D", first + 6, 2)
    bench.plc.memory.set_word("D", 8121, 5)
    bench.run_plc()
    assert bench.port_registers.engine is not None
    assert bench.plc.read("M8063") == 0


@pytest.mark.parametrize("port", PORTS)
@pytest.mark.parametrize("code", [*range(10, 20), *range(40, 48), 49])
def test_what_has_no_cause_on_the_wire_is_a_fault_of_the_board(port: str, code: int) -> None:
    bench = Bench(port, "modbus-rtu-master")
    number = 7000 + 100 * int(port[3:]) + code
    bench.plc.board_error(port, code)
    assert (bench.plc.read("M8063"), bench.plc.read("D8063")) == (1, number)
    bench.plc.board_error_over(port, code)
    assert (bench.plc.read("M8063"), bench.plc.read("D8063")) == (0, number)


@pytest.mark.parametrize(("m8179", "number"), [(0, 7348), (1, 7448)])
def test_48_is_the_links(m8179: int, number: int) -> None:
    registers = {"M8179": m8179, "D8177": 0}
    bench = Bench("COM5", "modbus-rtu-master", [poll("COM5")], linked=True, registers=registers)
    assert (bench.plc.read("M8063"), bench.plc.read("D8063")) == (1, number)
    bench.run(PHASE + 1)
    bench.wire.receive(GOOD, PHASE + LINE.characters(8) + 5 * MS)
    bench.run(500 * MS)
    # Another port's success is not the link's.
    assert bench.outcomes() == [None]
    assert (bench.plc.read("M8063"), bench.plc.read("D8063")) == (1, number)


def test_one_ports_recovery_does_not_hide_anothers_error() -> None:
    memory = Memory()
    errors = SerialErrors(memory)

    def shown() -> tuple[int, int]:
        return memory.get(Device("M", 8063)), memory.word("D", 8063)

    errors.over("COM3")
    assert shown() == (0, 0)
    assert errors.report("COM3", "COM3", 9) == 7309
    errors.report("COM5", "COM5", 3)
    assert shown() == (1, 7503)
    errors.over("COM5")
    assert shown() == (1, 7309)
    errors.report("COM5", "COM5", 1)
    errors.report("COM3", "COM3", 4)
    assert shown() == (1, 7304)
    errors.over("COM5")
    assert shown() == (1, 7304)
    errors.over("COM3")
    assert shown() == (0, 7304)


@pytest.mark.parametrize(
    ("profile", "port", "device", "numbers"),
    [
        ("pw10", "COM4", 8063, (7448, 7409)),
        ("fx2n", "COM4", 8063, (6308, 6306)),
        ("fx1s", "COM3", 8063, (6308, 6306)),
        ("fx3u", "COM3", 8063, (6308, 6306)),
        ("fx3u", "COM4", 8438, (3808, 3806)),
    ],
)
def test_the_numbers_of_the_families(profile: str, port: str, device: int, numbers: tuple[int, int]) -> None:
    """Bad N:N parameters, and no response in time."""
    memory = Memory()
    errors = SerialErrors(memory, PROFILES[profile].error_codes)
    assert errors.report("other", "COM2", 3) in (7203, 6303)
    for cause, code, number in zip("ab", (48, 9), numbers, strict=True):
        assert errors.report(cause, port, code) == number
        assert (memory.bits("M")[device], memory.words("D")[device]) == (1, number)
    errors.over("b")
    assert memory.words("D")[device] == numbers[0]
    errors.over("a")
    # The other port's error is on the first channel.
    assert (memory.bits("M")[8063], memory.bits("M")[8438]) == (1, 0)
    errors.over("other")
    assert memory.bits("M")[8063] == 0


def test_a_board_error_outlives_a_power_cycle_and_a_ports_error_does_not() -> None:
    bench = asked("COM4", refused(1))
    bench.plc.board_error("COM4", 12)
    bench.plc.board_error("COM4", 12)
    bench.stop_plc()
    bench.plc.power_off(bench.wire.now)
    bench.plc.power_on()
    assert (bench.plc.read("M8063"), bench.plc.read("D8063")) == (1, 7412)
    bench.plc.board_error_over("COM4", 12)
    assert bench.plc.read("M8063") == 1  # the other fault goes on
    bench.plc.board_error_over("COM4", 12)
    assert bench.plc.read("M8063") == 0
