"""``bussim site``: what the registers of a link say, read with nothing but the programming tool."""

from pathlib import Path

import click

from bussim.commands.common.output import checked_target, print_json, print_or_write, write_text
from bussim.errors import UsageError
from bussim.site.paper import form_page
from bussim.words.tables import LANGUAGES


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
    if (file is None) == (form is None):
        raise UsageError("name one FILE, a readout or a calibration; or --form en, --form zh for the paper")
    if file is None:
        if planned:
            raise UsageError("--plan is for a readout")
        print_or_write(form_page(form or ""), out, (".html",), force=force, as_json=as_json)
        return
    if force and out is None:
        raise UsageError("--force goes with --out")
    from bussim.commands.common.console import wide_console
    from bussim.commands.site.show import show_calibration, show_readout
    from bussim.scenario.yaml.dump import dumped
    from bussim.site.result import site

    found = site(file)
    decides, text = found.decides, ""
    if decides is None and out is not None:
        raise UsageError(f"-o is for the profile of a calibration; {file} is a readout")
    if decides is not None and planned:
        raise UsageError(f"--plan is for a readout; {file} is a calibration")
    target = None if out is None else checked_target(Path(out), (".yaml", ".yml"), force=force)
    if decides is not None and not decides.unexplained:
        text = dumped(decides.profile(found.noted.profile.form))
    if target is not None and text:
        write_text(target, "# By bussim site, of a calibration; what is open has the assumed value.\n" + text)
    if as_json:
        print_json(found.to_dict(planned=planned))
    elif decides is None:
        show_readout(wide_console(), found, planned=planned)
    else:
        show_calibration(wide_console(), decides, text)
    if target is not None and text:
        click.echo(f"profile: {target}", err=as_json)
