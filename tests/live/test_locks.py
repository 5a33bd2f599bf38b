"""Ports that two programs want."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import serial

from bussim.cli import main
from bussim.errors import UsageError
from bussim.line.characters import CharFormat, LineTiming
from bussim.live import endpoints
from bussim.live.wire import Wire

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows locks every port itself")
LINE = LineTiming(9600, CharFormat(8, "N", 1))


@pytest.fixture
def device() -> Iterator[str]:
    inner, outer = os.openpty()
    yield os.ttyname(outer)
    os.close(inner)
    os.close(outer)


def test_a_port_of_ours_is_no_other_programs(device: str, capsys: pytest.CaptureFixture[str]) -> None:
    wire = Wire(device, LINE)
    wire.open()
    try:
        with pytest.raises(serial.SerialException, match="exclusively lock"):
            serial.Serial(device, exclusive=True)
        assert main(["poll", device, "-1"]) == 2
        assert "another program has it open" in capsys.readouterr().err
        assert main(["sniff", device, "--for", "1 s"]) == 2
        assert f"bussim sniff pty:/tmp/tap --bridge {device}" in capsys.readouterr().err
    finally:
        wire.close()
    with serial.Serial(device, exclusive=True), pytest.raises(UsageError, match="another program"):
        Wire(device, LINE).open()


@pytest.mark.parametrize(("process", "used"), [(os.getppid(), True), (None, False)])
def test_lock_files_of_other_programs_are_respected(
    device: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, process: int | None, used: bool
) -> None:
    monkeypatch.setattr(endpoints, "LOCK_FOLDER", tmp_path)
    number = 2**22 + 1 if process is None else process  # beyond the highest process number of Linux
    (tmp_path / f"LCK..{Path(device).name}").write_text(f"{number:10d}\n")
    wire = Wire(device, LINE)
    if used:
        with pytest.raises(UsageError, match="another program has it open"):
            wire.open()
    else:
        wire.open()
    wire.close()
