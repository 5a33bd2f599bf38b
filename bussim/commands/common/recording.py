"""Recordings of lines for commands: which line it is, and its characters in order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bussim.commands.common.port_options import parity_of, with_options
from bussim.errors import UsageError
from bussim.files import reading

if TYPE_CHECKING:
    from bussim.line.characters import LineTiming
    from bussim.live.layout.judge import Misfit
    from bussim.live.recordings.source import LineSetup, Progress, Source
    from bussim.live.sniff.line import FoundLine
    from bussim.live.sniff.listener import Listener
    from bussim.live.sniff.reading import Settings

#: Protocols of a recorded line; auto: what is recognised.
PROTOCOLS = ("auto", "nn", "modbus-rtu", "modbus-ascii")
_RATES = click.IntRange(1, 4_000_000)


_options = with_options(
    click.option(
        "--protocol",
        type=click.Choice(PROTOCOLS),
        default="auto",
        show_default=True,
        help="The protocol; auto: what is recognised.",
    ),
    click.option(
        "-b", "baud", metavar="N", type=_RATES, help="Rate, unless found (port: 38400, Modbus 19200)."
    ),
    click.option(
        "-d", "data_bits", type=click.IntRange(7, 8), help="Data bits, unless found (port: 7, RTU 8)."
    ),
    click.option("-s", "stop_bits", type=click.IntRange(1, 2), help="Stop bits, unless found (port: 1)."),
    click.option("-P", "parity", metavar="P", help="Parity: none, even, odd, unless found (port: even)."),
    click.option("--invert/--no-invert", "inverted", default=None, help="The line idles low, or high (.sr)."),
    click.option(
        "--layout",
        metavar="FILE",
        type=click.Path(path_type=Path),
        help="Layout of the N:N frames (default: the assumed one; bussim guide wires).",
    ),
    click.option("--bus", metavar="NAME", help="Name of the bus (line); in a trace: which one (the first)."),
    click.option(
        "--channel",
        metavar="NAME[,NAME]",
        help="Channel of a sigrok session, interface of a pcapng file; two: one for each direction.",
    ),
)


def line_options(function: Callable[..., None]) -> Callable[..., None]:
    """Adds the options for a line and its name; what they say comes as ``settings``, and ``bus``."""

    @wraps(function)
    def command(
        *, protocol: str, parity: str | None, channel: str | None, layout: Path | None, **options: Any
    ) -> None:
        from bussim.live.sniff.heard import LineProtocol
        from bussim.live.sniff.reading import Settings

        names = ("baud", "data_bits", "stop_bits", "inverted")
        given: dict[str, Any] = {}
        if layout is not None:
            from bussim.live.layout.file import load_layout

            if protocol not in ("auto", "nn"):
                raise UsageError(f"--layout is for N:N frames, not for --protocol {protocol}")
            given, protocol = {"layout": load_layout(layout)}, "nn"
        settings = Settings(
            **given,
            protocol=None if protocol == "auto" else LineProtocol(protocol),
            parity=None if parity is None else parity_of(parity),
            channels=tuple(filter(None, channel.split(","))) if channel else (),
            **{name: options.pop(name) for name in names},
        )
        function(settings=settings, **options)

    return _options(command)


@dataclass(frozen=True, slots=True)
class OpenLine:
    """A recording whose line is known. ``names`` are stations by number, ``tolerance`` is in ticks."""

    source: Source
    found: FoundLine
    bus: str
    names: dict[int, str]
    tolerance: int
    #: What is known of a polled line of another layout than the one by which it is read.
    misfit: Misfit | None = None

    @property
    def timing(self) -> LineTiming:
        """Rate and format of the line."""
        return self.found.reading.setup.timing

    def listener_options(self) -> dict[str, Any]:
        """What a listener has to know of it."""
        setup = self.found.reading.setup
        return {
            "exact": self.source.exact,
            "tolerance": self.tolerance if self.source.tolerant else 0,
            "wires": max(len(setup.channels), self.source.wires),
            "echo": self.found.reading.score.echo,
            "begin": self.source.begin,
            "names": self.names,
            "layout": setup.layout,
        }


def is_recording(source: str) -> bool:
    """Whether a source is a file or folder, and not a device of the system."""
    with reading(Path(source)):
        return Path(source).is_dir() or Path(source).is_file()


def open_line(
    source: str,
    settings: Settings,
    *,
    bus: str | None,
    tolerance: int,
    limit: int | None = None,
    progress: Progress | None = None,
) -> OpenLine:
    """A recording, and how it is read, up to a tick. Raises UsageError where it cannot be.

    ``progress`` is called while it is read.
    """
    from bussim.live.recordings.frames import TraceFile
    from bussim.live.recordings.open import open_recording
    from bussim.live.recordings.sigrok import SigrokFile
    from bussim.live.recordings.text import TextFile
    from bussim.live.sniff.line import find_line

    opened = open_recording(Path(source), bus=bus, channels=settings.channels)
    if settings.inverted is not None and not isinstance(opened, SigrokFile):
        raise UsageError(f"--invert and --no-invert are for sigrok sessions: {source} has no levels")
    if settings.channels and isinstance(opened, TraceFile | TextFile):
        raise UsageError(f"--channel is for sigrok sessions and packets: {source} has no channels")
    if progress is not None:
        opened.progress = progress
    name, names = bus or "line", dict[int, str]()
    if isinstance(opened, TraceFile):
        name = opened.bus.name
        others = [repr(each.name) for each in opened.header.buses if each.name != name]
        if bus is None and others:
            click.echo(f"this is bus {name!r}; with --bus also: {', '.join(others)}", err=True)
        names = {number: node for node, number in reversed(opened.bus.stations.items())}
    found = find_line(opened, settings, tolerance)
    setup, misfit = _setup_of_other_layout(opened, found, settings), None
    if setup is not None:
        from bussim.live.layout.judge import judge

        misfit = judge(opened, setup, name, limit)
    if misfit is not None and setup is not None:
        found = replace(found, reading=replace(found.reading, setup=setup))
    return OpenLine(opened, found, name, names, tolerance, misfit)


#: Where so many characters are in sound frames, nothing is wrong with the layout.
_FITS = 0.98


def _setup_of_other_layout(source: Source, found: FoundLine, settings: Settings) -> LineSetup | None:
    """How a line is read that may have another layout; None where its frames are read well."""
    from bussim.live.recordings.frames import TraceFile
    from bussim.live.sniff.heard import LineProtocol
    from bussim.live.sniff.line import rate_of

    score, protocol, setup = found.reading.score, found.reading.protocol, found.reading.setup
    other, fits = protocol not in (None, LineProtocol.NN), score.sound_characters >= _FITS * score.characters
    if isinstance(source, TraceFile) and source.header.seed is not None:
        return None  # a simulation has the assumed layout
    if found.suggested is not None or settings.protocol not in (None, LineProtocol.NN):
        return None
    if score.responses > 0 and (other or fits):
        return None
    if protocol is not LineProtocol.NN and not rate_of(source):
        setup = setup._replace(timing=settings.timing(LineProtocol.NN))
    return found.likely or setup


def read(line: OpenLine, listener: Listener | None, limit: int | None, most_frames: int | None = None) -> int:
    """Read a recording up to a tick, to the end of its listener (None: nothing is recognised).

    Or until it has had about so many frames. Returns the tick at which it ends.
    """
    last = 0
    end: int | None
    for chars, wire, lost in line.source.chunks(line.found.reading.setup):
        if most_frames is not None and listener is not None and listener.decoder.frames >= most_frames:
            end = last
            break
        if limit is not None and chars and chars[-1][2] > limit:
            end = limit
            break
        last = max(last, chars[-1][2])
        if listener is not None:
            if lost:
                listener.lost()
            listener.chars(chars, wire)
    else:
        end = line.source.end()
    if listener is not None:
        listener.close(end)
    return max(end or 0, last)
