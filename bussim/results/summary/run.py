"""``summary.json``: the numbers of a run, by stable keys. Times in ms, instants in s."""

from collections.abc import Mapping
from typing import Any

from bussim.results.meters.histogram import quantiles
from bussim.results.meters.latency_record import LatencyRecord
from bussim.results.meters.link import LinkRecord, MasterLost, ScanTimes
from bussim.results.meters.ports import PortRecord
from bussim.results.meters.refresh import Refresh
from bussim.results.numbers import by_code, ms, s, share, whole
from bussim.results.summary import SCHEMA
from bussim.results.summary.latency import LatencyBounds, latency_summary
from bussim.results.summary.ports import bus_summary, device_summary, port_summary, unlisted_ports
from bussim.results.verdict.verdict import Evidence, verdict
from bussim.trace.records import LinkTotals, PlcTotals, RunTotals
from bussim.units import milliseconds
from bussim.version import __version__


def summarise(
    totals: RunTotals,
    links: Mapping[str, LinkRecord],
    ports: Mapping[str, PortRecord],
    *,
    scenario: str,
    seed: int,
    latency: Mapping[str, LatencyRecord] | None = None,
    bounds: Mapping[str, LatencyBounds] | None = None,
    evidence: Evidence | None = None,
) -> dict[str, Any]:
    """The content of ``summary.json``.

    ``links`` has a record for every link of the totals, ``ports`` for every node beside the links
    that was a master or had the free protocol (of a recording the totals know none of them);
    ``scenario`` is the scenario's name. ``bounds`` are what each ``latency`` may be at worst;
    ``evidence`` is what the verdict rests on beside.
    """
    duration = totals.duration
    summary = {
        "schema": SCHEMA,
        "bussim": __version__,
        "scenario": scenario,
        "seed": seed,
        "duration_s": s(duration),
        "links": {link.bus: _link(link, links[link.bus], duration) for link in totals.links},
        "buses": {bus.bus: bus_summary(bus, duration) for bus in totals.buses},
        "plcs": {plc.name: _plc(plc) for plc in totals.plcs},
        "ports": {
            port.node: port_summary(port, ports.get(port.node), duration)
            for port in (*totals.ports, *unlisted_ports(totals, ports))
        },
        "devices": {
            device.name: device_summary(device, ports.get(device.name), duration) for device in totals.devices
        },
        **_latencies(latency or {}, bounds or {}),
        "warnings": list(totals.warnings),
    }
    summary["verdict"] = verdict(summary, evidence or Evidence(links))
    return summary


def _latencies(latency: Mapping[str, LatencyRecord], bounds: Mapping[str, LatencyBounds]) -> dict[str, Any]:
    """The key ``latency`` of a run that measures some."""
    if not latency:
        return {}
    return {"latency": {name: latency_summary(entry, bounds.get(name)) for name, entry in latency.items()}}


def _link(totals: LinkTotals, record: LinkRecord, duration: int) -> dict[str, Any]:
    return {
        "stations": len(totals.plc_names),
        "mode": totals.mode,
        "retries": totals.retries,
        "attempts": totals.attempts,
        "timeout_ms": None if totals.timeout is None else whole(milliseconds(totals.timeout)),
        "scans": record.scan_times.histogram.count,
        "bus_load": share(totals.busy, duration),
        "scan_time_ms": {
            "current": ms(record.scan_times.last),
            **_statistics(record.scan_times),
            "after_startup": _statistics(record.after_startup),
        },
        "polls": totals.polls,
        "failed_attempts": {
            str(station): by_code(codes)
            for station, codes in sorted(totals.failed_attempts.items())
            if any(codes.values())
        },
        "station_errors": {
            str(station): totals.station_errors.get(station, 0)
            for station in range(1, (totals.slaves or 0) + 1)
        },
        "station_error_onsets": {
            str(station): record.onsets.get(station, 0) for station in range(1, (totals.slaves or 0) + 1)
        },
        "master_lost": [_lost(lost, duration) for lost in record.master_lost],
        "refresh_gap_ms": {
            f"{source}->{receiver}": _gaps(pair, duration)
            for (source, receiver), pair in record.refresh.items()
        },
        **_stale(record, duration),
        "undetected_frames": totals.undetected,
        "collisions": totals.collisions,
        "healthy_at_s": s(totals.healthy_at),
    }


def _lost(lost: MasterLost, duration: int) -> dict[str, Any]:
    return {
        "from_s": s(lost.start),
        "for_s": s((duration if lost.end is None else lost.end) - lost.start),
        "stations": list(lost.stations),
        "scans_missed": lost.scans_missed,
    }


def _statistics(times: ScanTimes) -> dict[str, Any]:
    histogram = times.histogram
    return {
        "min": ms(histogram.minimum),
        "mean": ms(histogram.mean),
        **quantiles(histogram),
        "max": ms(histogram.maximum),
        "max_at_s": s(times.longest_at),
        "max_cause": None if times.longest_at is None else times.longest_cause,
    }


def _gaps(pair: Refresh, duration: int) -> dict[str, Any]:
    """Statistics of one pair; ``open`` is the gap still open at the end (the run, if never refreshed)."""
    known = quantiles(pair.gaps)
    return {
        "p50": known["p50"],
        "p99": known["p99"],
        "p999": known["p999"],
        "max": ms(pair.gaps.maximum),
        "open": ms(duration - (pair.last or 0)),
        "count": pair.gaps.count,
    }


def _stale(record: LinkRecord, duration: int) -> dict[str, Any]:
    """How long receivers worked on data from before they or their source were away; of others nothing."""
    old = {f"{a}->{b}": pair.stale for (a, b), pair in record.refresh.items() if pair.stale}
    lasted = {pair: [(at.end or duration) - at.start for at in spans] for pair, spans in old.items()}
    found = {pair: {"total": ms(sum(each)), "longest": ms(max(each))} for pair, each in lasted.items()}
    return {"stale_ms": found} if old else {}


def _plc(totals: PlcTotals) -> dict[str, Any]:
    return {
        "registers": dict(totals.registers),
        **({"own_names": dict(totals.own_names)} if totals.own_names else {}),
        **({"set_under": totals.set_under} if totals.set_under != "M8002" else {}),
        "scan_ms": {"mean": ms(totals.scan_mean), "max": ms(totals.scan_max)},
    }
