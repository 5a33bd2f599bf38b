"""The entries of ``summary.json`` about latencies. Times in ms, instants in s."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from bussim.results.meters.histogram import statistics
from bussim.results.meters.latency_record import LatencyRecord
from bussim.results.numbers import ms, s


class LatencyBounds(NamedTuple):
    """What an entry may be at worst, by case, in ticks, and what must be said with it; or why it is not."""

    cases: Mapping[str, int]
    reasons: Sequence[str] = ()
    notes: Sequence[str] = ()
    comments: Mapping[str, str] = {}  # of devices, as entries name them


def latency_summary(record: LatencyRecord, bounds: LatencyBounds | None) -> dict[str, Any]:
    """The ``summary.json`` of an entry; ``bounds`` are what it may be at worst, if known."""
    delivered = record.delivered
    summary: dict[str, Any] = {
        "from": record.source,
        "to": record.target,
        "kind": "age of a word" if record.word else "change of a bit",
        "edge": None if record.word else record.edge,
        "inverted": record.inverted,
        "changes": record.changes,
        "delivered": delivered,
        "lost": record.lost,
        "unseen": record.unseen,
        "open": record.open,
        "ms": statistics(record.histogram),
        "max_at_s": s(record.longest.at if record.longest is not None else None),
        "parts_ms": {
            name: {
                "mean": ms(total / delivered) if delivered else None,
                "max": ms(longest) if delivered else None,
            }
            for name, (total, longest) in record.parts.items()
        },
        "reads": delivered if record.word else None,
        "lost_short": None if record.word else record.lost_short,
        "longest_gap_ms": None if record.word else ms(record.longest_gap),
        "way": record.way or None,
        "way_reasons": list(record.reasons),
    }
    if bounds is None:
        return summary
    ends = (record.source, record.target)
    if comments := {end: bounds.comments[end] for end in ends if end in bounds.comments}:
        summary["comments"] = comments
    if bounds.cases:
        summary["bound_ms"] = {case: ms(ticks) for case, ticks in bounds.cases.items()}
    if bounds.reasons:
        summary["bound_reasons"] = list(bounds.reasons)
    if bounds.cases and bounds.notes:
        summary["bound_notes"] = list(bounds.notes)
    return summary
