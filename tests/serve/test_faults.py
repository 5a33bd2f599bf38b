"""Faults of the scenario and injected ones, as a master outside meets them."""

from __future__ import annotations

import contextlib
import json
import socket
import stat
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from bussim.cli import main
from bussim.engines.modbus.adu import Mode
from bussim.errors import UsageError
from bussim.serve import control
from bussim.serve.control import ControlServer, control_folder, running
from bussim.serve.requests import SessionRequests
from tests.serve.serving import PATIENCE, SLAVES, Serving

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
if sys.platform != "win32":
    from tests.live.peers import pymodbus_master


@pytest.fixture(autouse=True)
def runtime(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of the test's own, with a path short enough for a socket."""
    with tempfile.TemporaryDirectory(prefix="bs") as folder:
        monkeypatch.setenv("XDG_RUNTIME_DIR", folder)
        yield Path(folder)


def read(client: Any, station: int = 1) -> bool:
    """Whether a station responds."""
    from tests.live.peers import peer

    try:
        return not client.read_holding_registers(0, count=2, device_id=station).isError()
    except peer("pymodbus").exceptions.ModbusIOException:
        return False


@pytest.fixture
def serving() -> Iterator[Serving]:
    with Serving(SLAVES, "v80", "oven") as session:
        yield session


@pytest.fixture
def controlled(serving: Serving) -> Iterator[Serving]:
    server = ControlServer("test", SessionRequests(serving.session))
    yield serving
    server.close()


@pytest.fixture
def client(controlled: Serving) -> Iterator[Any]:
    master = pymodbus_master(controlled.device, Mode.RTU)
    master.comm_params.timeout_connect = 0.4
    yield master
    master.close()


def test_dropped_replies_are_as_many_as_asked_for(controlled: Serving, client: Any) -> None:
    assert read(client)
    assert main(["inject", "v80", "drop_reply", "--count", "2"]) == 0
    assert [read(client) for _ in range(4)] == [False, False, True, True]
    assert read(client, 2)
    (device,) = [one for one in controlled.totals().devices if one.name == "v80"]
    assert device.requests - device.answered == 2


def test_bits_are_flipped_on_the_way_out_and_on_the_way_in(client: Any) -> None:
    assert read(client)
    # 8N1: bit 25 is a data bit of the third character.
    assert main(["inject", "v80", "flip_bits", "--bits", "[25]", "--count", "1"]) == 0
    assert [read(client) for _ in range(2)] == [False, True]
    assert main(["inject", "v80", "flip_bits", "--bits", "[25]", "--count", "1", "--direction", "rx"]) == 0
    assert [read(client) for _ in range(2)] == [False, True]
    assert main(["inject", "v80", "lose_char", "--index", "1", "--count", "1"]) == 0
    assert [read(client) for _ in range(2)] == [False, True]
    assert main(["inject", "v80", "insert_char", "--value", "0", "--count", "1", "--direction", "rx"]) == 0
    assert [read(client) for _ in range(2)] == [False, True]


def test_a_device_without_power_forgets_and_another_goes_on(controlled: Serving, client: Any) -> None:
    assert not client.write_register(0, 5, device_id=1).isError()
    assert main(["inject", "v80", "power_off", "--for", "700 ms"]) == 0
    assert not read(client)
    assert read(client, 2)
    controlled.wait_for(lambda: read(client))
    assert client.read_holding_registers(0, count=1, device_id=1).registers == [0]


def test_a_wrong_format_is_heard_and_spoken(controlled: Serving, client: Any) -> None:
    """At half the rate neither understands the other."""
    assert main(["inject", "v80", "wrong_format", "--baud", "57600", "--for", "600 ms"]) == 0
    assert not read(client)
    controlled.wait_for(lambda: read(client))


def test_a_pause_keeps_the_rest_of_a_reply_back(client: Any) -> None:
    import time

    assert read(client)
    assert main(["inject", "v80", "pause", "--index", "3", "--by", "200 ms", "--count", "1"]) == 0
    begun = time.monotonic()
    assert read(client)
    assert time.monotonic() - begun >= 0.2
    assert read(client)


def test_slow_is_slow(client: Any) -> None:
    import time

    assert main(["inject", "v80", "slow", "--extra", "200 ms"]) == 0
    begun = time.monotonic()
    assert read(client)
    assert time.monotonic() - begun >= 0.2  # a lower bound: no machine is too fast for it


def test_faults_of_the_scenario_happen_at_their_time() -> None:
    faults = "\nfaults: [{at: 0 s, for: 1 s, power_off: v80}, {at: 0 s, drop_reply: oven, count: 1}]\n"
    with Serving(SLAVES + faults, "v80", "oven") as serving:
        master = pymodbus_master(serving.device, Mode.RTU)
        master.comm_params.timeout_connect = 0.3
        try:
            assert not read(master)
            assert [read(master, 2) for _ in range(2)] == [False, True]
            serving.wait_for(lambda: read(master))
        finally:
            master.close()


def test_noise_of_the_bus_is_on_the_wire_too() -> None:
    noise = "\nnoise: [{bus: line, ber: 0.05}]\n"
    with Serving(SLAVES + noise, "v80", "oven") as serving:
        master = pymodbus_master(serving.device, Mode.RTU)
        master.comm_params.timeout_connect = 0.1
        try:
            # Some 130 bits: one in a thousand exchanges would pass.
            assert not any(read(master) for _ in range(5))
        finally:
            master.close()
    (device,) = [one for one in serving.totals().devices if one.name == "v80"]
    assert sum(device.rejected.values()) > 0


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["v80", "drop_replies"], "did you mean drop_reply"),
        (["v81", "drop_reply"], "did you mean v80"),
        (["v80", "slow"], "slow.extra is missing"),
        (["v80", "slow", "--extra", "5"], "without a unit"),
        (["v80", "slow", "--extra", "5 ms", "--count", "2"], "has no meaning for slow"),
        (["v80", "flip_bits", "--bits", "[1"], "--bits"),
        (["v80", "stop"], "PLCs only"),
        (["v80"], "name a fault, too"),
        (["v80", "jabber", "--process", "1"], "process 1 serves nothing"),
    ],
)
def test_mistakes_are_reported_and_nothing_happens(
    controlled: Serving, words: list[str], text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["inject", *words]) == 2
    assert text in capsys.readouterr().err
    assert controlled.session.collector.notes == []


