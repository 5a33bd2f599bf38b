"""What sigrok's own decoders make of an exported waveform, against the trace."""

from __future__ import annotations

import random
import re
from pathlib import Path

import pytest

from bussim.engines.modbus.pdu import pack_words
from bussim.export.lanes import microseconds
from bussim.trace.records import FrameRecord
from tests.export.peers import sigrok, sigrok_bytes
from tests.export.samples import (
    FEEDER,
    LINK,
    OVEN,
    Exchange,
    bits_of,
    exchanges,
    exported,
    frame,
    link_frames,
    timing,
    trace,
)
from tests.selection import quick

NN_UART = "baudrate=38400:data_bits=7:parity=even:stop_bits=1.0"
OVEN_UART = "baudrate=19200:data_bits=8:parity=even:stop_bits=1.0"
FORMATS = pytest.mark.parametrize("to", quick(1, ["vcd", "sr"]))


@FORMATS
def test_uart_gives_the_bytes_of_the_link_exactly(tmp_path: Path, to: str) -> None:
    frames = link_frames(80)
    path = exported(trace(*frames), tmp_path / f"a.{to}", to)
    sent = b"".join(each.chars for each in frames)
    assert sigrok_bytes(path, f"uart:rx=link:{NN_UART}", "uart=rx") == sent
    for node in LINK.nodes:
        own = b"".join(each.chars for each in frames if each.sender == node)
        assert sigrok_bytes(path, f"uart:rx={node}:{NN_UART}", "uart=rx") == own
    assert not sigrok(path, f"uart:rx=link:{NN_UART}", "uart=rx-parity-err", "uart=rx-warnings")


