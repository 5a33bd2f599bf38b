"""Ports that are opened, lost, refused, and remote."""

from __future__ import annotations

import errno
import os
import socket
import sys
import time
from pathlib import Path

import pytest
import serial

from bussim.engines.contract import RxChar
from bussim.engines.modbus.adu import Mode, encode_adu
from bussim.errors import UsageError
from bussim.line.characters import CharFormat, LineTiming
from bussim.live import endpoints
from bussim.live.clock import Clock, as_seconds
from bussim.live.options import DirectionControl, PortOptions
from bussim.live.port import LivePort
from bussim.live.served import ServedSlave
from bussim.live.wire import Wire
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND
from tests.live.peers import PATIENCE
from tests.live.rfc2217 import remote

if sys.platform != "win32":
    import tty

LINE = LineTiming(115200, CharFormat(8, "N", 1))
posix = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
REQUEST = encode_adu(Mode.RTU, 1, bytes((3, 0, 0, 0, 2))).chars
RESPONSE = encode_adu(Mode.RTU, 1, bytes((3, 4, 0, 0, 0, 0))).chars


def read_all(wire: Wire, count: int) -> bytes:
    data, until = b"", time.monotonic() + PATIENCE
    while len(data) < count and time.monotonic() < until:
        data += wire.read(wire.clock.now() + 50 * TICKS_PER_MS)
    return data


def test_the_clock_counts_ticks_and_never_goes_back() -> None:
    clock = Clock()
    before = clock.now()
    begun = time.perf_counter_ns()
    time.sleep(0.02)
    elapsed = time.perf_counter_ns() - begun
    after = clock.now()
    assert after - before >= elapsed * 72 // 1000
    assert as_seconds(TICKS_PER_SECOND) == 1.0
    assert as_seconds(-5) == 0.0


def test_a_loop_receives_what_it_sends() -> None:
    wire = Wire("loop://", LINE)
    wire.open()
    assert wire.instant
    wire.write(b"hello")
    assert read_all(wire, 5) == b"hello"
    assert (wire.counts.sent, wire.counts.received, wire.counts.dropped) == (5, 5, 0)
    wire.close()


