"""``bussim size``: which retries and timeout a link should have."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bussim.commands.common.scenario_options import code_option
from bussim.errors import UsageError

if TYPE_CHECKING:
    from rich.console import Console

    from bussim.commands.size.verify import Verdict
    from bussim.exact.sizing.goals import Goals
    from bussim.exact.sizing.size import Sizing
    from bussim.scenario.model import Scenario

_FORMS = "errors<=1/y, scan<=200ms@1e-6, dead<=400ms, ride>=100ms, heartbeat=500ms@0.1/y"


@click.command()
@click.argument("scenario", metavar="SCENARIO")
@click.option("--goal", "goals", metavar="GOAL", multiple=True, help=f"What it must achieve: {_FORMS}.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.option("--verify", "check", is_flag=True, help="Simulate the choice and two neighbours.")
@click.option(
    "--set", "overrides", metavar="KEY.PATH=VALUE", multiple=True, help="Set a value of the scenario."
)
@click.option("--out", metavar="DIR", help="Folder for size.json and the picture of the grid.")
@code_option
def command(
    scenario: str,
    *,
    goals: tuple[str, ...],
    as_json: bool,
    check: bool,
    overrides: tuple[str, ...],
    out: str | None,
    allow_code: bool,
) -> None:
    """Search all retries (D8179) and timeouts (D8180) of each link and recommend one setting.

    SCENARIO is a file or the name of a built-in scenario. Its faults are left out: a setting is for
    the line in operation. Without noise in it, a noise levels of levels is assumed and shown. The exit code
    is 1 if no setting meets the goals.
    """
    from bussim import api
    from bussim.commands.common.console import wide_console
    from bussim.errors import RunError
    from bussim.exact.from_scenario import from_scenario
    from bussim.exact.sizing.size import size

    wanted = _goals(goals)
    loaded = api.load(scenario, overrides, allow_code=allow_code)
    models = from_scenario(loaded, ignore_faults=True, bound_end=True)
    if not models:
        raise UsageError(f"{scenario} has no N:N link")
    found = {bus: size(model, wanted) for bus, model in models.items()}
    verdicts = {bus: _verify(loaded, bus, sizing) for bus, sizing in found.items()} if check else {}
    links: dict[str, object] = {}
    for bus, sizing in found.items():
        values = sizing.to_json()
        if check:
            values["verify"] = [verdict.to_json() for verdict in verdicts[bus]]
        links[bus] = values
    text = json.dumps({"schema": 1, "links": links}, indent=2, ensure_ascii=False)
    if as_json:
        click.echo(text)
    else:
        console = wide_console()
        for bus, sizing in found.items():
            _show(console, bus, sizing, verdicts.get(bus, []))
    if out is not None:
        for path in _write(loaded, found, text, Path(out)):
            click.echo(path, err=as_json)
    failed = [bus for bus, sizing in found.items() if sizing.recommended is None]
    if failed:
        raise RunError(f"no setting for {', '.join(failed)}: see above")


def _goals(texts: tuple[str, ...]) -> Goals:
    from bussim.exact.sizing.goals import Goals

    goals = Goals()
    for text in texts:
        try:
            goals = goals.with_text(text)
        except ValueError as error:
            raise UsageError(f"--goal {error}") from None
    return goals


def _verify(scenario: Scenario, bus: str, sizing: Sizing) -> list[Verdict]:
    from bussim.commands.size.verify import verify
    from bussim.exact.sizing.noise_levels import BAD, LEVELS

    loss = None if sizing.noise_levels is None else LEVELS[BAD]
    return [verify(scenario, bus, retries, timeout, loss) for retries, timeout in sizing.neighbours()]


def _show(console: Console, bus: str, sizing: Sizing, verdicts: list[Verdict]) -> None:
    from rich.text import Text

    from bussim.exact.text import ms
    from bussim.wording import about

    console.print(Text(f"{bus}: {len(sizing.model.stations) + 1} stations, mode {sizing.model.mode}", "bold"))
    if not sizing.valid:
        for reason in sizing.reasons:
            console.print(Text(f"  cannot be sized: {reason}"))
        return
    for note in sizing.model.notes:
        console.print(Text(f"  {note}"))
    for goal in sizing.goals.texts().values():
        console.print(Text(f"  goal: {goal}"))
    console.print(
        Text(f"  a timeout must be at least {ms(sizing.floor)} ms (longest reply, PLC scan, one tick)")
    )
    if sizing.noise_levels is not None:
        _show_noise_levels(console, sizing)
    best = sizing.recommended
    if best is None:
        for unmet in sizing.unmet:
            console.print(Text(f"  not to be met: {unmet.text}", "bold"))
            for help_ in unmet.helps:
                console.print(Text(f"    would help: {help_}"))
        return
    console.print(
        Text(
            f"  recommended: D8179 = {best.retries} ({best.attempts} attempts a poll), "
            f"D8180 = {best.d8180} ({ms(best.timeout)} ms)",
            style="bold green",
        )
    )
    console.print(
        Text(
            f"    {about(best.errors)} false station errors a year; link scan mean {_ms(best.mean)} ms, "
            f"with a dead station {_ms(best.dead)} ms; a dead station is noticed after "
            f"{_ms(best.detect)} ms on average, {_ms(best.detect_longest)} ms at worst; silence of "
            f"{_ms(best.ride)} ms passes unnoticed"
        )
    )
    for line in sizing.mov_lines():
        console.print(Text(f"    {line}"))
    for line in (sizing.apart(), *sizing.robust_unmet):
        if line:
            console.print(Text(f"  {line}"))
    _show_front(console, sizing)
    for verdict in verdicts:
        low, high = verdict.allowed
        sign = "agrees" if verdict.agrees else "DISAGREES"
        console.print(
            Text(
                f"  simulated {verdict.retries} retries, {ms(verdict.timeout)} ms: mean "
                f"{verdict.mean:.3f} ± {verdict.half:.3f} ms (exact {verdict.exact_mean:.3f}), "
                f"{verdict.errors} station errors (exact {about(verdict.expected_errors)}, "
                f"within {low} to {high}) in {verdict.scans:,} scans: {sign}"
            )
        )


def _show_noise_levels(console: Console, sizing: Sizing) -> None:
    from rich.table import Table
    from rich.text import Text

    from bussim.exact.sizing.noise_levels import LEVELS
    from bussim.exact.text import ms
    from bussim.wording import about

    noise_levels = sizing.noise_levels
    if noise_levels is None:
        return
    levels = ", ".join(f"{name} {chance:g}" for name, chance in LEVELS.items())
    console.print(
        Text(
            f"  no noise is given; assumed chances that an attempt fails: {levels} "
            f"(timeout {ms(noise_levels.timeout)} ms); an outage is silence, what noise corrupts may cost more"
        )
    )
    table = Table(box=None, pad_edge=False, padding=(0, 2))
    headings = ("D8179", "attempts", "one dead", "passes silence", "survives")
    for heading in (*headings, *(f"errors/y, {name}" for name in LEVELS)):
        table.add_column(Text(heading), justify="right")
    for rung in noise_levels.rungs:
        survived = ", ".join(ms(outage) for outage in rung.survived) or "–"
        table.add_row(
            str(rung.retries),
            str(rung.attempts),
            f"{_ms(rung.dead)} ms",
            f"{_ms(rung.ride)} ms",
            f"{survived} ms" if rung.survived else survived,
            *(about(rung.errors[name]) for name in LEVELS),
        )
    console.print(table)


def _show_front(console: Console, sizing: Sizing) -> None:
    from rich.table import Table
    from rich.text import Text

    from bussim.wording import about

    table = Table(title=Text("Pareto front"), title_justify="left", box=None, pad_edge=False, padding=(0, 2))
    for heading in ("D8179", "D8180", "attempts", "false errors/y", "dead-station scan", "noticed after"):
        table.add_column(Text(heading), justify="right")
    for choice in sizing.front[:12]:
        table.add_row(
            str(choice.retries),
            str(choice.d8180),
            str(choice.attempts),
            about(choice.errors),
            f"{_ms(choice.dead)} ms",
            f"{_ms(choice.detect)} ms",
        )
    console.print(table)
    if len(sizing.front) > 12:
        console.print(Text(f"  … and {len(sizing.front) - 12} more (--json has all)"))


def _ms(ticks: float) -> str:
    from bussim.units import TICKS_PER_MS

    return f"{ticks / TICKS_PER_MS:,.1f}"


def _write(scenario: Scenario, found: dict[str, Sizing], text: str, place: Path) -> list[Path]:
    import numpy as np

    from bussim.exact.sizing.evaluation import attempts_of, reading_of
    from bussim.plc.profiles import MAX_RETRIES
    from bussim.results.plots.distribution import sizing_grid
    from bussim.results.store.names import file_names
    from bussim.units import TICKS_PER_MS
    from bussim.version import __version__

    place.mkdir(parents=True, exist_ok=True)
    paths = [place / "size.json"]
    paths[0].write_text(text + "\n", encoding="utf-8")
    for bus, stem in file_names(found).items():
        sizing = found[bus]
        if sizing.checked is None:
            continue
        grid = sizing.checked.grid
        retries = range(MAX_RETRIES + 1)
        rows = [grid.attempts.index(attempts_of(reading_of(sizing.model), r)) for r in retries]
        errors = np.where(grid.valid, grid.errors_per_year, np.nan)[rows]
        best = sizing.recommended
        picture = sizing_grid(
            bus,
            list(retries),
            np.asarray(grid.timeouts) / TICKS_PER_MS,
            errors,
            [(choice.retries, choice.timeout / TICKS_PER_MS) for choice in sizing.front],
            None if best is None else (best.retries, best.timeout / TICKS_PER_MS),
            f"{scenario.name}, bussim {__version__}",
        )
        paths += picture.save_both(place / f"size_{stem}")
    return paths
