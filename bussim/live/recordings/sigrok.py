"""sigrok session files (``.sr``, of PulseView and sigrok-cli): logic samples through a UART.

A session is a ZIP archive: ``metadata`` names the sample rate, the channels and the bytes a sample,
``logic-1-1``, ``logic-1-2``, … hold the samples (sigrok wiki, "File format: sigrok/v2"). One
channel is the line, or two of them, one a direction.
"""

from __future__ import annotations

import configparser
import lzma
import re
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from bussim.live.arrival import Timed
from bussim.live.recordings.errors import RecordingError
from bussim.live.recordings.source import Chunk, Facts, LineSetup, Source
from bussim.live.recordings.waveform import SPIKE, Receiver
from bussim.units import TICKS_PER_SECOND
from bussim.wording import counted, visible

if TYPE_CHECKING:
    import numpy as np

_RATE = re.compile(r"\s*(\d{1,15}(?:\.\d{1,15})?)\s*([kKMG]?)\s*(?:Hz)?\s*")
_SCALES = {"": 1, "k": 1_000, "K": 1_000, "M": 1_000_000, "G": 1_000_000_000}
#: Samples that are read at once.
_BLOCK = 1 << 18
#: Edges of a channel by which rate, format and protocol are found.
MOST_SURVEYED = 40_000
_LARGEST_METADATA = 1 << 20
#: Samples of a bit below which a UART model cannot decode a character.
LEAST_SAMPLES = 4
#: What a damaged archive may raise.
_ZIP_ERRORS = (
    KeyError,
    OSError,
    EOFError,
    ValueError,
    RuntimeError,  # an encrypted part
    NotImplementedError,  # an unknown compression
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
)


class Channel(NamedTuple):
    """How many edges a channel has, and the samples of the first ones. Before the first the level is high."""

    total: int
    edges: np.ndarray


