"""What was wrong in a run and what was well, from what stations and buses showed; never from its faults."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from bussim.results.meters.failures import Irregulars
from bussim.results.meters.link import LinkRecord
from bussim.results.meters.ports import PortRecord
from bussim.results.verdict.catalogue import is_fault, sentence
from bussim.results.verdict.link import link_findings
from bussim.results.verdict.parts import DISTURBING, Away, Finding, not_running, serial_errors
from bussim.results.verdict.ports import bus_findings, has_failed, node_findings
from bussim.words.formats import render


@dataclass(frozen=True, slots=True)
class Evidence:
    """What a verdict rests on beside ``summary.json``; a folder of an earlier version has less of it.

    ``links`` are by bus. ``refused`` has D8063 of each PLC or port that has refused its parameters, 0 where
    a slave has refused the master's mode. ``irregular`` is by bus. ``away`` are the times of each PLC and
    device without supply or in STOP. ``ports`` has what became of requests and messages.
    """

    links: Mapping[str, LinkRecord] = field(default_factory=dict)
    refused: Mapping[str, int] = field(default_factory=dict)
    irregular: Mapping[str, Irregulars] = field(default_factory=dict)
    away: Mapping[str, Away] = field(default_factory=dict)
    ports: Mapping[str, PortRecord] = field(default_factory=dict)


def verdict(summary: Mapping[str, Any], evidence: Evidence) -> list[dict[str, Any]]:
    """The ``verdict`` of a summary: sentences as keys with values, each with its text in English."""
    return [
        {"key": key, "values": values, "text": render(key, values)}
        for key, values in _findings(summary, evidence)
    ]


def faults(items: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Those of a verdict that say that something was wrong."""
    return [item for item in items if is_fault(item["key"])]


def about(items: list[dict[str, Any]], bus: str) -> list[str]:
    """The texts of a verdict about one bus."""
    return [sentence(item) for item in items if item["values"].get("bus") == bus]


def _findings(summary: Mapping[str, Any], evidence: Evidence) -> Iterator[Finding]:
    links, buses = summary["links"], summary["buses"]
    if not links and not buses and summary["plcs"]:
        yield "no_bus", {}
    told: set[str] = set()
    for bus, link in links.items():
        record = evidence.links.get(bus)
        if record is not None:
            told |= {*record.plc_names}
            irregular = evidence.irregular.get(bus, {})
            yield from link_findings(bus, link, record, summary, evidence.refused, irregular, evidence.away)
    for name, away in evidence.away.items():
        if name not in told:
            yield from not_running(name, away, summary["duration_s"], {})
    nodes = {**(summary.get("ports") or {}), **(summary.get("devices") or {})}
    disturbed: set[str] = set()
    for bus, found in buses.items():
        on_bus = {name: node for name, node in nodes.items() if node["bus"] == bus}
        for key, values in bus_findings(bus, found, on_bus, evidence.irregular.get(bus, {})):
            yield key, values
            if key in DISTURBING:
                disturbed |= {*on_bus} if key == "two_masters" else {*values["plcs"]}
    failed: dict[str, bool] = {}  # by bus with a Modbus master
    for node in nodes.values():
        if node.get("transactions"):
            failed[node["bus"]] = failed.get(node["bus"], False) or has_failed(node)
    for name, node in nodes.items():
        made_good = not failed.get(node["bus"], True)
        port = evidence.ports.get(name) or PortRecord(node["bus"])
        irregular = evidence.irregular.get(node["bus"], {})
        yield from node_findings(
            name, node, evidence.refused.get(name), port, disturbed, irregular=irregular, made_good=made_good
        )
    for plc in summary["plcs"]:
        if plc not in told:
            yield from serial_errors(plc, summary, evidence.refused, {})
