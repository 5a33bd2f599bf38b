"""``bussim size``: which retries and timeout a link should have."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bussim.commands.common.drawing import import_matplotlib
from bussim.commands.common.output import (
    busy,
    check_pictures,
    checked_target,
    made_folder,
    print_files,
    show_carried,
    to_json,
    write_text,
)
from bussim.commands.common.scenario_options import code_option, lang_option, set_option
from bussim.commands.size.uniform_link import DEFAULT_PROFILE, DEFAULT_SCAN, uniform_link
from bussim.errors import RunError, UsageError
from bussim.words.language import current_language, say

if TYPE_CHECKING:
    from bussim.commands.size.verify import Verification
    from bussim.commands.size.verify_ports import PortVerification
    from bussim.exact.sizing.size import Sizing
    from bussim.scenario.model import Scenario

#: What a page's name may end in.
PAGES = (".html", ".htm")
_FORMS = (
    "errors<=1/y, onsets<=1/y, scan<=200ms@1e-6, dead<=400ms, ride>=100ms, heartbeat=500ms@0.1/y; "
    "of poll lists errors, dead, cycle<=500ms, age<=1s"
)


@click.command()
@click.argument("scenario", metavar="[SCENARIO]", required=False)
@click.option("--stations", type=int, metavar="N", help="Without SCENARIO: so many stations, the master too.")
@click.option("--mode", type=int, metavar="D8178", help="Their refresh mode. [default: 0]")
@click.option("--scan", metavar="T", help=f"Their PLC scan time. [default: {DEFAULT_SCAN}]")
@click.option("--ber", type=float, metavar="P", help="Bit error rate of their line. [default: not known]")
@click.option("--profile", metavar="NAME", help=f"Their profile. [default: {DEFAULT_PROFILE}]")
@click.option("--goal", "goals", metavar="GOAL", multiple=True, help=f"What it must achieve: {_FORMS}.")
@click.option(
    "--responses",
    metavar="RUN",
    help="Folder of a run of it: no timeout is shorter than the longest response of its Modbus masters.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.option("--verify", "check", is_flag=True, help="Simulate the choice, one retry less and none.")
@set_option
@click.option(
    "-o",
    "--out",
    metavar="PATH",
    help="Folder for size.json and the picture of the trade-off; or a file .html: a page with sliders.",
)
@click.option("--force", is_flag=True, help="Replace the files of --out.")
@lang_option
@click.option(
    "--standard-lines",
    "standard",
    is_flag=True,
    help="Without SCENARIO: the page of links of 2 to 8 stations in modes 0 to 4.",
)
@code_option
def command(
    scenario: str | None,
    *,
    stations: int | None,
    mode: int | None,
    scan: str | None,
    ber: float | None,
    profile: str | None,
    goals: tuple[str, ...],
    responses: str | None,
    as_json: bool,
    check: bool,
    overrides: tuple[str, ...],
    out: str | None,
    force: bool,
    standard: bool,
    allow_code: bool,
) -> None:
    """Search all retries (D8179) and timeouts (D8180) of each link and recommend one setting.

    Of each Modbus poll list of a PLC's port or a device likewise: timeout, retries and interval.

    SCENARIO is a file or the name of a built-in scenario. Its faults are left out: a setting is for
    the line in operation. Without a file, --stations and --mode describe a link of equal stations:
    bussim size --stations 4 --mode 2. -o sizing.html writes a page to hand over, whose sliders
    show every setting in English and Chinese, without Python. Where no noise is given, three levels of
    it are assumed and shown. The exit code is 1 if no setting meets the goals, or if a simulation
    disagrees with the law.
    """
    from bussim.exact.sizing.sized import size

    if force and out is None:
        raise UsageError("--force goes with --out")
    page = out is not None and Path(out).suffix.lower() in PAGES and not Path(out).is_dir()
    if standard and not page:
        raise UsageError(
            "--standard-lines is of the page with sliders: name it with --out, such as -o sizing.html"
        )
    target = checked_target(Path(out), PAGES, force=force) if page and out is not None else None
    _check_goals(goals)
    described = {"--stations": stations, "--mode": mode, "--scan": scan, "--ber": ber, "--profile": profile}
    given = [name for name, value in described.items() if value is not None]
    if standard and target is not None:
        refused = {
            "SCENARIO": scenario,
            "--stations": stations,
            "--mode": mode,
            "--json": as_json,
            "--verify": check,
            "--responses": responses,
        }
        wrong = next((name for name, value in refused.items() if value not in (None, False)), None)
        if wrong:
            raise UsageError(f"{wrong} and --standard-lines exclude each other")
        from bussim.commands.size.standard import standard_page

        with busy("sizing the usual lines"):
            text = standard_page(
                goals, current_language(), profile=profile, scan=scan, ber=ber, overrides=overrides
            )
        write_text(target, text)
        print_files([target], as_json=False)
        return
    if scenario is not None:
        from bussim import api

        if given:
            raise UsageError(
                f"{scenario} and {given[0]} exclude each other: size a scenario, whose stations are its own, "
                "or a link of --stations"
            )
        loaded = api.load(scenario, overrides, allow_code=allow_code)
    elif stations is None:
        missing = f"{given[0]} needs --stations" if given else "name a SCENARIO, or describe a link"
        raise UsageError(f"{missing}: bussim size --stations 4 --mode 2")
    else:
        loaded = uniform_link(
            stations, mode or 0, profile=profile or DEFAULT_PROFILE, scan=scan, ber=ber, overrides=overrides
        )
        for text in loaded.warnings:
            if text.startswith("plcs.master.scan "):  # each PLC has the same
                click.echo(f"warning: {text.replace('plcs.master.scan', '--scan', 1)}", err=True)
    show_carried(loaded, err=as_json)
    seen = None
    if responses is not None:
        from bussim.commands.size.measured import longest_responses

        seen = longest_responses(Path(responses))
    with busy("sizing"):
        sized = size(loaded, goals, seen)
    found, ports = sized.links, sized.ports
    folder, stems = None, {}
    if out is not None and target is None:
        from bussim.results.store.safe_names import file_names

        folder = made_folder(Path(out))
        checked_target(folder / "size.json", (), force=force, option="--out")
        valid = {bus: stem for bus, stem in file_names(found).items() if found[bus].valid}
        stems = {bus: folder / f"size_{stem}" for bus, stem in valid.items()}
        check_pictures(stems.values(), force=force)
    verifications: dict[str, list[Verification]] = {}
    verified: dict[str, list[PortVerification]] = {}
    if check:
        from bussim.commands.size.verify import verify
        from bussim.commands.size.verify_ports import verify_port

        with busy("simulating the choice"):
            verifications = {bus: verify(loaded, bus, sizing) for bus, sizing in found.items()}
            verified = {node: verify_port(loaded, node, sizing) for node, sizing in ports.items()}
    result: dict[str, Any] = sized.to_dict()
    if check:
        for bus, each in verifications.items():
            result["links"][bus]["verify"] = [verdict.to_json() for verdict in each]
        for node, checks in verified.items():
            result["ports"][node]["verify"] = [verdict.to_json() for verdict in checks]
    text = to_json(result)
    paths: list[Path] = []  # written before anything is printed: a reader may leave the screen half-way
    if target is not None:
        from bussim.exact.sizing.page.items import page_items
        from bussim.report.sizing import sizing_page

        with busy("working out the page"):
            write_text(
                target, sizing_page(loaded.name if scenario else "", page_items(sized), current_language())
            )
        paths = [target]
    elif folder is not None:
        paths = _write(loaded, found, text, folder, stems)
    if as_json:
        click.echo(text, nl=False)
    else:
        from bussim.commands.common.console import wide_console
        from bussim.commands.size.show import show_sizing

        console = wide_console()
        for bus, sizing in found.items():
            show_sizing(console, bus, sizing, verifications.get(bus, []))
        for node, port in ports.items():
            from bussim.commands.size.ports import show_port_sizing

            show_port_sizing(console, node, port, verified.get(node, []))
    for path in paths:
        click.echo(path, err=as_json)
    failed = [bus for bus, sizing in found.items() if sizing.recommended is None]
    # A list that cannot be sized is no failure beside a link that can.
    failed += [node for node, port in ports.items() if port.recommended is None and (port.valid or not found)]
    if failed:
        raise RunError(f"no setting for {', '.join(failed)}: see above")
    failed = [bus for bus, each in verifications.items() if any(one.agrees is False for one in each)]
    failed += [node for node, each in verified.items() if not all(one.agrees for one in each)]
    if failed:
        raise RunError(f"simulation and law disagree on {', '.join(failed)}: see above")


def _check_goals(texts: tuple[str, ...]) -> None:
    """Mistakes in goals are said before those in a scenario."""
    from bussim.exact.sizing.goals import Goals

    try:
        Goals().with_texts(texts)
    except ValueError as error:
        raise UsageError(str(error)) from None


def _write(
    scenario: Scenario, found: dict[str, Sizing], text: str, folder: Path, stems: dict[str, Path]
) -> list[Path]:
    import_matplotlib()
    from bussim.exact.sizing.trade_off import trade_off
    from bussim.results.plots.trade_off import trade_off_picture
    from bussim.units import TICKS_PER_MS
    from bussim.version import __version__

    paths = [folder / "size.json"]
    write_text(paths[0], text)
    for bus, stem in stems.items():
        sizing = found[bus]
        points, goals, best = trade_off(sizing), sizing.goals, sizing.recommended
        picture = trade_off_picture(
            bus,
            points.retries,
            {name: [(x / TICKS_PER_MS, y) for x, y in dots] for name, dots in points.series.items()},
            timeout=points.timeout / TICKS_PER_MS,
            errors=[goals.errors, *([] if goals.onsets is None else [points.errors_at(goals.onsets)])],
            dead=[
                *([] if goals.dead is None else [(0.0, goals.dead / TICKS_PER_MS)]),
                *([(points.riding_from(goals.ride) / TICKS_PER_MS, math.inf)] if goals.ride else []),
            ],
            goals=[
                say("plot_no_band", goal=words) if name in ("scan", "heartbeat") else words
                for name, words in goals.texts().items()
            ],
            more=bool(sizing.model.dead),
            chosen=None if best is None else (points.chosen_for, best.retries),
            description=f"{scenario.name}, bussim {__version__}",
        )
        paths += picture.save_both(stem)
    return paths
