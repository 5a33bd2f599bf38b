"""``bussim plot``: pictures of finished runs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bussim.errors import UsageError

if TYPE_CHECKING:
    from bussim.results.record import RunRecord


@click.command()
@click.argument("runs", metavar="RUN_DIR...", nargs=-1, required=True)
@click.option(
    "--out", metavar="DIR", help="Folder for the pictures (default: the run's; of several, this one)."
)
@click.option(
    "--kind",
    type=click.Choice(["histogram", "over-run", "both"]),
    default="both",
    show_default=True,
    help="Histogram of link scan times, or scan times over the run with its faults.",
)
@click.option("--bus", metavar="NAME", help="Only this N:N link (default: every one).")
def command(runs: tuple[str, ...], *, out: str | None, kind: str, bus: str | None) -> None:
    """Draw the link scan times of one run or several, as PNG and SVG.

    The histograms of several runs share one axis. Prints the paths of the pictures.
    """
    from bussim.results.load import load_run
    from bussim.results.names import file_name, file_names
    from bussim.results.plot_run import scan_times_over_run
    from bussim.results.plots import scan_time_histogram

    folders = [Path(run) for run in runs]
    records = [load_run(folder) for folder in folders]
    labels = _labels(folders)
    buses = _buses(records, labels, bus)
    alone = len(records) == 1
    place = _place(folders, out)
    stems = file_names(records[0].links)
    paths: list[Path] = []
    for name in buses:
        stem = stems[name]
        if kind != "over-run":
            ending = "" if alone else f"_{file_name('_'.join(labels))}"
            shown = None if alone else labels
            picture = scan_time_histogram(records, name, shown)
            paths += picture.save_both(place / f"scan_time_{stem}{ending}")
        if kind != "histogram":
            for record, ending in zip(records, file_names(labels).values(), strict=True):
                over_run = f"scan_time_over_run_{stem}" + ("" if alone else f"_{ending}")
                paths += scan_times_over_run(record, name).save_both(place / over_run)
    for path in paths:
        click.echo(path)


def _labels(folders: Sequence[Path]) -> list[str]:
    """The folders' names, or their paths where names are equal."""
    names = [folder.resolve().name for folder in folders]
    if len(set(names)) == len(names):
        return names
    paths = [str(folder.resolve()) for folder in folders]
    if len(set(paths)) < len(paths):
        twice = next(path for path in paths if paths.count(path) > 1)
        raise UsageError(f"{twice} is named twice")
    return paths


def _buses(records: Sequence[RunRecord], labels: Sequence[str], wanted: str | None) -> list[str]:
    """The links to draw: the wanted one, or all that made scans in every run."""
    from bussim.results.plots import link_of

    if wanted is not None:
        for run in records:
            link_of(run, wanted)  # says what is wrong
        return [wanted]
    common = [
        bus
        for bus in records[0].links
        if all(bus in run.links and run.links[bus].scan_times.histogram.count for run in records)
    ]
    if not common:
        found = "; ".join(
            f"{label}: {', '.join(run.links) or 'none'}" for label, run in zip(labels, records, strict=True)
        )
        where = "in this run" if len(records) == 1 else "common to these runs"
        raise UsageError(f"no N:N link with link scans {where} (links: {found})")
    return common


def _place(folders: Sequence[Path], out: str | None) -> Path:
    if out is None:
        return folders[0] if len(folders) == 1 else Path()
    place = Path(out)
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"--out {out}: cannot be made: {error.strerror or error}") from error
    return place
