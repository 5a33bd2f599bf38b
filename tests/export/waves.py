"""The waveform of frames, computed straight from the definition; and from the files that were written."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable
from pathlib import Path

from bussim.export.lanes import microseconds
from bussim.line.characters import CharFormat
from bussim.trace.records import FrameRecord
from tests.export.samples import timing

Lows = list[tuple[int, int]]


def lows(frames: Iterable[FrameRecord], *, damaged: bool) -> Lows:
    """When a wire is low that these frames drive, in µs: bit by bit, a 0 wins."""
    parts: list[tuple[int, int]] = []
    for frame in frames:
        form = CharFormat.parse(frame.format)
        own = timing(frame.baud, frame.format, frame.ppm)
        bits = [bit for value in frame.chars for bit in form.encode(value)]
        for number in frame.damaged_bits if damaged else ():
            bits[number] ^= 1
        for number, bit in enumerate(bits):
            first, last = frame.start + own.bits(number), min(frame.start + own.bits(number + 1), frame.end)
            if bit == 0 and first < last:
                parts.append((microseconds(first), microseconds(last)))
    return merged(parts)


def merged(parts: Iterable[tuple[int, int]]) -> Lows:
    found: Lows = []
    for first, last in sorted(parts):
        if first == last:
            continue
        if found and first <= found[-1][1]:
            found[-1] = (found[-1][0], max(found[-1][1], last))
        else:
            found.append((first, last))
    return found


def idle_before(frames: Iterable[FrameRecord], begin: int = 0, *, bit: float = 1e6 / 38400) -> int:
    """How long a picture that begins at a tick is idle before its first frame, in µs.

    Four characters of ten bits where one begins with it, so that a decoder sees its falling edge; else 0.
    """
    return round(40 * bit) if microseconds(min(each.start for each in frames)) == microseconds(begin) else 0


def clipped(parts: Lows, begin: int, end: int) -> Lows:
    return [
        (max(first, begin), min(last, end)) for first, last in parts if max(first, begin) < min(last, end)
    ]


def of_vcd(path: Path) -> tuple[dict[str, Lows], int, int]:
    """Lows by the lane's name; first and last time."""
    names: dict[str, str] = {}
    levels: dict[str, tuple[int, int]] = {}
    found: dict[str, Lows] = {}
    now, begin = 0, None
    text = path.read_text("utf-8")
    assert "$timescale 1 us $end" in text
    for line in text.splitlines():
        words = line.split()
        if words[:1] == ["$var"]:
            names[words[3]] = words[4]
            found[words[4]] = []
        elif line.startswith("#"):
            assert begin is None or int(line[1:]) > now
            now = int(line[1:])
            begin = now if begin is None else begin
        elif begin is not None and line[:1] in "01":
            name, level = names[line[1:]], int(line[0])
            before, since = levels.get(name, (1, now))
            if before == 0 and level == 1:
                found[name].append((since, now))
            levels[name] = (level, now)
    for name, (level, since) in levels.items():
        if level == 0:
            found[name].append((since, now))
    return found, begin or 0, now


def of_sr(path: Path) -> tuple[dict[str, Lows], int]:
    """Lows by the channel's name, from sample 0 on; how many samples."""
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        assert archive.read("version") == b"2"
        lines = archive.read("metadata").decode().splitlines()
        pairs = dict(line.split("=", 1) for line in lines if "=" in line)
        assert pairs["samplerate"] == "1 MHz"
        unit = int(pairs["unitsize"])
        chunks = sorted(
            (name for name in archive.namelist() if name.startswith("logic-1-")),
            key=lambda name: int(name.rsplit("-", 1)[1]),
        )
        assert [int(name.rsplit("-", 1)[1]) for name in chunks] == list(range(1, len(chunks) + 1))
        data = b"".join(map(archive.read, chunks))
    assert len(data) % unit == 0
    count = len(data) // unit
    found: dict[str, Lows] = {}
    channels = [key for key in pairs if key.startswith("probe")]
    assert len(channels) == int(pairs["total probes"])
    for key in channels:
        byte, bit = divmod(int(key[5:]) - 1, 8)
        levels = data[byte::unit].translate(bytes(value >> bit & 1 for value in range(256)))
        at, parts = 0, []
        while (first := levels.find(b"\0", at)) >= 0:
            at = levels.find(b"\1", first)
            at = count if at < 0 else at
            parts.append((first, at))
        found[pairs[key]] = parts
    return found, count