def test_rts_is_on_around_a_write_and_off_else(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[bool | bytes] = []
    loop = serial.serial_for_url("loop://", do_not_open=True).__class__
    write = loop.write
    monkeypatch.setattr(loop, "_update_rts_state", lambda self: seen.append(self._rts_state))
    monkeypatch.setattr(loop, "flush", lambda _self: seen.append(b"flushed"), raising=False)

    def noted(self: object, data: bytes) -> int:
        seen.append(data)
        return int(write(self, data))

    monkeypatch.setattr(loop, "write", noted)
    wire = Wire("loop://", LINE, PortOptions(direction=DirectionControl.RTS))
    wire.open()
    seen.clear()
    wire.write(b"ab")
    wire.close()
    assert seen[:4] == [True, b"ab", b"flushed", False]


@posix
def test_a_pseudo_terminal_has_a_stable_link(tmp_path: Path) -> None:
    link = tmp_path / "plc"
    for _ in range(2):  # again: a link that is left over is replaced
        wire = Wire(f"pty:{link}", LINE)
        wire.open()
        assert wire.name == str(link)
        with serial.Serial(str(link), timeout=PATIENCE) as client:
            client.write(b"\x01\x02")
            assert read_all(wire, 2) == b"\x01\x02"
            wire.write(b"\x00\xff\r\n")
            assert client.read(4) == b"\x00\xff\r\n"
        wire.close()
        assert not link.is_symlink()
        link.symlink_to(tmp_path / "nowhere")


@posix
def test_a_file_is_never_replaced_by_a_link(tmp_path: Path) -> None:
    link = tmp_path / "plc"
    link.write_text("mine")
    with pytest.raises(UsageError, match="no symbolic link"):
        Wire(f"pty:{link}", LINE).open()
    assert link.read_text() == "mine"


@posix
@pytest.mark.parametrize(("fmt", "warnings"), [("7E1", 0), ("8E1", 1), ("7O2", 0), ("8O2", 1)])
def test_eight_bits_and_parity_on_a_pseudo_terminal_are_warned_of_once(fmt: str, warnings: int) -> None:
    inner, outer = os.openpty()
    reported: list[str] = []
    wire = Wire(os.ttyname(outer), LineTiming(9600, CharFormat.parse(fmt)), report=reported.append)
    try:
        for _ in range(2):
            wire.open()
            wire.write(b"ab")
            assert os.read(inner, 10) == b"ab"
            wire.close()
    finally:
        os.close(inner)
        os.close(outer)
    assert len(reported) == warnings
    assert all("neither parity nor 7 data bits" in text for text in reported)


@posix
def test_the_link_of_another_program_is_never_replaced(tmp_path: Path) -> None:
    """Of two that want one name the second is refused, and the first goes on."""
    link, other = tmp_path / "plc", tmp_path / "mine"
    first, second = Wire(f"pty:{link}", LINE), Wire(f"pty:{link}", LINE)
    first.open()
    with pytest.raises(UsageError, match="in use"):
        second.open()
    second.close()
    with serial.Serial(str(link), timeout=PATIENCE) as client:
        client.write(b"\x01\x02")
        assert read_all(first, 2) == b"\x01\x02"
    first.close()
    other.write_text("mine")
    link.symlink_to(other)
    with pytest.raises(UsageError, match="is a link to"):
        second.open()
    assert link.read_text() == "mine"


@pytest.mark.parametrize(
    ("url", "why"),
    [
        ("/dev/ttyNOTHERE", "/dev/ttyNOTHERE cannot be opened: No such file or directory; "),
        ("COM7", "COM7 cannot be opened"),
        ("nonsense://x", "no port that can be opened"),
        ("", "a port without a name"),
        ("socket://127.0.0.1", "write socket://HOST:PORT"),
        ("socket://:502", "write socket://HOST:PORT"),
        ("rfc2217://box:seven", "write rfc2217://HOST:PORT"),
        ("socket://box:65536", "PORT is 1…65535"),
        ("listen://127.0.0.1:65536", "PORT is 0…65535"),
    ],
)
def test_a_port_that_is_not_there_is_a_mistake_of_the_user(url: str, why: str) -> None:
    with pytest.raises(UsageError) as reported:
        Wire(url, LINE).open()
    assert why in str(reported.value) or (
        sys.platform == "win32" and "cannot be opened" in str(reported.value)
    )


@posix
def test_why_a_port_cannot_be_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UsageError, match="it is no serial port"):
        Wire("/dev/null", LINE).open()
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = f"socket://127.0.0.1:{server.getsockname()[1]}"
    with pytest.raises(UsageError, match="cannot be opened: Connection refused"):
        Wire(url, LINE).open()
    for number, why in ((errno.EAGAIN, "another program"), (errno.EACCES, "dialout")):

        def refuse(*_: object, number: int = number) -> int:
            raise OSError(number, os.strerror(number))

        wire = Wire(str(tmp_path), LINE)
        with monkeypatch.context() as patched:
            patched.setattr(os, "open", refuse)
            with pytest.raises(UsageError, match=why):
                wire.open()


@posix
def test_a_driver_without_rs485_is_a_mistake_of_the_user() -> None:
    inner, outer = os.openpty()
    try:
        with pytest.raises(UsageError, match="cannot switch"):
            Wire(os.ttyname(outer), LINE, PortOptions(direction=DirectionControl.DRIVER)).open()
    finally:
        os.close(inner)
        os.close(outer)


@posix
def test_a_lost_port_is_reported_and_comes_back(tmp_path: Path) -> None:
    link = tmp_path / "tty"
    reported: list[str] = []
    options = PortOptions(retry_first=10 * TICKS_PER_MS, retry_last=40 * TICKS_PER_MS)
    inner, outer = os.openpty()
    link.symlink_to(os.ttyname(outer))
    wire = Wire(str(link), LINE, options, report=reported.append)
    wire.open()
    os.close(outer)
    os.close(inner)  # as if it were unplugged: EIO
    link.unlink()
    until = time.monotonic() + PATIENCE
    while wire.counts.retries < 3 and time.monotonic() < until:
        assert wire.read(wire.clock.now() + 20 * TICKS_PER_MS) == b""
    assert not wire.connected
    assert wire.counts.losses == 1
    assert wire.counts.retries >= 3
    wire.write(b"lost")
    assert wire.counts.dropped == 4
    inner, outer = os.openpty()
    link.symlink_to(os.ttyname(outer))
    while not wire.connected and time.monotonic() < until:
        wire.read(wire.clock.now() + 20 * TICKS_PER_MS)
    os.write(inner, b"again\n")
    assert read_all(wire, 6) == b"again\n"
    assert wire.counts.returns == 1
    assert [text.split()[-1] for text in reported] == ["again", "back"]
    wire.close()
    os.close(inner)
    os.close(outer)


