"""Tables and histograms of what is beside the N:N links: buses, ports of PLCs, and devices."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

from bussim.report import charts, tables
from bussim.report.parts import Chart, Charts
from bussim.report.runs import Source
from bussim.report.tables import CODE, Cell, Table, number, pointer
from bussim.words.formats import meaning

_SECTIONS = ("ports", "devices")


class Metric(NamedTuple):
    """A figure of a port or device: its label, the keys that lead to it in its entry, and its decimals."""

    label: str
    keys: tuple[str, ...]
    decimals: int | None = None


_TIMES = (("p50", "median"), ("p99", "p99"), ("max", "longest"))
#: What a node is: the key that shows it, what its table is called, and its figures. A key whose entries are
#: counts by name or code stands for a row of each.
_ROLES: tuple[tuple[str, str, tuple[Metric, ...]], ...] = (
    (
        "transactions",
        "Modbus masters",
        (
            Metric("requests", ("transactions",)),
            Metric("answered (ok)", ("ok",)),
            Metric("answered with own data", ("answered_with_own_data",)),
            Metric("answered with another request's data", ("mismatched_responses",)),
            Metric("responses after the timeout", ("late_responses",)),
            Metric("no response in time", ("timeouts",)),
            Metric("CRC or LRC", ("crc_errors",)),
            Metric("{}", ("other_errors",)),
            Metric("exception {} ({exception})", ("exceptions",)),
            Metric("port error {} ({port_error}; yy of D8063 = 7xyy)", ("errors",)),
            Metric("timeout (ms)", ("timeout_ms",)),
            *(Metric(f"response time, {label} (ms)", ("response_ms", key), 3) for key, label in _TIMES),
            *(Metric(f"poll cycle, {label} (ms)", ("cycle_ms", key), 3) for key, label in _TIMES),
        ),
    ),
    (
        "requests",
        "Modbus slaves",
        (
            Metric("station", ("station",)),
            Metric("requests", ("requests",)),
            Metric("answered", ("answered",)),
            Metric("broadcasts", ("broadcasts",)),
            Metric("exception {} ({exception})", ("exceptions",)),
            Metric("ignored: {}", ("rejected",)),
            Metric("port error {} ({port_error}; yy of D8063 = 7xyy)", ("errors",)),
        ),
    ),
    (
        "sent",
        "Free protocol",
        (
            Metric("messages sent", ("sent",)),
            Metric("messages received", ("received",)),
            Metric("receptions ended by timeout", ("timeouts",)),
            Metric("damaged characters", ("damaged",)),
            Metric("messages of others: {}", ("messages",)),
            Metric("bytes sent", ("bytes", "sent")),
            Metric("bytes received", ("bytes", "received")),
            Metric("port error {} ({port_error}; yy of D8063 = 7xyy)", ("errors",)),
        ),
    ),
    ("state", "Devices at the end of the run", (Metric("{}", ("state",)),)),
)
_BUS = (
    Metric("baud", ("baud",), CODE),
    Metric("format", ("format",)),
    Metric("bus load (share of the time)", ("bus_load",), 4),
    Metric("frames", ("frames",)),
    Metric("collisions", ("collisions",)),
    Metric("damaged frames taken as good", ("undetected_frames",)),
)
_POLL = (
    Metric("attempts", ("transactions",)),
    Metric("ok", ("ok",)),
    Metric("turns", ("turns",)),
    Metric("failed turns", ("failed_turns",)),
    *(Metric(f"response, {label} (ms)", ("response_ms", key), 3) for key, label in _TIMES),
    Metric("oldest data (ms)", ("age_ms", "oldest"), 3),
    Metric("data age at the end (ms)", ("age_ms", "open"), 3),
)


def node_tables(summary: Mapping[str, Any]) -> list[Table]:
    """A table of each role that ports and devices have, one of each master's polls, and one of the buses."""
    found = []
    nodes: dict[tuple[str, ...], Any] = {
        (section, name): node for section in _SECTIONS for name, node in summary[section].items()
    }
    for key, caption, metrics in _ROLES:
        named = {at: node for at, node in nodes.items() if _has(node, key)}
        found.append(_table(caption, named, metrics))
    for at, node in nodes.items():
        polls: dict[tuple[str, ...], Any] = {
            (*at, "polls", name): poll for name, poll in node.get("polls", {}).items()
        }
        found.append(_table(f"The polls of {at[-1]}", polls, _POLL))
    buses: dict[tuple[str, ...], Any] = {("buses", name): bus for name, bus in summary["buses"].items()}
    found.append(_table("Buses beside the N:N links", buses, _BUS))
    return [table for table in found if table.rows]


