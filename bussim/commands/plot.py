"""``bussim plot``: pictures of finished runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bussim.errors import UsageError

if TYPE_CHECKING:
    from bussim.results.run_record import RunRecord


#: What each kind draws, by the option that chooses one of them; and what that option is about.
_OPTIONS = {"histogram": "bus", "over-run": "bus", "responses": "port", "latency": "latency"}
_ABOUT = {"bus": "link scans", "port": "response times", "latency": "latencies"}


@click.command()
@click.argument("runs", metavar="RUN_DIR...", nargs=-1, required=True)
@click.option(
    "--out", metavar="DIR", help="Folder for the pictures (default: the run's; of several, this one)."
)
@click.option(
    "--kind",
    type=click.Choice([*_OPTIONS, "all"]),
    default="all",
    show_default=True,
    help="Histogram of link scan times, scan times over the run with its faults, histograms of the "
    "response times of Modbus masters, or latencies with their bounds and what they are made of.",
)
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
    kind: str,
    bus: str | None,
    port: str | None,
    latency: str | None,
) -> None:
    """Draw link scan times, response times and latencies of one run or several, as PNG and SVG.

    The histograms of several runs share one axis. Prints the paths of the pictures.
    """
    from bussim.results.store.load import load_run

    chosen = _chosen(kind, {"bus": bus, "port": port, "latency": latency})
    folders = [Path(run) for run in runs]
    records = [load_run(folder) for folder in folders]
    labels = _labels(folders)
    links = _buses(records, bus) if "bus" in chosen else []
    nodes = _masters(records, port) if "port" in chosen else []
    entries = _latencies(records, latency) if "latency" in chosen else []
    if not (links or nodes or entries):
        raise UsageError(_nothing(records, labels, chosen))
    place = _place(folders, out)
    for path in [
        *_draw_links(records, labels, links, kind, place),
        *_draw_responses(records, labels, nodes, place),
        *_draw_latencies(records, labels, entries, place),
    ]:
        click.echo(path)


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


def _draw_links(
    records: Sequence[RunRecord], labels: Sequence[str], buses: Sequence[str], kind: str, place: Path
) -> Iterator[Path]:
    from bussim.results.plots.over_run import scan_times_over_run
    from bussim.results.plots.scan_times import scan_time_histogram
    from bussim.results.store.names import file_names

    shown, ending = _together(labels)
    stems = file_names(records[0].links)
    for name in buses:
        if kind != "over-run":
            picture = scan_time_histogram(records, name, shown)
            yield from picture.save_both(place / f"scan_time_{stems[name]}{ending}")
        if kind != "histogram":
            for record, label in zip(records, file_names(labels).values(), strict=True):
                over_run = f"scan_time_over_run_{stems[name]}" + (f"_{label}" if ending else "")
                yield from scan_times_over_run(record, name).save_both(place / over_run)


def _draw_responses(
    records: Sequence[RunRecord], labels: Sequence[str], nodes: Sequence[str], place: Path
) -> Iterator[Path]:
    from bussim.results.plots.responses import masters, response_time_histogram
    from bussim.results.store.names import file_names

    shown, ending = _together(labels)
    stems = file_names(masters(records[0]))
    for node in nodes:
        picture = response_time_histogram(records, node, shown)
        yield from picture.save_both(place / f"response_time_{stems[node]}{ending}")


def _draw_latencies(
    records: Sequence[RunRecord], labels: Sequence[str], entries: Sequence[str], place: Path
) -> Iterator[Path]:
    from bussim.results.plots.latency import latency_picture, measured
    from bussim.results.store.names import file_names

    shown, ending = _together(labels)
    stems = file_names(measured(records[0]))
    for name in entries:
        picture = latency_picture(records, name, shown)
        yield from picture.save_both(place / f"latency_{stems[name]}{ending}")


def _together(labels: Sequence[str]) -> tuple[Sequence[str] | None, str]:
    """Labels of the runs on one axis, and what the file's name gets of them; of one run nothing."""
    from bussim.results.store.names import file_name

    return (None, "") if len(labels) == 1 else (labels, f"_{file_name('_'.join(labels))}")


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


def _buses(records: Sequence[RunRecord], wanted: str | None) -> list[str]:
    """The links to draw: the wanted one, or all that made scans in every run."""
    from bussim.results.plots.scan_times import link_of

    if wanted is not None:
        for run in records:
            link_of(run, wanted)  # says what is wrong
        return [wanted]
    return [
        bus
        for bus in records[0].links
        if all(bus in run.links and run.links[bus].scan_times.histogram.count for run in records)
    ]


def _masters(records: Sequence[RunRecord], wanted: str | None) -> list[str]:
    """The Modbus masters to draw: the wanted one, or all that had an answer in every run."""
    from bussim.results.plots.responses import master_of, masters

    if wanted is not None:
        for run in records:
            master_of(run, wanted)  # says what is wrong
        return [wanted]
    return [node for node in masters(records[0]) if all(node in masters(run) for run in records[1:])]


def _latencies(records: Sequence[RunRecord], wanted: str | None) -> list[str]:
    """The latencies to draw: the wanted one, or all of which something was measured in every run."""
    from bussim.results.plots.latency import latency_of, measured

    if wanted is not None:
        for run in records:
            latency_of(run, wanted)  # says what is wrong
        return [wanted]
    return [name for name in measured(records[0]) if all(name in measured(run) for run in records[1:])]


def _nothing(records: Sequence[RunRecord], labels: Sequence[str], chosen: Sequence[str]) -> str:
    missing = {
        "bus": "N:N link with link scans",
        "port": "Modbus master with an answer",
        "latency": "measured latency",
    }
    there: dict[str, tuple[str, Callable[[RunRecord], Sequence[str]]]] = {
        "bus": ("links", lambda run: list(run.links)),
        "port": ("masters", lambda run: [name for name, port in run.ports.items() if port.polls]),
        "latency": ("latencies", lambda run: list(run.latency)),
    }
    where = "in this run" if len(records) == 1 else "common to these runs"
    lists = []
    for what, names in (there[option] for option in chosen):
        found = "; ".join(
            f"{label}: {', '.join(names(run)) or 'none'}" for label, run in zip(labels, records, strict=True)
        )
        lists.append(f"{what}: {found}")
    wanted = [f"no {missing[option]}" for option in chosen]
    together = f"{', '.join(wanted[:-1])} and {wanted[-1]}" if len(wanted) > 1 else wanted[0]
    # A PLC that runs its program by itself has devices all the same.
    alone = not any(run.summary["links"] or run.summary["buses"] for run in records)
    hint = "; without a bus: bussim watch SCENARIO --devices … --plot FILE draws devices" if alone else ""
    return f"{together} {where} ({'; '.join(lists)}){hint}"


def _place(folders: Sequence[Path], out: str | None) -> Path:
    if out is None:
        return folders[0] if len(folders) == 1 else Path()
    place = Path(out)
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"--out {out}: cannot be made: {error.strerror or error}") from error
    return place
