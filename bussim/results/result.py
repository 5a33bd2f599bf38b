"""What a run gave, for Python and for notebooks."""

from __future__ import annotations

import os
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bussim.errors import UsageError
from bussim.results.run_record import RunRecord
from bussim.results.text.run import caption_of
from bussim.trace import records
from bussim.trace.records import RunTotals
from bussim.wording import counted

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from bussim.results.plots.style import Picture
    from bussim.results.store.in_memory import MemoryRows
    from bussim.results.store.load import FolderRows
    from bussim.trace.file import Trace


class Result:
    """What a run gave, in memory or in a folder.

    ``totals`` has the simulation's own counts (ticks of 1/72 MHz), None for a run that was opened
    from a folder. ``folder`` is None for a run that stayed in memory.
    """

    def __init__(
        self,
        record: RunRecord,
        rows: FolderRows | MemoryRows,
        *,
        totals: RunTotals | None = None,
        folder: Path | None = None,
    ) -> None:
        self.record = record
        self.totals = totals
        self.folder = folder
        self._rows = rows

    @property
    def summary(self) -> dict[str, Any]:
        """The content of ``summary.json``."""
        return self.record.summary

    @cached_property
    def link_scans(self) -> pd.DataFrame:
        """One row a link scan.

        Columns: :data:`bussim.results.store.rows.SCANS`. Raises UsageError if the run kept no rows.
        """
        return self._rows.table(records.ScanRecord)

    @cached_property
    def exchanges(self) -> pd.DataFrame:
        """One row an attempt.

        Columns: :data:`bussim.results.store.rows.ATTEMPTS`. Raises UsageError if the run was not traced.
        """
        return self._rows.table(records.AttemptRecord)

    @cached_property
    def transactions(self) -> pd.DataFrame:
        """One row an attempt of a Modbus master, in the order in which they were taken over.

        Columns: :data:`bussim.results.store.rows.TRANSACTIONS`. Raises UsageError if the run kept no rows.
        """
        return self._rows.table(records.TransactionRecord)

    @cached_property
    def free(self) -> pd.DataFrame:
        """One row a message of the free protocol, sent or received.

        Columns: :data:`bussim.results.store.rows.FREE`. Raises UsageError if the run kept no rows.
        """
        return self._rows.table(records.FreeRecord)

    @cached_property
    def values(self) -> pd.DataFrame:
        """One row a change of an observed device; columns: :data:`bussim.results.store.rows.VALUES`.

        The values are those in the PLC's memory at END, as a monitor shows them; of X the image that the
        scan has worked with. When the wire of an input changed is in :attr:`inputs`. Raises UsageError if
        the run kept no rows.
        """
        return self._rows.table(records.DeviceValueRecord)

    @cached_property
    def inputs(self) -> pd.DataFrame:
        """One row a change on the wire of an input that the scenario drives, whether observed or not.

        Columns: :data:`bussim.results.store.rows.INPUTS`. Raises UsageError if the run kept no rows.
        """
        return self._rows.table(records.InputRecord)

    @cached_property
    def trace(self) -> list[dict[str, Any]]:
        """The lines of ``trace.jsonl``: a header, then every frame and event.

        Raises UsageError if the run was not traced.
        """
        return self._rows.trace()

    def open_trace(self) -> Trace:
        """The trace as records of :mod:`bussim.trace.records`, by type, bus and time, read as asked for.

        Raises UsageError if the run was not traced.
        """
        return self._rows.open_trace()

    def save_plots(self) -> list[Path]:
        """Draw the run's pictures, as `bussim run` does, into its folder; returns the PNGs' paths.

        Raises UsageError if the run has no folder, and as :func:`bussim.files.written_whole`.
        """
        from bussim.results.pictures import draw_run

        if self.folder is None:
            raise UsageError("this run has no folder for pictures; run it with out=")
        return draw_run(self.record, self.folder)

    def plot_scan_times(self, path: str | os.PathLike[str] | None = None, bus: str | None = None) -> Figure:
        """The histogram of link scan times of a bus (default: the first one with scans).

        ``path``, ending in .png or .svg, is where to save it. In a notebook the figure shows itself.
        Raises UsageError if there is no such bus or nothing to draw.
        """
        from bussim.results.plots.scan_times import scan_time_histogram

        return _saved(scan_time_histogram([self.record], self._bus(bus)), path)

    def plot_scan_times_over_run(
        self, path: str | os.PathLike[str] | None = None, bus: str | None = None
    ) -> Figure:
        """Scan times over the run with its faults and stations in error; else as plot_scan_times."""
        from bussim.results.plots.over_run import scan_times_over_run

        return _saved(scan_times_over_run(self.record, self._bus(bus)), path)

    def plot_response_times(
        self, port: str | None = None, path: str | os.PathLike[str] | None = None
    ) -> Figure:
        """The histograms of response times of a Modbus master, poll by poll.

        ``port`` is a node: ``press1.COM3`` or an HMI's name (default: the first one with a response).
        ``path`` as of :meth:`plot_scan_times`. Raises UsageError if there is no such master or
        nothing to draw.
        """
        from bussim.results.plots.responses import masters, response_time_histogram

        if port is None:
            port = next(iter(masters(self.record)), None)
        if port is None:
            raise UsageError(
                f"{self.record.scenario}: no Modbus master had a response, there is nothing to plot"
            )
        return _saved(response_time_histogram([self.record], port), path)

    def plot_latency(self, name: str | None = None, path: str | os.PathLike[str] | None = None) -> Figure:
        """The histogram of a latency and what its time goes to.

        ``name`` is an entry of the scenario's ``latency`` (default: the first one with something
        measured). ``path`` as of :meth:`plot_scan_times`. Raises UsageError if there is no such entry or
        nothing to draw.
        """
        from bussim.results.plots.latency import latency_picture, measured

        if name is None:
            name = next(iter(measured(self.record)), None)
        if name is None:
            raise UsageError(f"{self.record.scenario}: no latency was measured, there is nothing to plot")
        return _saved(latency_picture([self.record], name), path)

    def _bus(self, bus: str | None) -> str:
        if bus is not None:
            return bus
        for name, link in self.record.links.items():
            if link.scan_times.histogram.count:
                return name
        raise UsageError(
            f"{self.record.scenario}: no N:N link made a complete scan, there is nothing to plot"
        )

    def __repr__(self) -> str:
        summary = self.summary
        parts = [f"{bus}: {_in_words(link)}" for bus, link in summary["links"].items()]
        parts += [
            f"{node}: {master['ok']:,} of {counted(master['transactions'], 'transaction')} ok"
            for node, master in _masters(summary).items()
        ]
        folder = f" in {self.folder}" if self.folder is not None else ""
        return (
            f"<Result of {summary['scenario']!r}, seed {summary['seed']}, {summary['duration_s']:g} s"
            f"{folder}: {'; '.join(parts) or 'no N:N link'}>"
        )

    def _repr_html_(self) -> str:
        summary = self.summary
        links = [
            [bus, link["scans"], link["attempts"], *(link["scan_time_ms"][key] for key in _SHOWN)]
            for bus, link in summary["links"].items()
        ]
        masters = [
            [node, master["transactions"], master["ok"], *(master["response_ms"][key] for key in _SHOWN)]
            for node, master in _masters(summary).items()
        ]
        times = [f"{key} (ms)" for key in _SHOWN]
        body = _rows(["link", "scans", "attempts", *times], links) if links or not masters else ""
        if masters:
            body += _rows(["Modbus master", "transactions", "ok", *times], masters)
        caption = escape(caption_of(summary))
        warnings = "".join(f"<li>{escape(text)}</li>" for text in summary["warnings"])
        return f"<table><caption>{caption}</caption>{body}</table>" + (
            f"<ul>{warnings}</ul>" if warnings else ""
        )


_SHOWN = ("min", "mean", "p99", "max")


def _masters(summary: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """The entries of all Modbus masters: ports and HMIs."""
    nodes = {**summary["ports"], **summary["devices"]}
    return {name: node for name, node in nodes.items() if "transactions" in node}


def _rows(head: list[str], rows: list[list[object]]) -> str:
    cells = "".join(f"<th>{name}</th>" for name in head)
    body = ["".join(f"<td>{escape(_cell(value))}</td>" for value in row) for row in rows]
    return f"<tr>{cells}</tr>" + "".join(f"<tr>{row}</tr>" for row in body)


def _cell(value: object) -> str:
    if value is None:
        return "–"
    return f"{value:.3f}" if isinstance(value, float) else str(value)


def _in_words(link: dict[str, Any]) -> str:
    times = link["scan_time_ms"]
    if not link["scans"]:
        return "no complete scan"
    return f"{counted(link['scans'], 'scan')}, mean {times['mean']:.3f} ms, max {times['max']:.3f} ms"


def _saved(picture: Picture, path: str | os.PathLike[str] | None) -> Picture:
    if path is not None:
        picture.save(Path(path))
    return picture
