"""What is known of a run when it has ended, and its form in ``histograms.json``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from bussim.results.meters.latency_record import LatencyRecord
from bussim.results.meters.link import LinkRecord
from bussim.results.meters.plain_data import from_plain, to_plain
from bussim.results.meters.ports import PortRecord
from bussim.results.summary import SCHEMA
from bussim.results.verdict.verdict import Evidence, verdict
from bussim.trace.codec import from_line, type_of
from bussim.trace.records import NoteRecord


@dataclass(frozen=True, slots=True)
class RunRecord:
    """A whole run: its summary (the content of ``summary.json``), its links, ports and notes.

    ``ports`` are the nodes beside the links that were a Modbus master or had the free protocol. Of
    notes other than faults only the first ones are kept; ``left_out`` counts the others by kind.
    ``latency`` is by entry. ``duration`` is in ticks.
    """

    summary: dict[str, Any]
    duration: int
    links: dict[str, LinkRecord]
    notes: tuple[NoteRecord, ...] = ()
    left_out: dict[str, int] = field(default_factory=dict)
    ports: dict[str, PortRecord] = field(default_factory=dict)
    latency: dict[str, LatencyRecord] = field(default_factory=dict)

    @property
    def scenario(self) -> str:
        """The scenario's name."""
        return str(self.summary["scenario"])

    def histograms(self) -> dict[str, Any]:
        """The content of ``histograms.json``."""
        return {
            "schema": SCHEMA,
            "duration": self.duration,
            "links": to_plain(self.links),
            "ports": to_plain(self.ports),
            "latency": to_plain(self.latency),
            "notes": [note._asdict() for note in self.notes],
            "notes_left_out": to_plain(self.left_out),
        }

    @classmethod
    def from_json(cls, summary: dict[str, Any], histograms: Mapping[str, Any]) -> RunRecord:
        """The run of its two files; a version that kept no verdict gets one.

        Raises KeyError, TypeError or ValueError for anything else.
        """
        links = from_plain(dict[str, LinkRecord], histograms["links"])
        latency = from_plain(dict[str, LatencyRecord], histograms.get("latency", {}))
        for key, records in (("links", links), ("latency", latency)):
            if records.keys() != summary.get(key, {}).keys():
                raise ValueError(f"{key} are {', '.join(records)}, in the summary {', '.join(summary[key])}")
        if "verdict" not in summary:
            summary = {**summary, "verdict": verdict(summary, Evidence(links))}
        return cls(
            summary=summary,
            duration=int(histograms["duration"]),
            links=links,
            notes=tuple(map(_note, histograms["notes"])),
            left_out=from_plain(dict[str, int], histograms["notes_left_out"]),
            ports=from_plain(dict[str, PortRecord], histograms["ports"]),
            latency=latency,
        )


def _note(data: Mapping[str, Any]) -> NoteRecord:
    note = from_line({"type": type_of(NoteRecord), **data}, {})
    if not isinstance(note, NoteRecord):
        raise TypeError(f"{data!r} is not a note")
    return note
