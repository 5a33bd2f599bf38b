"""ser2net, a device server that this project did not write, between a master and a served slave."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from bussim.cli import main
from bussim.line.characters import CharFormat
from bussim.live.served import ServedSlave
from tests.export.peers import program
from tests.live.peers import PATIENCE

pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore:set(Daemon|Name):DeprecationWarning"),  # pyserial's own
    pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals"),
]
CONFIGURATION = """%YAML 1.1
---
connection: &line
  accepter: {accepter}tcp,127.0.0.1,{port}
  connector: serialdev,{device},115200n81,local
  options:
    kickolduser: true
"""
LINE = ("-b", "115200", "-d", "8", "-P", "none")


@pytest.fixture(params=["raw", "telnet(rfc2217)"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """A port with a slave behind a device server, raw or with RFC 2217."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with ServedSlave(fmt=CharFormat(8, "N", 1)) as slave:
        accepter = "" if request.param == "raw" else f"{request.param},"
        text = CONFIGURATION.format(accepter=accepter, port=port, device=slave.device)
        (tmp_path / "ser2net.yaml").write_text(text, encoding="utf-8")
        command = [program("ser2net", "ser2net"), "-n", "-c", str(tmp_path / "ser2net.yaml")]
        server = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        try:
            until = time.monotonic() + PATIENCE
            while not _listens(port):
                assert time.monotonic() < until
                time.sleep(0.05)
            scheme = "socket" if request.param == "raw" else "rfc2217"
            yield f"{scheme}://127.0.0.1:{port}"
        finally:
            server.terminate()
            server.wait(PATIENCE)


def _listens(port: int) -> bool:
    with socket.socket() as client:
        return client.connect_ex(("127.0.0.1", port)) == 0


def test_what_is_written_over_a_device_server_is_read_over_it(
    url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if url.startswith("rfc2217"):
        assert main(["poll", url, *LINE, "-1"]) == 2  # a pseudo-terminal has no control lines
        hinted = f"{url}?ign_set_control"
        assert f"if the server has no control lines: {hinted}" in capsys.readouterr().err
        url = hinted
    for values in (("7", "65535"), ("8", "1")):
        assert main(["poll", url, *LINE, "-r", "5", *values]) == 0
        capsys.readouterr()
        assert main(["poll", url, *LINE, "-r", "5", "-c", "2", "--rounds", "5", "-l", "10", "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        assert (found["polls"][0]["ok"], found["polls"][0]["values"]) == (5, [int(one) for one in values])
        assert found["echo"] is False
