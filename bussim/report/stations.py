"""The stations of a link over a run, one row each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bussim.report.source import Source, StationTimes
from bussim.results.meters.histogram import QUANTILES, SAMPLES_BEYOND
from bussim.results.meters.timeline import time_on

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, slots=True)
class StationRow:
    """One station: what ``summary.json`` counts, and what the trace adds (None without one)."""

    number: int
    name: str
    failed: dict[str, int]  # by code
    errors: int
    error_s: float
    times: StationTimes | None


def station_rows(source: Source, bus: str) -> list[StationRow]:
    """The slaves of a link, in order of their numbers."""
    link: dict[str, Any] = source.summary["links"][bus]
    record = source.record.links[bus]
    names = source.station_names(bus)
    measured = source.stations.get(bus, {})
    rows = []
    for key, errors in link["station_errors"].items():
        number = int(key)
        name = names.get(number, "")
        rows.append(
            StationRow(
                number,
                name,
                dict(link["failed_attempts"].get(key, {})),
                errors,
                time_on(record.in_error.get(number, []), source.record.duration),
                measured.get(number),
            )
        )
    return rows


def measured_times(exchanges: pd.DataFrame) -> dict[str, dict[int, StationTimes]]:
    """Replies and turnarounds by bus and station, from the table of attempts."""
    good = exchanges[exchanges["outcome"] == "ok"]
    found: dict[str, dict[int, StationTimes]] = {}
    for key, rows in good.groupby(["bus", "station"], sort=True):
        bus, station = str(key[0]), int(str(key[1]))  # pandas types a key as anything
        turnarounds = sorted(rows["turnaround_ms"].dropna())
        quantiles: dict[str, float | None] = {"min": turnarounds[0] if turnarounds else None}
        for name, thousandths in QUANTILES.items():
            rank = -(-thousandths * len(turnarounds) // 1000)
            enough = len(turnarounds) - rank >= SAMPLES_BEYOND
            quantiles[name] = turnarounds[rank - 1] if enough else None
        quantiles["max"] = turnarounds[-1] if turnarounds else None
        found.setdefault(bus, {})[station] = StationTimes(len(rows), quantiles)
    return found
