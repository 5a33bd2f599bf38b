"""Reads a recording as ``bussim sniff --json`` does."""

from __future__ import annotations

import contextlib
import io
import json
from pathlib import Path
from typing import Any

from bussim.cli import main


def sniffed(path: Path, *options: str) -> dict[str, Any]:
    """What sniff prints of a file."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        assert main(["sniff", str(path), *options, "--json"]) == 0
    found: dict[str, Any] = json.loads(out.getvalue())
    return found


def attempts(found: dict[str, Any]) -> int:
    return sum(each["attempts"] for each in found["exchanges"].values())


def ok(found: dict[str, Any]) -> int:
    return int(found["outcomes"].get("ok", 0))
