"""Findings that links and other buses have in common: keys of the catalogue with values."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from bussim.results.meters.failures import Irregular, Irregulars, Times
from bussim.results.meters.timeline import Span
from bussim.results.numbers import s
from bussim.results.registers import own_name
from bussim.trace.records import (
    AFTER_FRAME,
    IN_FRAME,
    IN_STOP,
    JABBER,
    LATE_REPLY,
    OFF_RATE,
    UNEVEN,
    WITHOUT_FRAME,
    WITHOUT_SUPPLY,
)
from bussim.units import TICKS_PER_SECOND

Finding = tuple[str, dict[str, Any]]

#: The sentence about each thing that a node's driver does by itself.
_OF_A_NODE = {
    JABBER: "no_frame",
    AFTER_FRAME: "late_release",
    LATE_REPLY: "late_replies",
    UNEVEN: "pauses",
    OFF_RATE: "other_rate",
}

#: Findings that explain why exchanges fail.
DISTURBING = ("two_masters", "same_number")
#: The part of a sentence about each state.
_STATES = {WITHOUT_SUPPLY: "without_supply", IN_STOP: "in_stop"}


def in_all(times: Times) -> dict[str, Any]:
    """Times as a value of the format ``when``."""
    return {
        "times": times.number,
        "first_s": s(times.first),
        "last_s": s(times.last),
        "total_s": s(times.total),
        "from_s": s(times.at),
        "for_s": s(times.longest),
    }


def noted(found: Irregular | None) -> dict[str, Any] | None:
    """The times of what came now and then, as a value of the format ``when``; None where none were kept."""
    return None if found is None else in_all(found.times())


def summed(spans: Iterable[Span], duration_s: float) -> Times:
    """Spans of a run, counted."""
    found, duration = Times(), round(duration_s * TICKS_PER_SECOND)
    for span in spans:
        found.add(span.start, duration if span.end is None else span.end)
    return found


#: Times by what a PLC or device was in them: "without supply" or "in STOP".
Away = Mapping[str, list[Span]]


def not_running(name: str, away: Away, duration_s: float, where: Mapping[str, str]) -> Iterator[Finding]:
    """A PLC or device that was without supply or in STOP."""
    for state, spans in away.items():
        key = "still_not_running" if spans[-1].end is None else "not_running"
        when = in_all(summed(spans, duration_s))
        yield key, {**where, "plc": name, "state": _STATES[state], "when": when}


def serial_errors(
    plc: str, summary: Mapping[str, Any], refused: Mapping[str, int], where: Mapping[str, str]
) -> Iterator[Finding]:
    """M8063 and D8063 of a PLC, but for the codes of refused parameters, which stand elsewhere."""
    registers = summary["plcs"].get(plc, {}).get("registers", {})
    code, on = registers.get("D8063", 0), registers.get("M8063", 0)
    said = {number for name, number in refused.items() if name.partition(".")[0] == plc}
    if (code or on) and code not in said and not (plc in refused and not refused[plc]):
        yield (
            "serial_error_on" if on else "serial_error",
            {**where, "plc": plc, "code": code, **serial_names(summary, plc)},
        )


def serial_names(summary: Mapping[str, Any], plc: str) -> dict[str, str]:
    """What a PLC calls M8063 and D8063."""
    return {key: own_name(summary, plc, name) for key, name in (("flag", "M8063"), ("error", "D8063"))}


def driver_findings(bus: str, collisions: int, irregular: Irregulars, *, known: bool) -> Iterator[Finding]:
    """What the drivers on a bus did that disturbs it; ``known``: why two send at once is said already."""
    for what, key in _OF_A_NODE.items():
        for (node, kind), found in sorted(irregular.items()):
            if kind == what:
                known = True
                number = found.number
                if what == JABBER:  # its characters go on and on; what counts are the frames that it met
                    met = irregular.get((node, WITHOUT_FRAME))
                    number = met.number if met else 0
                yield key, {"bus": bus, "node": node, "frames": number, "when": noted(found)}
    if collisions and not known:
        senders = sorted(node for node, kind in irregular if kind == IN_FRAME)
        if senders:
            yield "collisions_with", {"bus": bus, "frames": collisions, "nodes": senders}
        else:
            yield "collisions", {"bus": bus, "frames": collisions}
