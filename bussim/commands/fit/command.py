"""``bussim fit``: estimate from a recording what the model needs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from bussim.commands.common.output import busy, checked_target, print_json, write_text
from bussim.commands.common.recording import is_recording, line_options
from bussim.commands.common.scenario_options import code_option
from bussim.commands.common.times import time_of
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
@click.option("-o", "--output", metavar="FILE", help="Write the scenario with the estimates.")
@click.option("--force", is_flag=True, help="Replace the file if it exists.")
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
    from bussim.commands.fit.show import comparison_of, show, to_json

    if not is_recording(trace):
        raise UsageError(f"{trace} is no file and no folder; record a line first: bussim sniff URL --out DIR")
    target = None if output is None else checked_target(Path(output), (), force=force)
    with busy(f"reading {trace}"):
        fitted = fit(trace, settings, bus=bus, tolerance=tolerance)
    scenario = scenario_of(
        fitted,
        base,
        name=f"fitted to {Path(trace).stem}",
        seed=seed,
        longest=time_of("--simulate", simulate),
        allow_code=allow_code,
    )
    with busy("simulating the estimates"):
        simulated = _simulated(scenario, fitted, wanted=time_of("--simulate", simulate) > 0)
    comparison = None if simulated is None else comparison_of(fitted, simulated)
    if target is not None:
        from bussim.scenario.yaml.dump import dumps
        from bussim.version import __version__

        write_text(target, f"# Made by bussim {__version__} fit from {trace}.\n{dumps(scenario)}")
    if plot is not None:
        _plot(Path(plot), fitted, simulated)
    if as_json:
        found = to_json(fitted, comparison)
        print_json({"source": trace, "scenario": output, **found})
        return
    show(fitted, comparison)
    if target is not None:
        click.echo(f"scenario: {target}")


def scenario_of(
    fitted: Fitted, base: str | None, *, name: str, seed: int, longest: int, allow_code: bool = False
) -> Scenario:
    """The scenario of the estimates, or ``base`` with them. Raises ScenarioError or UsageError."""
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
    folder = None if base is None else Path(base).parent
    return from_data(data, name=base or "<fit>", allow_code=allow_code, folder=folder)


def _simulated(scenario: Scenario, fitted: Fitted, *, wanted: bool) -> RunRecord | None:
    from bussim import api

    if not wanted or fitted.link is None or not fitted.link.scans:
        return None
    record = api.run(scenario, rows=False).record
    link = record.links.get(fitted.bus)
    return record if link is not None and link.scan_times.histogram.count else None


def _plot(folder: Path, fitted: Fitted, simulated: RunRecord | None) -> None:
    from bussim.results.plots.scan_times import scan_time_histogram
    from bussim.results.store.safe_names import file_name

    if simulated is None:
        raise UsageError("there are no link scans to draw")
    folder.mkdir(parents=True, exist_ok=True)
    picture = scan_time_histogram([fitted.measured, simulated], fitted.bus, ["measured", "simulated"])
    for path in picture.save_both(folder / f"fit_{file_name(fitted.bus)}"):
        click.echo(f"picture: {path}", err=True)
