"""``bussim plot``: pictures of finished runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bussim.commands.common.drawing import import_matplotlib
from bussim.commands.common.output import check_pictures, made_folder, print_files
from bussim.commands.common.scenario_options import lang_option
from bussim.errors import UsageError
from bussim.wording import visible

if TYPE_CHECKING:
    from bussim.results.plots.style import Picture
    from bussim.results.run_record import RunRecord


#: What each kind draws, by the option that chooses one of them; and what that option is about.
_OPTIONS = {"histogram": "bus", "over-run": "bus", "responses": "port", "latency": "latency"}
_ABOUT = {"bus": "link scans", "port": "response times", "latency": "latencies"}


@click.command()
@click.argument("runs", metavar="RUN_DIR...", nargs=-1, required=True)
@click.option(
    "-o", "--out", metavar="DIR", help="Folder for the pictures (default: the run's; of several, this one)."
)
@click.option("--force", is_flag=True, help="Replace pictures that exist.")
@click.option("--json", "as_json", is_flag=True, help="Print what was written as JSON.")
@click.option(
    "--kind",
    type=click.Choice([*_OPTIONS, "all"]),
    default="all",
    show_default=True,
    help="Histogram of link scan times, scan times over the run with its faults, histograms of the "
    "response times of Modbus masters, or latencies with their bounds and what they are made of.",
)
@lang_option
@click.option("--bus", metavar="NAME", help="Only this N:N link (default: every one).")
@click.option(
    "--port", metavar="NODE", help="Only this Modbus master, such as press1.COM3 (default: every one)."
)
@click.option(
    "--latency", metavar="NAME", help="Only this entry of the scenario's latency (default: every one)."
)
def command(
    runs: tuple[str, ...],
    *,
    out: str | None,
    force: bool,
    as_json: bool,
    kind: str,
    bus: str | None,
    port: str | None,
    latency: str | None,
) -> None:
    """Draw link scan times, response times and latencies of one run or several, as PNG and SVG.

    The histograms of several runs share one axis. Prints the paths of the pictures.
    """
    from bussim.results.store.load import load_run

    given = {"bus": bus, "port": port, "latency": latency}
    chosen = _chosen(kind, given)
    folders = [Path(run) for run in runs]
    records = [load_run(folder) for folder in folders]
    labels = _labels(folders)
    subjects = {option: _subject(option) for option in chosen}
    found = {option: subject.names(records, given[option]) for option, subject in subjects.items()}
    if not any(found.values()):
        raise UsageError(_nothing(records, labels, list(subjects.values())))
    target = _folder(folders, out)
    pictures = {
        target / stem: draw
        for option, subject in subjects.items()
        for stem, draw in _pictures(subject, found[option], records, labels, kind)
    }
    check_pictures(pictures, force=force)
    print_files([path for stem, draw in pictures.items() for path in draw().save_both(stem)], as_json=as_json)


@dataclass(frozen=True, slots=True)
class _Subject:
    """What an option of the command chooses one of.

    ``missing`` and ``called`` are for messages, ``stem`` begins the names of files. ``every`` are the names
    that a run has, ``drawable`` those with something to draw; ``check`` raises UsageError for a name
    without it.
    """

    missing: str
    called: str
    stem: str
    every: Callable[[RunRecord], Sequence[str]]
    drawable: Callable[[RunRecord], Sequence[str]]
    check: Callable[[RunRecord, str], object]
    picture: Callable[[Sequence[RunRecord], str, Sequence[str] | None], Picture]

    def names(self, records: Sequence[RunRecord], wanted: str | None) -> list[str]:
        """The wanted one, or all that can be drawn of every run."""
        if wanted is None:
            rest = [set(self.drawable(run)) for run in records[1:]]
            return [name for name in self.drawable(records[0]) if all(name in names for names in rest)]
        for run in records:
            self.check(run, wanted)
        return [wanted]


def _subject(option: str) -> _Subject:
    import_matplotlib()
    from bussim.results.plots.latency import latency_of, latency_picture, measured
    from bussim.results.plots.responses import master_of, masters, response_time_histogram
    from bussim.results.plots.scan_times import link_of, scan_time_histogram

    return {
        "bus": _Subject(
            "N:N link with link scans",
            "links",
            "scan_time",
            lambda run: list(run.links),
            lambda run: [bus for bus, link in run.links.items() if link.scan_times.histogram.count],
            link_of,
            scan_time_histogram,
        ),
        "port": _Subject(
            "Modbus master with a response",
            "masters",
            "response_time",
            lambda run: [name for name, port in run.ports.items() if port.polls],
            masters,
            master_of,
            response_time_histogram,
        ),
        "latency": _Subject(
            "measured latency",
            "latencies",
            "latency",
            lambda run: list(run.latency),
            measured,
            latency_of,
            latency_picture,
        ),
    }[option]


def _chosen(kind: str, given: Mapping[str, str | None]) -> list[str]:
    """What is to be drawn, by the options that choose one of it."""
    named = [option for option, name in given.items() if name is not None]
    if kind != "all":
        for option in named:
            if option != _OPTIONS[kind]:
                raise UsageError(f"--{option} is about {_ABOUT[option]}, --kind {kind} draws none")
        return [_OPTIONS[kind]]
    # Who names one thing wants nothing else.
    return named or list(given)


def _pictures(
    subject: _Subject, names: Sequence[str], records: Sequence[RunRecord], labels: Sequence[str], kind: str
) -> Iterator[tuple[str, Callable[[], Picture]]]:
    """What is to be drawn: the name of each picture, without an ending, and what draws it."""
    from bussim.results.plots.over_run import scan_times_over_run
    from bussim.results.store.safe_names import file_name, file_names

    several = len(records) > 1
    ending = f"_{file_name('_'.join(labels))}" if several else ""
    # A folder's own pictures are named so that no two of them are alike.
    stems = file_names(
        subject.every(records[0]) if subject.stem == "scan_time" else subject.drawable(records[0])
    )
    for name in names:
        if kind != "over-run":
            draw = partial(subject.picture, records, name, labels if several else None)
            yield f"{subject.stem}_{stems[name]}{ending}", draw
        if subject.stem == "scan_time" and kind != "histogram":
            for record, label in zip(records, file_names(labels).values(), strict=True):
                over_run = f"scan_time_over_run_{stems[name]}" + (f"_{label}" if several else "")
                yield over_run, partial(scan_times_over_run, record, name)


def _labels(folders: Sequence[Path]) -> list[str]:
    """The folders' names, or their paths where names are equal."""
    names = [visible(folder.resolve().name) for folder in folders]
    if len(set(names)) == len(names):
        return names
    paths = [str(folder.resolve()) for folder in folders]
    if len(set(paths)) < len(paths):
        twice = next(path for path in paths if paths.count(path) > 1)
        raise UsageError(f"{twice} is named twice")
    return paths


def _nothing(records: Sequence[RunRecord], labels: Sequence[str], subjects: Sequence[_Subject]) -> str:
    where = "in this run" if len(records) == 1 else "common to these runs"
    lists = []
    for subject in subjects:
        found = "; ".join(
            f"{label}: {', '.join(subject.every(run)) or 'none'}"
            for label, run in zip(labels, records, strict=True)
        )
        lists.append(f"{subject.called}: {found}")
    *wanted, last = [f"no {subject.missing}" for subject in subjects]
    missing = f"{', '.join(wanted)} and {last}" if wanted else last
    # A PLC that runs its program by itself has devices all the same.
    alone = not any(run.summary["links"] or run.summary["buses"] for run in records)
    hint = "; without a bus: bussim watch SCENARIO --devices … --plot FILE draws devices" if alone else ""
    return f"{missing} {where} ({'; '.join(lists)}){hint}"


def _folder(folders: Sequence[Path], out: str | None) -> Path:
    if out is None:
        return folders[0] if len(folders) == 1 else Path()
    return made_folder(Path(out))