def test_what_is_served_is_listed_and_gone_afterwards(
    serving: Serving, capsys: pytest.CaptureFixture[str]
) -> None:
    server = ControlServer("test", SessionRequests(serving.session))
    assert main(["inject", "--json"]) == 0
    (listed,) = json.loads(capsys.readouterr().out)
    assert listed["scenario"] == "test"
    assert [text.partition(":")[0] for text in listed["nodes"]] == ["v80", "oven"]
    server.close()
    assert running() == []
    assert list(control_folder().iterdir()) == []
    assert main(["inject", "v80", "drop_reply"]) == 2
    assert "nothing is being served" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no Unix sockets")
def test_rubbish_on_the_control_socket_does_not_end_it(serving: Serving) -> None:
    server = ControlServer("test", SessionRequests(serving.session))
    try:
        (note,) = control_folder().glob("*.json")
        path = note.with_suffix(".sock")
        assert [stat.S_IMODE(each.stat().st_mode) for each in (note, path)] == [0o600, 0o600]
        token = json.loads(note.read_text())["token"]
        rubbish = [
            b"\xff\xfe\n",
            b"[" * 100_000 + b"\n",
            b"x" * 300_000,  # longer than it reads, without an end
            b'{"do": "list", "token": "\\ud800"}\n',
            json.dumps({"do": "inject", "token": token, "node": "\ud800", "kind": "\ud800"}).encode() + b"\n",
            json.dumps({"do": "\ud800", "token": token}).encode() + b"\n",
        ]
        for line in rubbish:
            with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as peer:
                peer.settimeout(PATIENCE)
                peer.connect(str(path))
                with contextlib.suppress(BrokenPipeError, ConnectionResetError):
                    peer.sendall(line)
                    assert json.loads(peer.makefile().readline())["ok"] is False
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as peer:
            peer.connect(str(path))  # and goes without a word
        (found,) = running()
        assert found.ask(do="list")["scenario"] == "test"
    finally:
        server.close()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no Unix sockets")
