"""``bussim exact``: link scan times, Modbus polls and latencies in closed form."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from bussim.commands.common.drawing import import_matplotlib
from bussim.commands.common.output import check_pictures, made_folder, print_json, show_carried
from bussim.commands.common.scenario_options import code_option, lang_option, set_option, time_of
from bussim.errors import UsageError
from bussim.exact.text import ALMOST_CERTAIN, ms_cell, one_in
from bussim.units import milliseconds
from bussim.words.language import said_text, say

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
@click.option(
    "--refresh/--no-refresh",
    default=True,
    help="Also how old blocks get, which takes longest by far. [default: yes]",
)
@set_option
@lang_option
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
    refresh: bool,
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
            refresh=refresh,
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
        from bussim.commands.common.console import print_line, wide_console

        console = wide_console()
        for bus, figures in found.items():
            if bus not in changing:
                _show(console, bus, figures, request)
            for period, of_period in changing.get(bus, ()):
                name = say("exact_link_period", bus=bus, period=period.in_words())
                _show(console, name, of_period, request)
        if changing:
            print_line(console, say("exact_ignore"), 0)
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
    from bussim.commands.common.console import named_values, print_line
    from bussim.exact.sizing.assumptions import rests_on
    from bussim.wording import about

    model = figures.model
    settings = {"mode": model.mode, "retries": model.retries, "attempts": model.attempts}
    times = {"timeout": milliseconds(model.timeout), "stations": len(model.stations) + 1}
    print_line(console, say("run_link", bus=bus, **settings, **times), 0, "bold")
    for sentence in (*model.not_replying, *figures.in_words(), *model.notes):
        print_line(console, sentence)
    if not figures.valid:
        return
    rows: list[tuple[str, str]] = [
        (say("run_scan_time"), say("exact_mean", mean=ms_cell(figures.mean), sd=ms_cell(figures.sd))),
        (
            say("exact_without_errors"),
            say("exact_range", least=ms_cell(figures.shortest), most=ms_cell(figures.longest_clean)),
        ),
        (say("exact_at_worst"), say("exact_every_attempt", time=ms_cell(figures.worst_case))),
    ]
    rows += [
        (say("exact_exceeded", number=one_in(request.levels[key])), f"{ms_cell(x)} ms")
        for key, x in figures.quantiles.items()
    ]
    middle, high = map(ms_cell, figures.maximum.values())
    mission = say("exact_longest_in", time=_span(request.mission))
    rows.append((mission, say("exact_longest", median=middle, high=high)))
    for station, chance in figures.error_per_scan.items():
        year = say("exact_once_a_year", chance=about(figures.error_per_year[station]))
        if figures.error_per_year[station] > ALMOST_CERTAIN:
            year = say("exact_certain")
        text = say("exact_probability", chance=about(chance), year=year)
        rows.append((say("exact_flag_of", station=model.name(station)), text))
    if figures.silence is not None and figures.corruption is not None:
        passed = {"silence": ms_cell(figures.silence), "corruption": ms_cell(figures.corruption)}
        rows.append((say("exact_ride"), say("exact_ride_times", **passed)))
        rows.append(("", say("exact_not_covered")))
    more = "_more" if model.dead else ""
    for number, mean in (("one", figures.one_dead), ("two", figures.two_dead)):
        if mean is not None:
            rows.append((say(f"exact_{number}_dead{more}"), say("exact_scan", time=ms_cell(mean))))
    if figures.detect_mean is not None:
        noticed = (figures.detect_mean, figures.detect_longest, figures.worst_case)
        found = dict(zip(("mean", "longest", "bound"), map(ms_cell, noticed), strict=True))
        rows.append((say("exact_noticed"), say("exact_noticed_after", **found)))
    console.print(named_values(rows))
    _show_refresh(console, figures)
    for line in (say("exact_rests"), *rests_on(model, figures.to_json())["text"]):
        print_line(console, line)


def _show_refresh(console: Console, figures: Figures) -> None:
    from rich.text import Text

    from bussim.commands.common.console import plain_table

    keys = list(figures.quantiles)
    if not figures.refresh:
        return
    table = plain_table(
        [say("exact_pair")], [say("time_mean"), *keys, say("exact_heartbeat")], title=say("exact_refresh")
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

    import_matplotlib()
    from bussim import api
    from bussim.results.plots.distribution import distribution_and_histogram
    from bussim.version import __version__

    result = api.run(scenario, rows=False)
    lowest = min(request.levels.values(), default=1e-6) * _BELOW
    paths: list[Path] = []
    for bus, figures in found.items():
        distribution = figures.distribution
        if distribution is None:
            click.echo(said_text("exact_no_picture", bus=bus), err=True)
            continue
        least, _ = distribution.support
        x = np.linspace(least, distribution.quantile(lowest), _POINTS)
        what = {"scenario": scenario.name, "seed": scenario.seed, "version": __version__}
        about = say("picture_exact_about", **what)
        simulated = result.record.links[bus].scan_times.histogram
        picture = distribution_and_histogram(bus, x, distribution.tail(x), simulated, about, lowest)
        paths += picture.save_both(stems[bus])
    return paths