def test_a_port_that_never_comes_back_was_away_to_the_end() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        wire = Wire(f"socket://127.0.0.1:{server.getsockname()[1]}", LINE)
        wire.open()
        server.accept()[0].close()
    until = time.monotonic() + PATIENCE
    while wire.connected and time.monotonic() < until:
        wire.read(wire.clock.now() + 1_000_000)
    time.sleep(0.02)
    wire.close()
    assert wire.counts.away_s >= 0.02
    assert (wire.counts.losses, wire.counts.returns) == (1, 0)


def test_a_served_slave_survives_the_loss_of_its_connection() -> None:
    """A device server that hangs up: the slave responds again when it takes the connection again."""
    server = socket.create_server(("127.0.0.1", 0))
    server.settimeout(PATIENCE)
    port = server.getsockname()[1]
    options = PortOptions(retry_first=10 * TICKS_PER_MS, retry_last=20 * TICKS_PER_MS)
    with ServedSlave(f"socket://127.0.0.1:{port}", fmt=CharFormat(8, "N", 1), options=options) as slave:
        for round_ in range(3):
            connection, _ = server.accept()
            connection.settimeout(PATIENCE)
            until = time.monotonic() + PATIENCE
            while slave.wire.counts.returns < round_ and time.monotonic() < until:
                time.sleep(0.005)  # what is sent before it has opened its side is thrown away
            connection.sendall(REQUEST)
            response = b""
            while len(response) < len(RESPONSE):
                response += connection.recv(100)
            assert response == RESPONSE
            connection.sendall(REQUEST[:5])  # it hangs up in the middle of a request
            connection.close()
            assert slave.wire.counts.losses in (round_, round_ + 1)
    server.close()
    assert slave.wire.counts.losses >= 2


@pytest.mark.filterwarnings("ignore:set(Daemon|Name):DeprecationWarning")  # pyserial's own
@pytest.mark.parametrize(
    ("baud", "fmt"), [(38400, "7E1"), (9600, "8N1"), (19200, "8O2"), (4800, "7O2"), (115200, "8E1")]
)
def test_rfc2217_asks_for_exactly_this_line(baud: int, fmt: str) -> None:
    with remote() as (url, fake):
        wire = Wire(url, LineTiming(baud, CharFormat.parse(fmt)))
        try:
            wire.open()
            assert not wire.instant
            wire.write(b"\x01\xff\x02")
            until = time.monotonic() + PATIENCE
            while len(fake.written) < 3 and time.monotonic() < until:
                time.sleep(0.01)
        finally:
            wire.close()
    # Seven data bits and parity are eight data bits for the port, and their parity is in the eighth.
    seven = fmt[0] == "7"
    assert fake.asked == {
        "baudrate": baud,
        "bytesize": 8,
        "parity": "N" if seven else fmt[1],
        "stopbits": int(fmt[2]),
    }
    even, odd = b"\x81\xff\x82", b"\x01\x7f\x02"
    written = {"7E1": even, "7O2": odd}.get(fmt, b"\x01\xff\x02")
    assert bytes(fake.written) == written


@posix
def test_parity_in_software_is_checked_character_by_character(monkeypatch: pytest.MonkeyPatch) -> None:
    """A port that takes its time, whose driver knows no parity: the other end counts the bits itself."""
    monkeypatch.setattr(endpoints, "_is_terminal", lambda _: False)
    inner, outer = os.openpty()
    tty.setraw(outer)
    wire = Wire(os.ttyname(outer), LineTiming(9600, CharFormat.parse("7E1")))
    heard: list[RxChar] = []
    try:
        wire.open()
        os.write(inner, bytes((0x41, 0xC3, 0xC1)))  # A, C with its parity bit, A with a wrong one
        port = LivePort(wire, on_chars=lambda chars: heard.extend(char for char, _, _ in chars))
        until = time.monotonic() + PATIENCE
        while len(heard) < 3 and time.monotonic() < until:
            port.step(wire.clock.now() + 1_000_000)
        wire.write(b"AC")
        sent = os.read(inner, 10)
    finally:
        wire.close()
        os.close(inner)
        os.close(outer)
    assert heard == [RxChar(0x41), RxChar(0x43), RxChar(0x41, parity_ok=False)]
    assert sent == b"A\xc3"
    assert [value.bit_count() % 2 for value in sent] == [0, 0]
