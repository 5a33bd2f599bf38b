"""``bussim sniff``: listen to a line, or read a recording of one."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bussim.commands.common.output import print_json
from bussim.commands.common.port_options import options_of, port_options
from bussim.commands.common.recording import is_recording, known_line, line_of, line_options, read
from bussim.commands.common.times import time_of
from bussim.errors import UsageError
from bussim.line.protocols import BusProtocol

if TYPE_CHECKING:
    from bussim.commands.common.recording import KnownLine
    from bussim.commands.sniff.tally import Tally
    from bussim.live.sniff.heard import LineProtocol
    from bussim.live.sniff.listener import Listener
    from bussim.results.store.folder import RunFolder


@click.command()
@click.argument("source", metavar="URL|FILE")
@line_options
@click.option("--bridge", metavar="URL", help="Hand every byte on to this port, and back: listen in between.")
@click.option("--for", "--duration", "duration", metavar="T", help="Listen so long (default: until Ctrl-C).")
@click.option("--out", metavar="DIR", help="Record: write a folder as of a run, with its trace.")
@click.option("--force", is_flag=True, help="Replace the folder of an earlier run.")
@click.option("--json", "as_json", is_flag=True, help="Print what was heard as JSON.")
@port_options
def command(
    source: str,
    *,
    protocol: str,
    baud: int | None,
    data_bits: int | None,
    stop_bits: int | None,
    parity: str | None,
    bus: str | None,
    channel: str | None,
    bridge: str | None,
    duration: str | None,
    out: str | None,
    force: bool,
    as_json: bool,
    tolerance: str,
    echo: bool,
    rs485: str,
) -> None:
    """Listen to a line and show frames, errors, response times, link scan times and load.

    URL is a port (COM7, /dev/ttyUSB0, socket://HOST:PORT, pty); FILE is a run's folder or trace.jsonl,
    a pcapng file, a sigrok session (.sr), or a text file of lines "seconds hexbytes". Nothing is ever
    sent, except with --bridge.
    """
    from bussim.live.recordings.open import Kind, kind_of
    from bussim.live.sniff.heard import LineProtocol

    known = None if protocol == "auto" else LineProtocol(protocol)
    timing = line_of(known, baud, data_bits=data_bits, parity=parity, stop_bits=stop_bits)
    options = options_of(tolerance=tolerance, echo=echo, rs485=rs485)
    limit = None if duration is None else time_of("--for", duration)
    kind = kind_of(Path(source)) if is_recording(source) else None
    if kind is not None and bridge is not None:
        raise UsageError("--bridge joins two ports; a recording has none")
    line = known_line(source, kind, timing, bus)
    gap = options.tolerance if kind in (None, Kind.RAW) else 0
    with ExitStack() as stack:
        session = _Session(stack, line, known, gap, out=out, force=force)
        if kind is None:
            from bussim.commands.sniff.listen import listen

            ended = listen(
                source, bridge, line.timing, options, session.listener, limit, session.display(as_json)
            )
        else:
            ended = read(Path(source), kind, session.listener, channel, limit)
        session.finish(source, ended, as_json=as_json)


class _Session:
    """Listener, counts and folder of one command."""

    def __init__(
        self,
        stack: ExitStack,
        known: KnownLine,
        protocol: LineProtocol | None,
        tolerance: int,
        *,
        out: str | None,
        force: bool,
    ) -> None:
        from bussim.commands.sniff.tally import Tally
        from bussim.line.characters import NN_LINE
        from bussim.live.sniff.heard import LineProtocol
        from bussim.live.sniff.link import station_name
        from bussim.live.sniff.listener import Listener
        from bussim.results.store.folder import RunFolder
        from bussim.trace.records import TraceBus, TraceHeader

        bus, timing, names = known.bus, known.timing, known.names
        self.exact = known.exact
        self.folder: RunFolder | None = None
        if out is not None:
            link = protocol is LineProtocol.NN or (protocol is None and timing == NN_LINE)
            shared = BusProtocol.NN if link else BusProtocol.SERIAL
            stations = {name: number for number, name in sorted(names.items())}
            line = TraceBus(bus, shared, timing.baud, str(timing.format), tuple(stations), stations)
            header = TraceHeader(buses=(line,), scenario=bus, exact=known.exact)
            folder = RunFolder(Path(out), rows=True, traced=True, fmt="csv", force=force, header=header)
            self.folder = stack.enter_context(folder)
        rows = self.folder.rows if self.folder is not None else None
        master = names.get(0, station_name(0))
        self.tally: Tally = Tally(traced=rows is not None, rows=rows, bus_of={master: bus})
        self.listener: Listener = Listener(
            bus, timing, self.tally, tolerance=tolerance, protocol=protocol, names=names
        )

    def display(self, as_json: bool) -> Callable[[int], object] | None:  # noqa: FBT001 (private)
        """What shows the state at a tick, None where stdout is no terminal."""
        if as_json or not sys.stdout.isatty():
            return None
        from bussim.commands.sniff.tally import show

        return lambda now: show(self.listener, self.tally, now, exact=self.exact)

    def finish(self, source: str, duration: int, *, as_json: bool) -> None:
        """Nothing more will be heard: print, and complete the folder."""
        from bussim.commands.common.console import wide_console
        from bussim.commands.sniff.tally import show, to_json

        self.listener.close()
        duration = max(duration, self.listener.last)
        if self.folder is not None:
            self._record(source, duration)
        if as_json:
            found = to_json(self.listener, self.tally, duration, exact=self.exact)
            print_json({"source": source, **found})
            return
        wide_console().print(show(self.listener, self.tally, duration, exact=self.exact))
        if self.folder is not None:
            click.echo(f"recorded: {self.folder.target}")

    def _record(self, source: str, duration: int) -> None:
        from bussim.version import __version__

        assert self.folder is not None  # noqa: S101 - narrows the type
        warnings = () if self.exact else ("times are the operating system's, not the wire's",)
        totals = self.listener.totals(duration, warnings)
        record = self.tally.run(totals, scenario=self.listener.bus, seed=0)
        text = f"# Recorded by bussim {__version__} from {source}; bussim fit makes a scenario of it.\n"
        self.folder.finish(record, text)
