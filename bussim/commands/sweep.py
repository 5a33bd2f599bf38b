"""``bussim sweep``: run a scenario at every point of a grid."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bussim.commands.common.output import print_json
from bussim.commands.common.scenario_options import code_option, set_option, values_of
from bussim.errors import UsageError
from bussim.wording import counted

if TYPE_CHECKING:
    from rich.console import Console

    from bussim.sweep.result import SweepResult

#: Most points that are printed; the table in the folder has all.
_MOST_ROWS = 40
#: Characters in a line of a heading.
_HEAD = 14


@click.command()
@click.argument("scenario", metavar="SCENARIO")
@click.option(
    "--vary",
    metavar="KEY.PATH=VALUES",
    multiple=True,
    required=True,
    help="A key and its values: a:b:step, a:b:logN or a list a,b,c. Several make a grid.",
)
@click.option(
    "--repeat", metavar="N", type=int, default=1, help="Runs at each point, each with its own seed."
)
@click.option("--workers", metavar="N", type=int, help="Processes of this machine (default: one a core).")
@click.option("--scheduler", metavar="ADDRESS", help="Run on a Dask cluster, such as tcp://10.0.0.5:8786.")
@click.option(
    "--same-luck",
    "common_random_numbers",
    is_flag=True,
    help="The same seeds at every point (common random numbers).",
)
@click.option("--duration", metavar="T", help="Simulate so long, such as 90s or 10h.")
@click.option("--seed", metavar="N", help="Seed from which those of all runs are derived.")
@set_option
@click.option(
    "-o",
    "--out",
    metavar="DIR",
    help="Folder to write (default: sweeps/NAME, with a number if it is another's).",
)
@click.option(
    "--longest",
    metavar="H",
    type=click.FloatRange(0, min_open=True),
    default=24,
    show_default=True,
    help="Begin no sweep that would take more hours.",
)
@click.option("--json", "as_json", is_flag=True, help="Print means and confidence intervals as JSON.")
@click.option("--force", is_flag=True, help="Replace the folder of another sweep, or run this one again.")
@code_option
def command(
    scenario: str,
    *,
    vary: tuple[str, ...],
    repeat: int,
    workers: int | None,
    scheduler: str | None,
    common_random_numbers: bool,
    duration: str | None,
    seed: str | None,
    overrides: tuple[str, ...],
    out: str | None,
    longest: float,
    as_json: bool,
    force: bool,
    allow_code: bool,
) -> None:
    """Run a scenario at every point of a grid.

    SCENARIO is a file or the name of a built-in scenario. Stopped at any time, the same command goes
    on where it was. Examples of what can be varied:

    \b
      --vary plcs.press1.nn.retries=0:5:1
      --vary plcs.press1.nn.timeout=50ms:200ms:10ms
      --vary noise.0.ber=1e-6:1e-3:log7
      --vary plcs.press2.scan.mean=5ms,10ms,20ms
    """  # noqa: D301 - click keeps the lines of a paragraph that begins with this very character
    from bussim.commands.common.progress import WORTH_A_LINE, progress_bar, roughly
    from bussim.results.store.safe_names import file_name
    from bussim.sweep.run import sweep as run_sweep

    def estimated(seconds: float) -> None:
        if seconds > 3600 * longest:
            raise UsageError(
                f"the sweep would take about {roughly(seconds)}, allowed are {longest:,.6g} h: vary or "
                "repeat less, shorten --duration, have more --workers, or raise --longest"
            )
        if seconds > WORTH_A_LINE:
            click.echo(f"about {roughly(seconds)} in all", err=True)

    target = Path("sweeps") / file_name(Path(scenario).stem) if out is None else Path(out)
    try:
        with progress_bar(counted=True) as progress:
            result = run_sweep(
                scenario,
                vary,
                out=target,
                repeat=repeat,
                sets=values_of(overrides, duration=duration, seed=seed),
                workers=workers,
                scheduler=scheduler,
                common_random_numbers=common_random_numbers,
                force=force,
                allow_code=allow_code,
                numbered=out is None and not force,
                progress=progress,
                estimated=estimated,
            )
    except KeyboardInterrupt as error:
        raise type(error)("stopped: the same command goes on from what was run") from None
    if as_json:
        print_json(result.summary)
    else:
        _show(result)


def _show(result: SweepResult) -> None:
    from bussim.commands.common.console import wide_console
    from bussim.sweep.figures import kinds_in

    console = wide_console()
    plan = result.plan
    runs = f"{counted(plan.runs, 'run')} at {counted(len(plan.points), 'point')}"
    if result.already_there:
        runs += f", {result.already_there:,} of them were there already"
    click.echo(f"{plan.title}: {runs}")
    for name, kind in kinds_in(result.figures, [bus.name for bus in plan.base.buses]).items():
        _show_table(console, result, name, kind)
    if len(plan.points) > _MOST_ROWS:
        console.print(f"the first {_MOST_ROWS} points; points.csv has all")
    if plan.repeat == 1:
        console.print("one run a point: no confidence intervals; --repeat 5 or more gives them")
    else:
        console.print(f"means of {plan.repeat} runs ± half of the 95 % confidence interval")
    click.echo(f"\nresults: {result.folder}")
    for picture in sorted(result.folder.glob("sweep_*.png")):
        click.echo(f"picture: {picture}")


def _show_table(console: Console, result: SweepResult, name: str, kind: str) -> None:
    from textwrap import fill

    from rich.text import Text

    from bussim.commands.common.console import plain_table
    from bussim.sweep.figures import LATENCY, SHOWN
    from bussim.sweep.intervals import footnotes, with_interval

    plan, shown = result.plan, SHOWN[kind]
    heads = [*_short([axis.key for axis in plan.axes]), *(fill(title, _HEAD) for title in shown.values())]
    table = plain_table((), heads, title=f"{kind} {name.removeprefix(LATENCY)}", gap=1)
    for column in table.columns:
        column.no_wrap, column.vertical = True, "bottom"
    texts, needed = "", dict[str, int]()
    for number, point in enumerate(plan.points[:_MOST_ROWS]):
        cells = [Text(value.text) for value in point]
        for figure, title in shown.items():
            mean = result.mean(f"{name}.{figure}", number)
            cells.append(Text(with_interval(mean, result.values(f"{name}.{figure}", number))))
            if mean.needed is not None and mean.too_few(plan.repeat):
                label = title.removesuffix(" (ms)")
                needed[label] = max(needed.get(label, 0), mean.needed)
        table.add_row(*cells)
        texts += "".join(map(str, cells))
    console.print(table)
    for text in footnotes(texts, plan.repeat, needed) if plan.repeat > 1 else ():
        console.print(text)


def _short(keys: Sequence[str]) -> list[str]:
    """The ends of keys, as long as it takes to distinguish them."""
    parts = [key.split(".") for key in keys]
    for length in range(1, max(map(len, parts))):
        names = [".".join(each[-length:]) for each in parts]
        if len(set(names)) == len(names):
            return names
    return list(keys)
