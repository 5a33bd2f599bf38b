"""``bussim site``: what the registers of a link say, read with nothing but the programming tool."""

from __future__ import annotations

from pathlib import Path

import click

from bussim.commands.common.output import print_json
from bussim.errors import UsageError


@click.command()
@click.argument("file", metavar="FILE")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def command(file: str, *, as_json: bool) -> None:
    """Find what is wrong with a link and how much noise it has.

    FILE is a readout of its stations' registers.
    """
    from bussim.commands.common.console import wide_console
    from bussim.commands.site.show import show_diagnosis
    from bussim.site.diagnosis.diagnose import diagnose
    from bussim.site.file import load
    from bussim.site.link import SiteLink
    from bussim.site.readout import Readout

    noted = load(Path(file))
    if not isinstance(noted, Readout):
        raise UsageError(f"{file} is a calibration, which is not worked out")
    found = diagnose(noted, SiteLink.of(noted))
    if as_json:
        print_json({"schema": 1, "kind": "readout", **found.to_json(), "notes": list(noted.notes)})
        return
    console = wide_console()
    show_diagnosis(console, noted, found)
