"""What buses, ports and devices beside the links showed, as findings: keys of the catalogue with values."""

from collections.abc import Collection, Iterator, Mapping
from typing import Any

from bussim.results.meters.failures import Irregulars
from bussim.results.meters.ports import PortRecord
from bussim.results.verdict.parts import Finding, driver_findings, in_all, noted
from bussim.trace.records import LATE_RESPONSE, Outcome
from bussim.words.formats import render

#: Frames that a slave ignores because it is busy are the master's doing, and stand there.
_BUSY = "busy with another request"


def bus_findings(
    bus: str, found: Mapping[str, Any], nodes: Mapping[str, Mapping[str, Any]], irregular: Irregulars
) -> Iterator[Finding]:
    """Of a bus beside the links: which nodes send at the same time. ``nodes`` are its ports and devices."""
    masters = [name for name, node in nodes.items() if node.get("transactions")]
    several = len(masters) > 1 and bool(found["collisions"])
    if several:
        yield "two_masters", {"bus": bus, "number": len(masters), "masters": masters}
    shared = [*_shared_numbers(bus, nodes)]
    yield from shared
    yield from driver_findings(bus, found["collisions"], irregular, known=several or bool(shared))
    # A message of the free protocol has no check; each node has a sentence of those that it took wrongly.
    wrong = max((node.get("messages", {}).get("wrong", 0) for node in nodes.values()), default=0)
    if found["undetected_frames"] > wrong:
        yield "undetected", {"bus": bus, "frames": found["undetected_frames"] - wrong}


def _shared_numbers(bus: str, nodes: Mapping[str, Mapping[str, Any]]) -> Iterator[Finding]:
    """Stations that several slaves of a bus have replied as."""
    stations: dict[int, list[str]] = {}
    for name, node in nodes.items():
        if node.get("answered") and node["station"] is not None:
            stations.setdefault(node["station"], []).append(name)
    for station, names in stations.items():
        if len(names) > 1:
            yield "same_number", {"bus": bus, "station": station, "plcs": names}


def has_failed(master: Mapping[str, Any]) -> bool:
    """Whether a request of a Modbus master failed that no later attempt of its turn has made good."""
    failed = master["transactions"] > master["ok"]
    return failed and not all(poll["turns"] and not poll["failed_turns"] for poll in master["polls"].values())


def node_findings(
    name: str,
    node: Mapping[str, Any],
    refused: int | None,
    record: PortRecord,
    disturbed: Collection[str],
    *,
    irregular: Irregulars,
    made_good: bool,
) -> Iterator[Finding]:
    """Of a port or device: what it got as master, ignored as slave, and sent in the free protocol.

    ``disturbed`` are nodes of which it is said why exchanges with them fail; ``irregular`` is
    of its bus; ``made_good``: no master of its bus has a failed request.
    """
    where = {"bus": node["bus"], "node": name}
    if refused is not None:
        yield "port_refused", {**where, "code": refused}
    late = noted(irregular.get((name, LATE_RESPONSE)))
    found = _master(node, record, disturbed, late) if node.get("transactions") else iter(())
    for key, values in (
        *found,
        *(() if made_good else _slave(node)),
        *(_free(node, record) if "sent" in node else ()),
    ):
        yield key, {**where, **values}


def _master(
    node: Mapping[str, Any], record: PortRecord, disturbed: Collection[str], when_late: Any
) -> Iterator[Finding]:
    mistaken, late = node["mismatched_responses"], node.get("late_responses", 0)
    broadcasts = node.get("broadcast_requests", 0)
    requests = node["transactions"] - broadcasts
    if broadcasts:
        yield "broadcasts", {"requests": broadcasts}
    if not requests:
        return
    # A folder of an earlier version does not have how many were answered with their own data.
    own = node.get("answered_with_own_data", max(0, node["ok"] - mistaken))
    times = {key: node["response_ms"][key] for key in ("p50", "mean", "max")}
    if node["exceptions"]:  # their times are among these
        times["max"] = None
    values = {"requests": requests, "own": own, "times": times}
    yield "no_own_data" if not own else "own_data" if own == requests else "some_own_data", values
    if mistaken:
        yield "mistaken", {"responses": mistaken, "when": noted(record.mistaken)}
    if late:
        yield "late", {"responses": late, "timeout_ms": node["timeout_ms"], "when": when_late}
    yield from _failures(node, record, late)
    if has_failed(node):
        yield from _causes(record, disturbed)


def _causes(record: PortRecord, disturbed: Collection[str]) -> Iterator[Finding]:
    """Why requests failed, by the node that they were for; of one that was not at work it is said there."""
    for peer, each in record.exchanges.items():
        for outcome, times in each.failed.items():
            if outcome is not Outcome.AWAY and peer not in disturbed:
                values = {"peer": peer, "requests": each.counts[outcome], "when": in_all(times)}
                yield f"request_{outcome}", values
        if (unknown := each.counts[Outcome.UNKNOWN]) and peer not in disturbed:
            yield "request_unknown", {"peer": peer, "requests": unknown}


def _failures(node: Mapping[str, Any], record: PortRecord, late: int) -> Iterator[Finding]:
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
        values = {"responses": sum(node["exceptions"].values()), "codes": dict(node["exceptions"])}
        yield "exceptions", {**values, "when": noted(record.excepted)}


def _slave(node: Mapping[str, Any]) -> Iterator[Finding]:
    reasons = {reason: number for reason, number in node.get("rejected", {}).items() if reason != _BUSY}
    if reasons:
        yield "requests_ignored", {"frames": sum(reasons.values()), "reasons": reasons}


def _free(node: Mapping[str, Any], record: PortRecord) -> Iterator[Finding]:
    yield "messages", {"sent": node["sent"], "received": node["received"]}
    for peer, each in record.exchanges.items():
        whole, number = each.counts[Outcome.GOOD], each.counts.total()
        key = "messages_whole" if whole == number else "messages_some"
        yield key, {"peer": peer, "whole": whole, "messages": number}
        for outcome, times in each.failed.items():
            if outcome is not Outcome.AWAY:
                # A port that sends, too, need not receive what is for others.
                passed = outcome is Outcome.NOT_READY and node["sent"]
                values = {"peer": peer, "messages": each.counts[outcome], "when": in_all(times)}
                yield "message_passed" if passed else f"message_{outcome}", values
    for outcome, times in record.free.waits.failed.items():
        yield "messages_ended", {"number": record.free.waits.counts[outcome], "when": in_all(times)}
    if node["damaged"]:
        yield "characters_damaged", {"number": node["damaged"]}
