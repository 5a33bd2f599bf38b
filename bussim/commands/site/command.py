"""``bussim site``: what the registers of a link say, read with nothing but the programming tool."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bussim.commands.common.output import print_json
from bussim.errors import UsageError

if TYPE_CHECKING:
    from bussim.site.readout import Readout


@click.command()
@click.argument("file", metavar="FILE")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.option("--plan", "planned", is_flag=True, help="Say how long to watch with which reading.")
def command(file: str, *, as_json: bool, planned: bool) -> None:
    """Find what is wrong with a link, how much noise it has, and what to set.

    FILE is a readout of its stations' registers.
    """
    from bussim.site.file import load
    from bussim.site.readout import Readout

    noted = load(Path(file))
    if not isinstance(noted, Readout):
        raise UsageError(f"{file} is a calibration, which is not worked out")
    _readout(noted, as_json=as_json, planned=planned)


def _readout(noted: Readout, *, as_json: bool, planned: bool) -> None:
    from bussim.commands.common.console import wide_console
    from bussim.commands.site.show import show_diagnosis, show_picture, show_plan
    from bussim.plc.profiles import Attempts
    from bussim.site.diagnosis.diagnose import diagnose
    from bussim.site.link import SiteLink
    from bussim.site.noise.picture import picture
    from bussim.site.noise.sizing import sizes
    from bussim.site.plan import plan

    found = diagnose(noted, SiteLink.of(noted))
    # What a calibration left open is worked out both ways.
    meanings = [*Attempts] if "attempts" in noted.profile.open else [None]
    pictures = [picture(noted, SiteLink.of(noted, meaning)) for meaning in meanings]
    first = pictures[0]
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
