"""What Wireshark makes of an export, against the trace."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from bussim.engines.modbus.adu import Mode
from bussim.engines.modbus.pdu import unpack_bits, unpack_words
from bussim.engines.nn.frames import MODES, decode
from bussim.export.packets import script
from bussim.export.received import Received, receive
from bussim.export.selection import Selection, in_order, survey
from bussim.line.checksums import crc16
from bussim.line.protocols import BusProtocol
from bussim.trace.file import Trace
from bussim.trace.records import FrameRecord, TraceBus
from bussim.units import TICKS_PER_SECOND
from tests.export.peers import CRC, RTU_SERIAL, RTU_UDP, number, tshark, tshark_text
from tests.export.samples import (
    LINK,
    OVEN,
    PUMPS,
    Exchange,
    bits_of,
    exchanges,
    exported,
    frame,
    link_frames,
    trace,
)

NN = ["-X", f"lua_script:{script('nn.lua')}"]
ASCII = ["-X", f"lua_script:{script('mbascii.lua')}"]
GOOD, BAD = 1, 0


def values_of(one: Exchange, pdu: bytes, kind: str) -> tuple[int, ...] | None:
    """Registers that a frame carries; None where it carries none."""
    function = pdu[0]
    if kind == "response":
        return unpack_words(pdu[2:]) if function in (3, 4) else None
    return one.request.values if function == 16 else None


@pytest.fixture(scope="module")
def rtu() -> list[Exchange]:
    return exchanges(160, seed=4)


def frames_of(done: list[Exchange]) -> list[FrameRecord]:
    return [each for one in done for each in one.frames]


FIELDS = [
    "frame.time_epoch",
    "frame.interface_name",
    "mbrtu.unit_id",
    "mbrtu.crc16",
    "mbrtu.crc16.status",
    "modbus.func_code",
    "modbus.reference_num",
    "modbus.word_cnt",
    "modbus.bit_cnt",
    "modbus.exception_code",
    "modbus.regval_uint16",
    "modbus.bitval",
    "modbus.data",
    "modbus.request_frame",
]


@pytest.mark.parametrize("encapsulation", ["serial", "udp"])
def test_modbus_rtu_frames_are_those_of_the_trace(
    tmp_path: Path, rtu: list[Exchange], encapsulation: str
) -> None:
    frames = frames_of(rtu)
    path = exported(
        trace(*frames, buses=(OVEN,)), tmp_path / "a.pcapng", "pcapng", encapsulation=encapsulation
    )
    udp = encapsulation == "udp"
    rows = tshark(path, FIELDS, [*(RTU_UDP if udp else RTU_SERIAL), *CRC])
    assert len(rows) == len(frames)
    by_frame = {id(each): one for one in rtu for each in one.frames}
    broadcasts = writes = 0
    for index, (one, row) in enumerate(zip(frames, rows, strict=True)):
        seconds = one.start / TICKS_PER_SECOND
        assert float(row["frame.time_epoch"][0]) == pytest.approx(seconds, abs=1e-9)
        assert row["frame.interface_name"] == ["oven"]
        if one.station == 0 and not udp:
            assert not row["mbrtu.unit_id"]  # on a serial line Wireshark takes no broadcast
            continue
        broadcasts += one.station == 0
        pdu, done = one.chars[1:-2], by_frame[id(one)]
        assert number(row["mbrtu.unit_id"]) == one.station
        assert number(row["mbrtu.crc16"]) == int.from_bytes(one.chars[-2:], "big")
        assert number(row["mbrtu.crc16.status"]) == GOOD
        assert number(row["modbus.func_code"]) == pdu[0] & 0x7F
        assert number(row["modbus.exception_code"]) == (pdu[1] if pdu[0] & 0x80 else None)
        if pdu[0] & 0x80:
            continue
        writes_one = pdu[0] in (5, 6)
        if one.kind == "request" or pdu[0] >= 5:
            # Without ports an echo of 05 and 06 cannot be distinguished from its request: then no fields.
            if udp or not writes_one:
                assert number(row["modbus.reference_num"]) == done.request.address
            if udp and writes_one:
                writes += one.kind == "response"
        if one.kind == "request" and pdu[0] in (1, 2, 15):
            assert number(row["modbus.bit_cnt"]) == done.request.quantity
        if one.kind == "request" and pdu[0] in (3, 4, 16):
            assert number(row["modbus.word_cnt"]) == done.request.quantity
        values = values_of(done, pdu, one.kind)
        if values is not None:
            assert tuple(map(int, row["modbus.regval_uint16"])) == values
        if one.kind == "response" and pdu[0] in (1, 2) and udp:
            # UDP lets Wireshark find the request, which knows how many bits were asked for.
            bits = tuple(int(bit in ("1", "True")) for bit in row["modbus.bitval"])
            assert bits == unpack_bits(pdu[2:], done.request.quantity)
            assert number(row["modbus.request_frame"]) == index
    if udp:
        assert broadcasts > 3
        assert writes > 20


@pytest.mark.parametrize("encapsulation", ["serial", "udp"])
def test_the_crc_status_of_damaged_frames_is_that_of_what_was_heard(
    tmp_path: Path, rtu: list[Exchange], encapsulation: str
) -> None:
    chance = random.Random(8)
    frames = [
        each._replace(damaged_bits=tuple(sorted(chance.sample(range(bits_of(each)), chance.randint(1, 2)))))
        if chance.random() < 0.6
        else each
        for each in frames_of(rtu)
    ]
    source = trace(*frames, buses=(OVEN,))
    path = exported(source, tmp_path / "a.pcapng", "pcapng", encapsulation=encapsulation)
    fields = [
        "mbrtu.crc16.status",
        "frame.comment",
        "frame.packet_flags_symbol_error",
        "udp.payload",
        "data.data",
    ]
    rows = tshark(path, fields, [*(RTU_UDP if encapsulation == "udp" else RTU_SERIAL), *CRC])
    good = bad = 0
    for one, row in zip(heard_of(source), rows, strict=True):
        assert bool(row["frame.comment"]) is bool(one.frame.damaged_bits)
        assert (row["frame.packet_flags_symbol_error"] in (["1"], ["True"])) is bool(one.wrong)
        status = number(row["mbrtu.crc16.status"])
        expected = GOOD if crc16(one.chars) == 0 else BAD
        if encapsulation == "udp":
            assert row["udp.payload"] == [one.chars.hex()]
            assert status == (expected if len(one.chars) >= 5 else None)
        elif status is not None:
            # On a serial line a damaged byte count makes Wireshark look for the CRC elsewhere, or give up.
            assert status == GOOD if expected == GOOD else status == BAD
        else:
            assert expected == BAD or one.chars[0] == 0
        good += status == GOOD
        bad += status == BAD
        if expected == GOOD and one.frame.damaged_bits:
            assert one.wrong  # only a parity or stop bit was hit: the CRC does not show it
    assert good > 50
    assert bad > 50


def heard_of(source: Trace) -> list[Received]:
    selection = Selection(source)
    found = survey(selection)
    return list(receive(in_order(selection.frames(), found.lateness), found))


NN_FIELDS = [
    "nn.kind",
    "nn.station",
    "nn.counter",
    "nn.mode",
    "nn.slaves",
    "nn.retries",
    "nn.timeout",
    "nn.data",
    "nn.m",
    "nn.m.on",
    "nn.d",
    "nn.sum",
    "nn.sum.status",
    "nn.wrong",
]


@pytest.mark.parametrize("mode", range(5))
def test_nn_frames_are_those_of_the_trace(tmp_path: Path, mode: int) -> None:
    frames = link_frames(60, seed=mode, mode=mode)
    path = exported(trace(*frames), tmp_path / "a.pcapng", "pcapng")
    for one, row in zip(frames, tshark(path, NN_FIELDS, NN), strict=True):
        coded = decode(one.chars)
        assert coded is not None
        assert row["nn.kind"] == [one.kind]
        assert (number(row["nn.station"]), number(row["nn.counter"])) == (one.station, one.counter)
        assert number(row["nn.sum"]) == int(one.chars[-2:], 16)
        assert number(row["nn.sum.status"]) == GOOD
        assert not row["nn.wrong"]
        if one.kind == "parameters":
            names = ("nn.slaves", "nn.mode", "nn.retries", "nn.timeout")
            assert tuple(number(row[name]) for name in names) == coded.settings
        if one.kind == "data":
            block = MODES[mode]
            bits, words = coded.data[: block.bits // 8], coded.data[block.bits // 8 :]
            assert number(row["nn.mode"]) == mode
            assert row["nn.data"] == [coded.data.hex()]
            assert row["nn.m"] == ([bits.hex()] if bits else [])
            on = [
                1000 + 64 * (one.station or 0) + bit
                for bit, on in enumerate(unpack_bits(bits, block.bits))
                if on
            ]
            assert list(map(int, row["nn.m.on"])) == on
            assert tuple(map(int, row["nn.d"])) == unpack_words(words)


def test_nn_frames_that_were_damaged_say_so(tmp_path: Path) -> None:
    source = trace(*link_frames(300, damage=0.5))
    path = exported(source, tmp_path / "a.pcapng", "pcapng")
    rows = tshark(
        path, [*NN_FIELDS, "frame.comment", "_ws.expert.message", "frame.packet_flags_symbol_error"], NN
    )
    good = bad = parity_only = 0
    for one, row in zip(heard_of(source), rows, strict=True):
        chars, status = one.chars, number(row["nn.sum.status"])
        marked = {index for index, _ in one.wrong}
        assert number(row["nn.wrong"]) == (len(marked) or None)
        assert (row["frame.packet_flags_symbol_error"] in (["1"], ["True"])) is bool(one.wrong)
        assert bool(row["frame.comment"]) is bool(one.frame.damaged_bits)
        sound = len(chars) >= 5 and chars[-2:] == b"%02X" % (sum(chars[1:-2]) & 0xFF)
        assert status == (None if len(chars) < 5 else GOOD if sound else BAD)
        clean_header = 0 not in marked and chars[:1] in (b"\x01", b"\x02", b"\x05")
        assert (row["nn.kind"] == ["unknown"]) is not clean_header
        assert bool(row["_ws.expert.message"]) is (bool(marked) or decode(chars) is None)
        if decode(chars) is not None:
            assert number(row["nn.station"]) == one.frame.station
            parity_only += bool(marked)
        good += status == GOOD
        bad += status == BAD
    assert good > 100
    assert bad > 50
    assert parity_only


def test_the_spacing_of_words_is_a_preference(tmp_path: Path) -> None:
    frames = [each for each in link_frames(20) if each.kind == "data" and each.station == 2]
    path = exported(trace(*frames), tmp_path / "a.pcapng", "pcapng")
    for options, first in ([], 64), (["-o", "nn.spacing:10"], 20):
        assert tshark_text(path, [*NN, *options]).count(f"D{first}: D word") == len(frames)


@pytest.mark.parametrize(("bus", "options"), [(LINK, NN), (PUMPS, ASCII)])
def test_no_bytes_break_a_dissector(tmp_path: Path, bus: TraceBus, options: list[str]) -> None:
    chance = random.Random(11)
    headers = (b"", b"\x01F0", b"\x02", b"\x05", b":", b":06", b"\x0200")
    alphabet = b"0123456789ABCDEF\x03\r\n"
    frames, now = [], 0
    for _ in range(600):
        size = chance.choice((0, 1, 2, 3, 5, 9, 11, 18, 50))
        some = (
            bytes(chance.choice(alphabet) for _ in range(size))
            if chance.random() < 0.7
            else chance.randbytes(size)
        )
        chars = chance.choice(headers) + some
        frames.append(
            frame(
                bus,
                now,
                bus.nodes[0],
                chars,
                protocol="nn" if bus.protocol is BusProtocol.NN else "modbus-ascii",
            )
        )
        now = frames[-1].end + 50_000
    path = exported(trace(*frames, buses=(bus,)), tmp_path / "a.pcapng", "pcapng")
    text = tshark_text(path, options)
    assert "Lua Error" not in text
    assert "Malformed Packet" not in text


def test_modbus_ascii_frames_are_those_of_the_trace(tmp_path: Path) -> None:
    done = exchanges(60, mode=Mode.ASCII, bus=PUMPS)
    frames = frames_of(done)
    path = exported(trace(*frames, buses=(PUMPS,)), tmp_path / "a.pcapng", "pcapng")
    fields = ["mbascii.station", "mbascii.function", "mbascii.pdu", "mbascii.lrc.status", "modbus.func_code"]
    rows = tshark(path, [*fields, "mbrtu.crc16.status"], [*ASCII, *CRC])
    for one, row in zip(frames, rows, strict=True):
        body = bytes.fromhex(one.chars[1:-2].decode())
        assert number(row["mbascii.station"]) == one.station
        assert number(row["mbascii.function"]) == body[1]
        assert row["mbascii.pdu"] == [body[1:-1].hex()]
        assert number(row["mbascii.lrc.status"]) == GOOD
        if one.station:
            assert number(row["modbus.func_code"]) == body[1] & 0x7F
            assert number(row["mbrtu.crc16.status"]) == GOOD


def test_modbus_ascii_frames_that_were_damaged_say_so(tmp_path: Path) -> None:
    chance = random.Random(2)
    frames = [
        each._replace(damaged_bits=(chance.randrange(bits_of(each)),))
        for each in frames_of(exchanges(80, mode=Mode.ASCII, bus=PUMPS))
    ]
    source = trace(*frames, buses=(PUMPS,))
    path = exported(source, tmp_path / "a.pcapng", "pcapng")
    rows = tshark(
        path, ["mbascii.lrc.status", "mbascii.wrong", "_ws.expert.message", "modbus.func_code"], ASCII
    )
    seen = set()
    for one, row in zip(heard_of(source), rows, strict=True):
        status = number(row["mbascii.lrc.status"])
        assert number(row["mbascii.wrong"]) == (len({index for index, _ in one.wrong}) or None)
        if status == GOOD:
            assert one.chars == one.frame.chars
        else:
            assert one.chars != one.frame.chars
            assert row["_ws.expert.message"]
            assert not row["modbus.func_code"]
        seen.add(status)
    assert seen == {GOOD, BAD, None}
