"""The entries of ``summary.json`` about what is beside the N:N links: buses, ports, devices."""

from collections import Counter
from collections.abc import Mapping
from typing import Any

from bussim.results.meters.histogram import quantiles, statistics
from bussim.results.meters.ports import FreeCounts, Poll, PortRecord
from bussim.results.numbers import by_code, ms, share, whole
from bussim.trace.records import BusTotals, DeviceTotals, Outcome, PortTotals, RunTotals
from bussim.units import milliseconds

#: What may become of a message of another node that was for this one, and its key.
_MESSAGES: Mapping[Outcome, str] = {
    Outcome.GOOD: "whole",
    Outcome.DAMAGED: "damaged",
    Outcome.WRONG: "wrong",
    Outcome.DEAF: "lost",
    Outcome.NOT_READY: "not_ready",
    Outcome.AWAY: "away",
}


def bus_summary(totals: BusTotals, duration: int) -> dict[str, Any]:
    """A bus that is no N:N link."""
    return {
        "baud": totals.baud,
        "format": totals.format,
        "nodes": list(totals.nodes),
        "bus_load": share(totals.busy, duration),
        "frames": totals.frames,
        "collisions": totals.collisions,
        "undetected_frames": totals.undetected,
    }


def unlisted_ports(totals: RunTotals, records: Mapping[str, PortRecord]) -> list[PortTotals]:
    """Totals of nodes of which only records are known: those of a recording."""
    listed = {port.node for port in totals.ports} | {device.name for device in totals.devices}
    return [PortTotals(node, "", "", record.bus) for node, record in records.items() if node not in listed]


def port_summary(totals: PortTotals, record: PortRecord | None, duration: int) -> dict[str, Any]:
    """A port of a PLC: what it is, and what it did as master, as slave or with the free protocol.

    A port that a program has changed while running has the keys of all that it was.
    """
    protocol = totals.protocol or ""
    found: dict[str, Any] = {"protocol": totals.protocol, "bus": totals.bus}
    record = record or PortRecord(totals.bus, totals.timeout)
    if protocol.endswith("-master") or record.polls:
        found |= _master(record, duration, totals.late)
    if protocol.endswith("-slave") or totals.requests:
        found |= {
            "station": totals.station,
            "requests": totals.requests,
            "answered": totals.answered,
            "exceptions": _more(found.get("exceptions", {}), by_code(totals.exceptions)),
            "rejected": dict(sorted(totals.rejected.items())),
        }
    if protocol == "free" or record.free != FreeCounts():
        found |= _free(record)
    # D8063 = 7xyy has its yy in decimal.
    found["errors"] = {f"{code:02d}": number for code, number in sorted(totals.errors.items()) if number}
    return found


def device_summary(totals: DeviceTotals, record: PortRecord | None, duration: int) -> dict[str, Any]:
    """A device; of an HMI also what it did as master, of one with the free protocol what it sent."""
    found: dict[str, Any] = {
        "model": totals.model,
        "bus": totals.bus,
        "station": totals.station,
        "requests": totals.requests,
        "answered": totals.answered,
        "broadcasts": totals.broadcasts,
        "exceptions": by_code(totals.exceptions),
        "rejected": dict(sorted(totals.rejected.items())),
        "state": dict(totals.state),
    }
    record = record or PortRecord(totals.bus, totals.timeout)
    if totals.model == "hmi" or record.polls:
        found |= _master(record, duration, totals.late)
    if totals.model == "free" or record.free != FreeCounts():
        found |= _free(record)
    return found


def _master(record: PortRecord, duration: int, late: Mapping[str, int]) -> dict[str, Any]:
    """Counts of attempts: each is ok, an exception, a timeout, a CRC error or one of the others."""
    polls = record.polls
    return {
        "timeout_ms": None if record.timeout is None else whole(milliseconds(record.timeout)),
        "transactions": sum(poll.transactions for poll in polls.values()),
        "broadcast_requests": sum(poll.broadcasts for poll in polls.values()),
        "ok": sum(poll.ok for poll in polls.values()),
        "answered_with_own_data": sum(poll.own for poll in polls.values()),
        "exceptions": dict(sorted(record.exceptions.items())),
        "timeouts": record.timeouts,
        "crc_errors": record.crc_errors,
        "other_errors": dict(sorted(record.others.items())),
        "mismatched_responses": record.mismatched,
        "late_responses": sum(late.values()),
        "response_ms": statistics(record.responses),
        "polls": {name: _poll(poll, duration, late.get(name, 0)) for name, poll in polls.items()},
        "cycle_ms": {**statistics(record.cycles), "count": record.cycles.count},
    }


def _poll(poll: Poll, duration: int, late: int) -> dict[str, Any]:
    return {
        "transactions": poll.transactions,
        "ok": poll.ok,
        "timeouts": poll.timeouts,
        "late_responses": late,
        "response_ms": statistics(poll.responses),
        "turns": poll.turns,
        "failed_turns": poll.failed_turns,
        "late_ms": {"max": ms(poll.late.maximum)},
        "age_ms": _age(poll, duration) if poll.reads else None,
    }


def _age(poll: Poll, duration: int) -> dict[str, Any]:
    """The data ages of a poll; ``open`` is that at the end (the whole run, if nothing arrived)."""
    arrival, refresh = poll.on_arrival, poll.before_refresh
    known, still = quantiles(refresh), duration - (poll.last_served or 0)
    return {
        "on_arrival": {"p50": quantiles(arrival)["p50"], "max": ms(arrival.maximum)},
        "before_refresh": {"p50": known["p50"], "p99": known["p99"], "max": ms(refresh.maximum)},
        "open": ms(still),
        "oldest": ms(max(still, refresh.maximum or 0)),
    }


def _free(record: PortRecord) -> dict[str, Any]:
    counts = record.free
    heard = sum((each.counts for each in record.exchanges.values()), Counter[Outcome]())
    return {
        "sent": counts.sent,
        "received": counts.received,
        "timeouts": counts.timeouts,
        "damaged": counts.damaged,
        "bytes": {"sent": counts.bytes_sent, "received": counts.bytes_received},
        "messages": {"sent": heard.total(), **{word: heard[what] for what, word in _MESSAGES.items()}},
    }


def _more(first: Mapping[str, int], second: Mapping[str, int]) -> dict[str, int]:
    return {code: first.get(code, 0) + second.get(code, 0) for code in sorted({*first, *second})}
