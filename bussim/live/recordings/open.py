"""Opens a recording by its content."""

import json
from codecs import BOM_UTF8
from enum import Enum
from pathlib import Path
from typing import assert_never

from bussim.files import reading
from bussim.live.recordings.errors import RecordingError
from bussim.live.recordings.frames import TraceFile, open_trace
from bussim.live.recordings.packets import PCAP_MAGICS, PacketFile
from bussim.live.recordings.sigrok import SigrokFile
from bussim.live.recordings.text import TextFile

#: No header of a trace is longer (bytes).
_LONGEST_HEADER = 1 << 20
#: How files begin that must be unpacked first, and what they are.
_PACKED = {
    b"\x1f\x8b": "gzip",
    b"\xfd7zXZ": "xz",
    b"BZh": "bzip2",
    b"\x28\xb5\x2f\xfd": "zstd",
    b"7z\xbc\xaf": "7z",
    b"Rar!": "rar",
}


class Kind(Enum):
    """The kinds of recordings."""

    TRACE = "trace.jsonl"
    PACKETS = "pcapng or pcap"
    SIGROK = "sigrok session"
    TEXT = "text with the bytes of a line"


def kind_of(path: Path) -> Kind:
    """What a file or a run's folder is, by its first bytes. Raises RecordingError if it cannot be read."""
    with reading(path):
        if path.is_dir():
            return Kind.TRACE
        with path.open("rb") as file:
            begin = file.read(4)
            file.seek(0)
            head = file.readline(_LONGEST_HEADER)
    packed = next((name for mark, name in _PACKED.items() if head.startswith(mark)), None)
    if packed is not None:
        raise RecordingError(f"{path} is compressed by {packed}: unpack it first")
    if begin == b"\n\r\r\n" or begin in PCAP_MAGICS:
        return Kind.PACKETS
    if head.startswith(b"PK"):
        return Kind.SIGROK
    if _is_header(head):
        return Kind.TRACE
    if not head:
        raise RecordingError(f"{path} is empty")
    return Kind.TEXT


def _is_header(line: bytes) -> bool:
    """Whether a trace begins so: damaged, or written anew with blanks, other orders or line breaks."""
    line = line.removeprefix(BOM_UTF8)
    if line.startswith(b'{"type":') or line.strip() == b"{":
        return True
    if not line.lstrip().startswith(b"{"):
        return False
    try:
        header = json.loads(line)
    except (ValueError, RecursionError):
        return False
    return bool(header.get("type") == "trace")


def open_recording(
    path: Path, *, bus: str | None = None, channels: tuple[str, ...] = ()
) -> TraceFile | PacketFile | SigrokFile | TextFile:
    """A recording. Raises RecordingError where it is damaged, or has no such channels.

    ``bus`` names one of a trace, ``channels`` those of a sigrok session or interfaces of a pcapng file.
    """
    match kind := kind_of(path):
        case Kind.TRACE:
            return open_trace(path, bus)
        case Kind.PACKETS:
            return PacketFile(path, channels)
        case Kind.SIGROK:
            return SigrokFile(path, channels)
        case Kind.TEXT:
            return TextFile(path)
        case _:
            assert_never(kind)
