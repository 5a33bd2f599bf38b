"""What adapters and device servers need: latency, direction, RFC 2217."""

from __future__ import annotations

import os
import socket
import struct
import sys
import threading
import time

import pytest
import serial

from bussim.cli import main
from bussim.line.characters import CharFormat, LineTiming
from bussim.live import endpoints
from bussim.live.options import DirectionControl, PortOptions
from bussim.live.wire import Wire
from tests.live.rfc2217 import WithoutControl, remote

LINE = LineTiming(1200, CharFormat(8, "N", 1))
#: IAC DO and an option that no client knows: each is refused by the client's thread.
DO_SOMETHING = b"\xff\xfd\x2d"


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has that mode")
def test_a_serial_port_is_asked_for_low_latency(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[bool] = []
    monkeypatch.setattr(endpoints, "_is_terminal", lambda _: False)
    inner, outer = os.openpty()
    wire = Wire(os.ttyname(outer), LINE)
    wire.open()  # whose driver knows no latency
    wire.close()
    monkeypatch.setattr(serial.Serial, "set_low_latency_mode", lambda _, on: asked.append(on))
    wire.open()
    wire.close()
    os.close(inner)
    os.close(outer)
    assert asked == [True]


def test_rts_is_held_for_as_long_as_the_characters_take(monkeypatch: pytest.MonkeyPatch) -> None:
    """A port that does not know when all has left, as Windows and loops do not."""
    switched: list[tuple[bool, float]] = []
    loop = serial.serial_for_url("loop://", do_not_open=True).__class__
    monkeypatch.setattr(
        loop, "_update_rts_state", lambda self: switched.append((self._rts_state, time.perf_counter()))
    )
    wire = Wire("loop://", LINE, PortOptions(direction=DirectionControl.RTS))
    wire.open()
    switched.clear()
    wire.write(b"abc")
    wire.close()
    (on, begun), (off, ended) = switched[:2]
    assert (on, off) == (True, False)
    assert ended - begun >= 3 * 10 / 1200


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:set(Daemon|Name):DeprecationWarning")  # pyserial's own
def test_a_server_without_control_lines_is_told_how_to_use(capsys: pytest.CaptureFixture[str]) -> None:
    with remote(WithoutControl) as (url, _):
        assert main(["poll", url, "-1"]) == 2
    assert f"if the server has no control lines: {url}?ign_set_control" in capsys.readouterr().err
    with remote(WithoutControl) as (url, _):
        assert main(["poll", f"{url}?ign_set_control", "-1", "-o", "50 ms"]) == 1  # it opens, nobody responds


@pytest.mark.filterwarnings("ignore:set(Daemon|Name):DeprecationWarning")  # pyserial's own
def test_a_server_that_breaks_the_handshake_off_ends_no_thread_with_a_traceback(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    raised: list[object] = []
    monkeypatch.setattr(threading, "excepthook", raised.append)
    with socket.create_server(("127.0.0.1", 0)) as server:

        def break_off() -> None:
            connection, _ = server.accept()
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            connection.sendall(DO_SOMETHING * 20_000)
            connection.close()

        thread = threading.Thread(target=break_off)
        thread.start()
        assert main(["poll", f"rfc2217://127.0.0.1:{server.getsockname()[1]}", "-1", "-o", "50 ms"]) == 2
        thread.join()
    assert not raised
