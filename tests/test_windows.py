"""Windows has neither pseudo-terminals nor Unix sockets nor POSIX's modules; all else works there."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from bussim.cli import COMMANDS


@pytest.mark.slow
def test_commands_without_what_only_posix_has(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "tests.windows"],
        cwd=Path(__file__).parents[1],
        env={**os.environ, "TMPDIR": str(tmp_path), "XDG_RUNTIME_DIR": ""},
        capture_output=True,
        check=False,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    said = done.stdout.splitlines()
    assert {f"imported {name}" for name in COMMANDS} <= set(said)
    assert {"ran run", "ran check", "ran exact", "ran size", "ran sweep"} <= set(said)
    assert said[-2:] == ["controlled", "served nothing"]