def test_peers_that_say_nothing_or_wait_keep_nobody_waiting() -> None:
    """Half a line, silence, and a request that takes until a fault begins; others are answered meanwhile."""
    held = threading.Event()

    def handle(request: dict[str, Any]) -> dict[str, Any]:
        if request["do"] == "wait":
            held.wait(PATIENCE)
        return {"did": request["do"]}

    server = ControlServer("test", handle)
    (found,) = running()
    path = next(control_folder().glob("*.sock"))
    try:
        with contextlib.ExitStack() as stack:
            pool = stack.enter_context(ThreadPoolExecutor(8))
            stack.callback(held.set)
            for part in (b"", b'{"do":', b" "):
                peer = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
                peer.connect(str(path))
                peer.sendall(part)
            waiting = pool.submit(found.ask, do="wait")
            asked = [pool.submit(found.ask, do=f"{number}") for number in range(20)]
            assert [each.result(PATIENCE)["did"] for each in asked] == [f"{number}" for number in range(20)]
            assert not waiting.done()
            slow = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
            slow.connect(str(path))
            for byte in json.dumps({"do": "slow", "token": found._token}).encode() + b"\n":
                slow.sendall(bytes([byte]))
                time.sleep(0.005)
            assert json.loads(slow.makefile().readline()) == {"ok": True, "did": "slow"}
    finally:
        server.close()


@pytest.mark.skipif(not Path("/proc/self/net/tcp").exists(), reason="only Linux lists its sockets so")
def test_nothing_listens_on_the_network(serving: Serving) -> None:
    def listening() -> list[str]:
        own = set()
        for handle in Path("/proc/self/fd").iterdir():
            with contextlib.suppress(OSError):
                own.add(str(handle.readlink()))
        rows = [row.split() for name in ("tcp", "tcp6", "udp", "udp6") for row in _sockets(name)]
        # Columns: 1 the address, 3 the state (0A: TCP listens, 07: UDP receives), 9 the inode.
        return [row[1] for row in rows if row[3] in ("0A", "07") and f"socket:[{row[9]}]" in own]

    before = listening()
    server = ControlServer("test", SessionRequests(serving.session))
    try:
        assert listening() == before
        with socket.create_server(("127.0.0.1", 0)):  # it would be seen
            assert len(listening()) == len(before) + 1
    finally:
        server.close()


def _sockets(name: str) -> list[str]:
    path = Path("/proc/self/net") / name
    return path.read_text().splitlines()[1:] if path.exists() else []


def test_without_unix_sockets_a_token_is_wanted_on_the_loopback(
    serving: Serving, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(control, "_UNIX", False)
    server = ControlServer("test", SessionRequests(serving.session))
    try:
        (note,) = control_folder().glob("*.json")
        assert note.stat().st_mode & 0o077 == 0
        port = json.loads(note.read_text())["port"]
        assert server._listener.getsockname()[0] == "127.0.0.1"
        for line in (b'{"do": "list"}\n', b'{"do": "list", "token": "00"}\n', b"rubbish\n", b"[]\n"):
            with socket.create_connection(("127.0.0.1", port), 10) as peer:
                peer.sendall(line)
                assert json.loads(peer.makefile().readline())["ok"] is False
        (found,) = running()
        assert found.ask(do="list")["scenario"] == "test"
        with pytest.raises(UsageError, match="is no request"):
            found.ask(do="stop")
    finally:
        server.close()


def test_the_folder_of_control_sockets_is_the_user_s_alone(runtime: Path) -> None:
    folder = runtime / "bussim"
    folder.mkdir(mode=0o755)
    folder.chmod(0o755)
    with pytest.raises(UsageError, match="not this user's alone"):
        control_folder()
    folder.rmdir()
    folder.symlink_to(runtime)
    with pytest.raises(UsageError, match="no folder"):
        control_folder()
