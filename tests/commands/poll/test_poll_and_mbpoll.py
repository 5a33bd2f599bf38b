"""The same options mean the same to ``bussim poll`` and to mbpoll: requests, values and exit status."""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from typing import NamedTuple

import pytest

from bussim.cli import main
from bussim.devices.v80.map import V80
from bussim.engines.modbus.server import Space
from bussim.line.characters import CharFormat
from bussim.live.served import ServedSlave
from tests.live.peers import TerminalPair

pytestmark = [
    pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals"),
    pytest.mark.skipif(
        shutil.which("mbpoll") is None and not os.environ.get("CI"), reason="mbpoll is not installed"
    ),
]
#: Seconds: nothing here takes so long unless something is broken.
PATIENCE = 20.0
LINE = ("-m", "rtu", "-b", "115200", "-P", "none", "-d", "8", "-s", "1")


class Polled(NamedTuple):
    """What a program sent and received, what it read, and how it ended."""

    sent: bytes
    received: bytes
    values: list[float]
    failed: bool


@pytest.fixture
def pair() -> Iterator[TerminalPair]:
    """Two ends of a line; a slave with stations 1 and 2 is on the right one."""
    with TerminalPair() as pair:
        maps = {1: V80(), 2: V80()}
        for number in range(60):
            maps[1].set(Space.HOLDING, number, number * 1000)
            maps[2].set(Space.HOLDING, number, number * 7)
        for number in range(0, 60, 3):
            maps[1].set(Space.COILS, number, 1)
        with ServedSlave(pair.right, maps, fmt=CharFormat(8, "N", 1)):
            yield pair


def both(pair: TerminalPair, options: tuple[str, ...], values: tuple[str, ...]) -> tuple[Polled, Polled]:
    """What mbpoll and then this program do with the same arguments."""
    arguments = [*LINE, *options, pair.left, *(("--", *values) if values else ())]
    theirs = subprocess.run(
        ["mbpoll", *arguments], capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    read = [_number(text) for text in re.findall(r"^\[\d+\]: \t(\S+)", theirs.stdout, re.MULTILINE)]
    taken = [len(data) for data in pair.carried]
    mbpoll = Polled(bytes(pair.carried[0]), bytes(pair.carried[1]), read, theirs.returncode != 0)
    return mbpoll, ours(pair, arguments, taken)


def _number(text: str) -> float:
    return float(int(text, 16)) if text.startswith("0x") else float(text)


def ours(pair: TerminalPair, arguments: list[str], taken: list[int]) -> Polled:
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()):
        code = main(["poll", "--json", *arguments])
    assert code in (0, 1)
    found = json.loads(out.getvalue())
    read = [_number(str(value)) for poll in found["polls"] for value in poll["values"]]
    sent, received = (bytes(data[begin:]) for data, begin in zip(pair.carried, taken, strict=True))
    return Polled(sent, received, read, code != 0)


READS = [
    (),
    ("-a", "2"),
    ("-a", "1,2"),
    ("-a", "1:2"),
    ("-a", "9", "-o", "0.05"),
    ("-a", "2,9,1", "-o", "0.05"),
    ("-r", "5"),
    ("-r", "0x10"),
    ("-0",),
    ("-0", "-r", "0", "-c", "3"),
    ("-0", "-r", "41"),
    ("-c", "40"),
    ("-r", "60000"),
    ("-t", "0", "-c", "20"),
    ("-t", "0", "-c", "1"),
    ("-t", "1", "-c", "9"),
    ("-t", "3", "-c", "4"),
    ("-t", "3:hex", "-c", "4"),
    ("-t", "4:hex", "-r", "41", "-c", "2"),
    ("-t4:int", "-r", "41", "-c", "3"),
    ("-t4:int", "-r", "41", "-c", "3", "-B"),
    ("-t", "4:float", "-r", "3", "-c", "2"),
    ("-t", "4:float", "-r", "3", "-c", "2", "-B"),
    ("-t", "3:float",),
    ("-l", "500"),
    ("-o", "0.5"),
    ("-P", "NONE"),
]  # fmt: skip