class SigrokFile(Source):
    """A session file. Raises RecordingError for what is none, and where it cannot be a serial line's."""

    exact, tolerant, times, begin = True, False, "exact", 0

    def __init__(self, path: Path, channels: tuple[str, ...] = ()) -> None:
        self._name = str(path)
        self.facts = Facts()
        #: Samples that were read.
        self.samples = 0
        try:
            self._zip = zipfile.ZipFile(path)
        except _ZIP_ERRORS as error:
            size = path.stat().st_size
            raise RecordingError(
                f"{path}: no sigrok session: {error}; one that was cut off lacks the directory at the end of "
                f"the archive: 'zip -FF {path.name} --out whole.sr' makes one of its {counted(size, 'byte')}"
            ) from error
        try:
            self._read_metadata()
        except RecordingError:
            self.close()
            raise
        for channel in channels:
            if channel not in self.channels:
                raise RecordingError(f"{path}: it has no channel {channel!r}, but {', '.join(self.channels)}")
        self.resolution = -(-TICKS_PER_SECOND // self.rate)

    def close(self) -> None:
        """Close the file."""
        self._zip.close()

    def _read_metadata(self) -> None:
        try:
            info = self._zip.getinfo("metadata")
            if info.file_size > _LARGEST_METADATA:
                raise RecordingError(f"{self._name}: its metadata are {info.file_size:,} bytes long")
            text = self._zip.read(info).decode("utf-8", "replace")
            config = configparser.ConfigParser(interpolation=None)
            config.read_string(text)
        except _ZIP_ERRORS as error:
            raise RecordingError(f"{self._name}: no sigrok session: it has no metadata") from error
        except configparser.Error as error:
            raise RecordingError(f"{self._name}: its metadata cannot be read") from error
        sections = (config[name] for name in config.sections())
        section = next((each for each in sections if {"samplerate", "capturefile"} <= each.keys()), None)
        if section is None:
            raise RecordingError(f"{self._name}: it has no logic samples with a sample rate")
        match = _RATE.fullmatch(section["samplerate"])
        if match is None:
            raise RecordingError(f"{self._name}: the sample rate is {section['samplerate'][:40]!r}")
        #: Samples a second.
        self.rate = round(float(match.group(1)) * _SCALES[match.group(2)])
        unit = section.get("unitsize", "1").strip()
        self._unit = int(unit) if unit.isascii() and unit.isdigit() and len(unit) < 3 else 0
        if not self.rate or self.rate > 10**10 or not 1 <= self._unit <= 8:
            raise RecordingError(f"{self._name}: {self.rate} samples a second of {unit[:8]} bytes")
        #: Channels by name, with the number of their bit.
        self.channels = {
            visible(section[key].strip()): int(key[5:]) - 1
            for key in section
            if re.fullmatch(r"probe\d{1,2}", key) and 1 <= int(key[5:]) <= 8 * self._unit
        }
        if not self.channels:
            raise RecordingError(f"{self._name}: it has no logic channels")
        self._capture = section["capturefile"].strip()

    def survey(self) -> dict[str, Channel]:
        """Every channel: how many edges it has, and the first ones, up to :data:`MOST_SURVEYED`."""
        import numpy as np

        first: dict[str, list[int]] = {name: [] for name in self.channels}
        counts = dict.fromkeys(self.channels, 0)
        for found, _ in self.changes(self.channels, "looking for the line"):
            for name, edges in found.items():
                counts[name] += len(edges)
                if len(first[name]) < MOST_SURVEYED:
                    first[name] += edges[: MOST_SURVEYED - len(first[name])].tolist()
        return {name: Channel(counts[name], np.array(first[name], dtype=np.int64)) for name in self.channels}

    def enough_samples(self, baud: int, what: str = "") -> None:
        """Raise RecordingError if there are too few samples for a rate."""
        if self.rate < LEAST_SAMPLES * baud:
            raise RecordingError(
                f"{self._name}: {what}{self.rate:,} samples a second are too few for {baud:,} bps; "
                f"at least {LEAST_SAMPLES * baud:,} are needed"
            )

    def chunks(self, setup: LineSetup) -> Iterator[Chunk]:
        """See the source of a recording."""
        import numpy as np

        if not setup.channels:
            return  # in none of them anything was recognised
        self.enough_samples(setup.timing.baud)
        receivers = [Receiver(setup.timing, self.rate, inverted=bool(setup.inverted)) for _ in setup.channels]
        self.facts = Facts()
        latest = dict.fromkeys(setup.channels, np.empty(0, dtype=np.int64))
        shortest = SPIKE * self.rate / setup.timing.baud
        for found, until in self.changes(setup.channels):
            for name in setup.channels:
                edges = found[name]
                self.facts.spikes += int((np.diff(edges, prepend=latest[name]) < shortest).sum())
                latest[name] = edges[-1:] if len(edges) else latest[name]
            yield from merged(
                [
                    receiver.feed(found[name], until)
                    for name, receiver in zip(setup.channels, receivers, strict=True)
                ]
            )

    def end(self) -> int | None:
        """See the source of a recording."""
        return (2 * self.samples * TICKS_PER_SECOND + self.rate) // (2 * self.rate)

    def changes(
        self, names: Iterable[str], what: str = "reading"
    ) -> Iterator[tuple[dict[str, np.ndarray], int]]:
        """The samples at which each channel changes, in blocks, and how many samples were read so far.

        A channel whose first sample is low has an edge there. ``what`` is shown as being done.
        """
        import numpy as np

        total = sum(self._zip.getinfo(name).file_size for name in self._parts()) // self._unit

        before, at = np.array([np.iinfo(np.uint64).max], dtype="<u8"), 0
        for block in self._blocks():
            samples = np.concatenate((before.astype(block.dtype), block))
            changed = np.flatnonzero(samples[1:] != samples[:-1])
            flips = samples[changed] ^ samples[changed + 1]
            found = {}
            for name in names:
                found[name] = changed[(flips >> self.channels[name]) & 1 == 1] + at
            before = samples[-1:]
            at += len(block)
            self.progress(what, at, total)
            yield found, at
        self.samples = at

    def _blocks(self) -> Iterator[np.ndarray]:
        import numpy as np

        size = 1 << (self._unit - 1).bit_length()  # a number has 1, 2, 4 or 8 bytes
        parts = self._parts()
        for name in parts:
            try:
                with self._zip.open(name) as part:
                    rest = b""
                    while data := part.read(_BLOCK * self._unit):
                        data = rest + data
                        whole = len(data) // self._unit * self._unit
                        rest = data[whole:]
                        if whole:
                            rows = np.frombuffer(data[:whole], dtype=np.uint8).reshape(-1, self._unit)
                            if size > self._unit:
                                rows = np.pad(rows, ((0, 0), (0, size - self._unit)))
                            yield rows.view(f"<u{size}")[:, 0]
            except _ZIP_ERRORS as error:
                if len(parts) == 1 or name != parts[-1]:
                    raise RecordingError(f"{self._name}: {name} cannot be read: {error}") from error
                self.facts.warnings["cut_file"] = (
                    f"the recording is cut off in its last part, {name}: {error}"
                )

    def _parts(self) -> list[str]:
        names = self._zip.namelist()
        numbered = [
            (int(match.group(1)), name)
            for name in names
            if (match := re.fullmatch(re.escape(self._capture) + r"-(\d{1,9})", name))
        ]
        if numbered:
            numbers = sorted(number for number, _ in numbered)
            if numbers != [*range(1, len(numbers) + 1)]:
                lost = next((at for at, number in enumerate(numbers, 1) if number != at), 0)
                part = f"{self._capture}-{lost}"
                raise RecordingError(f"{self._name}: {part} is missing, or a part is there twice")
            return [name for _, name in sorted(numbered)]
        if self._capture in names:
            return [self._capture]
        raise RecordingError(f"{self._name}: its samples {self._capture!r} are missing")


def merged(wires: list[list[Timed]]) -> Iterator[Chunk]:
    """Characters of all wires by time, in chunks of one wire."""
    if len(wires) == 1:
        if wires[0]:
            yield Chunk(wires[0])
        return
    every = sorted((char[1], wire, at) for wire, chars in enumerate(wires) for at, char in enumerate(chars))
    for wire, batch in groupby(every, itemgetter(1)):
        yield Chunk([wires[wire][at] for _, _, at in batch], wire)
