"""``bussim sniff``: listen to a line, or read a recording of one."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bussim.commands.common.output import checked_target, print_json, write_text
from bussim.commands.common.port_options import options_of, port_options
from bussim.commands.common.progress import progress_bar
from bussim.commands.common.recording import is_recording, line_options, open_line, read
from bussim.commands.common.scenario_options import time_of
from bussim.errors import RunError, UsageError

if TYPE_CHECKING:
    from bussim.commands.common.recording import OpenLine
    from bussim.commands.sniff.tally import Tally
    from bussim.line.characters import LineTiming
    from bussim.live.layout.judge import Misfit
    from bussim.live.sniff.heard import LineProtocol
    from bussim.live.sniff.listener import Listener
    from bussim.live.sniff.reading import Settings
    from bussim.live.sniff.recognise import Recogniser
    from bussim.results.store.folder import RunFolder


@click.command()
@click.argument("source", metavar="URL|FILE")
@line_options
@click.option("--bridge", metavar="URL", help="Hand every byte on to this port, and back: listen in between.")
@click.option("--for", "--duration", "duration", metavar="T", help="Listen so long (default: until Ctrl-C).")
@click.option("-o", "--out", metavar="DIR", help="Record: write a folder as of a run, with its trace.")
@click.option("--force", is_flag=True, help="Replace the folder of an earlier run, or the file.")
@click.option("--propose", metavar="FILE", help="Where no layout fits, write the one that is proposed.")
@click.option("--json", "as_json", is_flag=True, help="Print what was heard as JSON.")
@port_options
def command(
    source: str,
    *,
    settings: Settings,
    bus: str | None,
    bridge: str | None,
    duration: str | None,
    out: str | None,
    force: bool,
    propose: str | None,
    as_json: bool,
    tolerance: str,
    echo: bool,
    rs485: str,
) -> None:
    """Listen to a line and show frames, errors, response times, link scan times and load.

    URL is a port (COM7, /dev/ttyUSB0, socket://HOST:PORT, pty); FILE is a run's folder or trace.jsonl,
    a pcapng or pcap file, a sigrok session (.sr), or a text file with times and bytes (bussim guide wires).
    Rate, format, polarity, channel and protocol of a recording are found where they are not said. Nothing is
    ever sent, except with --bridge.
    """
    settings = replace(settings, echo=echo or None)
    options = options_of(tolerance=tolerance, echo=echo, rs485=rs485)
    limit = None if duration is None else time_of("--for", duration)
    target = None if propose is None else checked_target(Path(propose), (), force=force, option="--propose")
    with ExitStack() as stack:
        if not is_recording(source):
            if settings.inverted is not None or settings.channels:
                raise UsageError("--invert, --no-invert and --channel are for recordings: a port has neither")
            if target is not None:
                raise UsageError(
                    "--propose takes a recording of a logic analyser: a port does not tell the silences"
                )
            from bussim.commands.sniff.listen import listen
            from bussim.live.sniff.recognise import Recogniser

            timing = settings.timing(None)
            session = _Session(bus or "line", timing, settings.protocol, {}, exact=False)
            session.record(stack, out, force=force)
            recogniser = Recogniser(
                lambda found: session.listener(
                    found,
                    exact=False,
                    tolerance=options.tolerance,
                    echo=settings.echo,
                    layout=settings.layout,
                ),
                timing,
                options.tolerance,
                settings.protocol,
            )
            picture = session.display(recogniser) if sys.stdout.isatty() and not as_json else None
            ended = listen(source, bridge, timing, options, recogniser, limit, picture)
            recogniser.close(ended)
            session.finish(source, ended, recogniser.listener, as_json=as_json)
            return
        if bridge is not None:
            raise UsageError("--bridge joins two ports; a recording has none")
        with progress_bar() as progress:
            line = open_line(
                source, settings, bus=bus, tolerance=options.tolerance, limit=limit, progress=progress
            )
            found, kept = line.found.reading, line.source
            session = _Session(line.bus, line.timing, found.protocol, line.names, exact=kept.exact)
            session.record(stack, out, force=force)
            listener = None
            if line.misfit is not None:
                line.misfit.record(session.tally)
            elif found.protocol is not None:
                listener = session.listener(found.protocol, **line.listener_options())
            ended = read(line, listener, limit)
        session.finish(source, ended, listener, as_json=as_json, line=line)
        if target is not None:
            _propose(line, source, target)


def _propose(line: OpenLine, source: str, target: Path) -> None:
    """Write the layout that is proposed. Raises RunError where there is none."""
    from bussim.commands.sniff.tally import PROPOSED
    from bussim.live.layout.file import to_text

    if line.misfit is None:
        click.echo(f"{target} is not written: no line of another layout is seen", err=True)
    elif line.misfit.proposed is None:
        raise RunError(f"{source}: none of the usual layouts fits; {target} is not written")
    else:
        write_text(target, to_text(line.misfit.proposed, PROPOSED))
        click.echo(f"layout: {target}", err=True)


class _Session:
    """Listener, counts and folder of one command. ``names`` are stations by number."""

    def __init__(
        self,
        bus: str,
        timing: LineTiming,
        protocol: LineProtocol | None,
        names: dict[int, str],
        *,
        exact: bool,
    ) -> None:
        self.bus, self.timing, self.protocol, self.names = bus, timing, protocol, names
        self.exact = exact
        self.folder: RunFolder | None = None
        self.tally: Tally

    def record(self, stack: ExitStack, out: str | None, *, force: bool) -> None:
        """Begin the folder that is written, if one is."""
        from bussim.commands.sniff.tally import Tally
        from bussim.line.characters import NN_LINE
        from bussim.live.sniff.heard import BUS_PROTOCOLS, LineProtocol
        from bussim.live.sniff.link import station_name
        from bussim.results.store.folder import RunFolder
        from bussim.trace.records import TraceBus, TraceHeader

        if out is not None:
            likely = LineProtocol.NN if self.timing == NN_LINE else LineProtocol.RTU
            shared = BUS_PROTOCOLS[self.protocol or likely]
            stations = {name: number for number, name in sorted(self.names.items())}
            form = str(self.timing.format)
            line = TraceBus(self.bus, shared, self.timing.baud, form, tuple(stations), stations)
            header = TraceHeader(buses=(line,), scenario=self.bus, exact=self.exact)
            folder = RunFolder(
                Path(out), rows=True, traced=True, fmt="csv", force=force, header=header, live=True
            )
            self.folder = stack.enter_context(folder)
        rows = self.folder.rows if self.folder is not None else None
        master = self.names.get(0, station_name(0))
        self.tally = Tally(traced=rows is not None, rows=rows, bus_of={master: self.bus})

    def listener(self, protocol: LineProtocol, **options: Any) -> Listener:
        """The listener of a protocol."""
        from bussim.live.sniff.listener import Listener

        return Listener(self.bus, self.timing, self.tally, protocol, **options)

    def display(self, recogniser: Recogniser) -> Callable[[int], object]:
        """What shows the state at a tick."""
        from bussim.commands.sniff.tally import show, to_json

        return lambda now: show(to_json(recogniser.listener, self.tally, self.timing, now, exact=self.exact))

    def finish(
        self,
        source: str,
        duration: int,
        listener: Listener | None,
        *,
        as_json: bool,
        line: OpenLine | None = None,
    ) -> None:
        """Nothing more will be heard: print, and complete the folder."""
        from bussim.commands.common.console import wide_console
        from bussim.commands.sniff.tally import show, to_json

        found = to_json(listener, self.tally, self.timing, duration, exact=self.exact, line=line)
        if self.folder is not None:
            misfit = None if line is None else line.misfit
            self._complete(self.folder, source, duration, listener, misfit)
        if as_json:
            print_json({"source": source, **found})
            return
        wide_console().print(show(found))
        if self.folder is not None:
            click.echo(f"recorded: {self.folder.target}")

    def _complete(
        self, folder: RunFolder, source: str, duration: int, listener: Listener | None, misfit: Misfit | None
    ) -> None:
        from bussim.results.pictures import draw_run
        from bussim.trace.records import RunTotals
        from bussim.version import __version__

        warnings = () if self.exact else ("times are the operating system's, not the wire's",)
        totals = RunTotals(duration, (), (), warnings, ())
        if listener is not None:
            totals = listener.totals(duration, warnings)
        elif misfit is not None:
            totals = RunTotals(duration, (misfit.totals(),), (), warnings, ())
        record = self.tally.run(totals, scenario=self.bus, seed=0)
        text = f"# Recorded by bussim {__version__} from {source}; bussim fit makes a scenario of it.\n"
        draw_run(record, folder.finish(record, text))
