"""``bussim serve``: nodes of a scenario on real ports, while the rest is simulated in real time."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bussim.commands.common.output import print_json
from bussim.commands.common.port_options import options_of, port_options
from bussim.commands.common.scenario_options import code_option, set_option, time_of, values_of
from bussim.wording import counted

if TYPE_CHECKING:
    from bussim.results.run_record import RunRecord
    from bussim.results.store.folder import RunFolder
    from bussim.scenario.model import Scenario
    from bussim.serve.session import Session


@click.command()
@click.argument("scenario", metavar="SCENARIO")
@click.argument("nodes", metavar="[NODE]...", nargs=-1)
@click.option("--port", "ports", metavar="NODE=URL", multiple=True, help="Serve a node on this port.")
@click.option("--for", "limit", metavar="T", help="Serve so long (default: until Ctrl-C).")
@click.option("--seed", metavar="N", help="Seed of all random numbers.")
@set_option
@click.option("--paced", is_flag=True, help="Space bytes at the line's rate, as a virtual port does not.")
@click.option("-o", "--out", metavar="DIR", help="Folder to write, as of a run.")
@click.option("--trace", is_flag=True, help="Also write every frame (to --out, else runs/NAME).")
@click.option(
    "--format", "fmt", type=click.Choice(["csv", "parquet"]), default="csv", help="Format of tables."
)
@click.option("--force", is_flag=True, help="Replace the folder of an earlier run.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON at the end.")
@code_option
@port_options
def command(
    scenario: str,
    nodes: tuple[str, ...],
    *,
    ports: tuple[str, ...],
    limit: str | None,
    seed: str | None,
    overrides: tuple[str, ...],
    paced: bool,
    out: str | None,
    trace: bool,
    fmt: str,
    force: bool,
    as_json: bool,
    allow_code: bool,
    tolerance: str,
    echo: bool,
    rs485: str,
) -> None:
    """Serve nodes of a scenario on real ports; the rest of it is simulated in real time.

    NODE is a PLC's link port (press1), another port (press1.COM3) or a device; without --port it is
    served on a new pseudo-terminal, whose name is printed. URLs: COM7, /dev/ttyUSB0, socket://HOST:PORT,
    rfc2217://HOST:PORT, pty, pty:LINK, listen://HOST:PORT. Nodes of one bus with the same URL share that
    wire. Nothing named: what can be served. Faults: those of the scenario, and `bussim inject`.
    """
    from bussim.live.stopping import Stopping
    from bussim.scenario import loader
    from bussim.serve.session import FOREVER, Session
    from bussim.serve.targets import targets

    values = values_of(overrides, seed=seed)
    loaded = loader.load(scenario, values, allow_code=allow_code)
    duration = FOREVER if limit is None else time_of("--for", limit)
    lines = targets(loaded, nodes, ports)
    options = options_of(tolerance=tolerance, echo=echo, rs485=rs485, paced=paced)
    with ExitStack() as stack:
        stop = stack.enter_context(Stopping())
        folder = _folder(stack, scenario, loaded, lines, out, fmt, trace=trace, force=force)
        session = Session(
            loaded,
            lines,
            options=options,
            rows=folder.rows if folder is not None else None,
            traced=folder is not None and trace,
            duration=duration,
            report=lambda text: click.echo(text, err=True),
        )
        with session:
            _serve(session, stop, Path(scenario).parent, allow_code=allow_code)
        record = session.record()
        results = folder.finish(record, _as_served(loaded, record)) if folder is not None else None
    _show(session, record, results, as_json=as_json)
    if results is not None:
        from bussim.results.pictures import draw_run

        draw_run(record, results)


def _folder(
    stack: ExitStack,
    source: str,
    scenario: Scenario,
    lines: tuple[Any, ...],
    out: str | None,
    fmt: str,
    *,
    trace: bool,
    force: bool,
) -> RunFolder | None:
    if out is None and not trace:
        return None
    from bussim.results.store.folder import RunFolder
    from bussim.results.store.safe_names import file_name
    from bussim.serve.session import session_header

    target = Path("runs") / file_name(Path(source).stem) if out is None else Path(out)
    folder = RunFolder(
        target,
        rows=True,
        traced=trace,
        fmt=fmt,
        force=force,
        numbered=out is None and not force,
        header=session_header(scenario, lines),
        live=True,
    )
    return stack.enter_context(folder)


def _serve(session: Session, stop: Any, folder: Path, *, allow_code: bool) -> None:
    from bussim.serve.control import ControlServer
    from bussim.serve.requests import SessionRequests

    for text in session.described():  # for people and, by its last word, for programs
        click.echo(text, err=True)
    for text in session.hints():
        click.echo(text, err=True)
    click.echo("Ctrl-C ends it.", err=True)
    requests = SessionRequests(session, allow_code=allow_code, folder=folder)
    control = ControlServer(session.scenario.name, requests)
    interval = sys.getswitchinterval()
    # What is injected is checked in another thread, which must not keep this one waiting.
    sys.setswitchinterval(0.0005)
    try:
        session.run(stop)
    finally:
        sys.setswitchinterval(interval)
        control.close()


def _as_served(scenario: Scenario, record: RunRecord) -> str:
    from dataclasses import replace

    from bussim.scenario.yaml.dump import dumps
    from bussim.version import __version__

    # A scenario lasts a microsecond at least.
    lasted = replace(scenario, duration=max(record.duration, 72))
    return f"# As served by bussim {__version__}, with every default filled in.\n{dumps(lasted)}"


def _show(session: Session, record: RunRecord, results: Path | None, *, as_json: bool) -> None:
    if as_json:
        print_json(record.summary)
        return
    from rich.console import Console

    from bussim.results.text.run import show_result

    names = {link.bus: link.station_names for link in session.totals().links}
    show_result(Console(highlight=False), record, names)
    for line, counts in record.summary["served"]["lines"].items():
        click.echo(
            f"{line}: {counted(counts['received'], 'byte')} in, {counts['sent']:,} out, "
            f"{counts['dropped']:,} dropped, lost {counted(counts['losses'], 'time')}"
            + (f" for {counts['away_s']:.1f} s" if counts["losses"] else "")
        )
    late = record.summary["served"]["late_ms"]
    click.echo(f"late: {late['mean']:.3f} ms on average, {late['max']:.3f} ms at most")
    if results is not None:
        click.echo(f"results: {results}")