@pytest.mark.parametrize("options", READS, ids=" ".join)
def test_reading(pair: TerminalPair, options: tuple[str, ...]) -> None:
    mbpoll, bussim = both(pair, ("-1", *options), ())
    assert bussim.sent == mbpoll.sent != b""
    assert bussim.received == mbpoll.received
    assert bussim.values == pytest.approx(mbpoll.values, rel=1e-5)  # mbpoll prints six digits of a float
    assert bussim.failed == mbpoll.failed


WRITES = [
    ((), ("100",)),
    ((), ("0xFFFF", "0", "17")),
    (("-t", "4:hex"), ("100",)),
    (("-t", "4:hex"), ("0x1F", "31")),
    (("-t", "4:int"), ("100000",)),
    (("-t", "4:int", "-B"), ("100000", "-2")),
    (("-t", "4:float"), ("1.5",)),
    (("-t", "4:float", "-B"), ("-1e-3", "2")),
    (("-t", "0"), ("1",)),
    (("-t", "0"), ("0",)),
    (("-t", "0", "-r", "9"), ("1", "0", "1")),
    (("-a", "2", "-r", "7"), ("5",)),
    (("-0", "-r", "7"), ("5",)),
    (("-r", "60000"), ("5",)),
    (("-a", "9", "-o", "0.05"), ("5",)),
]  # fmt: skip


@pytest.mark.parametrize(("options", "values"), WRITES)
def test_writing(pair: TerminalPair, options: tuple[str, ...], values: tuple[str, ...]) -> None:
    mbpoll, bussim = both(pair, options, values)
    assert mbpoll.sent != b""
    assert bussim.sent.startswith(mbpoll.sent)
    # The response to a write of one item equals it: one that comes sooner than a line of this rate could bring it
    # may be an echo, so that the item is read back.
    read_back = bussim.sent[len(mbpoll.sent) :]
    assert bussim.received[: None if not read_back else len(mbpoll.received)] == mbpoll.received
    if read_back:
        assert mbpoll.sent[1] in (5, 6)
        assert (read_back[1], read_back[2:4]) == (
            mbpoll.sent[1] - (4 if mbpoll.sent[1] == 5 else 3),
            mbpoll.sent[2:4],
        )
    assert bussim.failed == mbpoll.failed


REFUSED = [
    (("-t", "4"), ("70000",)),
    (("-t", "4"), ("-5",)),
    (("-t", "4:hex"), ("65536",)),
    (("-t", "4"), ("word",)),
    (("-t", "0"), ("2",)),
    (("-t", "3"), ("2",)),
    (("-c", "2"), ("5",)),
    (("-c", "126"), ()),
    (("-c", "0"), ()),
    (("-a", "256"), ()),
    (("-a", "0"), ()),
    (("-o", "0"), ()),
    (("-o", "500"), ()),
    (("-l", "5"), ()),
    (("-r", "65537"), ()),
    (("-t", "2"), ()),
    (("-t", "4:long"), ()),
    (("-d", "9"), ()),
    (("-s", "3"), ()),
    (("-P", "mark"), ()),
    (("-b", "0"), ()),
]  # fmt: skip


@pytest.mark.parametrize(("options", "values"), REFUSED)
def test_what_one_refuses_the_other_refuses(
    pair: TerminalPair, options: tuple[str, ...], values: tuple[str, ...]
) -> None:
    arguments = ["-1", *LINE, *options, pair.left, *(("--", *values) if values else ())]
    assert (
        subprocess.run(["mbpoll", *arguments], capture_output=True, timeout=PATIENCE, check=False).returncode
        == 1
    )
    assert main(["poll", *arguments]) == 2
    assert pair.carried == [b"", b""]
