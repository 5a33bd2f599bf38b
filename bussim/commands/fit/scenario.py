"""Scenarios made of estimates: a new one, or a given one with what was measured put in."""

from __future__ import annotations

import copy
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from bussim.engines.modbus.adu import FIRST_STATION, LAST_STATION
from bussim.engines.modbus.pdu import WRITES
from bussim.engines.modbus.server import SPACES, Space
from bussim.errors import UsageError
from bussim.line.protocols import BusProtocol
from bussim.live.fit.link import LinkEstimate
from bussim.live.fit.modbus import BusEstimate, PollEstimate
from bussim.live.fit.turnaround import TurnaroundDistribution
from bussim.plc.link_registers import D_STATION
from bussim.plc.profiles import PROFILES
from bussim.units import TICKS_PER_MS, format_time

if TYPE_CHECKING:
    from bussim.scenario.model import Scenario

#: Longest delay of a device that a scenario takes.
_LONGEST_DELAY = 60_000 * TICKS_PER_MS
_SPACE_KEYS = {
    Space.COILS: "coils",
    Space.INPUTS: "inputs",
    Space.INPUT_REGISTERS: "input_registers",
    Space.HOLDING: "registers",
}


def link_scenario(
    link: LinkEstimate, bus: str, names: dict[int, str], *, name: str, duration: int, seed: int
) -> dict[str, Any]:
    """A scenario of one N:N link in plain data. ``names`` are those of stations that are known.

    What cannot be seen on the wire is as in the default profile: the PLCs' scan times above all.
    """
    settings = link.settings
    low, high = PROFILES["pw10"].timeout_range
    base = "pw10" if low <= settings.timeout <= high else "fx2n"
    name_of = {number: names.get(number, f"station{number}") for number in range(settings.slaves + 1)}
    plcs = [
        {
            "name": node,
            "profile": {"base": base} | _profile(link, number),
            "nn": {"bus": bus, "port": "COM4", "station": number} | ({} if number else _settings(link)),
        }
        for number, node in name_of.items()
    ]
    return {
        "schema": 1,
        "name": name,
        "duration": format_time(duration),
        "seed": seed,
        "buses": [{"name": bus, "nn": True}],
        "plcs": plcs,
        "noise": _link_noise(link, bus, name_of),
        "faults": [
            {
                "at": format_time(outage.start),
                **({} if outage.end is None else {"for": format_time(max(1, outage.end - outage.start))}),
                "power_off": name_of[k.station],
            }
            for k in link.stations
            for outage in k.outages
            if k.station in name_of and outage.start < duration
        ],
    }


def put_link(scenario: Scenario, link: LinkEstimate, bus: str) -> dict[str, Any]:
    """A given scenario's data with what was measured of its link ``bus``.

    Its other keys stay, its faults too; noise of the link that is measured anew is replaced.
    Raises UsageError if it has no such link.
    """
    data: dict[str, Any] = copy.deepcopy(dict(scenario.source))
    attached = {
        plc.name: plc.registers.get(f"D{D_STATION}", 0)
        for plc in scenario.plcs
        if plc.link is not None and plc.link.bus == bus
    }
    if not attached:
        links = [each.name for each in scenario.buses if each.protocol is BusProtocol.NN]
        raise UsageError(
            f"scenario {scenario.name!r} has no PLCs on an N:N link {bus!r}; its links are "
            f"{', '.join(links) or 'none'} (--bus names one of the recording, which must be called alike)"
        )
    name_of = {number: name for name, number in reversed(attached.items())}
    for plc in data["plcs"]:
        number = attached.get(plc["name"])
        if number is None:
            continue
        old = plc.get("profile", "pw10")
        profile = dict(old) if isinstance(old, dict) else {"base": old}
        profile.setdefault("base", "pw10")
        new = _profile(link, number)
        new["measured"] = profile.get("measured", {}) | new.get("measured", {})
        plc["profile"] = profile | {key: value for key, value in new.items() if value}
        if number == 0 and link.settings_received and isinstance(plc.get("nn"), dict):
            plc["nn"] |= _settings(link)
    kept_noise = [
        each
        for each in data.get("noise", [])
        if each.get("bus") != bus or not ({"ber", "reply_loss"} & set(each))
    ]
    data["noise"] = kept_noise + _link_noise(link, bus, name_of)
    return data


