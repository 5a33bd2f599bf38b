"""The pictures that belong to a run's folder, drawn when its numbers are whole."""

from collections.abc import Iterator
from pathlib import Path

from bussim.results.plots.latency import latency_picture, measured
from bussim.results.plots.responses import masters, response_time_histogram
from bussim.results.plots.scan_times import scan_time_histogram
from bussim.results.plots.style import Picture
from bussim.results.run_record import RunRecord
from bussim.results.store.safe_names import file_names


def draw_run(record: RunRecord, folder: Path) -> list[Path]:
    """Draw a run's pictures as PNG and SVG into its folder; returns the PNGs' paths.

    Each file is written as a whole; raises as :func:`bussim.files.written_whole`.
    """
    return [picture.save_both(folder / stem)[0] for stem, picture in _pictures(record)]


def _pictures(record: RunRecord) -> Iterator[tuple[str, Picture]]:
    for bus, stem in file_names(record.links).items():
        if record.links[bus].scan_times.histogram.count:
            yield f"scan_time_{stem}", scan_time_histogram([record], bus)
    for node, stem in file_names(masters(record)).items():
        yield f"response_time_{stem}", response_time_histogram([record], node)
    for name, stem in file_names(measured(record)).items():
        yield f"latency_{stem}", latency_picture([record], name)
