"""Ports that return what is sent, are lost at once, or have no pace; pymodbus servers behind them."""

from __future__ import annotations

import contextlib
import json
import socket
import sys
import threading

import pytest

from bussim.cli import main
from bussim.engines.modbus.adu import Mode

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
if sys.platform != "win32":
    from tests.live.peers import PymodbusServer

LINE = ("-b", "115200", "-d", "8", "-P", "none", "-o", "300 ms", "--json")


def polled(
    capsys: pytest.CaptureFixture[str], url: str, *options: str, mode: str = "rtu"
) -> tuple[int, dict[str, object], str]:
    code = main(["poll", url, *LINE, "-m", mode, *options])
    out, err = capsys.readouterr()
    found = json.loads(out)
    return code, {key: found["polls"][0][key] for key in ("ok", "values")} | {"echo": found["echo"]}, err


@pytest.mark.parametrize("mode", list(Mode))
@pytest.mark.parametrize("options", [("-1",), ("100",), ("-t", "0", "1"), ("1", "2")])
def test_an_echo_is_no_success(
    mode: Mode, options: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    code, found, err = polled(capsys, "loop://", *options, mode=mode.value)
    assert (code, found["ok"], found["echo"]) == (1, 0, True)
    assert "--echo" in err


@pytest.mark.parametrize(("options", "value"), [(("-1",), [107]), (("100",), [])])
def test_echo_and_response_are_told_apart(
    options: tuple[str, ...], value: list[int], capsys: pytest.CaptureFixture[str]
) -> None:
    with PymodbusServer(Mode.RTU, [107], [True], echo=True) as server:
        code, _, err = polled(capsys, server.device, *options)
        assert (code, "--echo" in err) == (1, True)
        code, found, err = polled(capsys, server.device, *options, "--echo")
        assert (code, found["ok"], "--echo" in err) == (0, 1, False)
    if value:
        assert found["values"] == value


@pytest.mark.parametrize("mode", list(Mode))
def test_a_server_that_responds_at_once_is_no_echo(mode: Mode, capsys: pytest.CaptureFixture[str]) -> None:
    with PymodbusServer(mode, [107], [True]) as server:
        code, found, _ = polled(capsys, server.device, "100", mode=mode.value)
    assert (code, found["ok"], found["echo"]) == (0, 1, False)


def test_an_echo_is_known_where_the_response_comes_before_that_of_the_read(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Station 1 responds while an adapter that holds bytes back has the read already; station 9 is not there."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def adapter() -> None:
            client, _ = server.accept()
            with client:
                client.sendall(written := client.recv(8))
                client.sendall(written + client.recv(8))
                while data := client.recv(8):
                    client.sendall(data)

        threading.Thread(target=adapter, daemon=True).start()
        url = f"socket://127.0.0.1:{server.getsockname()[1]}"
        code, found, err = polled(capsys, url, "-a", "1,9", "--tolerance", "100 ms", "77")
    assert (code, found["ok"], found["echo"]) == (1, 0, True)
    assert "--echo" in err


@pytest.mark.slow
def test_a_server_that_accepts_and_closes_ends_a_single_poll(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:

        def refuse() -> None:
            with contextlib.suppress(OSError):
                while True:
                    server.accept()[0].close()

        threading.Thread(target=refuse, daemon=True).start()
        url = f"socket://127.0.0.1:{server.getsockname()[1]}"
        assert main(["poll", url, "-1"]) == 1
        assert "lost 3 times without a response: given up" in capsys.readouterr().err
        server.shutdown(socket.SHUT_RDWR)


def test_a_port_that_nobody_opens_is_not_lost(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["poll", "listen://127.0.0.1:0", "-1", "-o", "50 ms"]) == 1
    assert "port: 8 bytes unsent" in capsys.readouterr().out


def test_a_port_that_is_faster_than_its_rate_is_known(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 300 bps a request and its response take 0.55 s: what comes sooner has no response time yet."""
    monkeypatch.setattr("bussim.live.endpoints._is_instant", lambda _: False)
    with PymodbusServer(Mode.RTU, [107], [True]) as server:
        slow = ("-b", "300", "-d", "8", "-P", "none", "-l", "10", "--rounds", "3", "--json")
        assert main(["poll", server.device, *slow]) == 0
    out, err = capsys.readouterr()
    (poll,) = json.loads(out)["polls"]
    assert err.count("its bytes take no time") == 1
    assert (poll["ok"], poll["turns"]) == (3, 3)
    assert 0 < poll["response_ms"]["mean"] < poll["response_ms"]["max"] * 1.01  # and none is 0.000
