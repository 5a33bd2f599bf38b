"""``bussim scenarios``: list, show and copy the built-in scenarios."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import click

from bussim.errors import RunError, UsageError
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
    """Write the scenario beside its place and move it there, so that no half of it is ever left."""
    source = builtin.path(name)
    target = destination / source.name if destination.is_dir() else destination
    if target.exists() and not force:
        raise UsageError(f"{target} exists; give another place, or --force to overwrite it")
    if target.is_dir():
        raise UsageError(f"{target} is a folder")
    try:
        handle, beside = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
    except OSError as error:
        raise RunError(f"cannot write {target}: {error.strerror}") from None
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(source.read_bytes())
        Path(beside).chmod(0o644)
        Path(beside).replace(target)
    except OSError as error:
        Path(beside).unlink(missing_ok=True)
        raise RunError(f"cannot write {target}: {error.strerror}") from None
    return target
