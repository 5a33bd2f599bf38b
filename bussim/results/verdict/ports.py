"""What buses, ports and devices beside the links showed, as findings: keys of the catalogue with values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from bussim.results.meters.failures import Irregulars
from bussim.results.verdict.catalogue import render
from bussim.results.verdict.parts import Finding, driver_findings

#: Frames that a slave ignores because it is busy are the master's doing, and stand there.
_BUSY = "busy with another request"


def bus_findings(
    bus: str,
    found: Mapping[str, Any],
    nodes: Mapping[str, Mapping[str, Any]],
    irregular: Irregulars,
) -> Iterator[Finding]:
    """Of a bus beside the links: which nodes send at the same time. ``nodes`` are its ports and devices."""
    masters = [name for name, node in nodes.items() if node.get("transactions")]
    several = len(masters) > 1 and bool(found["collisions"])
    if several:
        yield "two_masters", {"bus": bus, "number": len(masters), "masters": masters}
    yield from driver_findings(bus, found["collisions"], irregular, known=several)
    if found["undetected_frames"]:
        yield "undetected", {"bus": bus, "frames": found["undetected_frames"]}


def has_failed(master: Mapping[str, Any]) -> bool:
    """Whether a request of a Modbus master failed that no later attempt of its turn has made good."""
    failed = master["transactions"] > master["ok"]
    return failed and not all(poll["turns"] and not poll["failed_turns"] for poll in master["polls"].values())


def node_findings(
    name: str, node: Mapping[str, Any], refused: int | None, *, made_good: bool
) -> Iterator[Finding]:
    """Of a port or device: what it got as master, ignored as slave, and sent in the free protocol.

    ``made_good``: no master of its bus has a failed request.
    """
    where = {"bus": node["bus"], "node": name}
    if refused is not None:
        yield "port_refused", {**where, "code": refused}
    found = _master(node) if node.get("transactions") else iter(())
    for key, values in (
        *found,
        *(() if made_good else _slave(node)),
        *(_free(node) if "sent" in node else ()),
    ):
        yield key, {**where, **values}


def _master(node: Mapping[str, Any]) -> Iterator[Finding]:
    requests, mistaken, late = (
        node["transactions"],
        node["mismatched_responses"],
        node.get("late_responses", 0),
    )
    # A folder of an earlier version does not have how many were answered with their own data.
    own = node.get("answered_with_own_data", max(0, node["ok"] - mistaken))
    times = node["response_ms"]
    values: dict[str, Any] = {"requests": requests}
    if own < requests:
        values["own"] = own
    if times["max"] is not None:
        which = "median" if times["p50"] is not None else "mean"
        shown = times["p50"] if times["p50"] is not None else times["mean"]
        values |= {"which": render(f"which_{which}"), "response_ms": shown, "max_ms": times["max"]}
    if not own:
        yield "no_own_data", {"requests": requests}
    else:
        key = "own_data" if own == requests else "some_own_data"
        yield (f"{key}_times" if times["max"] is not None else key), values
    if mistaken:
        yield "mistaken", {"responses": mistaken}
    if late:
        yield "late", {"responses": late, "timeout_ms": node["timeout_ms"]}
    yield from _failures(node, late)


def _failures(node: Mapping[str, Any], late: int) -> Iterator[Finding]:
    """Failed requests; where each was repeated with success, only how many."""
    polls, failed = node["polls"], node["transactions"] - node["ok"]
    if not has_failed(node):
        if failed:
            yield "requests_repeated", {"requests": failed}
        return
    if node["timeouts"] > late:
        # A folder of an earlier version does not have them by poll.
        without = {
            name: poll.get("timeouts", poll["transactions"] - poll["ok"]) - poll.get("late_responses", 0)
            for name, poll in polls.items()
        }
        bad = [name or render("program") for name, number in without.items() if number > 0]
        yield "no_response", {"requests": node["timeouts"] - late, "polls": bad}
    reasons = dict(node["other_errors"])
    if node["crc_errors"]:
        reasons = {"CRC or LRC": node["crc_errors"], **reasons}
    if reasons:
        yield "damaged_responses", {"responses": sum(reasons.values()), "reasons": reasons}
    if node["exceptions"]:
        yield "exceptions", {"responses": sum(node["exceptions"].values()), "codes": dict(node["exceptions"])}


def _slave(node: Mapping[str, Any]) -> Iterator[Finding]:
    reasons = {reason: number for reason, number in node.get("rejected", {}).items() if reason != _BUSY}
    if reasons:
        yield "requests_ignored", {"frames": sum(reasons.values()), "reasons": reasons}


def _free(node: Mapping[str, Any]) -> Iterator[Finding]:
    yield "messages", {"sent": node["sent"], "received": node["received"]}
    if node["timeouts"] and "transactions" not in node:
        yield "messages_ended", {"number": node["timeouts"]}
    if node["damaged"]:
        yield "characters_damaged", {"number": node["damaged"]}
