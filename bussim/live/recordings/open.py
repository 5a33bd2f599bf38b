"""Opens a recording by its content and gives the characters in it, in chunks."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from enum import Enum
from pathlib import Path
from typing import BinaryIO

from bussim.engines.contract import RxChar
from bussim.line.characters import LineTiming
from bussim.live.arrival import Arrivals, Timed
from bussim.live.recordings.errors import RecordingError
from bussim.live.recordings.pcapng import PcapngReader
from bussim.live.recordings.raw import read_raw
from bussim.live.recordings.sigrok import SigrokFile
from bussim.units import TICKS_PER_SECOND

#: Bit of a character in a pcapng file that was received wrongly.
_MARK = 0x80
#: Recordings whose times begin later count from 1970, and are moved to begin at 0.
_A_MONTH = 31 * 86_400 * TICKS_PER_SECOND


class Kind(Enum):
    """The kinds of recordings."""

    TRACE = "trace.jsonl"
    PCAPNG = "pcapng"
    SIGROK = "sigrok session"
    RAW = "raw bytes with timestamps"


def kind_of(path: Path) -> Kind:
    """What a file or a run's folder is, by its first bytes. Raises RecordingError if it cannot be read."""
    if path.is_dir():
        return Kind.TRACE
    try:
        with path.open("rb") as file:
            head = file.read(64)
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror or error}") from error
    if head.startswith(b"\n\r\r\n"):
        return Kind.PCAPNG
    if head.startswith(b"PK"):
        return Kind.SIGROK
    if head.lstrip().startswith(b"{"):
        return Kind.TRACE
    if not head:
        raise RecordingError(f"{path} is empty")
    return Kind.RAW


def characters(
    path: Path, kind: Kind, timing: LineTiming, *, channel: str | None = None
) -> Iterator[list[Timed]]:
    """The characters of a recording that is no trace, in chunks. Raises RecordingError where it is damaged.

    ``timing`` is the line's rate and format; ``channel`` the logic channel (of sigrok) or the
    interface (of pcapng) that is the line, None for the first.
    """
    if kind is Kind.SIGROK:
        session = SigrokFile(path, channel)
        with contextlib.closing(session):
            yield from session.characters(timing)
    elif kind is Kind.PCAPNG:
        yield from _packets(path, timing, channel)
    elif kind is Kind.RAW:
        yield from _raw(path, timing)
    else:
        raise ValueError(kind)


def placed(data: bytes, start: int, timing: LineTiming) -> list[Timed]:
    """Characters back to back from their first edge on."""
    mask = (1 << timing.format.data_bits) - 1
    ends = [start + timing.characters(number) for number in range(len(data) + 1)]
    return [(RxChar(value & mask), ends[at], ends[at + 1]) for at, value in enumerate(data)]


def _packets(path: Path, timing: LineTiming, channel: str | None) -> Iterator[list[Timed]]:
    with _opened(path) as file:
        reader = PcapngReader(file, str(path))
        chosen: int | None = None
        end = 0
        since: int | None = None  # where the recording begins, if its times count from 1970
        for interface, tick, data in reader.packets():
            if chosen is None and channel in (None, reader.interfaces[interface].name, str(interface)):
                chosen = interface
            if interface != chosen or not data:
                continue
            if since is None and tick is not None:
                since = tick if tick > _A_MONTH else 0
            # A simple packet has no time: right behind the one before.
            begun = end if tick is None else max(tick - (since or 0), 0)
            line = reader.interfaces[interface]
            chars = placed(data, begun, replace(timing, baud=line.speed) if line.speed else timing)
            if line.marked:
                chars = [
                    (char if byte < _MARK else RxChar(byte & ~_MARK, parity_ok=False), start, stop)
                    for byte, (char, start, stop) in zip(data, chars, strict=True)
                ]
            end = chars[-1][2]
            yield chars
        if chosen is None:
            names = ", ".join(each.name or str(at) for at, each in enumerate(reader.interfaces)) or "none"
            what = "no frames of a serial line" if channel is None else f"no interface {channel!r}"
            raise RecordingError(f"{path} has {what}; its interfaces are {names}")


def _raw(path: Path, timing: LineTiming) -> Iterator[list[Timed]]:
    arrivals = Arrivals(timing)
    try:
        with path.open(encoding="utf-8", errors="replace") as lines:
            for tick, data, from_start in read_raw(lines, str(path)):
                if from_start:
                    yield placed(data, tick, timing)
                else:
                    yield arrivals.chunk(data, tick)
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror or error}") from error


def _opened(path: Path) -> BinaryIO:
    try:
        return path.open("rb")
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror or error}") from error
