"""Buses, ports and devices beside the N:N links as text, from ``summary.json``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from bussim.wording import counted
from bussim.words.formats import meaning

#: What statistics of times are called.
SHOWN = {"min": "min", "p50": "median", "mean": "mean", "p99": "p99", "max": "max"}
#: Most polls of a master that have a line.
_MOST_POLLS = 12


def port_lines(summary: Mapping[str, Any]) -> Iterator[str]:
    """Lines for a terminal; an empty one before each block, none at all in a plain N:N run."""
    if summary["buses"]:
        yield ""
        for name, bus in summary["buses"].items():
            yield _bus(name, bus)
    for name, port in summary["ports"].items():
        yield ""
        yield from _port(name, port)
    for name, device in summary["devices"].items():
        yield ""
        yield from _device(name, device)


def alone_lines(summary: Mapping[str, Any]) -> Iterator[str]:
    """Lines about the PLCs of a run without any bus; none in another run."""
    if summary["links"] or summary["buses"] or not summary["plcs"]:
        return
    yield ""
    yield "no bus: every PLC runs by itself"
    for name, plc in summary["plcs"].items():
        scan = plc["scan_ms"]
        if scan["mean"] is None:
            yield f"{name}: no scan was finished"
        else:
            yield f"{name}: PLC scan mean {scan['mean']:.3f}, max {scan['max']:.3f} ms"


def _bus(name: str, bus: Mapping[str, Any]) -> str:
    words = [
        f"{bus['baud']} {bus['format']}",
        f"bus load {bus['bus_load']:.1%}",
        counted(bus["frames"], "frame"),
        *rare(bus),
    ]
    return f"{name}: {', '.join(words)}"


def rare(bus: Mapping[str, Any]) -> list[str]:
    """Collisions and undetected damaged frames of a bus or link; those that there were."""
    words = {"collisions": "collision", "undetected_frames": "undetected damaged frame"}
    return [counted(bus[key], word) for key, word in words.items() if bus[key]]


def _port(name: str, port: Mapping[str, Any]) -> Iterator[str]:
    what = port["protocol"] or ("Modbus master" if "transactions" in port else "no protocol")
    station = port.get("station")
    if station is not None:
        what += f", station {station}"
    yield f"{name}: {what} on {port['bus']}{_timeout(port)}"
    yield from _counts(port)
    if port["errors"]:
        errors = ", ".join(
            f"{yy} {number:,}× ({meaning(yy, kind='port_error')})" for yy, number in port["errors"].items()
        )
        yield f"  port errors      yy of D8063 = 7xyy: {errors}"


def _device(name: str, device: Mapping[str, Any]) -> Iterator[str]:
    station = "" if device["station"] is None else f", station {device['station']}"
    yield f"{name}: {device['model']}{station} on {device['bus']}{_timeout(device)}"
    yield from _counts(device)
    if device["state"]:
        yield f"  at the end       {', '.join(f'{key} {value}' for key, value in device['state'].items())}"


def _counts(node: Mapping[str, Any]) -> Iterator[str]:
    if "transactions" in node:
        yield from _master(node)
    if "sent" in node:
        yield f"  messages         {_free(node)}"
    # A device of the free protocol or an HMI has no requests, and no line of them.
    if node.get("requests") or (node.get("station") is not None and "requests" in node):
        yield f"  requests         {_slave(node)}"


def _master(port: Mapping[str, Any]) -> Iterator[str]:
    failures = [
        *(
            f"{number:,} exception {code} ({meaning(code, kind='exception')})"
            for code, number in port["exceptions"].items()
        ),
        *_unless_none(port["timeouts"], "no response in time"),
        *_unless_none(port["crc_errors"], "CRC or LRC"),
        *(f"{number:,} {words}" for words, number in port["other_errors"].items()),
    ]
    own = port.get("answered_with_own_data")  # a folder of an earlier version does not have it
    accepted = [f"{port['ok']:,} ok"]
    if own not in (None, port["ok"]):
        accepted.append(f"{own:,} with own data")
    counts = [f"{port['transactions']:,}: {', '.join(accepted)}", *failures]
    mismatched = port["mismatched_responses"]
    wrong = (
        f"; {counted(mismatched, 'response')} taken that belonged to another request" if mismatched else ""
    )
    yield f"  transactions     {', '.join(counts)}{wrong}"
    if port["response_ms"]["max"] is not None:
        yield f"  response         {times_in_words(port['response_ms'])}"
    cycles = port["cycle_ms"]
    if cycles["count"]:
        yield f"  poll cycle       {times_in_words(cycles)}, {counted(cycles['count'], 'cycle')}"
    polls = {name: poll for name, poll in port["polls"].items() if name}
    for name in list(polls)[:_MOST_POLLS]:
        yield f"  {f'poll {name}':<16} {_poll(polls[name])}"
    if len(polls) > _MOST_POLLS:
        yield f"  and {counted(len(polls) - _MOST_POLLS, 'more poll')}, in summary.json"


def _poll(poll: Mapping[str, Any]) -> str:
    words = f"{counted(poll['turns'], 'turn')}, {poll['failed_turns']:,} failed"
    if poll["response_ms"]["max"] is not None:
        words += f"; response {times_in_words(poll['response_ms'])}"
    age = poll["age_ms"]
    if age is not None:
        # A folder of an earlier version does not have it.
        oldest = age.get("oldest", max(age["open"], age["before_refresh"]["max"] or 0))
        still = ", still so at the end" if oldest == age["open"] else ""
        words += f"; data up to {oldest:.3f} ms old{still}"
    return words


def _slave(node: Mapping[str, Any]) -> str:
    words = [f"{node['requests']:,}", f"{node['answered']:,} answered"]
    words += _unless_none(node.get("broadcasts", 0), "broadcasts")
    if "transactions" not in node:  # else the exceptions stand among the master's
        words += [
            f"{number:,} exception {code} ({meaning(code, kind='exception')})"
            for code, number in node["exceptions"].items()
        ]
    if node["rejected"]:
        reasons = ", ".join(f"{reason} {number:,}×" for reason, number in node["rejected"].items())
        words.append(f"ignored: {reasons}")
    return ", ".join(words)


def _free(node: Mapping[str, Any]) -> str:
    data = node["bytes"]
    words = [
        f"{node['sent']:,} sent ({counted(data['sent'], 'byte')})",
        f"{node['received']:,} received ({counted(data['received'], 'byte')})",
        *_unless_none(node["timeouts"], "ended by timeout"),
        *_unless_none(node["damaged"], "damaged characters"),
    ]
    others = node.get("messages", {})  # a folder of an earlier version does not have it
    if others.get("sent"):
        became = (f"{number:,} {word.replace('_', ' ')}" for word, number in others.items() if number)
        words.append(f"of others {', '.join(became)}")
    return ", ".join(words)


def times_in_words(times: Mapping[str, float | None], keys: Sequence[str] = ("p50", "p99", "max")) -> str:
    """Statistics of times in ms, ``median 50.406, p99 50.414, max 51.103 ms``; unknown ones left out."""
    return ", ".join(f"{SHOWN[key]} {times[key]:.3f}" for key in keys if times[key] is not None) + " ms"


def _timeout(node: Mapping[str, Any]) -> str:
    timeout = node.get("timeout_ms")
    return "" if timeout is None else f", timeout {timeout:g} ms"


def _unless_none(number: int, what: str) -> list[str]:
    return [f"{number:,} {what}"] if number else []
