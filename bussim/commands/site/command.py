"""``bussim site``: what the registers of a link say, read with nothing but the programming tool."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bussim.commands.common.output import checked_target, print_json, print_or_write, write_text
from bussim.errors import UsageError
from bussim.site.paper import LANGUAGES, form_page

if TYPE_CHECKING:
    from bussim.site.readout import Calibration, Readout


@click.command()
@click.argument("file", metavar="[FILE]", required=False)
@click.option("--form", type=click.Choice(LANGUAGES), help="Print the form to fill in by hand, as HTML.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.option("--plan", "planned", is_flag=True, help="Say how long to watch with which reading.")
@click.option("-o", "--out", metavar="FILE", help="Where to write the profile of a calibration, or the form.")
@click.option("--force", is_flag=True, help="Replace the file of -o.")
def command(
    file: str | None, *, form: str | None, as_json: bool, planned: bool, out: str | None, force: bool
) -> None:
    """Find what is wrong with a link, how much noise it has, and what to set.

    FILE is a readout of its stations' registers, or a calibration: experiments at a machine at rest that
    decide its profile.
    """
    from bussim.site.file import load
    from bussim.site.readout import Readout

    if (file is None) == (form is None):
        raise UsageError("name one FILE, a readout or a calibration; or --form en, --form zh for the paper")
    if file is None:
        if planned:
            raise UsageError("--plan is for a readout")
        print_or_write(form_page(form or ""), out, (".html",), force=force, as_json=as_json)
        return
    if force and out is None:
        raise UsageError("--force goes with --out")
    noted = load(Path(file))
    if isinstance(noted, Readout):
        if out is not None:
            raise UsageError(f"-o is for the profile of a calibration; {file} is a readout")
        _readout(noted, as_json=as_json, planned=planned)
        return
    if planned:
        raise UsageError(f"--plan is for a readout; {file} is a calibration")
    target = None if out is None else checked_target(Path(out), (".yaml", ".yml"), force=force)
    _calibration(noted, target, as_json=as_json)


def _calibration(noted: Calibration, target: Path | None, *, as_json: bool) -> None:
    from bussim.commands.common.console import wide_console
    from bussim.commands.site.show import show_calibration
    from bussim.scenario.yaml.dump import dumped
    from bussim.site.calibration import calibrate

    found = calibrate(noted)
    text = "" if found.unexplained else dumped(found.profile(noted.profile.form))
    if as_json:
        print_json({"schema": 1, "kind": "calibration", **found.to_json()})
    else:
        show_calibration(wide_console(), found, text)
    if target is not None and text:
        write_text(target, "# By bussim site, of a calibration; what is open has the assumed value.\n" + text)
        click.echo(f"profile: {target}", err=as_json)


def _readout(noted: Readout, *, as_json: bool, planned: bool) -> None:
    from bussim.commands.common.console import wide_console
    from bussim.commands.site.show import show_diagnosis, show_picture, show_plan
    from bussim.plc.profiles import Attempts
    from bussim.site.diagnosis.diagnose import diagnose
    from bussim.site.link import SiteLink
    from bussim.site.noise.picture import picture
    from bussim.site.noise.sizing import sizes
    from bussim.site.plan import plan

    # What a calibration left open is worked out both ways.
    meanings = [*Attempts] if "attempts" in noted.profile.open else [None]
    pictures = [picture(noted, SiteLink.of(noted, meaning)) for meaning in meanings]
    first = pictures[0]
    found = diagnose(noted, SiteLink.of(noted), first.bursts)
    if as_json:
        values: dict[str, Any] = {"schema": 1, "kind": "readout", **found.to_json(), **first.to_json()}
        values["size"] = {name: chosen.to_json() for name, chosen in sizes(first).items()}
        values["plan"] = [watch.to_json() for watch in plan(first)] if planned else None
        if len(pictures) > 1:
            named = zip(meanings, pictures, strict=True)
            values["attempts_open"] = {str(name): one.to_json()["stations"] for name, one in named}
        print_json({**values, "notes": list(noted.notes)})
        return
    console = wide_console()
    show_diagnosis(console, noted, found)
    for meaning, one in zip(meanings, pictures, strict=True):
        show_picture(console, noted, one, meaning, mend_first=found.broken)
    if planned:
        show_plan(console, first, plan(first))
