"""``bussim timeline``: a bus like a logic analyser shows it, from a traced run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from bussim.commands.common.drawing import import_matplotlib
from bussim.commands.common.output import print_json
from bussim.commands.common.scenario_options import lang_option, time_of
from bussim.errors import UsageError
from bussim.words.language import shown

if TYPE_CHECKING:
    from bussim.report.trace_window import TraceWindow
    from bussim.results.run_record import RunRecord
    from bussim.trace.file import Trace

#: Where neither --from nor --span says how long.
_DEFAULT_SPAN = "200ms"
#: More frames than this in a window cannot be distinguished.
_MOST_FRAMES = 1_000


@click.command()
@click.argument("run", metavar="RUN_DIR")
@click.option("--from", "since", metavar="T", help="Begin so long after the run's start, such as 10s.")
@click.option("--span", metavar="T", help=f"Draw so much of it (default: {_DEFAULT_SPAN}).")
@lang_option
@click.option("--worst", is_flag=True, help="The longest link scan or Modbus attempt; so too without --from.")
@click.option("--bus", metavar="NAME", help="Which bus (default: the one with the longest link scan).")
@click.option("-o", "--out", metavar="FILE", help="A .png or .svg (default: a .png in the run's folder).")
@click.option("--force", is_flag=True, help="Replace the file if it exists.")
@click.option("--json", "as_json", is_flag=True, help="Print what link scans were made of, as JSON.")
def command(
    run: str,
    *,
    since: str | None,
    span: str | None,
    worst: bool,
    bus: str | None,
    out: str | None,
    force: bool,
    as_json: bool,
) -> None:
    """Draw a window of a traced run: what each station sent when, attempts, damage, ENDs, what changed.

    Under the picture stands what the time of each link scan with a failed attempt went to. Needs a
    run with --trace. Prints the path of the picture.
    """
    import_matplotlib()
    from bussim.api import drawn_bus
    from bussim.commands.common.output import busy, checked_target, traced_again, whole_trace
    from bussim.report.picture import timeline_picture
    from bussim.report.scene import scene_of
    from bussim.report.trace_window import read_window
    from bussim.results.store.load import load_run
    from bussim.results.store.safe_names import file_names
    from bussim.results.text.run import caption_of
    from bussim.trace.file import TRACE
    from bussim.units import seconds

    folder = Path(run)
    record = load_run(folder)
    if not (folder / TRACE).is_file():
        raise UsageError(f"{folder} has no trace to draw; get one with {traced_again(folder)}")
    trace = whole_trace(folder, record)
    buses = [each.name for each in trace.header.buses]
    name = drawn_bus(record, buses, bus)
    with busy(f"looking for the longest scan in {folder / TRACE}"):
        begin, end = _window(trace, record, name, since, span, worst=worst)
    stem = file_names(buses)[name]
    path = folder / f"timeline_{stem}_{seconds(begin):.3f}s.png" if out is None else Path(out)
    target = checked_target(path, (".png", ".svg"), force=force)
    with busy(f"reading {folder / TRACE}"):
        window = read_window(trace, record, name, begin, end)
    if len(window.frames) > _MOST_FRAMES:
        raise UsageError(
            f"the window holds {len(window.frames):,} frames, which cannot be distinguished; at most "
            f"{_MOST_FRAMES:,}: choose a shorter --span"
        )
    scene = scene_of(window)
    timeline_picture(scene, caption_of(record.summary)).save(target)
    if as_json:
        print_json(_as_json(window, target))
        return
    for sentence in scene.why:
        click.echo(shown(sentence))
    click.echo(target)


def _window(
    trace: Trace, record: RunRecord, bus: str, since: str | None, span: str | None, *, worst: bool
) -> tuple[int, int]:
    """First and last tick to draw."""
    from bussim.report.trace_window import worst_window
    from bussim.units import format_time, seconds

    if since is None:
        if span is not None and worst:
            raise UsageError("--worst draws the longest link scan, however long: leave --span away")
        if span is not None:
            raise UsageError("--span is how much to draw: name its beginning, too, with --from")
        found = worst_window(trace, record, bus)
        if found is None:
            what = "made no complete link scan" if bus in record.links else "carried nothing"
            raise UsageError(f"the bus {bus!r} {what}; choose a window with --from and --span")
        return found
    if worst:
        raise UsageError("--worst chooses the window itself: leave --from away")
    begin = time_of("--from", since)
    length = time_of("--span", span or _DEFAULT_SPAN, positive=True)
    if begin >= record.duration:
        raise UsageError(
            f"--from is {format_time(begin)}; the run covers 0 s to {seconds(record.duration):g} s"
        )
    return begin, min(begin + length, record.duration)


def _as_json(window: TraceWindow, target: Path) -> dict[str, object]:
    """What every link scan that lies whole in the window was made of. Times in ms, instants in s."""
    from bussim.report.trace_window import parts_of_scan
    from bussim.units import milliseconds, seconds

    scans = []
    for scan in window.scans:
        if window.begin <= scan.start and scan.start + scan.duration <= window.end:
            parts = [
                {
                    "start_s": round(seconds(part.start), 9),
                    "ms": round(milliseconds(part.ticks), 6),
                    "what": part.what,
                    "attempt": part.attempt or None,
                    "lost": part.lost,
                }
                for part in parts_of_scan(window, scan)
            ]
            scans.append(
                {
                    "number": scan.number,
                    "start_s": round(seconds(scan.start), 9),
                    "ms": round(milliseconds(scan.duration), 6),
                    "failed": scan.failed,
                    "parts": parts,
                }
            )
    return {
        "schema": 1,
        "picture": str(target),
        "bus": window.bus,
        "from_s": round(seconds(window.begin), 9),
        "to_s": round(seconds(window.end), 9),
        "scans": scans,
    }
