"""The command itself: what it says where it cannot begin."""

from __future__ import annotations

import importlib.util
import socket
from pathlib import Path

import pytest

from bussim.cli import main
from bussim.commands import ui


@pytest.mark.parametrize("missing", ["starlette", "uvicorn"])
def test_a_missing_extra_is_said_with_what_to_type(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], missing: str
) -> None:
    found = importlib.util.find_spec
    monkeypatch.setattr(ui, "find_spec", lambda name: None if name == missing else found(name))
    assert main(["ui", "--no-browser"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert f"the page needs {missing}, which is not installed: pip install 'bussim[ui]'" in said.err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nothing.yaml"], "nothing.yaml: no such file"),
        (["--folder", "nowhere"], "--folder nowhere: no such folder"),
    ],
)
def test_what_is_not_there_is_named(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    arguments: list[str],
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["ui", "--no-browser", *arguments]) == 2
    assert said in capsys.readouterr().err


def test_answers_are_sent_without_delay(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """asyncio sets TCP_NODELAY where a socket's protocol is TCP, and not where it is the default, 0."""
    found: list[tuple[int, str]] = []

    def serve(listening: socket.socket, *_: object, **__: object) -> None:
        with socket.create_connection(listening.getsockname()), listening.accept()[0] as accepted:
            found.append((accepted.proto, listening.getsockname()[0]))

    monkeypatch.setattr("bussim.ui.server.serve", serve)
    assert main(["ui", "--no-browser", "--folder", str(tmp_path)]) == 0
    assert found == [(socket.IPPROTO_TCP, "127.0.0.1")]
