"""Recordings of lines for commands: which bus, which line, and their frames in order."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bussim.commands.common.port_options import format_of, with_options

if TYPE_CHECKING:
    from bussim.line.characters import LineTiming
    from bussim.live.recordings.open import Kind
    from bussim.live.sniff.heard import LineProtocol
    from bussim.live.sniff.listener import Listener


#: Protocols of a recorded line; auto: what is recognised.
PROTOCOLS = ("auto", "nn", "modbus-rtu", "modbus-ascii")
_RATES = click.IntRange(1, 4_000_000)


#: Adds the options for the protocol, format and name of a line.
line_options = with_options(
    click.option(
        "--protocol",
        type=click.Choice(PROTOCOLS),
        default="auto",
        show_default=True,
        help="What is spoken; auto: what is recognised.",
    ),
    click.option("-b", "baud", metavar="N", type=_RATES, help="Rate (38400; Modbus 19200)."),
    click.option("-d", "data_bits", type=click.IntRange(7, 8), help="Data bits (7; RTU 8)."),
    click.option("-s", "stop_bits", type=click.IntRange(1, 2), help="Stop bits (1)."),
    click.option("-P", "parity", metavar="P", help="Parity: none, even (default) or odd."),
    click.option("--bus", metavar="NAME", help="Name of the bus (line); in a trace: which one (the first)."),
    click.option(
        "--channel", metavar="NAME", help="Channel of a sigrok session, interface of a pcapng file."
    ),
)


@dataclass(frozen=True, slots=True)
class KnownLine:
    """What is known of a line before anything of it is read; ``exact``: the times of a recording are."""

    bus: str
    timing: LineTiming
    names: dict[int, str]
    exact: bool


def known_line(source: str, kind: Kind | None, timing: LineTiming, name: str | None) -> KnownLine:
    """The line of a recording: of a trace (the bus of that name, else the first) as it says itself.

    ``kind`` is None for a port. Raises UsageError for a trace without such a bus.
    """
    from bussim.line.characters import CharFormat, LineTiming
    from bussim.live.recordings.open import Kind
    from bussim.trace.file import read_trace

    if kind is not Kind.TRACE:
        return KnownLine(name or "line", timing, {}, kind in (Kind.SIGROK, Kind.PCAPNG))
    trace = read_trace(source)
    buses = trace.header.buses
    if name is None and (others := [repr(bus.name) for bus in buses[1:]]):
        click.echo(f"this is bus {buses[0].name!r}; with --bus also: {', '.join(others)}", err=True)
    bus = buses[0] if name is None and buses else trace.bus(name or "line")
    names = {number: node for node, number in reversed(bus.stations.items())}
    timing = LineTiming(bus.baud, CharFormat.parse(bus.format))
    return KnownLine(bus.name, timing, names, trace.header.exact)


def is_recording(source: str) -> bool:
    """Whether a source is a file or folder, and not a device of the system."""
    path = Path(source)
    return path.is_dir() or path.is_file()


def line_of(
    protocol: LineProtocol | None,
    baud: int | None,
    *,
    data_bits: int | None,
    parity: str | None,
    stop_bits: int | None,
) -> LineTiming:
    """Rate and format: what is given, the rest as usual for the protocol (auto: the N:N link)."""
    from bussim.engines.modbus.adu import Mode
    from bussim.line.characters import NN_LINE, LineTiming
    from bussim.live.modbus import STANDARD_FORMATS
    from bussim.live.sniff.heard import LineProtocol

    if protocol in (None, LineProtocol.NN):
        usual, rate = NN_LINE.format, NN_LINE.baud
    else:
        usual = STANDARD_FORMATS[Mode.RTU if protocol is LineProtocol.RTU else Mode.ASCII]
        rate = 19200
    fmt = format_of(usual, data_bits=data_bits, parity=parity, stop_bits=stop_bits)
    return LineTiming(baud or rate, fmt)


def read(path: Path, kind: Kind, listener: Listener, channel: str | None, limit: int | None) -> int:
    """Read a recording up to a tick, to the end of its listener; returns when it ends."""
    from bussim.live.recordings.open import Kind, characters

    last = 0
    if kind is Kind.TRACE:
        last = _trace(path, listener, limit)
    else:
        for chars in characters(path, kind, listener.timing, channel=channel):
            if limit is not None and chars[-1][2] > limit:
                last = limit
                break
            last = chars[-1][2]
            listener.chars(chars)
    listener.close()
    return last


def _trace(path: Path, listener: Listener, limit: int | None) -> int:
    from bussim.live.recordings.frames import heard_of
    from bussim.trace.file import read_trace
    from bussim.trace.records import FrameRecord

    trace = read_trace(path)
    last = 0
    for record in trace.of(FrameRecord, bus=listener.bus):
        if limit is not None and record.end > limit:
            return limit
        heard = heard_of(record)
        if heard is not None:
            listener.heard(heard)
        last = max(last, record.end)
    if limit is None and trace.header.duration is not None:
        last = max(last, trace.header.duration)
    return last
