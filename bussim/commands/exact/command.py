"""``bussim exact``: link scan times, Modbus polls and latencies in closed form."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from bussim.commands.common.output import check_pictures, print_json, show_carried
from bussim.commands.common.scenario_options import code_option, set_option, time_of
from bussim.errors import UsageError
from bussim.exact.text import ALMOST_CERTAIN, ms, ms_cell, one_in
from bussim.files import made_folder
from bussim.words.language import say

if TYPE_CHECKING:
    from rich.console import Console

    from bussim.exact.metrics import Figures
    from bussim.exact.metrics import Request as RequestType
    from bussim.scenario.model import Scenario

#: Levels of exceeding that the picture reaches below the least quantile asked for.
_BELOW = 1e-1
_POINTS = 1200


@click.command()
@click.argument("scenario", metavar="SCENARIO")
@click.option("--json", "as_json", is_flag=True, help="Print the figures as JSON.")
@click.option(
    "--q",
    "levels",
    metavar="P,P,...",
    default="1e-3,1e-6,1e-9",
    show_default=True,
    help="Quantiles, by the probability of exceeding them.",
)
@click.option("--deadline", "deadlines", metavar="T", multiple=True, help="Also P(link scan > T).")
@click.option(
    "--mission",
    metavar="T",
    default="1y",
    show_default=True,
    help="Time in which D8202, the longest scan, is asked for.",
)
@click.option("--ignore-faults", is_flag=True, help="Leave out what acts only for a part of the run.")
@set_option
@click.option("--plot", is_flag=True, help="Draw law and simulated histogram, as PNG and SVG.")
@click.option("-o", "--out", metavar="DIR", help="Folder for the pictures (default: this one).")
@click.option("--force", is_flag=True, help="Replace pictures that exist.")
@code_option
def command(
    scenario: str,
    *,
    as_json: bool,
    levels: str,
    deadlines: tuple[str, ...],
    mission: str,
    ignore_faults: bool,
    overrides: tuple[str, ...],
    plot: bool,
    out: str | None,
    force: bool,
    allow_code: bool,
) -> None:
    """Work out link scan times, tails included, and Modbus poll cycles, without simulating.

    SCENARIO is a file or the name of a built-in scenario. Where a closed form does not hold, the answer
    says why instead. Of a poll list: cycle time without errors, what dead slaves and spent retries make of
    it, response times, bus load, age of the data. Of the scenario's latencies: what they are at worst.
    Where a fault comes or goes during the run, the figures are those before, during and after it.
    """
    from bussim import api
    from bussim.commands.common.progress import progress_bar
    from bussim.exact.metrics import Request
    from bussim.exact.solution import exact

    if not plot and (out is not None or force):
        option = "--force" if out is None else "--out"
        raise UsageError(f"{option} is about the pictures of --plot: give --plot as well")
    request = Request(
        levels=_levels(levels),
        deadlines=tuple(time_of("--deadline", text, positive=True) for text in deadlines),
        mission=time_of("--mission", mission, positive=True),
    )
    loaded = api.load(scenario, overrides, allow_code=allow_code)
    show_carried(loaded, err=as_json)
    with progress_bar() as progress:
        solved = exact(
            loaded,
            levels=request.levels,
            deadlines=request.deadlines,
            mission=request.mission,
            ignore_faults=ignore_faults,
            progress=progress,
        )
    found, polls, bounds, changing = solved.links, solved.polls, solved.latency, solved.periods
    if not (found or polls or loaded.latency):
        raise UsageError(f"{scenario} has neither an N:N link nor a Modbus poll list nor a latency")
    if plot and not found:
        raise UsageError(f"{scenario} has no N:N link, whose law --plot draws")
    stems = {}
    if plot:
        from bussim.results.store.safe_names import file_names

        folder = made_folder(Path(out or "."))
        drawn = [bus for bus, figures in found.items() if figures.distribution is not None]
        stems = {bus: folder / f"law_{file_names(found)[bus]}" for bus in drawn}
        check_pictures(stems.values(), force=force)
    pictures = _draw(loaded, found, request, stems) if plot else []
    if as_json:
        print_json(solved.to_dict())
    else:
        from bussim.commands.common.console import wide_console

        console = wide_console()
        for bus, figures in found.items():
            if bus not in changing:
                _show(console, bus, figures, request)
            for period, of_period in changing.get(bus, ()):
                _show(console, f"{bus}, {period.in_words()}", of_period, request)
        if changing:
            console.print(
                "--ignore-faults: one law for the whole run, without what acts only for a part of it"
            )
        if polls:
            from bussim.commands.exact.polls import show

            for figures_of_list in polls.values():
                show(console, figures_of_list)
        if bounds:
            from bussim.commands.common.latency_bounds import show_bounds

            show_bounds(console, bounds)
    for path in pictures:
        click.echo(path, err=as_json)


def _levels(text: str) -> dict[str, float]:
    found: dict[str, float] = {}
    for part in text.split(","):
        key = part.strip()
        try:
            level = float(key)
        except ValueError:
            raise UsageError(f"--q has {key!r}, not a probability; write such as 1e-3,1e-6") from None
        if not 1e-15 <= level < 1:
            raise UsageError(f"--q has {key}, allowed 1e-15 up to, not including, 1")
        found[key] = level
    return found


def _show(console: Console, bus: str, figures: Figures, request: RequestType) -> None:
    from rich.text import Text

    from bussim.commands.common.console import named_values
    from bussim.exact.sizing.assumptions import rests_on
    from bussim.wording import about, counted

    model = figures.model
    slaves = len(model.stations)
    console.print(
        Text(
            f"{bus}: {counted(slaves + 1, 'station')}, mode {model.mode}, "
            f"{counted(model.retries, 'retry')} = {counted(model.attempts, 'attempt')} a poll, "
            f"timeout {ms(model.timeout)} ms",
            style="bold",
        )
    )
    for sentence in (*model.not_replying, *figures.in_words(), *model.notes):
        console.print(Text(f"  {sentence}"))
    if not figures.valid:
        return
    rows: list[tuple[str, str]] = [
        ("link scan time", f"mean {ms_cell(figures.mean)}, sd {ms_cell(figures.sd)} ms"),
        ("  without errors", f"{ms_cell(figures.shortest)} to {ms_cell(figures.longest_clean)} ms"),
        ("  at worst", f"{ms_cell(figures.worst_case)} ms (every attempt of every station spent)"),
    ]
    rows += [
        (f"  exceeded by 1 scan in {one_in(request.levels[key])}", f"{ms_cell(x)} ms")
        for key, x in figures.quantiles.items()
    ]
    middle, high = figures.maximum.values()
    longest = f"median {ms_cell(middle)}, with a chance of 1 % above {ms_cell(high)} ms"
    rows.append((f"  longest in {_span(request.mission)}", longest))
    for station, chance in figures.error_per_scan.items():
        year = f"{about(figures.error_per_year[station])} at least once a year"
        if figures.error_per_year[station] > ALMOST_CERTAIN:
            year = "almost certain at least once a year"
        text = f"probability {about(chance)} a scan, {year}"
        rows.append((f"error flag of {model.name(station)}", text))
    if figures.silence is not None and figures.corruption is not None:
        text = (
            f"interruption of {ms_cell(figures.silence)} ms, corruption of {ms_cell(figures.corruption)} ms"
        )
        rows.append(("ride-through of the line", text))
        rows.append(("", say("exact_not_covered")))
    more = " more" if model.dead else ""
    if figures.one_dead is not None:
        rows.append((f"one{more} station dead", f"link scan {ms_cell(figures.one_dead)} ms"))
    if figures.two_dead is not None:
        rows.append((f"two{more} stations dead", f"link scan {ms_cell(figures.two_dead)} ms"))
    if figures.detect_mean is not None:
        longest = f"{ms_cell(figures.detect_longest)} ms at worst while no other reply is lost"
        text = f"mean {ms_cell(figures.detect_mean)}, {longest}, else {ms_cell(figures.worst_case)} ms"
        rows.append(("dead station noticed", text))
    console.print(named_values(rows))
    _show_refresh(console, figures)
    for line in ("what the figures rest on", *rests_on(model, figures.to_json())["text"]):
        console.print(Text(f"  {line}"))


def _show_refresh(console: Console, figures: Figures) -> None:
    from rich.text import Text

    from bussim.commands.common.console import plain_table

    keys = list(figures.quantiles)
    if not figures.refresh:
        return
    table = plain_table(
        ["pair"],
        ["mean", *keys, "heartbeat"],
        title="refresh gap (ms) by the probability of exceeding it, and a heartbeat preset from it",
    )
    for pair, refresh in figures.refresh.items():
        times = [refresh.mean, *(refresh.quantiles.get(key) for key in keys), refresh.heartbeat]
        table.add_row(Text(pair), *(ms_cell(time) for time in times))
    console.print(table)


def _span(ticks: int) -> str:
    from bussim.units import UNIT_TICKS

    for unit in ("y", "d", "h", "min", "s"):
        value = ticks / UNIT_TICKS[unit]
        if value >= 1:
            return f"{float(value):g} {unit}"
    return f"{float(ticks / UNIT_TICKS['ms']):g} ms"


def _draw(
    scenario: Scenario, found: dict[str, Figures], request: RequestType, stems: dict[str, Path]
) -> list[Path]:
    import numpy as np

    from bussim import api
    from bussim.results.plots.distribution import distribution_and_histogram
    from bussim.version import __version__

    result = api.run(scenario, rows=False)
    lowest = min(request.levels.values(), default=1e-6) * _BELOW
    paths: list[Path] = []
    for bus, figures in found.items():
        distribution = figures.distribution
        if distribution is None:
            click.echo(f"{bus}: no picture, since there is no exact law", err=True)
            continue
        least, _ = distribution.support
        x = np.linspace(least, distribution.quantile(lowest), _POINTS)
        about = f"{scenario.name}, seed {scenario.seed}, bussim {__version__}"
        simulated = result.record.links[bus].scan_times.histogram
        picture = distribution_and_histogram(bus, x, distribution.tail(x), simulated, about, lowest)
        paths += picture.save_both(stems[bus])
    return paths
