"""What commands print as JSON, and files that their options name: written whole, over others by --force."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bussim.errors import UsageError
from bussim.files import not_written, written_whole
from bussim.wording import shell_word, visible
from bussim.words.language import said_text

if TYPE_CHECKING:
    from bussim.results.run_record import RunRecord
    from bussim.scenario.model import Scenario
    from bussim.trace.file import Trace


def print_json(data: Any, *, indent: int = 2) -> None:
    """Print plain data as JSON; raises as :func:`to_json`."""
    click.echo(to_json(data, indent=indent), nl=False)


def to_json(data: Any, *, indent: int | None = 2) -> str:
    """Plain data as lines of JSON, texts not escaped. Raises ValueError for what is no number."""
    return json.dumps(data, ensure_ascii=False, allow_nan=False, indent=indent) + "\n"


def show_carried(scenario: Scenario, *, err: bool = False) -> None:
    """Repeat what the command that wrote a scenario warns of, before anything is said of it."""
    for warning in scenario.carried:
        click.echo(f"warning: {warning.text}", err=err)


def checked_target(path: Path, endings: Sequence[str], *, force: bool, option: str = "-o") -> Path:
    """The path, if a file may be written there; ``option`` is that which names it. No endings: any.

    Raises UsageError for another ending, for a folder, for a file that exists unless ``force``, or
    where there is no folder to write it to.
    """
    if endings and path.suffix.lower() not in endings:
        allowed = " or ".join(endings)
        raise UsageError(f"{path} ends in {path.suffix or 'nothing'}; write a name that ends in {allowed}")
    if path.is_dir():
        raise UsageError(f"{path} is a folder; name a file")
    if path.exists() and not path.is_file():
        raise UsageError(f"{path} is no plain file, and is not replaced even by --force; name a file")
    if path.exists() and not force:
        raise UsageError(f"{path} exists; choose another name with {option}, or replace it with --force")
    if not path.parent.is_dir():
        raise UsageError(f"{path}: there is no folder {path.parent}")
    return path


def check_pictures(stems: Iterable[Path], *, force: bool, option: str = "--out") -> None:
    """Raise as :func:`checked_target` for pictures, named without .png or .svg, that may not be written."""
    for stem in stems:
        for ending in (".png", ".svg"):
            checked_target(stem.with_name(stem.name + ending), (), force=force, option=option)


def made_folder(path: Path) -> Path:
    """The folder for a command's files, made with those above it where it is not there.

    Those that are empty when the command ends, because its files could not be written, are removed.
    Raises UsageError or RunError where it cannot be made.
    """
    made = [each for each in (path, *path.parents) if not os.path.lexists(each)]

    def remove() -> None:
        for each in made:
            with suppress(OSError):
                each.rmdir()

    click.get_current_context().call_on_close(remove)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise not_written(path, error) from error
    return path


def print_files(paths: Sequence[Path], *, as_json: bool) -> None:
    """Print the files that a command wrote, each on a line or as JSON."""
    if as_json:
        print_json({"schema": 1, "files": list(map(str, paths))})
    else:
        click.echo("\n".join(map(str, paths)))


def traced_again(folder: Path) -> str:
    """The command that repeats a run with a trace."""
    from bussim.results.store.folder import SCENARIO

    return f"bussim run {shell_word(folder / SCENARIO)} --trace --out NEW_DIR"


def whole_trace(path: Path, record: RunRecord | None = None) -> Trace:
    """The trace in a file or a run's folder; a warning on standard error says where it is cut off.

    Raises UsageError where the folder's record is of another run than its trace.
    """
    from bussim.trace.file import TRACE, read_trace

    trace = read_trace(path)
    if record is not None and trace.header.seed is not None:
        runs = [(each["scenario"], each["seed"]) for each in (trace.header._asdict(), record.summary)]
        if runs[0] != runs[1]:
            found, kept = (f"{visible(str(name))!r} with seed {seed}" for name, seed in runs)
            raise UsageError(f"{path / TRACE} is of another run: of {found}; the folder has {kept}")
    if trace.is_cut:
        text = f"{visible(str(path))}: {said_text('trace_cut_off')}"
        click.echo(said_text("run_warning", text=text), err=True)
    return trace


def write_text(path: Path, text: str) -> None:
    """Write a file beside its target and move it there; raises as :func:`bussim.files.written_whole`.

    Of a name of a file that is no text here, as one in GBK, bytes stand in escapes.
    """
    with written_whole(path) as part:
        part.write_text(text, encoding="utf-8", errors="backslashreplace", newline="\n")


def print_or_write(text: str, out: str | None, endings: Sequence[str], *, force: bool, as_json: bool) -> None:
    """Print a text, or write it to the file of ``--out`` and print its name.

    Raises UsageError for ``--force`` or ``--json`` without ``--out``, and as :func:`checked_target`.
    """
    if out is None:
        if force or as_json:
            raise UsageError(f"{'--force' if force else '--json'} goes with --out")
        click.echo(text, nl=False)
        return
    target = checked_target(Path(out), endings, force=force)
    write_text(target, text)
    print_files([target], as_json=as_json)


@contextmanager
def busy(what: str) -> Iterator[None]:
    """Say on stderr what takes its time, only on a terminal."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console

    with Console(stderr=True).status(what):
        yield
