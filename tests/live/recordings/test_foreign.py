"""Recordings of other programs: their names are shown, and their numbers used, only as far as is safe."""

from __future__ import annotations

import struct
import zipfile
from io import BytesIO
from pathlib import Path

import pytest

from bussim.cli import main
from bussim.live.recordings.errors import RecordingError
from bussim.live.recordings.packets import PacketReader
from bussim.live.recordings.sigrok import SigrokFile

METADATA = "[global]\n[device 1]\ncapturefile=logic-1\nunitsize=1\nsamplerate={}\nprobe1={}\n"
ESCAPE, SHOWN = "\x1b[31m<b>\u202e", "\\x1b[31m<b>\\u202e"


def session(path: Path, rate: str = "1 MHz", channel: str = "RX") -> Path:
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("version", "2")
        file.writestr("metadata", METADATA.format(rate, channel))
        file.writestr("logic-1-1", b"\xff" * 1000)
    return path


@pytest.mark.parametrize("rate", ["9" * 400, "9" * 16, "1." + "9" * 400, "9" * 15 + " GHz", "0", "1e400"])
def test_a_sample_rate_that_nothing_has(rate: str, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="sample"):
        SigrokFile(session(tmp_path / "x.sr", rate))


def test_a_channel_whose_name_a_terminal_would_obey(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = session(tmp_path / "x.sr", channel=ESCAPE)
    for words in ([], ["--channel", SHOWN], ["--channel", ESCAPE], ["--channel", "other"]):
        assert main(["sniff", str(path), *words]) == (2 if words and words[1] != SHOWN else 0)
        output = "".join(capsys.readouterr())
        assert SHOWN in output
        assert not set(output) & set("\x1b\u202e")


def test_an_interface_whose_name_a_terminal_would_obey() -> None:
    name = ESCAPE.encode()
    options = struct.pack("<HH", 2, len(name)) + name + bytes(-len(name) % 4)
    body = struct.pack("<HHI", 147, 0, 0) + options
    size = len(body) + 12
    section = struct.pack("<IIIHHqI", 0x0A0D0D0A, 28, 0x1A2B3C4D, 1, 0, -1, 28)
    reader = PacketReader(
        BytesIO(section + struct.pack("<II", 1, size) + body + struct.pack("<I", size)), "x"
    )
    assert list(reader.packets()) == []
    assert [each.name for each in reader.interfaces] == [SHOWN]
