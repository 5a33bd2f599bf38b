"""``bussim fit``: estimate from a recording what the model needs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bussim.commands.common.drawing import import_matplotlib
from bussim.commands.common.output import (
    busy,
    check_pictures,
    checked_target,
    made_folder,
    print_json,
    write_text,
)
from bussim.commands.common.progress import progress_bar
from bussim.commands.common.recording import is_recording, line_options
from bussim.commands.common.scenario_options import code_option, time_of
from bussim.errors import UsageError

if TYPE_CHECKING:
    from bussim.commands.fit.recording import Fitted
    from bussim.live.sniff.reading import Settings
    from bussim.results.run_record import RunRecord
    from bussim.scenario.model import Scenario

#: A longer recording is compared with a simulation of this length: ten minutes.
_LONGEST_SIMULATED = "10 min"


@click.command()
@click.argument("trace", metavar="TRACE")
@click.option("--scenario", "base", metavar="FILE", help="Put the estimates into this scenario.")
@click.option("-o", "--out", "output", metavar="FILE", help="Write the scenario with the estimates.")
@click.option("--force", is_flag=True, help="Replace the file, or the picture, if it exists.")
@line_options
@click.option("--tolerance", metavar="T", help="Silence inside a frame that the system may have made.")
@click.option("--seed", metavar="N", type=click.IntRange(0), default=1, show_default=True)
@click.option(
    "--simulate",
    metavar="T",
    default=_LONGEST_SIMULATED,
    show_default=True,
    help="Longest simulation to compare with; 0 s: none.",
)
@click.option("--plot", metavar="DIR", help="Folder for a picture of both histograms.")
@click.option("--json", "as_json", is_flag=True, help="Print the estimates as JSON.")
@code_option
def command(
    trace: str,
    *,
    base: str | None,
    output: str | None,
    force: bool,
    settings: Settings,
    bus: str | None,
    tolerance: str | None,
    seed: int,
    simulate: str,
    plot: str | None,
    as_json: bool,
    allow_code: bool,
) -> None:
    """Estimate from a recording what the model needs, and compare it with a simulation.

    TRACE is anything that sniff reads: a run's folder or trace.jsonl, a recording of sniff, pcapng,
    a sigrok session, raw bytes with timestamps. Estimated are turnarounds, the master's gap and
    overhead, loss and bit errors with their 95 % confidence intervals, and poll intervals.
    """
    from bussim.commands.fit.recording import fit
    from bussim.commands.fit.recording import simulate as simulated_of
    from bussim.commands.fit.show import compared, show, to_json
    from bussim.commands.fit.warnings import carried, difference, warnings_of
    from bussim.wording import visible

    if not is_recording(trace):
        raise UsageError(f"{trace} is no file and no folder; record a line first: bussim sniff URL --out DIR")
    target = None if output is None else checked_target(Path(output), (), force=force)
    with progress_bar() as progress:
        fitted = fit(trace, settings, bus=bus, tolerance=tolerance, progress=progress)
    estimated = warnings_of(fitted)
    to_carry = carried(fitted, estimated)
    longest = time_of("--simulate", simulate)
    scenario = scenario_of(
        fitted,
        base,
        name=f"fitted to {visible(Path(trace).stem)[:150]}",
        seed=seed,
        longest=longest,
        warnings=to_carry,
        allow_code=allow_code,
    )
    simulated = None
    if longest and fitted.timed and fitted.behaviour.times:
        with busy("simulating the estimates"):
            simulated = simulated_of(scenario, fitted)
    found = None if simulated is None else compared(fitted, simulated[1])
    differs = {} if found is None else difference(found.comparison)
    for text in differs.values():
        click.echo(text, err=True)
    warnings = differs | fitted.warnings | estimated
    if target is not None:
        from bussim.scenario.yaml.dump import dumps
        from bussim.version import __version__

        if differs:
            carries = [{"code": code, "text": text} for code, text in (differs | to_carry).items()]
            scenario = replace(scenario, source={**scenario.source, "warnings": carries})
        write_text(target, f"# Made by bussim {__version__} fit from {trace}.\n{dumps(scenario)}")
    if plot is not None:
        _plot(Path(plot), fitted, None if simulated is None else simulated[0], force=force)
    if as_json:
        print_json({"source": trace, "scenario": output, **to_json(fitted, found, warnings)})
        return
    show(fitted, found, warnings)
    if target is not None:
        click.echo(f"scenario: {target}")


def scenario_of(
    fitted: Fitted,
    base: str | None,
    *,
    name: str,
    seed: int,
    longest: int,
    warnings: Mapping[str, str],
    allow_code: bool = False,
) -> Scenario:
    """The scenario of the estimates, or ``base`` with them; it carries ``warnings``, by code.

    Raises ScenarioError or UsageError.
    """
    from bussim import api
    from bussim.commands.fit.scenario import bus_scenario, link_scenario, put_link
    from bussim.scenario.loader import from_data
    from bussim.units import TICKS_PER_SECOND

    duration = max(TICKS_PER_SECOND, min(fitted.duration, longest) if longest else fitted.duration)
    if base is not None:
        if fitted.link is None:
            raise UsageError("--scenario takes estimates of an N:N link; this recording is of a Modbus bus")
        data = put_link(api.load(base, allow_code=allow_code), fitted.link, fitted.bus)
    elif fitted.link is not None:
        data = link_scenario(fitted.link, fitted.bus, fitted.names, name=name, duration=duration, seed=seed)
    else:
        assert fitted.ports is not None  # noqa: S101 - narrows the type
        data = bus_scenario(fitted.ports, fitted.bus, name=name, duration=duration, seed=seed)
    if warnings:
        data["warnings"] = [{"code": code, "text": text} for code, text in warnings.items()]
    folder = None if base is None else Path(base).parent
    return from_data(data, name=base or "<fit>", allow_code=allow_code, folder=folder)


def _plot(folder: Path, fitted: Fitted, simulated: RunRecord | None, *, force: bool) -> None:
    import_matplotlib()
    from bussim.results.plots.scan_times import scan_time_histogram
    from bussim.results.store.safe_names import file_name

    if simulated is None or fitted.link is None:
        raise UsageError("there are no link scans to draw")
    stem = made_folder(folder) / f"fit_{file_name(fitted.bus)}"
    check_pictures([stem], force=force, option="--plot")
    picture = scan_time_histogram([fitted.measured, simulated], fitted.bus, ["measured", "simulated"])
    for path in picture.save_both(stem):
        click.echo(f"picture: {path}", err=True)