@FORMATS
def test_uart_flags_the_damaged_parity_bits_where_they_are(tmp_path: Path, to: str) -> None:
    chance = random.Random(1)
    frames: list[FrameRecord] = []
    hit: list[int] = []
    for one in link_frames(60):
        indices = sorted(chance.sample(range(len(one.chars)), min(2, len(one.chars))))
        damaged = tuple(10 * index + chance.randint(1, 8) for index in indices)  # data bits and parity bits
        frames.append(one._replace(damaged_bits=damaged))
        bit = timing(38400, "7E1")
        hit += [
            microseconds(one.start + (bit.bits(10 * index + 8) + bit.bits(10 * index + 9)) // 2)
            for index in indices
        ]
    path = exported(trace(*frames), tmp_path / f"a.{to}", to)
    offset = microseconds(frames[0].start) if to == "vcd" else 0
    found = sigrok(path, f"uart:rx=link:{NN_UART}", "uart=rx-parity-err")
    assert len(found) == len(hit)
    # A VCD is read from its first time stamp on, which is the run's start.
    assert all(first <= at <= last for (first, last, _), at in zip(found, hit, strict=True)), offset
    flipped = b"".join(
        bytes(
            value ^ sum(1 << bit % 10 - 1 for bit in each.damaged_bits if bit // 10 == index and bit % 10 < 8)
            for index, value in enumerate(each.chars)
        )
        for each in frames
    )
    assert sigrok_bytes(path, f"uart:rx=link:{NN_UART}", "uart=rx") == flipped


@FORMATS
def test_uart_reads_a_collision_as_both_at_once(tmp_path: Path, to: str) -> None:
    one = frame(LINK, 200_000, "press2", b"\x021234ABCD", collided=True)
    other = frame(LINK, 200_000, "press3", b"\x02789A1234", collided=True)
    path = exported(trace(one, other), tmp_path / f"a.{to}", to)
    both = bytes(a & b for a, b in zip(one.chars, other.chars, strict=True))
    assert sigrok_bytes(path, f"uart:rx=link:{NN_UART}", "uart=rx") == both
    assert sigrok_bytes(path, f"uart:rx=press2:{NN_UART}", "uart=rx") == one.chars


def decoded(path: Path, lanes: str, uart: str, side: str) -> list[list[str]]:
    """Annotations of the Modbus decoder on one side ("cs": requests, "sc": responses), frame by frame."""
    kinds = [
        f"modbus={side}-{kind}"
        for kind in ("server-id", "function", "address", "length", "data", "crc", "error")
    ]
    frames: list[list[str]] = []
    for _, _, text in sigrok(path, f"uart:{lanes}:{uart},modbus", *kinds):
        if text.startswith(("Slave ID", "Broadcast")):
            frames.append([])
        frames[-1].append(text)
    return frames


@pytest.mark.slow
@FORMATS
def test_modbus_gives_the_frames_of_the_bus(tmp_path: Path, to: str) -> None:
    done = exchanges(120, seed=9)
    frames = [each for one in done for each in one.frames]
    path = exported(trace(*frames, buses=(OVEN,)), tmp_path / f"a.{to}", to)
    # The lanes of the transmitters give the decoder the master (TX) and the slave (RX).
    lanes = "rx=oven1:tx=press2.COM5"
    requests = decoded(path, lanes, OVEN_UART, "cs")
    responses = decoded(path, lanes, OVEN_UART, "sc")
    assert len(requests) == len(done)
    assert len(responses) == sum(one.response is not None for one in done)
    for one, said in zip(done, requests, strict=True):
        _check_request(one, said)
    with_response = [one for one in done if one.response is not None]
    for one, said in zip(with_response, responses, strict=True):
        _check_response(one, said)


def _check_request(one: Exchange, said: list[str]) -> None:
    request = one.request
    text = "\n".join(said)
    assert (f"Slave ID: {one.station}" in said[0]) if one.station else ("Broadcast" in said[0])
    assert f"Function {request.function}:" in text
    assert f"0x{request.address:X} / " in text
    assert said[-1] == "CRC correct"
    if request.function <= 4:
        assert f"Read {request.quantity} units of data" in text
    if request.function == 6:
        assert f"Register Value 0x{request.values[0]:X} / {request.values[0]}" in text
    if request.function == 16:
        data = bytes(int(byte, 16) for byte in re.findall(r"^Value 0x([0-9A-F]{1,2})", text, re.MULTILINE))
        assert data == pack_words(request.values)


def _check_response(one: Exchange, said: list[str]) -> None:
    assert one.response is not None
    text = "\n".join(said)
    assert said[0] == f"Slave ID: {one.station}"
    assert said[-1] == "CRC correct"
    if one.response[0] & 0x80:
        assert str(one.response[1]) in text
        return
    assert f"Function {one.request.function}:" in text
    if one.request.function in (3, 4):
        words = re.findall(r"^0x([0-9A-F]{4}) / \d+$", text, re.MULTILINE)
        assert bytes.fromhex("".join(words)) == one.response[2:]
    if one.request.function in (1, 2):
        assert [int(bits, 2) for bits in re.findall(r"^([01]{8})$", text, re.MULTILINE)] == list(
            one.response[2:]
        )


@FORMATS
def test_modbus_says_which_frames_are_damaged(tmp_path: Path, to: str) -> None:
    done = exchanges(80, seed=12, bus=FEEDER)
    frames = []
    damaged = []
    for number, one in enumerate(done):
        request, *response = one.frames
        hit = number % 3 == 0
        # The lanes of transmitters are free of noise: the bus's own lane is what is decoded here.
        frames += [request._replace(damaged_bits=(bits_of(request) - 5,)) if hit else request, *response]
        damaged.append(hit)
    path = exported(trace(*frames, buses=(FEEDER,)), tmp_path / f"a.{to}", to)
    uart = "baudrate=9600:data_bits=8:parity=none"
    said = sigrok(
        path, f"uart:rx=feeder:{uart},modbus:scchannel=TX:cschannel=RX", "modbus=cs-crc", "modbus=cs-error"
    )
    spans = [(microseconds(one.frames[0].start), microseconds(one.frames[0].end)) for one in done]
    for (first, last), hit in zip(spans, damaged, strict=True):
        texts = [text for since, until, text in said if first <= since and until <= last + 60]
        assert any(text.startswith("CRC should be") for text in texts) is hit
        assert ("CRC correct" in texts) is not hit
