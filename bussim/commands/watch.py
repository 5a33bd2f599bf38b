"""``bussim watch``: chosen devices over time, like the monitor of a programming tool."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bussim.commands.common.drawing import import_matplotlib
from bussim.commands.common.output import print_json
from bussim.commands.common.scenario_options import (
    code_option,
    lang_option,
    set_option,
    time_of,
    unsimulated_option,
    values_of,
)
from bussim.errors import UsageError
from bussim.words.language import said_text, say

if TYPE_CHECKING:
    from bussim.results.meters.watch import Watch, Watched
    from bussim.scenario.model import Scenario

#: Rows that a terminal gets; a file gets them all.
_MOST_ROWS = 200
_MOST_DEVICES = 100


@click.command()
@click.argument("scenario", metavar="SCENARIO")
@click.option("--devices", metavar="PLC.DEVICE,...", required=True, help="Such as press1.D8201,press2.M1064.")
@click.option("--from", "since", metavar="T", help="Show from so long after the run's start on, such as 10s.")
@click.option("--to-time", "until", metavar="T", help="Show up to then; no longer is simulated.")
@click.option(
    "--csv",
    "csv_file",
    metavar="FILE",
    help="Write a table: a row for every instant of a change, and which PLCs had no supply.",
)
@click.option(
    "--plot", "plot_file", metavar="FILE", help="Draw bits as lanes and words as steps (.png, .svg)."
)
@click.option("--json", "as_json", is_flag=True, help="Print every change as JSON.")
@lang_option
@click.option("--signed", is_flag=True, help="Words with their sign, from -32768 to 32767.")
@click.option("--seed", metavar="N", help="Seed of all random numbers.")
@set_option
@click.option("--force", is_flag=True, help="Replace a file that exists.")
@unsimulated_option
@code_option
def command(
    scenario: str,
    *,
    devices: str,
    since: str | None,
    until: str | None,
    csv_file: str | None,
    plot_file: str | None,
    as_json: bool,
    signed: bool,
    seed: str | None,
    overrides: tuple[str, ...],
    force: bool,
    allow_code: bool,
    allow_unsimulated: bool,
) -> None:
    """Simulate, and show chosen devices of PLCs over time: at every END at which one has changed.

    They also change where a PLC goes to RUN or to STOP, and where its supply goes (its outputs, which are
    off then) or comes back (all others that are not latched). When it had none is said below the table.

    X is the image in memory, which is sampled at the beginning of a scan and shown at its END; when the
    wire itself changed is in inputs.csv of a run.

    SCENARIO is a file or the name of a built-in scenario. Devices are X and Y (numbered in octal), M, S
    and D; T0 and C0 are the contacts of timers and counters, TN0 and CN0 their current values (CN200 and
    up have 32 bits), V0 to V7 and Z0 to Z7 the index registers; an FX3U also has R0 to R32767. Comments of
    the PLC stand below the devices.
    """
    from bussim.commands.common.output import checked_target, write_text
    from bussim.results.numbers import s
    from bussim.scenario import loader
    from bussim.units import seconds
    from bussim.version import __version__
    from bussim.wording import names

    given = values_of(overrides, allow_unsimulated=allow_unsimulated, seed=seed)
    loaded = loader.load(scenario, given, allow_code=allow_code)
    watched = _watched(loaded, devices)
    begin, end = _window(loaded, since, until)
    targets = [
        checked_target(Path(name), endings, force=force, option=option) if name is not None else None
        for option, name, endings in (("--csv", csv_file, (".csv",)), ("--plot", plot_file, (".png", ".svg")))
    ]
    watch = _simulated(replace(loaded, duration=end), watched)
    if signed:
        for each in watched:
            if not each.bit:
                half = 1 << each.width - 1
                each.values[:] = [(value ^ half) - half for value in each.values]
    table, picture = targets
    if table is not None:
        write_text(table, _csv(watch, begin, end))
    if picture is not None:
        import_matplotlib()
        from bussim.results.plots.watch import shown_devices, watch_picture

        left_out = watched[shown_devices(watched) :]
        if left_out:
            click.echo(f"{picture} has no room for {names(each.name for each in left_out)}", err=True)
        what = {"scenario": loaded.name, "seed": loaded.seed, "version": __version__}
        about, heading = say("picture_exact_about", **what), say("plot_devices", scenario=loaded.name)
        watch_picture(watch, begin, end, heading, about).save(picture)
    if as_json:
        found = {
            "schema": 1,
            "scenario": loaded.name,
            "seed": loaded.seed,
            "from_s": round(seconds(begin), 9),
            "to_s": round(seconds(end), 9),
            "devices": watch.to_json(begin, end),
            "without_supply": [
                (plc, s(since), s(until)) for plc, since, until in watch.without_supply(begin, end)
            ],
            "stale": [(*pair, s(since), s(until)) for *pair, since, until in watch.stale if until > begin],
        }
        print_json(found, indent=1)
        return
    for path in (table, picture):
        if path is not None:
            click.echo(path)
    if table is None and picture is None:
        _show(watch, begin, end)


def _watched(scenario: Scenario, devices: str) -> list[Watched]:
    from bussim.plc.memory import parse_device
    from bussim.results.meters.watch import Watched
    from bussim.wording import shorten
    from bussim.words.values import suggest

    known = {plc.name: plc for plc in scenario.plcs}
    example = next(iter(known))
    found: dict[str, Watched] = {}
    parts = [part.strip() for part in devices.split(",")]
    if parts == [""]:
        raise UsageError(f"--devices is empty; write such as {example}.D8201")
    for number, text in enumerate(parts, 1):
        if not text:
            before = f" behind {shorten(parts[number - 2])}" if number > 1 else ""
            raise UsageError(f"--devices: entry {number} of {len(parts)} is empty{before}; remove a comma")
        plc, dot, name = text.partition(".")
        if not dot:
            raise UsageError(f"--devices has {shorten(repr(text))}; write such as {example}.D8201")
        if plc not in known:
            raise UsageError(
                f"--devices has {shorten(text)}, but {plc} is no PLC; {suggest(plc, list(known))}"
            )
        try:
            device = parse_device(name[:100], observed=True, family=known[plc].profile.family)
        except ValueError as error:
            raise UsageError(f"--devices: the device of {plc} {error}") from None
        each = Watched(plc, str(device), device.width, known[plc].comment(str(device)))
        if each.name in found:
            also = f", the second time as {text}" if text != each.name else ""
            raise UsageError(f"--devices has {each.name} twice{also}")
        found[each.name] = each
    if len(found) > _MOST_DEVICES:
        raise UsageError(f"--devices has {len(found)} devices, allowed {_MOST_DEVICES}")
    return list(found.values())


def _window(scenario: Scenario, since: str | None, until: str | None) -> tuple[int, int]:
    from bussim.units import format_time

    begin = 0 if since is None else time_of("--from", since)
    end = scenario.duration if until is None else time_of("--to-time", until)
    if not begin < end <= scenario.duration:
        raise UsageError(
            f"from {format_time(begin)} to {format_time(end)} does not lie within the run, which lasts "
            f"{format_time(scenario.duration)}"
        )
    return begin, end


def _simulated(scenario: Scenario, watched: list[Watched]) -> Watch:
    from bussim.commands.common.progress import simulating_bar
    from bussim.results.collector import Collector
    from bussim.results.meters.watch import Watch
    from bussim.sim.runner import simulate

    wanted: dict[str, list[str]] = {}
    for each in watched:
        wanted.setdefault(each.plc, []).append(each.device)
    plcs = tuple(
        replace(plc, observed=tuple(dict.fromkeys((*plc.observed, *wanted.get(plc.name, ())))))
        for plc in scenario.plcs
    )
    watch = Watch(watched)
    with simulating_bar() as progress:
        collector = Collector(rows=watch)
        totals = simulate(replace(scenario, plcs=plcs), collector, progress=progress)
    watch.stale = sorted(
        (receiver, source, span.start, span.end or scenario.duration)
        for link in collector.links(totals).values()
        for (source, receiver), pair in link.refresh.items()
        for span in pair.stale
        if receiver in wanted
    )
    return watch


def _csv(watch: Watch, begin: int, end: int) -> str:
    from bussim.results.store.safe_names import cell
    from bussim.units import seconds

    rows, lost = dict(watch.rows(begin, end)), watch.without_supply(begin, end)
    for tick in (tick for _, *edges in lost for tick in edges if begin < tick < end):
        rows.setdefault(tick, [each.at(tick) for each in watch.watched])
    plcs = list(dict.fromkeys(plc for plc, *_ in lost))
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    heads = [*(each.name for each in watch.watched), *(f"{plc} without supply" for plc in plcs)]
    table.writerow(["time_s", *map(cell, heads)])
    for tick, values in sorted(rows.items()):
        without = {plc for plc, since, until in lost if since <= tick < until}
        table.writerow([f"{seconds(tick):.9f}", *values, *(int(plc in without) for plc in plcs)])
    return text.getvalue()


def _show(watch: Watch, begin: int, end: int) -> None:
    from rich.table import Table
    from rich.text import Text

    from bussim.commands.common.console import wide_console
    from bussim.units import seconds

    table = Table(box=None, pad_edge=False, padding=(0, 3, 0, 0))
    table.add_column(said_text("watch_time"), justify="right", no_wrap=True)
    for each in watch.watched:
        heading = f"{each.name}\n{each.comment}" if each.comment else each.name
        table.add_column(Text(heading), justify="right", no_wrap=True)
    rows = list(watch.rows(begin, end))
    before: list[int] = []
    for tick, values in rows[:_MOST_ROWS]:
        # What has not changed stands back.
        old: Sequence[int | None] = before or [None] * len(values)
        cells = [
            Text(str(value), style="dim" * (value == was)) for value, was in zip(values, old, strict=True)
        ]
        table.add_row(f"{seconds(tick):.6f}", *cells)
        before = values
    wide_console().print(table)
    if len(rows) > _MOST_ROWS:
        click.echo(said_text("watch_more", number=len(rows) - _MOST_ROWS))
    for plc, since, until in watch.without_supply(begin, end):
        click.echo(said_text("watch_off", plc=plc, since=seconds(since), until=seconds(until)))
    for plc, source, since, until in watch.stale:
        if until > begin:
            times = {"since": seconds(since), "until": seconds(until)}
            click.echo(said_text("watch_old", plc=plc, source=source, **times))
