"""``bussim ui``: a line on a page of the browser."""

import secrets
import socket
import webbrowser
from importlib.util import find_spec
from pathlib import Path

import click

from bussim.errors import UsageError
from bussim.words.language import system_language
from bussim.words.tables import LANGUAGES


@click.command()
@click.argument("scenario", metavar="[SCENARIO]", required=False)
@click.option("--folder", metavar="DIR", help="Where it opens and saves. [default: SCENARIO's, or this]")
@click.option("--lang", type=click.Choice(LANGUAGES), help="Language of the page. [default: the system's]")
@click.option("--no-browser", is_flag=True, help="Do not open the browser.")
def command(scenario: str | None, *, folder: str | None, lang: str | None, no_browser: bool) -> None:
    """Show a line on a page: move retries, timeout or noise, and see link scan times and errors at once.

    SCENARIO is a file or the name of a built-in scenario; without it the page begins with an example.
    The first line printed is the address, which this computer alone can open and only with the token in
    it: a colleague who works on this computer at the same time could read it from the list of processes.
    Scenarios are saved in the folder, and runs in its folder runs. Ends with Quit on the page or Ctrl-C.
    """
    from bussim.scenario import builtin

    for name in ("starlette", "uvicorn"):
        if find_spec(name) is None:
            raise UsageError(f"the page needs {name}, which is not installed: pip install 'bussim[ui]'")
    opened, home = None, Path()
    if scenario is not None:
        opened = builtin.locate(scenario)[0].absolute()
        if not opened.is_file():
            raise UsageError(f"{scenario}: no such file, and no built-in scenario of that name")
        home = Path() if opened.parent == builtin.folder() else opened.parent
    where = home if folder is None else Path(folder)
    if not where.is_dir():
        raise UsageError(f"--folder {where}: no such folder")

    token = secrets.token_urlsafe(32)
    # TCP by its name: asyncio delays what it sends where a socket does not name it (each answer by 40 ms).
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP) as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        # The fragment of an address is never sent, nor logged.
        address = f"http://127.0.0.1:{listening.getsockname()[1]}/#{token}"
        click.echo(address)
        if not no_browser:
            webbrowser.open(address)
        # While the browser begins.
        from bussim.commands.new import new_scenario
        from bussim.commands.report import report
        from bussim.site.result import site
        from bussim.ui.server import serve
        from bussim.ui.workspace import Workspace

        parts = {"report": report, "site": site, "example": new_scenario(4, 2)}
        serve(listening, token, Workspace(where, opened), lang or system_language(), **parts)
