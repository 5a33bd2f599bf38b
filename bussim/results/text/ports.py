"""Buses, ports and devices beside the N:N links as text, from ``summary.json``."""

from collections.abc import Iterator, Mapping
from typing import Any

from bussim.results.text.lines import labelled, times_in_words
from bussim.words.formats import meaning_of
from bussim.words.language import say, shown
from bussim.words.tables import entries

#: Most polls of a master that have a line.
_MOST_POLLS = 12


def port_lines(summary: Mapping[str, Any]) -> Iterator[str]:
    """Lines in the language that is used; an empty one before each block, none at all in a plain N:N run."""
    if summary["buses"]:
        yield ""
        for name, bus in summary["buses"].items():
            yield shown(_bus(name, bus))
    for name, port in summary["ports"].items():
        yield ""
        yield from _port(name, port)
    for name, device in summary["devices"].items():
        yield ""
        yield from _device(name, device)


def alone_lines(summary: Mapping[str, Any]) -> Iterator[str]:
    """Lines about the PLCs of a run without any bus, in the language that is used; none in another run."""
    if summary["links"] or summary["buses"] or not summary["plcs"]:
        return
    yield ""
    yield shown(say("run_no_bus"))
    for name, plc in summary["plcs"].items():
        scan = plc["scan_ms"]
        key = "run_no_plc_scan" if scan["mean"] is None else "run_plc_scan"
        yield shown(say(key, name=name, **({} if scan["mean"] is None else scan)))


def _bus(name: str, bus: Mapping[str, Any]) -> str:
    load, frames = say("bus_load", load=bus["bus_load"]), say("bus_frames", number=bus["frames"])
    return say("bus_line", name=name, parts=[f"{bus['baud']} {bus['format']}", load, frames, *rare(bus)])


def rare(bus: Mapping[str, Any]) -> list[str]:
    """Collisions and undetected damaged frames of a bus or link; those that there were."""
    return [say(f"bus_{key}", number=bus[key]) for key in ("collisions", "undetected_frames") if bus[key]]


def _port(name: str, port: Mapping[str, Any]) -> Iterator[str]:
    what = say("port_protocol", name=port["protocol"]) if port["protocol"] else None
    what = what or say("port_modbus_master" if "transactions" in port else "port_no_protocol")
    yield _heading(name, port, what, port.get("station"))
    yield from _counts(port)
    if port["errors"]:
        errors = [
            say("code_times", code=yy, number=number, meaning=meaning_of(yy, kind="port_error"))
            for yy, number in port["errors"].items()
        ]
        yield labelled(say("port_errors"), say("port_error_list", errors=errors))


def _device(name: str, device: Mapping[str, Any]) -> Iterator[str]:
    yield _heading(name, device, say("port_protocol", name=device["model"]), device["station"])
    yield from _counts(device)
    if device["state"]:
        state = [f"{key} {value}" for key, value in device["state"].items()]
        yield labelled(say("port_at_end"), ", ".join(state))


def _heading(name: str, node: Mapping[str, Any], what: str, station: int | None) -> str:
    if station is not None:
        what = say("port_station", what=what, station=station)
    line = say("port_line", name=name, what=what, bus=node["bus"])
    timeout = node.get("timeout_ms")
    return shown(line if timeout is None else say("port_line_timeout", line=line, timeout=timeout))


def _counts(node: Mapping[str, Any]) -> Iterator[str]:
    if "transactions" in node:
        yield from _master(node)
    if "sent" in node:
        yield labelled(say("port_messages"), _free(node))
    # A device of the free protocol or an HMI has no requests, and no line of them.
    if node.get("requests") or (node.get("station") is not None and "requests" in node):
        yield labelled(say("port_requests"), _slave(node))


def _exceptions(node: Mapping[str, Any]) -> list[str]:
    return [
        say("port_exception", number=number, code=code, meaning=meaning_of(code, kind="exception"))
        for code, number in node["exceptions"].items()
    ]


def _master(port: Mapping[str, Any]) -> Iterator[str]:
    own = port.get("answered_with_own_data")  # a folder of an earlier version does not have it
    counts = [
        say("port_ok", number=port["ok"]),
        *([] if own in (None, port["ok"]) else [say("port_own_data", number=own)]),
        *_exceptions(port),
        *_unless_none("port_timeouts", port["timeouts"]),
        *_unless_none("port_crc_errors", port["crc_errors"]),
        *(say("port_other", number=number, what=what) for what, number in port["other_errors"].items()),
    ]
    said = say("port_counts", number=port["transactions"], counts=counts)
    if mismatched := port["mismatched_responses"]:
        said = say("port_mismatched", said=said, number=mismatched)
    yield labelled(say("port_transactions"), said)
    if port["response_ms"]["max"] is not None:
        yield labelled(say("port_response"), times_in_words(port["response_ms"]))
    cycles = port["cycle_ms"]
    if cycles["count"]:
        text = say("port_cycles", times=times_in_words(cycles), number=cycles["count"])
        yield labelled(say("port_cycle"), text)
    polls = {name: poll for name, poll in port["polls"].items() if name}
    for name in list(polls)[:_MOST_POLLS]:
        yield labelled(say("port_poll", name=name), _poll(polls[name]))
    if len(polls) > _MOST_POLLS:
        yield f"  {shown(say('port_more_polls', number=len(polls) - _MOST_POLLS))}"


def _poll(poll: Mapping[str, Any]) -> str:
    said = say("port_turns", turns=poll["turns"], failed=poll["failed_turns"])
    if poll["response_ms"]["max"] is not None:
        said = say("port_turns_response", said=said, times=times_in_words(poll["response_ms"]))
    age = poll["age_ms"]
    if age is not None:
        # A folder of an earlier version does not have it.
        oldest = age.get("oldest", max(age["open"], age["before_refresh"]["max"] or 0))
        still = oldest == age["open"]
        said = say("port_turns_age_end" if still else "port_turns_age", said=said, oldest=oldest)
    return said


def _slave(node: Mapping[str, Any]) -> str:
    counts = [say("port_received", number=node["requests"]), say("port_answered", number=node["answered"])]
    counts += _unless_none("port_broadcasts", node.get("broadcasts", 0))
    if "transactions" not in node:  # else the exceptions stand among the master's
        counts += _exceptions(node)
    if node["rejected"]:
        counts.append(say("port_ignored", reasons=node["rejected"]))
    return say("comma_list", texts=counts)


def _free(node: Mapping[str, Any]) -> str:
    data = node["bytes"]
    counts = [
        say("port_sent", number=node["sent"], bytes=data["sent"]),
        say("port_got", number=node["received"], bytes=data["received"]),
        *_unless_none("port_ended", node["timeouts"]),
        *_unless_none("port_damaged", node["damaged"]),
    ]
    others = node.get("messages", {})  # a folder of an earlier version does not have it
    if others.get("sent"):
        words = (word for word in others if others[word] and f"port_others_{word}" in entries())
        became = [say(f"port_others_{word}", number=others[word]) for word in words]
        counts.append(say("port_of_others", counts=became))
    return say("comma_list", texts=counts)


def _unless_none(key: str, number: int) -> list[str]:
    return [say(key, number=number)] if number else []
