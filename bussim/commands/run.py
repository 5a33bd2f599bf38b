"""``bussim run``: simulate a scenario and write its results."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from bussim.api import Result

#: Shorter runs need no progress bar (seconds).
_PATIENCE = 2.0


@click.command()
@click.argument("scenario", metavar="[SCENARIO]", required=False)
@click.option("--duration", metavar="T", help="Simulate so long, such as 90s or 10h.")
@click.option("--seed", metavar="N", help="Seed of all random numbers.")
@click.option(
    "--set", "overrides", metavar="KEY.PATH=VALUE", multiple=True, help="Set a value of the scenario."
)
@click.option(
    "--out", metavar="DIR", help="Folder to write (default: runs/NAME, with a number if it exists)."
)
@click.option("--trace", is_flag=True, help="Also write every attempt, frame and event.")
@click.option("--no-rows", is_flag=True, help="Write no tables, only statistics.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
@click.option(
    "--format", "fmt", type=click.Choice(["csv", "parquet"]), default="csv", help="Format of the tables."
)
@click.option("--force", is_flag=True, help="Replace the folder of an earlier run.")
@click.option(
    "--allow-code",
    is_flag=True,
    help="Load the Python functions that the scenario names; they can do anything.",
)
def command(
    scenario: str | None,
    *,
    duration: str | None,
    seed: str | None,
    overrides: tuple[str, ...],
    out: str | None,
    trace: bool,
    no_rows: bool,
    as_json: bool,
    fmt: str,
    force: bool,
    allow_code: bool,
) -> None:
    """Simulate a scenario and write its results.

    SCENARIO is a file or the name of a built-in scenario; without it the built-in press_line runs.
    """
    from bussim import api
    from bussim.results.names import file_name
    from bussim.scenario import loader
    from bussim.scenario.builtin import DEFAULT
    from bussim.scenario.overrides import Override

    source = DEFAULT if scenario is None else scenario
    values: list[str | Override] = list(overrides)
    for key, value in (("duration", duration), ("seed", seed)):
        if value is not None:
            values.append(Override(key, value, f"--{key} {value}"))
    loaded = loader.load(source, values, allow_code=allow_code)
    target = Path("runs") / file_name(Path(source).stem) if out is None else Path(out)
    try:
        with _progress_bar() as progress:
            result = api.run(
                loaded,
                out=target,
                trace=trace,
                rows=not no_rows,
                format=fmt,
                force=force,
                numbered=out is None and not force,
                progress=progress,
            )
    except KeyboardInterrupt:
        click.echo("stopped: the run was not finished and left no results", err=True)
        raise
    if as_json:
        click.echo(json.dumps(result.summary, ensure_ascii=False, allow_nan=False, indent=2))
    else:
        _show(result)


def _show(result: Result) -> None:
    from rich.console import Console

    from bussim.results.text import show_result

    names = {link.bus: link.station_names for link in result.totals.links} if result.totals else {}
    console = Console(highlight=False)
    show_result(console, result.record, names)
    if result.folder is not None:
        kinds = ("scan_time_*.png", "response_time_*.png", "latency_*.png")
        pictures = [path for kind in kinds for path in sorted(result.folder.glob(kind))]
        click.echo(f"\nresults: {result.folder}")
        for picture in pictures:
            click.echo(f"picture: {picture}")


@contextmanager
def _progress_bar() -> Iterator[Callable[[int, int], None] | None]:
    """A progress bar on stderr, only on a terminal and only for a run that takes its time."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    begun = time.monotonic()
    bar = Progress(console=Console(stderr=True), transient=True)
    task = bar.add_task("simulating", total=None)

    def progress(done: int, total: int) -> None:
        if not bar.live.is_started and time.monotonic() - begun > _PATIENCE:
            bar.start()
        bar.update(task, completed=done, total=total)

    try:
        yield progress
    finally:
        if bar.live.is_started:
            bar.stop()
