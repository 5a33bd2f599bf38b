"""``bussim scenarios``: list, show and copy the built-in scenarios."""

from pathlib import Path

import click

from bussim.commands.common.output import checked_target, write_text
from bussim.errors import UsageError
from bussim.scenario import builtin


@click.command()
@click.argument("name", required=False)
@click.option(
    "--copy",
    "destination",
    metavar="[DEST]",
    is_flag=False,
    flag_value=".",
    help="Copy scenario NAME to DEST, a folder or a file; without DEST, to the current folder.",
)
@click.option("--force", is_flag=True, help="Let --copy overwrite an existing file.")
def command(name: str | None, destination: str | None, *, force: bool) -> None:
    """List the built-in scenarios, show one (NAME), or copy it (NAME --copy)."""
    if destination is None:
        if force:
            raise UsageError("--force goes with --copy")
        if name is None:
            _list()
        else:
            click.echo(builtin.read(name), nl=False)
        return
    if name is None:
        raise UsageError("--copy needs the NAME of a scenario before it: bussim scenarios NAME --copy [DEST]")
    click.echo(f"copied to {_copy(name, Path(destination), force=force)}")


def _list() -> None:
    names = builtin.names()
    width = max(map(len, names))
    for name in names:
        click.echo(f"{name:<{width}}  {builtin.title(name)}")


def _copy(name: str, destination: Path, *, force: bool) -> Path:
    source = builtin.path(name)
    target = destination / source.name if destination.is_dir() else destination
    write_text(checked_target(target, (), force=force, option="--copy"), source.read_text(encoding="utf-8"))
    return target
