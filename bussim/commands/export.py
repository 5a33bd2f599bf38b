"""``bussim export``: a traced run for Wireshark, PulseView, Perfetto or a spreadsheet."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from bussim.commands.common.output import print_json
from bussim.commands.common.scenario_options import time_of
from bussim.errors import UsageError
from bussim.export.formats import FORMATS
from bussim.files import reading

if TYPE_CHECKING:
    from bussim.export.selection import Written
    from bussim.trace.file import Trace


def _formats() -> str:
    """The formats by the tools that read them, for ``--help``."""
    tools: dict[str, list[str]] = {}
    for name, form in FORMATS.items():
        tools.setdefault(form.tool, []).append(name)
    return "; ".join(f"{', '.join(names)}: {tool}" for tool, names in tools.items()) + "."


@click.command()
@click.argument("run", metavar="RUN_DIR")
@click.option("--to", "fmt", type=click.Choice(list(FORMATS)), required=True, help=_formats())
@click.option("--bus", metavar="NAME", help="Only this bus (default: every one).")
@click.option("--from", "since", metavar="T", help="Begin so long after the run's start, such as 10s.")
@click.option("--to-time", "until", metavar="T", help="End so long after the run's start, such as 12s.")
@click.option(
    "--encap",
    type=click.Choice(["serial", "udp"]),
    help="pcapng: Modbus RTU as on the line (default), or in UDP, which distinguishes request and response.",
)
@click.option("-o", "--out", metavar="FILE", help="Where to (default: a file in the run's folder).")
@click.option("--force", is_flag=True, help="Replace the file if it exists.")
@click.option("--json", "as_json", is_flag=True, help="Print what was written as JSON.")
def command(
    run: str,
    *,
    fmt: str,
    bus: str | None,
    since: str | None,
    until: str | None,
    encap: str | None,
    out: str | None,
    force: bool,
    as_json: bool,
) -> None:
    """Export a traced run: its frames as packets, its waveform, its tracks, or a table.

    Needs a run with --trace. Prints the file, and how the tool that opens it is set up.
    """
    from bussim.commands.common.output import busy, checked_target, traced_again, whole_trace
    from bussim.export.formats import export_trace
    from bussim.results.store.load import load_run
    from bussim.trace.file import TRACE

    if encap is not None and fmt != "pcapng":
        raise UsageError(f"--encap goes with --to pcapng, not with {fmt}")
    start, stop = _window(since, until)
    folder = Path(run)
    with reading(folder):
        if not folder.exists():
            raise UsageError(f"{folder} does not exist; name the folder of a run")
        if folder.is_dir() and not (folder / TRACE).is_file():
            load_run(folder)  # raises UsageError for a folder that is not a run's
            raise UsageError(f"{folder} has no trace to export; get one with {traced_again(folder)}")
    trace = whole_trace(folder)
    path = _default(folder, fmt, trace, bus) if out is None else Path(out)
    target = checked_target(path, [FORMATS[fmt].ending], force=force)
    with busy(f"writing {target}"):
        done = export_trace(
            trace, target, fmt, bus=bus, start=start, stop=stop, encapsulation=encap or "serial"
        )
    if as_json:
        print_json(_as_json(target, done, fmt))
        return
    click.echo(target)
    for hint in done.hints:
        click.echo(hint)


def _window(since: str | None, until: str | None) -> tuple[int | None, int | None]:
    start = None if since is None else time_of("--from", since)
    stop = None if until is None else time_of("--to-time", until)
    if stop is not None and stop <= (start or 0):
        after = f"after --from {since}" if since is not None else "above 0"
        raise UsageError(f"--to-time is {until}, it must be {after}")
    return start, stop


def _default(folder: Path, fmt: str, trace: Trace, bus: str | None) -> Path:
    from bussim.results.store.safe_names import file_names

    stem, ending = FORMATS[fmt].stem, FORMATS[fmt].ending
    if bus is not None:
        safe = file_names(each.name for each in trace.header.buses)
        stem += f"_{safe.get(bus, '')}"
    return (folder if folder.is_dir() else folder.parent) / f"{stem}{ending}"


def _as_json(target: Path, done: Written, fmt: str) -> dict[str, object]:
    return {
        "schema": 1,
        "file": str(target),
        "format": fmt,
        FORMATS[fmt].items: done.items,
        "buses": list(done.buses),
        "open_with": list(done.hints),
    }
