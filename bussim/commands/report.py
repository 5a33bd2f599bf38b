"""``bussim report``: one page on one run or several."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from bussim.commands.common.drawing import import_matplotlib
from bussim.commands.common.scenario_options import code_option, lang_option
from bussim.errors import ScenarioError, UsageError
from bussim.files import followed, plain
from bussim.words.language import current_language, say, use_language

if TYPE_CHECKING:
    from bussim.exact.metrics import Figures
    from bussim.report.runs import ExactDistribution, Source
    from bussim.report.scene import Scene
    from bussim.results.meters.histogram import Histogram
    from bussim.results.run_record import RunRecord

#: A scenario is no larger (bytes).
_LARGEST = 4 * 1024 * 1024
#: What a page does not show: no scenario that can be read has them.
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
#: Most runs on one axis and in one table.
_MOST_RUNS = 7


@click.command()
@click.argument("runs", metavar="RUN_DIR...", nargs=-1, required=True)
@click.option(
    "-o", "--out", metavar="FILE", help="The page to write (default: report.html in the run's folder)."
)
@click.option("--force", is_flag=True, help="Replace the file if it exists.")
@click.option("--json", "as_json", is_flag=True, help="Print what was written as JSON.")
@click.option("--no-exact", is_flag=True, help="Without the exact law (it takes long on a noisy line).")
@lang_option
@code_option
def command(
    runs: tuple[str, ...], *, out: str | None, force: bool, as_json: bool, no_exact: bool, allow_code: bool
) -> None:
    """Report one run, or compare several, as one HTML page that needs no network.

    What was simulated, a verdict in words, histogram and exact distribution, the longest link scan as a
    timeline (of a run with --trace), figures of every station, settings, scenario, and how to repeat
    it. Prints the path of the page.
    """
    from bussim.commands.common.output import busy, print_files

    import_matplotlib()
    with busy(f"reading {', '.join(runs)}"):
        lang = current_language()
        target = report(*runs, out=out, force=force, exact=not no_exact, allow_code=allow_code, lang=lang)
    print_files([target], as_json=as_json)


def report(
    *runs: str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    force: bool = False,
    exact: bool = True,
    allow_code: bool = False,
    lang: str = "en",
) -> Path:
    """Write one HTML page on the folders of one run or several, and return its path.

    ``out`` is the page (None: report.html in the run's folder, of several runs in this one); ``force``
    replaces it. Without ``exact`` the page has no exact law, which takes long on a noisy line. ``lang`` is
    the page's language, "en" or "zh".

    Raises UsageError for another language, for folders that are none of runs, for too many, and where the
    page cannot be written.
    """
    from bussim.commands.common.output import checked_target, write_text
    from bussim.report.page import labels_of, report_page
    from bussim.report.scene import MOST_SHAPES
    from bussim.results.store.load import load_run
    from bussim.wording import visible

    if not 1 <= len(runs) <= _MOST_RUNS:
        many = f"{len(runs)} runs on one page cannot be distinguished; at most {_MOST_RUNS}"
        raise UsageError(many if runs else "no run to report: name the folder of one at least")
    folders = [Path(run) for run in runs]
    resolved = [followed(folder) for folder in folders]
    for folder, whole in zip(folders, resolved, strict=True):
        if resolved.count(whole) > 1:
            raise UsageError(f"{folder} is named twice")
    records = [load_run(folder) for folder in folders]
    target = checked_target(_target(folders, out), (".html", ".htm"), force=force)
    labels = labels_of([visible(whole.name) for whole in resolved], records)
    shapes = MOST_SHAPES // len(folders)
    sources = [
        _source(folder, record, label, shapes=shapes, exact=exact, allow_code=allow_code)
        for folder, record, label in zip(folders, records, labels, strict=True)
    ]
    with use_language(lang):
        page = report_page(sources, ["bussim", "report", *map(str, runs)])
    write_text(target, page)
    return target


def _target(folders: Sequence[Path], out: str | os.PathLike[str] | None) -> Path:
    if out is not None:
        return Path(out)
    return folders[0] / "report.html" if len(folders) == 1 else Path("report.html")


def _source(
    folder: Path, record: RunRecord, label: str, *, shapes: int, exact: bool, allow_code: bool
) -> Source:
    from bussim.commands.common.output import traced_again, whole_trace
    from bussim.report.runs import Source
    from bussim.report.scene import worst_scenes
    from bussim.report.tables import turnarounds_of
    from bussim.trace.file import TRACE
    from bussim.trace.records import AttemptRecord
    from bussim.wording import shell_word

    scenario = _scenario(folder)
    distributions: dict[str, ExactDistribution] = {}
    no_distribution = ""
    if exact:
        try:
            distributions = _distributions(folder, allow_code=allow_code)
        except (ScenarioError, UsageError) as error:
            first = str(error).splitlines()[0]
            no_distribution = say("report_no_law", reason=first)
    turnarounds: dict[str, dict[int, Histogram]] = {}
    scenes: dict[str, Scene] = {}
    no_trace = ""
    if (folder / TRACE).is_file():
        trace = whole_trace(folder, record)
        turnarounds = turnarounds_of(trace.of(AttemptRecord))
        scenes = worst_scenes(trace, record, [bus.name for bus in trace.header.buses], shapes)
        draw = f"bussim timeline {shell_word(folder)} --worst"
        no_trace = say("report_too_much", command=draw)
    else:
        no_trace = say("report_no_trace", command=traced_again(folder))
    return Source(
        label, str(folder), record, scenario, distributions, no_distribution, turnarounds, scenes, no_trace
    )


def _scenario(folder: Path) -> str:
    from bussim.results.store.folder import SCENARIO
    from bussim.wording import visible

    path = folder / SCENARIO
    try:
        if plain(path).stat().st_size > _LARGEST:
            raise UsageError(f"{path} is larger than any scenario ({_LARGEST:,} bytes)")
        text = path.read_text(encoding="utf-8-sig")
        return _CONTROL.sub(lambda found: visible(found[0]), text)
    except FileNotFoundError:
        raise UsageError(f"{path} is missing: {folder} is not the whole folder of a run") from None
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}") from error


def _distributions(folder: Path, *, allow_code: bool) -> dict[str, ExactDistribution]:
    """The distribution of every N:N link; of one that faults disturb, the distribution between them."""
    from bussim import api
    from bussim.exact.solution import between_faults
    from bussim.results.store.folder import SCENARIO

    # Refreshes take by far the longest, and the run has measured them.
    figures = between_faults(api.load(folder / SCENARIO, allow_code=allow_code))
    return {bus: _distribution(each) for bus, each in figures.items()}


def _distribution(figures: Figures) -> ExactDistribution:
    from bussim.exact.metrics import fine_curve
    from bussim.report.runs import ExactDistribution

    if figures.distribution is None:
        return ExactDistribution(figures.to_json())
    x, tail = fine_curve(figures.distribution)
    sentences = figures.in_words()
    return ExactDistribution(
        figures.to_json(), sentences[-1] if sentences else "", figures.model.notes, x.tolist(), tail.tolist()
    )
