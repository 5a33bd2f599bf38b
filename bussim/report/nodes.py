"""Tables and histograms of what is beside the N:N links: buses, ports of PLCs, and devices."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from bussim.report import charts, tables
from bussim.report.parts import Chart, Charts
from bussim.report.runs import Source
from bussim.report.tables import Cell, Table, number, pointer
from bussim.words.formats import meaning_of
from bussim.words.language import say
from bussim.words.tables import Said, read_table

_SECTIONS = ("ports", "devices")
_MISSING = object()


class Metric(NamedTuple):
    """A figure of a port or device: its label, the keys that lead to it in its entry, and its decimals.

    Where there is a figure for each name of an entry, the label is the key of a text about a ``name``.
    """

    label: str
    keys: tuple[str, ...]
    decimals: int | None = None


def _metrics(rows: Iterable[Sequence[Any]]) -> tuple[Metric, ...]:
    found: list[Metric] = []
    for label, path, *decimals in rows:
        *keys, last = path.split(".")
        if last == "*":
            found.append(Metric(label, tuple(keys)))
        elif last == "each":
            names = {name: say(label, label=tables.TIMES[name]) for name in ("p50", "p99", "max")}
            found += [Metric(said, (*keys, name), *decimals) for name, said in names.items()]
        else:
            found.append(Metric(say(label), (*keys, last), *decimals))
    return tuple(found)


_TABLE = read_table("bussim.report", "nodes.yaml")
_ROLES = [(key, say(role["caption"]), _metrics(role["figures"])) for key, role in _TABLE["roles"].items()]
_BUS, _POLL = _metrics(_TABLE["bus"]), _metrics(_TABLE["poll"])


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


def value_at(data: Any, keys: Iterable[str], missing: Any = _MISSING) -> Any:
    """The value that keys lead to; ``missing`` where there is none."""
    for key in keys:
        if not isinstance(data, Mapping) or key not in data:
            return missing
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
