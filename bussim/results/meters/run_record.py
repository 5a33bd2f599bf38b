"""What is known of a run when it has ended, and its form in ``histograms.json``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from bussim.results.meters.histogram import Histogram
from bussim.results.meters.latency_record import LatencyRecord
from bussim.results.meters.ports import PortRecord
from bussim.results.meters.refresh import Refresh
from bussim.results.meters.timeline import (
    Cell,
    Span,
    cells_from_json,
    cells_to_json,
    spans_from_json,
    spans_to_json,
)
from bussim.trace.records import NoteRecord, ScanRecord

#: Version of ``summary.json`` and ``histograms.json``; rises when a key changes its meaning.
SCHEMA = 1


class ScanTimes:
    """Link scan times of one bus: their histogram, the last one, and when and why the longest was."""

    __slots__ = ("histogram", "last", "longest_at", "longest_cause")

    def __init__(self) -> None:
        self.histogram = Histogram()
        self.last: int | None = None
        self.longest_at: int | None = None
        self.longest_cause = ""

    def add(self, scan: ScanRecord) -> None:
        """Take in a scan; of several longest ones the first is told."""
        longest = self.histogram.maximum
        if longest is None or scan.duration > longest:
            self.longest_at, self.longest_cause = scan.start, scan.cause
        self.histogram.add(scan.duration)
        self.last = scan.duration

    def to_json(self) -> dict[str, Any]:
        """Plain data, times in ticks."""
        return {
            "last": self.last,
            "longest_at": self.longest_at,
            "longest_cause": self.longest_cause,
            **self.histogram.to_json(),
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> ScanTimes:
        """The value of :meth:`to_json`. Raises KeyError, TypeError or ValueError for anything else."""
        times = cls()
        times.histogram = Histogram.from_json(data)
        times.last, times.longest_at = data["last"], data["longest_at"]
        times.longest_cause = str(data["longest_cause"])
        return times


@dataclass(frozen=True, slots=True)
class LinkRecord:
    """One N:N link's statistics.

    ``after_startup`` are the scans that began at or after the link was healthy for the first time.
    ``refresh`` is by (source, receiver) names. ``in_error`` tells when each station's error flag
    was on at the master. ``failed_per_scan`` tells, by error code, how many scans had how many
    failed attempts with that code (only scans that had one).
    """

    plc_names: tuple[str, ...]
    scan_times: ScanTimes
    after_startup: ScanTimes
    refresh: dict[tuple[str, str], Refresh] = field(default_factory=dict)
    timeline: list[Cell] = field(default_factory=list)
    in_error: dict[int, list[Span]] = field(default_factory=dict)
    failed_per_scan: dict[int, dict[int, int]] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Plain data, times in ticks."""
        return {
            "seats": list(self.plc_names),
            "scan_times": self.scan_times.to_json(),
            "after_startup": self.after_startup.to_json(),
            "refresh": [
                {"source": source, "receiver": receiver, "last": pair.last, **pair.gaps.to_json()}
                for (source, receiver), pair in self.refresh.items()
            ],
            "timeline": cells_to_json(self.timeline),
            "in_error": spans_to_json(self.in_error),
            "failed_per_scan": {
                f"{code:02X}": {str(number): scans for number, scans in sorted(by_number.items())}
                for code, by_number in sorted(self.failed_per_scan.items())
            },
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> LinkRecord:
        """The value of :meth:`to_json`. Raises KeyError, TypeError or ValueError for anything else."""
        return cls(
            plc_names=tuple(map(str, data["seats"])),
            scan_times=ScanTimes.from_json(data["scan_times"]),
            after_startup=ScanTimes.from_json(data["after_startup"]),
            refresh={
                (str(pair["source"]), str(pair["receiver"])): Refresh(Histogram.from_json(pair), pair["last"])
                for pair in data["refresh"]
            },
            timeline=cells_from_json(data["timeline"]),
            in_error=spans_from_json(data["in_error"]),
            failed_per_scan={
                int(code, 16): {int(number): int(scans) for number, scans in by_number.items()}
                for code, by_number in data["failed_per_scan"].items()
            },
        )


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
            "links": {bus: link.to_json() for bus, link in self.links.items()},
            "ports": {node: port.to_json() for node, port in self.ports.items()},
            "latency": {name: entry.to_json() for name, entry in self.latency.items()},
            "notes": [note_to_json(note) for note in self.notes],
            "notes_left_out": dict(sorted(self.left_out.items())),
        }

    @classmethod
    def from_json(cls, summary: dict[str, Any], histograms: Mapping[str, Any]) -> RunRecord:
        """The run of its two files. Raises KeyError, TypeError or ValueError for anything else."""
        return cls(
            summary=summary,
            duration=int(histograms["duration"]),
            links={bus: LinkRecord.from_json(link) for bus, link in histograms["links"].items()},
            notes=tuple(note_from_json(note) for note in histograms["notes"]),
            left_out={kind: int(number) for kind, number in histograms["notes_left_out"].items()},
            ports={node: PortRecord.from_json(port) for node, port in histograms["ports"].items()},
            latency={
                name: LatencyRecord.from_json(entry) for name, entry in histograms.get("latency", {}).items()
            },
        )


def note_to_json(note: NoteRecord) -> dict[str, Any]:
    """A note as plain data."""
    return note._asdict()


def note_from_json(data: Mapping[str, Any]) -> NoteRecord:
    """The note of :func:`note_to_json`. Raises KeyError, TypeError or ValueError for anything else."""
    return NoteRecord(
        int(data["tick"]), str(data["kind"]), str(data["where"]), str(data["text"]), dict(data["detail"])
    )
