"""Scenarios made of estimates: a new one, or a given one with what was measured put in."""

from __future__ import annotations

import copy
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from bussim.engines.modbus.adu import FIRST_STATION, LAST_STATION
from bussim.engines.modbus.pdu import WRITES
from bussim.engines.modbus.server import SPACES, Space
from bussim.errors import UsageError
from bussim.live.fit.link import LinkEstimate
from bussim.live.fit.modbus import BusEstimate
from bussim.live.fit.noise import MASTER, NoiseEstimate
from bussim.live.fit.outages import Losses
from bussim.live.fit.polls import PollEstimate
from bussim.live.fit.statistics import Estimate
from bussim.live.fit.turnaround import TurnaroundDistribution
from bussim.plc.link_registers import D_STATION
from bussim.plc.ports.cpavl import DEFAULT_INTERVAL
from bussim.plc.profiles import PROFILES
from bussim.scenario.schema.document import MAX_POLLS
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
        "noise": _noise(link.noise, bus, name_of, _lost(link), link.recording),
        "faults": [
            fault
            for each in link.stations
            if each.station in name_of
            for fault in _outages(each.losses, name_of[each.station], duration)
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
        raise UsageError(
            f"scenario {scenario.name!r} has no PLCs on an N:N link {bus!r}; its links are "
            f"{', '.join(scenario.links) or 'none'} "
            "(--bus names one of the recording, which must be called alike)"
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
        if each.get("bus") != bus or not ({"ber", "burst", "reply_loss"} & set(each))
    ]
    data["noise"] = kept_noise + _noise(link.noise, bus, name_of, _lost(link), link.recording)
    return data


def bus_scenario(found: BusEstimate, bus: str, *, name: str, duration: int, seed: int) -> dict[str, Any]:
    """A scenario of a Modbus bus in plain data: an HMI with the polls, and a register map a slave."""
    mode = "ascii" if found.protocol == "modbus-ascii" else "rtu"
    hmi: dict[str, Any] = {"name": "master", "model": "hmi", "bus": bus, "mode": mode}
    interval = DEFAULT_INTERVAL
    if found.interval is not None:
        silence = 0 if mode == "ascii" else found.silence
        interval = min(DEFAULT_INTERVAL, max(0, found.interval - silence))
        hmi["interval"] = format_time(interval)
    if found.timeout is not None:
        # A master keeps its pause behind a missing reply, too: the wait is both.
        hmi["timeout"] = format_time(max(found.silence, found.timeout - interval))
    hmi["polls"] = []
    left = left_out(found.polls)
    held = [poll for poll in found.polls if poll not in left]
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
        if poll.every is not None:
            entry["every"] = format_time(poll.every)
            entry["at"] = format_time(max(0, poll.first - found.begin))
        hmi["polls"].append(entry)
    devices = [hmi] if hmi["polls"] else []
    slaves = [each for each in found.slaves if FIRST_STATION <= each.station <= LAST_STATION]
    for slave in slaves:
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
    names = {slave.station: f"station{slave.station}" for slave in slaves} | {MASTER: "master"}
    loss = {slave.station: slave.losses for slave in slaves if slave.delay is not None}
    return {
        "schema": 1,
        "name": name,
        "duration": format_time(duration),
        "seed": seed,
        "buses": [{"name": bus, "baud": found.baud, "format": found.format}],
        "plcs": [{"name": "idle"}],  # a scenario needs one
        "devices": devices,
        "noise": _noise(found.noise, bus, names, loss, found.recording),
        "faults": [
            fault for station, losses in loss.items() for fault in _outages(losses, names[station], duration)
        ],
    }


def _delay(distribution: TurnaroundDistribution) -> dict[str, str]:
    """A device waits ``delay`` and up to ``jitter`` more."""
    least = max(0, distribution.mean - distribution.jitter)
    return {
        "delay": format_time(min(least, _LONGEST_DELAY)),
        "jitter": format_time(min(2 * distribution.jitter, _LONGEST_DELAY)),
    }


def left_out(polls: Sequence[PollEstimate]) -> dict[PollEstimate, str]:
    """The polls that a scenario cannot have, and why; beyond their number, those that come least often."""
    found = {poll: reason for poll in polls if (reason := _unsendable(poll)) is not None}
    rest = sorted((poll for poll in polls if poll not in found), key=lambda poll: -poll.turns)
    return found | dict.fromkeys(rest[MAX_POLLS:], f"a scenario's master has at most {MAX_POLLS} polls")


def _unsendable(poll: PollEstimate) -> str | None:
    if poll.function not in SPACES:
        return f"a scenario's master does not send function {poll.function}"
    if not FIRST_STATION <= poll.station <= LAST_STATION and (poll.station or poll.function not in WRITES):
        return f"station {poll.station} is none that may be asked"
    return None


def _outages(losses: Losses, name: str, duration: int) -> Iterator[dict[str, Any]]:
    """Faults that switch a station off while it did not reply."""
    for outage in losses.outages:
        if outage.start < duration:
            lasts = {} if outage.end is None else {"for": format_time(max(1, outage.end - outage.start))}
            yield {"at": format_time(outage.start), **lasts, "power_off": name}


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


def _lost(link: LinkEstimate) -> dict[int, Losses]:
    return {each.station: each.losses for each in link.stations}


def _noise(
    found: NoiseEstimate, bus: str, name_of: Mapping[int, str], lost: Mapping[int, Losses], where: str
) -> list[dict[str, Any]]:
    """Entries of noise: on the whole line, or of each sender's frames where they differ; lost replies.

    What only the master's receiver has is noise of it. A reply of which it heard nothing is as one that was
    not sent: it waits as long.
    """
    noise = list[dict[str, Any]]()

    def add(rate: Estimate | None, key: str, **more: Any) -> None:
        if rate is not None and rate.value:
            noise.append({"bus": bus, **more, key: rate.value, "measured": where})

    states, master = found.bursts.states, found.master_receiver
    if states is not None:
        times = {"good": states.good, "bad": states.bad}
        burst: dict[str, Any] = {key: format_time(max(1, round(each.value))) for key, each in times.items()}
        burst |= {"ber_good": states.ber_good.value, "ber_bad": states.ber_bad.value}
        noise.append({"bus": bus, "burst": burst, "measured": where})
    elif found.senders:
        for sender, rate in found.senders.items():
            if sender in name_of:
                add(rate, "ber", station=name_of[sender], direction="tx")
    else:
        add(found.ber, "ber")
    add(master.ber, "ber", station=name_of[MASTER], direction="rx")
    add(master.unheard, "reply_loss")
    for station, each in lost.items():
        if station in name_of:
            add(each.loss, "reply_loss", station=name_of[station])
    return noise
