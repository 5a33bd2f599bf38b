"""Programs of other projects, and what they print."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

#: The one preference of a serial capture of Modbus RTU, and the one of a capture in UDP.
RTU_SERIAL = ["-o", 'uat:user_dlts:"User 0 (DLT=147)","mbrtu","0","","0",""']
RTU_UDP = ["-o", "mbrtu.udp.port:5020"]
CRC = ["-o", "mbrtu.crc_verification:TRUE"]
_PATIENCE = 120


def program(name: str, package: str) -> str:
    """A program that CI must have, and others may lack."""
    found = shutil.which(name)
    if found is None:
        missing = f"{name} is not installed (Debian: {package})"
        if os.environ.get("CI"):
            pytest.fail(missing)
        pytest.skip(missing)
    return found


def tshark(path: Path, fields: list[str], options: list[str]) -> list[dict[str, list[str]]]:
    """Fields of every packet, each with all its values."""
    wanted = ["-T", "fields", "-E", "separator=/t", "-E", "occurrence=a", "-E", "aggregator=|"]
    for field in fields:
        wanted += ["-e", field]
    rows = []
    for line in tshark_text(path, [*options, *wanted], verbose=False).split("\n")[:-1]:
        cells = line.split("\t")
        assert len(cells) == len(fields), line
        rows.append({name: cell.split("|") if cell else [] for name, cell in zip(fields, cells, strict=True)})
    return rows


def tshark_text(path: Path, options: list[str], *, verbose: bool = True) -> str:
    """What tshark prints of a file."""
    command = [program("tshark", "tshark"), "-r", str(path), "-n", *options, *(["-V"] if verbose else [])]
    # A configuration of its own: what the user has set does not matter.
    home = {"XDG_CONFIG_HOME": str(path.parent), "HOME": str(path.parent), "TZ": "UTC", "LC_ALL": "C.UTF-8"}
    run = subprocess.run(
        command,
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=_PATIENCE,
        env={**os.environ, **home},
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert "Lua" not in run.stderr, run.stderr
    return run.stdout


def sigrok(path: Path, decoders: str, *wanted: str) -> list[tuple[int, int, str]]:
    """Annotations of protocol decoders on a file: first sample, last sample, text. They are in file order."""
    command = [*_sigrok(path, decoders), "--protocol-decoder-samplenum", "-A", ",".join(wanted)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE, check=False)
    assert run.returncode == 0, run.stderr
    found = []
    for line in run.stdout.splitlines():
        samples, _, text = line.partition(" ")
        first, _, last = samples.partition("-")
        found.append((int(first), int(last), text.partition(": ")[2]))
    return found


def sigrok_bytes(path: Path, decoders: str, stream: str) -> bytes:
    """A binary stream of a protocol decoder."""
    run = subprocess.run(
        [*_sigrok(path, decoders), "-B", stream], capture_output=True, timeout=_PATIENCE, check=False
    )
    assert run.returncode == 0, run.stderr
    return run.stdout


def _sigrok(path: Path, decoders: str) -> list[str]:
    kind = ["-I", "vcd"] if path.suffix == ".vcd" else []
    return [program("sigrok-cli", "sigrok-cli"), *kind, "-i", str(path), "-P", decoders]


def number(cells: list[str]) -> Any:
    """The one number of a field, decimal or hexadecimal; None where there is none."""
    return int(cells[0], 0) if cells else None