def bus_scenario(found: BusEstimate, bus: str, *, name: str, duration: int, seed: int) -> dict[str, Any]:
    """A scenario of a Modbus bus in plain data: an HMI with the polls, and a register map a slave."""
    mode = "ascii" if found.protocol == "modbus-ascii" else "rtu"
    hmi: dict[str, Any] = {"name": "master", "model": "hmi", "bus": bus, "mode": mode}
    if found.timeout is not None:
        hmi["timeout"] = format_time(found.timeout)
    if found.interval is not None:
        hmi["interval"] = format_time(min(found.interval, _LONGEST_DELAY))
    hmi["polls"] = []
    held = [poll for poll in found.polls if _holds(poll)]
    for poll in held:
        entry: dict[str, Any] = {
            "station": poll.station,
            "function": poll.function,
            "address": poll.address,
            "count": poll.quantity,
            "retries": min(poll.retries, 100),
        }
        if poll.function in WRITES:
            entry["values"] = [0] * poll.quantity  # what was written may have changed each time
        if poll.every is not None and poll.periodic:
            entry["every"] = format_time(poll.every)
            entry["at"] = format_time(max(0, poll.first - found.begin))
        if poll.turns == 1:
            entry["times"] = 1
        hmi["polls"].append(entry)
    noise: list[dict[str, Any]] = []
    if found.ber is not None and found.ber.value:
        noise.append({"bus": bus, "ber": found.ber.value, "measured": found.recording})
    devices = [hmi] if hmi["polls"] else []
    for slave in found.slaves:
        if slave.station not in range(FIRST_STATION, LAST_STATION + 1):
            continue
        device: dict[str, Any] = {
            "name": f"station{slave.station}",
            "model": "map",
            "bus": bus,
            "station": slave.station,
            "mode": mode,
        }
        if slave.distribution is not None:
            device |= _delay(slave.distribution)
        # A station that is asked for nothing that a map has is there nevertheless.
        device |= _items(held, slave.station) or {"registers": [{"address": 0, "count": 1, "value": 0}]}
        devices.append(device)
        if slave.loss is not None and slave.loss.value and slave.delay is not None:
            loss = {"reply_loss": slave.loss.value, "measured": found.recording}
            noise.append({"bus": bus, "station": device["name"], **loss})
    return {
        "schema": 1,
        "name": name,
        "duration": format_time(duration),
        "seed": seed,
        "buses": [{"name": bus, "baud": found.baud, "format": found.format}],
        "plcs": [{"name": "idle"}],  # a scenario needs one
        "devices": devices,
        "noise": noise,
    }


def _delay(distribution: TurnaroundDistribution) -> dict[str, str]:
    """A device waits ``delay`` and up to ``jitter`` more."""
    least = max(0, distribution.mean - distribution.jitter)
    return {
        "delay": format_time(min(least, _LONGEST_DELAY)),
        "jitter": format_time(min(2 * distribution.jitter, _LONGEST_DELAY)),
    }


def _holds(poll: PollEstimate) -> bool:
    """Whether a scenario can have a poll: its function, and its station."""
    return poll.function in SPACES and poll.station <= LAST_STATION


def _items(polls: Sequence[PollEstimate], station: int) -> dict[str, list[dict[str, Any]]]:
    """The items that a station was asked for, without gaps between those that overlap."""
    items: dict[str, list[dict[str, Any]]] = {}
    for space, key in _SPACE_KEYS.items():
        asked = sorted(
            (poll.address, poll.address + poll.quantity)
            for poll in polls
            if poll.station == station and SPACES[poll.function] is space and poll.quantity
        )
        merged: list[list[int]] = []
        for start, end in asked:
            if merged and start <= merged[-1][1]:
                merged[-1][1] = max(end, merged[-1][1])
            else:
                merged.append([start, end])
        if merged:
            writable = {"writable": True} if space in (Space.COILS, Space.HOLDING) else {}
            items[key] = [
                {"address": start, "count": end - start, "value": 0, **writable} for start, end in merged
            ]
    return items


def _settings(link: LinkEstimate) -> dict[str, int | str]:
    slaves, mode, retries, timeout = link.settings
    return {"slaves": slaves, "mode": mode, "retries": retries, "timeout": f"{timeout * 10} ms"}


def _profile(link: LinkEstimate, number: int) -> dict[str, Any]:
    """What was measured of a station, as keys of its profile, and where."""
    found = _fields(link, number)
    return found | ({"measured": dict.fromkeys(found, link.recording)} if found else {})


def _fields(link: LinkEstimate, number: int) -> dict[str, Any]:
    if number == 0:
        times = {"master_gap": link.master_gap, "scan_overhead": link.scan_overhead}
        return {
            key: format_time(max(0, round(found.value))) for key, found in times.items() if found is not None
        }
    distribution = next((each.distribution for each in link.stations if each.station == number), None)
    if distribution is None:
        return {}
    if distribution.values:
        counts = Counter(distribution.values)
        values = [format_time(value) for value in counts]
        return {"turnaround": {"values": values, "weights": list(counts.values())}}
    mean, jitter = distribution.mean, min(distribution.jitter, distribution.mean)
    return {"turnaround": {"mean": format_time(mean), "jitter": format_time(jitter)}}


def _link_noise(link: LinkEstimate, bus: str, name_of: dict[int, str]) -> list[dict[str, Any]]:
    noise, where = list[dict[str, Any]](), link.recording
    if link.ber is not None and link.ber.value:
        noise.append({"bus": bus, "ber": link.ber.value, "measured": link.recording})
    noise += [
        {"bus": bus, "station": name_of[found.station], "reply_loss": found.loss.value, "measured": where}
        for found in link.stations
        if found.loss is not None and found.loss.value and found.station in name_of
    ]
    return noise
