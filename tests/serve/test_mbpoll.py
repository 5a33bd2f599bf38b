"""mbpoll, a master on libmodbus that this project did not write, against a served register map."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from tests.export.peers import program
from tests.serve.serving import SLAVES, Serving

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")


def mbpoll(*arguments: str) -> str:
    """What one call prints, of station 2 with addresses from 0."""
    line = ["-m", "rtu", "-b", "115200", "-d", "8", "-s", "1", "-P", "none"]
    done = subprocess.run(
        [program("mbpoll", "mbpoll"), *line, "-a", "2", "-0", *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_what_mbpoll_writes_it_reads_back() -> None:
    with Serving(SLAVES, "v80", "oven") as serving:
        device = serving.device
        assert "Written 3 references." in mbpoll("-t", "4", "-r", "5", device, "1", "65535", "42")
        found = mbpoll("-t", "4", "-r", "4", "-c", "5", "-1", device)
    assert re.findall(r"^\[(\d+)\]:\s+(\d+)", found, re.MULTILINE) == [
        ("4", "7"), ("5", "1"), ("6", "65535"), ("7", "42"), ("8", "7"),
    ]  # fmt: skip
    assert sum(device.answered for device in serving.totals().devices) == 2
