"""sigrok session files (``.sr``): the waveform sampled at 1 MHz, for PulseView and sigrok-cli.

A ZIP archive (sigrok wiki, "File format: sigrok/v2"): ``version`` is 2, ``metadata`` names rate and
channels, ``logic-1-1``, ``logic-1-2``, … hold the samples, a bit a channel, lowest byte first.
Sample 0 is the window's first microsecond.
"""

from __future__ import annotations

import zipfile
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
    """Write the lanes; the format has no place for a ``comment``.

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
        samples = _Samples(archive, unit)
        state = (1 << len(lanes.lanes)) - 1
        at = lanes.begin
        for us, lane, level in lanes.changes():
            if us > at:
                samples.add(state, us - at)
                at = us
            state = state | 1 << lane if level else state & ~(1 << lane)
        samples.add(state, lanes.end - at)
        samples.finish()


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


class _Samples:
    """Runs of equal samples, cut into the archive's chunks."""

    def __init__(self, archive: zipfile.ZipFile, unit: int) -> None:
        self._archive = archive
        self._unit = unit
        self._size = _CHUNK // unit * unit
        self._buffer = bytearray()
        self._chunks = 0

    def add(self, state: int, count: int) -> None:
        sample = state.to_bytes(self._unit, "little")
        while count:
            fits = min(count, (self._size - len(self._buffer)) // self._unit)
            self._buffer += sample * fits
            count -= fits
            if len(self._buffer) == self._size:
                self.finish()

    def finish(self) -> None:
        if self._buffer:
            self._chunks += 1
            _put(self._archive, f"logic-1-{self._chunks}", self._buffer)
            self._buffer.clear()
