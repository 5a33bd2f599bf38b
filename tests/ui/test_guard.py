"""Who is refused, each by a raw request, and what no answer says."""

from __future__ import annotations

import re
import socket
import subprocess
import sys
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from bussim.ui.guard import MOST_BYTES
from tests.ui.asking import EXAMPLE, PORT, TOKEN, Page

HERE = f"http://127.0.0.1:{PORT}"


@pytest.fixture
def page(tmp_path: Path) -> Page:
    return Page(tmp_path)


@pytest.mark.parametrize(
    "headers",
    [
        {"host": "attacker.example"},
        {"host": f"attacker.example:{PORT}"},
        {"host": "127.0.0.1"},
        {"host": f"127.0.0.1:{PORT + 1}"},
        {"host": f"127.0.0.1:{PORT}.attacker.example"},
        {"host": f"attacker.example:{PORT}", "origin": f"http://attacker.example:{PORT}"},
        {"origin": "http://attacker.example"},
        {"origin": f"http://127.0.0.1:{PORT + 1}"},
        {"origin": f"https://127.0.0.1:{PORT}"},
        {"origin": "null"},
    ],
)
@pytest.mark.parametrize("address", ["/", "/static/page.js", "/api/hello", "/api/run", "/nothing"])
def test_foreign_hosts_and_origins_are_refused_at_every_address(
    page: Page, headers: dict[str, str], address: str
) -> None:
    asked = page.client.get if not address.startswith("/api") else page.client.post
    response = asked(address, headers=headers)
    assert response.status_code == 403
    assert response.json()["error"]["key"] == "foreign"


@pytest.mark.parametrize(
    ("headers", "key"),
    [
        ({"x-bussim-token": ""}, "token"),
        ({"x-bussim-token": TOKEN[:-1]}, "token"),
        ({"x-bussim-token": "ü"}, "token"),
        ({"content-type": "text/plain"}, "type"),
        ({"content-type": "application/x-www-form-urlencoded"}, "type"),
        ({"content-type": ""}, "type"),
    ],
)
def test_without_token_or_json_nothing_is_answered(page: Page, headers: dict[str, str], key: str) -> None:
    sent = {
        name: value.encode("latin-1")
        for name, value in {"content-type": "application/json", **headers}.items()
    }
    response = page.client.post("/api/hello", content=b"{}", headers=sent)
    assert (response.status_code, response.json()["error"]["key"]) == (403, key)


def test_the_page_itself_is_answered_to_its_own_host(page: Page) -> None:
    for host in (f"127.0.0.1:{PORT}", f"localhost:{PORT}"):
        own = {"host": host, "origin": f"http://{host}"}
        assert page.client.get("/", headers=own).status_code == 200
        assert page.client.post("/api/hello", json={}, headers=own).status_code == 200


@pytest.mark.parametrize(
    "address",
    ["/../server.py", "/static/../server.py", "/static/%2e%2e/server.py", "/static/ui.js", "/made/x"],
)
def test_addresses_are_those_of_a_table(page: Page, address: str) -> None:
    assert page.client.get(address).status_code == 404


@pytest.mark.parametrize("method", ["PUT", "DELETE", "OPTIONS", "PATCH"])
def test_other_methods_are_refused(page: Page, method: str) -> None:
    assert page.client.request(method, "/api/hello").status_code == 405


def test_no_page_and_no_program_may_use_the_answers(page: Page) -> None:
    for response in (
        page.client.get("/"),
        page.client.get("/static/page.js"),
        page.client.post("/api/hello", json={}),
        page.client.get("/", headers={"host": "x"}),
        page.client.get("/no"),
    ):
        policy = response.headers["content-security-policy"]
        assert "default-src 'none'; script-src 'self'; connect-src 'self'" in policy
        assert "unsafe-eval" not in policy
        assert "frame-ancestors 'none'" in policy
        assert response.headers["x-content-type-options"] == "nosniff"
        assert response.headers["cache-control"] == "no-store"
        assert response.headers["referrer-policy"] == "no-referrer"
        assert response.headers["cross-origin-resource-policy"] == "same-origin"
        assert "set-cookie" not in response.headers
        assert not [name for name in response.headers if name.startswith("access-control")]


def test_no_more_is_read_than_is_allowed_whatever_the_length_says(page: Page) -> None:
    sent = 0

    async def parts() -> AsyncIterator[bytes]:
        nonlocal sent
        for _ in range(64):
            sent += 1
            yield b" " * (MOST_BYTES // 8)

    response = page.client.post("/api/law", content=parts(), headers={"content-type": "application/json"})
    assert (response.status_code, response.json()["error"]["key"]) == (413, "too_large")


@pytest.mark.slow
def test_the_real_server_listens_at_this_computer_alone_and_prints_its_address_first(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "bussim", "ui", "--no-browser", "--folder", str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            found = re.fullmatch(r"http://127\.0\.0\.1:(\d+)/#([\w-]{43})\n", process.stdout.readline())
            assert found
            port = int(found[1])
            with socket.create_connection(("127.0.0.1", port)) as raw:
                raw.sendall(b"GET / HTTP/1.1\r\nHost: attacker.example\r\n\r\n")
                assert raw.recv(4096).startswith(b"HTTP/1.1 403 ")
            upgrade = f"Host: 127.0.0.1:{port}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n"
            key = "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
            with socket.create_connection(("127.0.0.1", port)) as raw:
                raw.sendall(f"GET / HTTP/1.1\r\n{upgrade}{key}".encode())
                assert b" 101 " not in raw.recv(4096)
            with socket.create_connection(("127.0.0.1", port)) as raw:
                raw.sendall(f"GET /static/../server.py HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
                assert raw.recv(4096).startswith(b"HTTP/1.1 404 ")
            with socket.socket() as other:
                other.settimeout(2)
                assert other.connect_ex(("127.0.0.2", port)) != 0
        finally:
            process.terminate()
    assert process.returncode == 143


def test_a_scenario_cannot_read_this_computer(tmp_path: Path, page: Page) -> None:
    secret = tmp_path.parent / "secret.csv"
    secret.write_text("time,value\nTOPSECRET,1\n", "utf-8")
    (tmp_path / "link.csv").symlink_to(secret)
    (tmp_path / "below").mkdir()
    (tmp_path / "below" / "inner.csv").write_text("TOPSECRET\n", "utf-8")
    text = EXAMPLE.replace("  - name: master\n", "  - name: master\n    inputs: {X0: {csv: FILE}}\n")
    for name in (str(secret), "../secret.csv", "link.csv", "/etc/passwd", "below/inner.csv", "below"):
        for question in ("check", "law", "size", "run"):
            status, error = page.refused(question, text=text.replace("FILE", name))
            assert (status, error["key"]) == (400, "mistakes")
            assert "was not given" in error["text"]
            assert "TOPSECRET" not in str(error)
            assert "root:" not in str(error)
    (tmp_path / "own.csv").write_text("time,value\n0 s,1\n5 s,0\n", "utf-8")
    assert page.client.post("/api/check", json={"text": text.replace("FILE", "own.csv")}).status_code != 500