def node_metrics(nodes: Iterable[Mapping[str, Any]]) -> list[Metric]:
    """The figures that one node has in several runs, with those of all its roles and of its polls."""
    entries = list(nodes)
    roles = [metrics for key, _, metrics in _ROLES if any(_has(node, key) for node in entries)]
    found = [metric for metrics in roles for metric in _spread(metrics, entries)]
    for poll in dict.fromkeys(name for node in entries for name in node.get("polls", {})):
        found += [
            Metric(f"{_poll_name(poll)}: {metric.label}", ("polls", poll, *metric.keys), metric.decimals)
            for metric in _POLL
        ]
    return list(dict.fromkeys(found))


def _has(node: Mapping[str, Any], key: str) -> bool:
    """Whether a node has a role: a device without requests or polls is no slave or master."""
    return bool(node.get(key)) or (key == "requests" and key in node and node.get("station") is not None)


def _poll_name(name: str) -> str:
    return name or "driven by the program"


def _table(
    caption: str, named: Mapping[tuple[str, ...], Mapping[str, Any]], metrics: Iterable[Metric]
) -> Table:
    """A column an entry, a row a figure that one of them has."""
    rows = []
    for metric in _spread(metrics, named.values()):
        cells = []
        for at, entry in named.items():
            value = value_at(entry, metric.keys)
            known = value is not _MISSING
            cells.append(
                Cell(number(value, metric.decimals), pointer(*at, *metric.keys)) if known else Cell("")
            )
        if any(cell.path for cell in cells):
            rows.append((metric.label, cells))
    return Table(caption, ["", *(_poll_name(at[-1]) for at in named)], rows)


def _spread(metrics: Iterable[Metric], entries: Iterable[Mapping[str, Any]]) -> Iterator[Metric]:
    """The figures, with a row for each name of those that are counts by name."""
    entries = list(entries)
    for metric in metrics:
        if "{}" not in metric.label:
            yield metric
            continue
        values = [value for entry in entries if isinstance(value := value_at(entry, metric.keys), Mapping)]
        for name in dict.fromkeys(name for value in values for name in value):
            words = {kind: meaning(name, kind=kind) for kind in ("exception", "port_error")}
            yield Metric(metric.label.format(name, **words), (*metric.keys, name), metric.decimals)


_MISSING = object()


def value_at(data: Any, keys: Iterable[str]) -> Any:
    """The value that keys lead to; a value of its own where there is none."""
    for key in keys:
        if not isinstance(data, Mapping) or key not in data:
            return _MISSING
        data = data[key]
    return data


def response_charts(source: Source, drawn: Charts) -> list[Chart]:
    """The histogram of each Modbus master's response times; of one without an own response there is none."""
    found = []
    for name, record in source.record.ports.items():
        responses = record.responses
        if not responses.count:
            continue
        title = f"Histogram of the response times of {name}"
        chart = charts.histogram_chart({source.label: responses}, None, title, charts.RESPONSES)
        data = tables.histogram_data(responses, f"the response times of {name}", charts.RESPONSES)
        attempts = sum(poll.transactions for poll in record.polls.values())
        text = f"requests answered with their own response: {responses.count:,} of {attempts:,}."
        found.append(drawn.add(chart, f"Histogram of response times: {text}", data, f"R{text[1:]}"))
    return found
