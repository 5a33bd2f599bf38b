"""``summary.json``: the numbers of a run, by stable keys. Times in ms, instants in s."""

from __future__ import annotations

from typing import Any

from bussim.results.histogram import QUANTILES, Histogram
from bussim.results.record import SCHEMA, LinkRecord, ScanTimes
from bussim.results.refresh import Refresh
from bussim.trace import LinkTotals, PlcTotals, RunTotals
from bussim.units import milliseconds, seconds
from bussim.version import __version__

#: Decimals of a number: ns for times in ms.
_DECIMALS = 6


def summarise(totals: RunTotals, links: dict[str, LinkRecord], *, scenario: str, seed: int) -> dict[str, Any]:
    """The content of ``summary.json``.

    ``links`` has a record for every link of the totals; ``scenario`` is the scenario's name.
    """
    return {
        "schema": SCHEMA,
        "bussim": __version__,
        "scenario": scenario,
        "seed": seed,
        "duration_s": _s(totals.duration),
        "links": {link.bus: _link(link, links[link.bus], totals.duration) for link in totals.links},
        "plcs": {plc.name: _plc(plc) for plc in totals.plcs},
        "ports": {},
        "devices": {},
        "warnings": list(totals.warnings),
    }


def _link(totals: LinkTotals, record: LinkRecord, duration: int) -> dict[str, Any]:
    return {
        "stations": len(totals.seats),
        "mode": totals.mode,
        "retries": totals.retries,
        "attempts": totals.attempts,
        "timeout_ms": None if totals.timeout is None else _whole(milliseconds(totals.timeout)),
        "scans": record.scan_times.histogram.count,
        "bus_load": round(totals.busy / duration, _DECIMALS) if duration else 0.0,
        "scan_time_ms": {
            "current": _ms(record.scan_times.last),
            **_statistics(record.scan_times),
            "after_startup": _statistics(record.after_startup),
        },
        "polls": totals.polls,
        "failed_attempts": {
            str(station): {f"{code:02X}": number for code, number in sorted(codes.items()) if number}
            for station, codes in sorted(totals.failed_attempts.items())
            if any(codes.values())
        },
        "station_errors": {
            str(station): totals.station_errors.get(station, 0)
            for station in range(1, (totals.slaves or 0) + 1)
        },
        "refresh_gap_ms": {
            f"{source}->{receiver}": _gaps(pair, duration)
            for (source, receiver), pair in record.refresh.items()
        },
        "undetected_frames": totals.undetected,
        "collisions": totals.collisions,
        "healthy_at_s": _s(totals.healthy_at),
    }


def _statistics(times: ScanTimes) -> dict[str, Any]:
    histogram = times.histogram
    return {
        "min": _ms(histogram.minimum),
        "mean": _ms(histogram.mean),
        **_quantiles(histogram),
        "max": _ms(histogram.maximum),
        "max_at_s": _s(times.longest_at),
        "max_cause": None if times.longest_at is None else times.longest_cause,
    }


def _gaps(pair: Refresh, duration: int) -> dict[str, Any]:
    """Statistics of one pair; ``open`` is the gap still open at the end (the run, if never refreshed)."""
    quantiles = _quantiles(pair.gaps)
    return {
        "p50": quantiles["p50"],
        "p99": quantiles["p99"],
        "p999": quantiles["p999"],
        "max": _ms(pair.gaps.maximum),
        "open": _ms(duration - (pair.last or 0)),
        "count": pair.gaps.count,
    }


def _plc(totals: PlcTotals) -> dict[str, Any]:
    return {
        "registers": dict(totals.registers),
        "scan_ms": {"mean": _ms(totals.scan_mean), "max": _ms(totals.scan_max)},
    }


def _quantiles(histogram: Histogram) -> dict[str, float | None]:
    return {name: _ms(histogram.quantile(thousandths)) for name, thousandths in QUANTILES.items()}


def _ms(ticks: float | None) -> float | None:
    return None if ticks is None else round(milliseconds(ticks), _DECIMALS)


def _s(ticks: int | None) -> float | None:
    return None if ticks is None else round(seconds(ticks), _DECIMALS)


def _whole(value: float) -> float:
    """A whole number without a decimal point, as D8180 is entered."""
    return int(value) if value == int(value) else round(value, _DECIMALS)
