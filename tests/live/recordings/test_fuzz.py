"""Whatever a file or a line holds, a decoder reports what is wrong or reads on: nothing else ever leaves it."""

from __future__ import annotations

import contextlib
import io
import struct
import tempfile
import zipfile
from itertools import pairwise
from pathlib import Path

from hypothesis import example, given
from hypothesis import strategies as st

from bussim.commands.sniff.tally import MOST_ASKED, Tally
from bussim.engines.contract import RxChar
from bussim.engines.modbus.adu import Mode, encode_adu
from bussim.engines.nn.frames import encode_poll
from bussim.errors import UsageError
from bussim.line.characters import NN_LINE, CharFormat, LineTiming
from bussim.live.arrival import Arrivals, characters_of, placed
from bussim.live.recordings.frames import TraceFile
from bussim.live.recordings.open import open_recording
from bussim.live.recordings.packets import PacketReader
from bussim.live.recordings.sigrok import SigrokFile
from bussim.live.recordings.source import LineSetup
from bussim.live.recordings.text import TextFile
from bussim.live.sniff.heard import LineProtocol
from bussim.live.sniff.line import find_line
from bussim.live.sniff.listener import Listener
from bussim.live.sniff.reading import Settings
from bussim.live.sniff.recognise import Recogniser
from bussim.live.sniff.splitter import MOST_DAMAGE
from bussim.live.sniff.splitters import splitter
from bussim.results.collector import Collector
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND
from tests.live.recordings.generator import rtu

LINE = LineTiming(9600, CharFormat(8, "N", 1))

SECTION = struct.pack("<IIIHHqI", 0x0A0D0D0A, 28, 0x1A2B3C4D, 1, 0, -1, 28)
INTERFACE = struct.pack("<IIHHII", 1, 20, 147, 0, 0, 20)
PACKET = struct.pack("<IIIIIII", 6, 40, 0, 0, 1000, 8, 8) + bytes(8) + struct.pack("<I", 40)


@given(st.binary(max_size=400), st.booleans())
@example(b"", True)
@example(INTERFACE + PACKET, True)
def test_pcapng(data: bytes, begins_well: bool) -> None:
    reader = PacketReader(io.BytesIO(SECTION + data if begins_well else data), "x")
    try:
        for packet in reader.packets():
            assert packet.interface < len(reader.interfaces)
            assert len(packet.data) <= len(data)
    except UsageError as error:
        assert str(error).startswith("x: at byte")


