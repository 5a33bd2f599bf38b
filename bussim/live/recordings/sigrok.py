"""sigrok session files (``.sr``, of PulseView and sigrok-cli): logic samples through a UART.

A session is a ZIP archive: ``metadata`` names the sample rate, the channels and the bytes a sample,
``logic-1-1``, ``logic-1-2``, … hold the samples (sigrok wiki, "File format: sigrok/v2"). One
channel is the line, high when idle; an RS485 receiver's output is.
"""

from __future__ import annotations

import configparser
import lzma
import re
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from bussim.engines.contract import RxChar
from bussim.line.characters import LineTiming
from bussim.line.uart import Uart
from bussim.line.wave import Wave
from bussim.live.arrival import Timed
from bussim.live.recordings.errors import RecordingError
from bussim.units import TICKS_PER_SECOND

if TYPE_CHECKING:
    import numpy as np

_RATE = re.compile(r"\s*(\d+(?:\.\d+)?)\s*([kKMG]?)\s*(?:Hz)?\s*")
_SCALES = {"": 1, "k": 1_000, "K": 1_000, "M": 1_000_000, "G": 1_000_000_000}
#: Samples that are read at once.
_BLOCK = 1 << 20
#: Times that the line may go low: hours of a busy line; more would take gigabytes.
MOST_LOWS = 20_000_000
_LARGEST_METADATA = 1 << 20
#: Samples of a bit below which a UART model cannot decode a character.
_LEAST_SAMPLES = 4
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


class SigrokFile:
    """A session file. Raises RecordingError for what is none, and where it cannot be a serial line's."""

    def __init__(self, path: Path, channel: str | None = None) -> None:
        self._name = str(path)
        try:
            self._zip = zipfile.ZipFile(path)
        except (OSError, zipfile.BadZipFile) as error:
            raise RecordingError(f"{path}: no sigrok session: {error}") from error
        try:
            self._read_metadata(channel)
        except RecordingError:
            self._zip.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._zip.close()

    def _read_metadata(self, channel: str | None) -> None:
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
        section = next(
            (
                config[s]
                for s in config.sections()
                if "samplerate" in config[s] and "capturefile" in config[s]
            ),
            None,
        )
        if section is None:
            raise RecordingError(f"{self._name}: it has no logic samples with a sample rate")
        match = _RATE.fullmatch(section["samplerate"])
        if match is None:
            raise RecordingError(f"{self._name}: the sample rate is {section['samplerate'][:40]!r}")
        #: Samples a second.
        self.rate = round(float(match.group(1)) * _SCALES[match.group(2)])
        unit = section.get("unitsize", "1").strip()
        self._unit = int(unit) if unit.isascii() and unit.isdigit() and len(unit) < 3 else 0
        if not self.rate or self.rate > 10**11 or not 1 <= self._unit <= 8:
            raise RecordingError(f"{self._name}: {self.rate} samples a second of {unit[:8]} bytes")
        #: Channels by name, with the number of their bit.
        self.channels = {
            section[key].strip(): int(key[5:]) - 1
            for key in section
            if re.fullmatch(r"probe\d{1,2}", key) and 1 <= int(key[5:]) <= 8 * self._unit
        }
        if not self.channels:
            raise RecordingError(f"{self._name}: it has no logic channels")
        if channel is not None and channel not in self.channels:
            raise RecordingError(
                f"{self._name}: it has no channel {channel!r}, but {', '.join(self.channels)}"
            )
        self._bit = self.channels[channel if channel is not None else next(iter(self.channels))]
        self._capture = section["capturefile"].strip()

    def characters(self, timing: LineTiming) -> Iterator[list[Timed]]:
        """What a UART of this rate and format hears on the line, in chunks."""
        if self.rate < _LEAST_SAMPLES * timing.baud:
            raise RecordingError(
                f"{self._name}: {self.rate:,} samples a second are too few for {timing.baud:,} bps; "
                f"at least {_LEAST_SAMPLES * timing.baud:,} are needed"
            )
        wave = Wave([self._lows()])
        uart, ready = Uart(timing), 0
        chunk: list[Timed] = []
        while (heard := uart.next_character(wave, ready)) is not None:
            chunk.append((RxChar(heard.value, heard.parity_ok, heard.stop_ok), heard.start, heard.end))
            ready = heard.ready
            if len(chunk) >= 256:
                yield chunk
                chunk = []
        if chunk:
            yield chunk

    def _lows(self) -> list[tuple[int, int]]:
        """When the line was low, in ticks."""
        import numpy as np

        edges: list[int] = []
        level, at = 1, 0
        for bits in self._blocks():
            changed = np.flatnonzero(np.diff(bits, prepend=np.uint8(level)))
            edges += (changed + at).tolist()
            if len(edges) > 2 * MOST_LOWS:
                raise RecordingError(f"{self._name}: the line goes low more than {MOST_LOWS:,} times")
            level = int(bits[-1])
            at += len(bits)
        if len(edges) % 2:
            edges.append(at)
        scale = TICKS_PER_SECOND
        ticks = [(2 * edge * scale + self.rate) // (2 * self.rate) for edge in edges]
        return list(zip(ticks[::2], ticks[1::2], strict=True))

    def _blocks(self) -> Iterator[np.ndarray]:
        """The channel's level, sample by sample, in blocks."""
        import numpy as np

        byte, shift = divmod(self._bit, 8)
        for name in self._parts():
            try:
                with self._zip.open(name) as part:
                    rest = b""
                    while data := part.read(_BLOCK * self._unit):
                        data = rest + data
                        whole = len(data) // self._unit * self._unit
                        rest = data[whole:]
                        if whole:
                            samples = np.frombuffer(data[:whole], dtype=np.uint8)[byte :: self._unit]
                            yield (samples >> shift) & 1
            except _ZIP_ERRORS as error:
                raise RecordingError(f"{self._name}: {name} cannot be read: {error}") from error

    def _parts(self) -> list[str]:
        names = self._zip.namelist()
        numbered = [
            (int(match.group(1)), name)
            for name in names
            if (match := re.fullmatch(re.escape(self._capture) + r"-(\d{1,9})", name))
        ]
        if numbered:
            return [name for _, name in sorted(numbered)]
        if self._capture in names:
            return [self._capture]
        raise RecordingError(f"{self._name}: its samples {self._capture!r} are missing")
