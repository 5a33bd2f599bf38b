"""Tables and histograms of what is beside the N:N links: buses, ports of PLCs, and devices."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

from bussim.report import charts, tables
from bussim.report.parts import Chart, Charts
from bussim.report.runs import Source
from bussim.report.tables import CODE, Cell, Table, number, pointer
from bussim.words.formats import meaning_of
from bussim.words.language import say
from bussim.words.tables import Said

_SECTIONS = ("ports", "devices")


class Metric(NamedTuple):
    """A figure of a port or device: its label, the keys that lead to it in its entry, and its decimals.

    Where there is a figure for each name of an entry, the label is the key of a text about a ``name``.
    """

    label: str
    keys: tuple[str, ...]
    decimals: int | None = None


_TIMES = tuple((key, tables.TIMES[key]) for key in ("p50", "p99", "max"))
#: What a node is: the key that shows it, what its table is called, and its figures. A key whose entries are
#: counts by name or code stands for a row of each.
_ROLES: tuple[tuple[str, str, tuple[Metric, ...]], ...] = (
    (
        "transactions",
        say("node_masters"),
        (
            Metric(say("node_requests"), ("transactions",)),
            Metric(say("node_ok"), ("ok",)),
            Metric(say("node_own"), ("answered_with_own_data",)),
            Metric(say("node_mistaken"), ("mismatched_responses",)),
            Metric(say("node_late"), ("late_responses",)),
            Metric(say("node_timeouts"), ("timeouts",)),
            Metric(say("node_crc"), ("crc_errors",)),
            Metric("node_name", ("other_errors",)),
            Metric("node_exception", ("exceptions",)),
            Metric("node_port_error", ("errors",)),
            Metric(say("table_timeout_ms"), ("timeout_ms",)),
            *(Metric(say("node_response", label=label), ("response_ms", key), 3) for key, label in _TIMES),
            *(Metric(say("node_cycle", label=label), ("cycle_ms", key), 3) for key, label in _TIMES),
        ),
    ),
    (
        "requests",
        say("node_slaves"),
        (
            Metric(say("table_station"), ("station",)),
            Metric(say("node_requests"), ("requests",)),
            Metric(say("node_answered"), ("answered",)),
            Metric(say("node_broadcasts"), ("broadcasts",)),
            Metric("node_exception", ("exceptions",)),
            Metric("node_ignored", ("rejected",)),
            Metric("node_port_error", ("errors",)),
        ),
    ),
    (
        "sent",
        say("node_free"),
        (
            Metric(say("node_sent"), ("sent",)),
            Metric(say("node_received"), ("received",)),
            Metric(say("node_ended"), ("timeouts",)),
            Metric(say("node_damaged"), ("damaged",)),
            Metric("node_others", ("messages",)),
            Metric(say("node_bytes_sent"), ("bytes", "sent")),
            Metric(say("node_bytes_received"), ("bytes", "received")),
            Metric("node_port_error", ("errors",)),
        ),
    ),
    ("state", say("node_devices"), (Metric("node_state", ("state",)),)),
)
_BUS = (
    Metric(say("node_baud"), ("baud",), CODE),
    Metric(say("node_format"), ("format",)),
    Metric(say("node_load"), ("bus_load",), 4),
    Metric(say("node_frames"), ("frames",)),
    Metric(say("table_collisions"), ("collisions",)),
    Metric(say("table_undetected_frames"), ("undetected_frames",)),
)
_POLL = (
    Metric(say("node_attempts"), ("transactions",)),
    Metric(say("node_good"), ("ok",)),
    Metric(say("node_turns"), ("turns",)),
    Metric(say("node_failed_turns"), ("failed_turns",)),
    *(Metric(say("node_poll_response", label=label), ("response_ms", key), 3) for key, label in _TIMES),
    Metric(say("node_oldest"), ("age_ms", "oldest"), 3),
    Metric(say("node_age_end"), ("age_ms", "open"), 3),
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
        found.append(_table(say("node_polls", name=at[-1]), polls, _POLL))
    buses: dict[tuple[str, ...], Any] = {("buses", name): bus for name, bus in summary["buses"].items()}
    found.append(_table(say("node_buses"), buses, _BUS))
    return [table for table in found if table.rows]


def node_metrics(nodes: Iterable[Mapping[str, Any]]) -> list[Metric]:
    """The figures that one node has in several runs, with those of all its roles and of its polls."""
    entries = list(nodes)
    roles = [metrics for key, _, metrics in _ROLES if any(_has(node, key) for node in entries)]
    found = [metric for metrics in roles for metric in _spread(metrics, entries)]
    for poll in dict.fromkeys(name for node in entries for name in node.get("polls", {})):
        found += [
            Metric(
                say("node_of_poll", poll=_poll_name(poll), label=metric.label),
                ("polls", poll, *metric.keys),
                metric.decimals,
            )
            for metric in _POLL
        ]
    return list(dict.fromkeys(found))


def _has(node: Mapping[str, Any], key: str) -> bool:
    """Whether a node has a role: a device without requests or polls is no slave or master."""
    return bool(node.get(key)) or (key == "requests" and key in node and node.get("station") is not None)


def _poll_name(name: str) -> str:
    return name or say("program")


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
        if isinstance(metric.label, Said):
            yield metric
            continue
        values = [value for entry in entries if isinstance(value := value_at(entry, metric.keys), Mapping)]
        for name in dict.fromkeys(name for value in values for name in value):
            words = {kind: meaning_of(name, kind=kind) for kind in ("exception", "port_error")}
            yield Metric(say(metric.label, name=name, **words), (*metric.keys, name), metric.decimals)


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
        title = say("chart_responses", name=name)
        chart = charts.histogram_chart({source.label: responses}, None, title, charts.RESPONSES)
        data = tables.histogram_data(responses, say("chart_responses_of", name=name), charts.RESPONSES)
        attempts = sum(poll.transactions for poll in record.polls.values())
        counts = {"responses": responses.count, "attempts": attempts}
        texts = say("chart_responses_said", **counts), say("chart_responses_caption", **counts)
        found.append(drawn.add(chart, texts[0], data, texts[1]))
    return found