@given(st.lists(st.sampled_from([SECTION, INTERFACE, PACKET]), max_size=12), st.data())
def test_pcapng_with_a_few_bytes_changed(blocks: list[bytes], data: st.DataObject) -> None:
    raw = bytearray(SECTION + b"".join(blocks))
    for _ in range(data.draw(st.integers(0, 3))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    with contextlib.suppress(UsageError):
        list(PacketReader(io.BytesIO(bytes(raw)), "x").packets())


@given(st.binary(max_size=300), st.sampled_from([b"\xd4\xc3\xb2\xa1", b"\xa1\xb2\x3c\x4d"]))
def test_pcap(data: bytes, magic: bytes) -> None:
    reader = PacketReader(io.BytesIO(magic + data), "x")
    with contextlib.suppress(UsageError):
        assert all(len(packet.data) <= len(data) for packet in reader.packets())


@given(st.lists(st.text(max_size=60), max_size=8))
@example(["0 01", "1e400 02"])
@example(["nan 01"])
@example(["0.1;01,02 03", "0.2"])
@example(["9999-99-99 10:00:00 01", "0000-01-01T23:59:60.5 0x1"])
@example(["Time [s],Value,Parity Error,Framing Error", "0.1,'a',,", "0.2,999,,", "x,1,,"])
@example(["> 2026/01/05 08:00:01.0  length=3 from=0 to=2", " 01 02", "--"])
@example(["[01][03]", "<01>", "ERROR nothing"])
@example(["1,5;01 02", "2,5;03"])
def test_text(lines: list[str]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.txt"
        path.write_text("\n".join(lines) or " ", encoding="utf-8")
        with contextlib.suppress(UsageError):
            source = TextFile(path)
            for comma in (False, True):
                before = 0
                for chunk in source.chunks(LineSetup(LINE, decimal_comma=comma)):
                    assert chunk.chars
                    assert 0 <= chunk.wire < source.wires
                    assert all(start <= end for _, start, end in chunk.chars)
                    assert chunk.chars[-1][2] >= before
                    before = chunk.chars[-1][1]


@given(
    metadata=st.one_of(
        st.binary(max_size=200),
        st.builds(
            "[device 1]\ncapturefile=logic-1\nsamplerate={}\nunitsize={}\nprobe{}=D0\n".format,
            st.sampled_from(["1 MHz", "100000", "0", "-1", "1e99", "5 THz", "9600"]),
            st.sampled_from(["1", "2", "0", "9", "x"]),
            st.integers(0, 70),
        ).map(str.encode),
    ),
    samples=st.binary(max_size=500),
    name=st.sampled_from(["logic-1", "logic-1-1", "logic-1-2", "other"]),
)
def test_sigrok(metadata: bytes, samples: bytes, name: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x.sr"
        with zipfile.ZipFile(path, "w") as file:
            file.writestr("metadata", metadata)
            file.writestr(name, samples)
        try:
            session = SigrokFile(path)
            try:
                found = find_line(session, Settings(), 0)
                list(session.chunks(found.reading.setup))
            finally:
                session.close()
        except UsageError as error:
            assert "x.sr" in str(error)


@given(st.binary(max_size=300), st.sampled_from([b"", b"PK\x03\x04", b"\n\r\r\n", b"{", b"# "]))
def test_any_file(data: bytes, head: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "x"
        path.write_bytes(head + data)
        with contextlib.suppress(UsageError):
            source = open_recording(path)
            found = find_line(source, Settings(), 0)
            if not isinstance(source, TraceFile):
                list(source.chunks(found.reading.setup))


chunks = st.lists(
    st.tuples(
        st.one_of(
            st.binary(max_size=40),
            st.sampled_from(
                [
                    encode_poll(1, 2).chars,
                    encode_adu(Mode.RTU, 1, b"\x03\x00\x00\x00\x01").chars,
                    encode_adu(Mode.ASCII, 1, b"\x03\x00\x00\x00\x01").chars,
                ]
            ),
        ),
        st.integers(0, 100 * TICKS_PER_MS),
    ),
    max_size=30,
)


@given(chunks, st.sampled_from(list(LineProtocol)), st.integers(0, 20 * TICKS_PER_MS), st.booleans())
def test_every_character_is_told_once_and_in_order(
    pieces: list[tuple[bytes, int]], protocol: LineProtocol, tolerance: int, flawed: bool
) -> None:
    arrivals, now = Arrivals(NN_LINE), 0
    listener = Listener("b", NN_LINE, Collector(), protocol, exact=not tolerance, tolerance=tolerance)
    heard = []
    for index, (data, wait) in enumerate(pieces):
        now += NN_LINE.characters(len(data)) + wait
        if data:
            chars = arrivals.chunk(data, now, characters_of(NN_LINE.format))
            if flawed and index % 3 == 0:
                chars = [(RxChar(char.value, False, True), start, end) for char, start, end in chars]
            heard += listener.chars(chars)
        heard += listener.idle(now)
    heard += listener.close()
    assert all(before.start <= after.start for before, after in pairwise(heard))
    assert all(len(one.chars) <= MOST_DAMAGE + 600 for one in heard)
    decoded = b"".join(one.chars for one in heard)
    assert decoded == b"".join(bytes(value & 0x7F for value in data) for data, _ in pieces)


@given(chunks)
def test_a_port_is_listened_to_whatever_comes(pieces: list[tuple[bytes, int]]) -> None:
    for protocol in (None, *LineProtocol):
        arrivals, now = Arrivals(LINE), 0
        recogniser = Recogniser(
            lambda found: Listener("b", LINE, Collector(), found, exact=False), LINE, 0, protocol
        )
        for data, wait in pieces:
            now += LINE.characters(len(data)) + wait
            if data:
                recogniser.chars(arrivals.chunk(data, now))
            recogniser.idle(now)
        recogniser.close(now)
        assert recogniser.characters == sum(len(data) for data, _ in pieces)
        if recogniser.listener is not None:
            recogniser.listener.totals(now)


def test_memory_of_a_splitter_is_bounded() -> None:
    for protocol in LineProtocol:
        cutter = splitter(protocol, LINE, 0)
        character = LINE.characters(1)
        for number in range(20_000):
            char = (RxChar(number * 7 % 256), number * character, (number + 1) * character)
            for heard in cutter.take([char]):
                assert len(heard.chars) <= MOST_DAMAGE + 600
            assert len(cutter._data) <= MOST_DAMAGE + 600


def test_what_is_counted_is_bounded_whatever_is_requested() -> None:
    """A master that sends another request every time fills no memory, and each request is counted."""
    timing = LineTiming(9600, CharFormat(8, "N", 1))
    tally = Tally(traced=False, rows=None, bus_of={})
    listener = Listener("b", timing, tally, LineProtocol.RTU)
    count = MOST_ASKED + 300
    for number in range(count):
        at = number * TICKS_PER_SECOND // 10
        listener.chars(placed(rtu(1, 3, number >> 8, number & 0xFF, 0, 1), at, timing))
        listener.chars(placed(rtu(1, 3, 2, 0, 7), at + TICKS_PER_SECOND // 50, timing))
    listener.close()
    assert len(tally.asked) == MOST_ASKED + 1
    polls = tally.run(listener.totals(listener.last), scenario="b", seed=0).ports["master"].polls
    assert len(polls) == MOST_ASKED + 1
    assert sum(poll.ok for poll in polls.values()) == count
    assert tally.asked["others"].outcomes == {"ok": 300}
