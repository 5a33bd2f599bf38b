"""How far a command is: on a terminal by a bar, elsewhere by lines."""

from __future__ import annotations

import io
import sys
import time

import pytest

from bussim.commands.common import progress as module
from bussim.commands.common.progress import progress_bar


def test_lines_say_what_takes_minutes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = 100.0
    monkeypatch.setattr(module.time, "monotonic", lambda: now)
    with progress_bar() as progress:
        for done in range(1000, 10_001):  # what was there at the beginning is no measure
            progress("running", done, 10_000)
            now += 0.125
    assert capsys.readouterr().err.splitlines() == [
        "running: 10.4% done, about 19 min left",
        "running: 11.6% done, about 19 min left",
        "running: 16.4% done, about 18 min left",
        "running: 35.6% done, about 14 min left",
    ]


def test_what_takes_hours_and_what_takes_seconds(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = 0.0
    monkeypatch.setattr(module.time, "monotonic", lambda: now)
    with progress_bar() as progress:
        for what, total in (("checking", 60), ("running", 10_000)):
            for done in range(40):
                progress(what, done, total)
                now += 1.0
    assert capsys.readouterr().err.splitlines() == [
        "running: 0.1% done, about 2.8 h left",
        "running: 0.2% done, about 2.8 h left",
    ]


def test_a_bar_begins_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is called once and then takes its time has a bar, and what is over sooner has none."""

    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    shown = Terminal()
    monkeypatch.setattr(sys, "stderr", shown)
    with progress_bar() as progress:
        progress("refresh gaps", 0, 56)
    assert shown.getvalue() == ""
    monkeypatch.setattr(module, "_PATIENCE", 0.01)
    with progress_bar() as progress:
        progress("refresh gaps", 0, 56)
        until = time.monotonic() + 30
        while "refresh gaps" not in shown.getvalue() and time.monotonic() < until:
            time.sleep(0.01)
    assert "refresh gaps" in shown.getvalue()
