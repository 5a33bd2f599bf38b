"""sigrok session files (``.sr``): the waveform sampled at 1 MHz, for PulseView and sigrok-cli.

A ZIP archive (sigrok wiki, "File format: sigrok/v2"): ``version`` is 2, ``metadata`` names rate and
channels, ``logic-1-1``, ``logic-1-2``, … hold the samples, a bit a channel, lowest byte first.
Sample 0 is the window's first microsecond, or where a frame begins then, of the idle line before it.
"""

import zipfile
from collections.abc import Iterator
from pathlib import Path

from bussim.errors import UsageError
from bussim.export.lanes import Lanes
from bussim.version import __version__

#: Longest recording: every microsecond is a sample, and PulseView keeps them all in memory.
MOST_SECONDS = 600
#: Most channels: PulseView's own limit is the bits of the largest sample it takes.
MOST_CHANNELS = 64
_CHUNK = 4 * 1024 * 1024
# Always the same time stamp inside the archive: the same bytes for the same run.
_DATE = (1980, 1, 1, 0, 0, 0)


def write_sigrok(path: Path, lanes: Lanes, comment: str) -> None:
    """Write the lanes; the format has no field for a ``comment``.

    Raises UsageError, before a file is begun, where they are too long or too many.
    """
    del comment
    length = lanes.end - lanes.begin
    if length > MOST_SECONDS * 1_000_000:
        raise UsageError(
            f"the window is {length / 1e6:,.0f} s long, {length:,} samples; a sigrok session may have "
            f"{MOST_SECONDS} s: choose less with --from and --to-time, or export a vcd"
        )
    if len(lanes.lanes) > MOST_CHANNELS:
        raise UsageError(
            f"there are {len(lanes.lanes)} lanes; a sigrok session may have {MOST_CHANNELS}: choose a --bus"
        )
    unit = (len(lanes.lanes) + 7) // 8
    with zipfile.ZipFile(path, "w") as archive:
        _put(archive, "version", b"2")
        _put(archive, "metadata", _metadata(lanes, unit).encode("utf-8"))
        for number, chunk in enumerate(_chunks(lanes, unit), 1):
            _put(archive, f"logic-1-{number}", chunk)


def _metadata(lanes: Lanes, unit: int) -> str:
    lines = [
        "[global]",
        f"sigrok version=bussim {__version__}",
        "",
        "[device 1]",
        "capturefile=logic-1",
        f"total probes={len(lanes.lanes)}",
        "samplerate=1 MHz",
        "total analog=0",
        *(f"probe{number}={lane.name}" for number, lane in enumerate(lanes.lanes, 1)),
        f"unitsize={unit}",
    ]
    return "\n".join(lines) + "\n"


def _put(archive: zipfile.ZipFile, name: str, data: bytes | bytearray) -> None:
    entry = zipfile.ZipInfo(name, _DATE)
    entry.compress_type = zipfile.ZIP_DEFLATED
    archive.writestr(entry, bytes(data), compresslevel=1)


def _chunks(lanes: Lanes, unit: int) -> Iterator[bytearray]:
    """The samples, cut into the archive's chunks."""
    size = _CHUNK // unit * unit
    chunk = bytearray()
    for levels, count in _runs(lanes):
        left = count
        sample = levels.to_bytes(unit, "little")
        while left:
            fits = min(left, (size - len(chunk)) // unit)
            chunk += sample * fits
            left -= fits
            if len(chunk) == size:
                yield chunk
                chunk = bytearray()
    if chunk:
        yield chunk


def _runs(lanes: Lanes) -> Iterator[tuple[int, int]]:
    """The levels of all lanes, a bit each, and for how many samples they last."""
    levels, at = (1 << len(lanes.lanes)) - 1, lanes.begin
    for us, lane, level in lanes.changes():
        if us > at:
            yield levels, us - at
            at = us
        levels = levels | 1 << lane if level else levels & ~(1 << lane)
    yield levels, lanes.end - at
