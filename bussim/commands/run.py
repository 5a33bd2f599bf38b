"""``bussim run``: simulate a scenario and write its results."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from bussim.commands.common.drawing import import_matplotlib
from bussim.commands.common.output import checked_target, print_json, show_carried, write_text
from bussim.commands.common.scenario_options import (
    code_option,
    lang_option,
    set_option,
    unsimulated_option,
    values_of,
)
from bussim.errors import UsageError
from bussim.words.language import said_text

if TYPE_CHECKING:
    from bussim.api import Result


@click.command()
@click.argument("scenario", metavar="[SCENARIO]", required=False)
@click.option("--duration", metavar="T", help="Simulate so long, such as 90s or 10h.")
@click.option("--seed", metavar="N", help="Seed of all random numbers.")
@set_option
@click.option(
    "-o", "--out", metavar="DIR", help="Folder to write (default: runs/NAME, with a number if it exists)."
)
@click.option("--trace", is_flag=True, help="Also write every attempt, frame and event.")
@click.option("--no-rows", is_flag=True, help="Write no tables, only statistics.")
@click.option("--no-plots", is_flag=True, help="Draw no pictures, which take longer than a short run.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
@click.option(
    "--format", "fmt", type=click.Choice(["csv", "parquet"]), default="csv", help="Format of the tables."
)
@click.option("--force", is_flag=True, help="Replace the folder, or the readout, of an earlier run.")
@click.option("--readout", metavar="FILE", help="Also write what could be read on site at the end.")
@click.option("--as-seen", is_flag=True, help="With --readout: only what a technician would note.")
@click.option(
    "--largest",
    metavar="GB",
    type=click.FloatRange(0, min_open=True),
    default=10,
    show_default=True,
    help="Give up a run whose folder would become larger.",
)
@unsimulated_option
@lang_option
@code_option
def command(
    scenario: str | None,
    *,
    duration: str | None,
    seed: str | None,
    overrides: tuple[str, ...],
    out: str | None,
    trace: bool,
    no_rows: bool,
    no_plots: bool,
    as_json: bool,
    fmt: str,
    force: bool,
    readout: str | None,
    as_seen: bool,
    largest: float,
    allow_code: bool,
    allow_unsimulated: bool,
) -> None:
    """Simulate a scenario and write its results.

    SCENARIO is a file or the name of a built-in scenario; without it the built-in press_line runs.
    """
    from bussim import api
    from bussim.commands.common.progress import simulating_bar
    from bussim.results.store.safe_names import file_name
    from bussim.scenario import loader
    from bussim.scenario.builtin import DEFAULT

    source = DEFAULT if scenario is None else scenario
    values = values_of(overrides, allow_unsimulated=allow_unsimulated, duration=duration, seed=seed)
    loaded = loader.load(source, values, allow_code=allow_code)
    show_carried(loaded, err=as_json)
    if as_seen and readout is None:
        raise UsageError("--as-seen says what to write: name a file with --readout")
    paper = None if readout is None else checked_target(Path(readout), (), force=force, option="--readout")
    target = Path("runs") / file_name(Path(source).stem) if out is None else Path(out)
    try:
        with simulating_bar() as progress:
            result = api.run(
                loaded,
                out=target,
                trace=trace,
                rows=not no_rows,
                format=fmt,
                force=force,
                numbered=out is None and not force,
                progress=progress,
                largest=int(min(largest, 1e9) * 1e9),
            )
    except KeyboardInterrupt as error:
        raise type(error)("stopped: the run was not finished and left no results") from None
    if as_json:
        print_json(result.summary)
    else:
        _show(result)
    if paper is not None and result.totals is not None:
        from bussim.scenario.yaml.dump import dumped
        from bussim.site.writing import readout_data

        write_text(paper, dumped(readout_data(loaded, result.totals, as_seen=as_seen)))
        click.echo(said_text("run_readout", path=paper), err=as_json)
    if no_plots:
        return
    # Last, as pictures take longer than the numbers.
    import_matplotlib()
    for picture in result.save_plots():
        if not as_json:
            click.echo(said_text("run_picture", path=picture))


def _show(result: Result) -> None:
    from rich.console import Console

    from bussim.results.text.run import show_result

    names = {link.bus: link.station_names for link in result.totals.links} if result.totals else {}
    console = Console(highlight=False)
    show_result(console, result.record, names)
    click.echo(f"\n{said_text('run_results', folder=result.folder)}")
