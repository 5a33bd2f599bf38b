"""Random scenarios with fixed seeds in which one thing is wrong, or nothing."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

from .port_cases import (
    PORT_CASES,
    Case,
    Data,
    dead_device,
    dead_modbus_master,
    late_responses,
    mistaken_responses,
    modbus,
    modbus_master_dead_to_the_end,
    readers,
    two_modbus_masters,
    wrong_address,
    wrong_addresses_alone,
    wrong_format_of_a_device,
)

#: What is said of every station error and every request without a response, whatever its cause is; and what
#: stations show of the master's frames and of their ports besides.
SYMPTOMS = frozenset(
    {
        "station_error",
        "station_still_in_error",
        "undecided",
        "no_response",
        "master_damaged",
        "serial_error",
        "serial_error_on",
    }
)


def link(draw: random.Random, **changes: Any) -> Data:
    """A healthy N:N link of three to five PLCs."""
    slaves = draw.randint(2, 4)
    settings = {
        "slaves": slaves,
        "mode": draw.randint(0, 3),
        "retries": draw.randint(1, 4),
        "timeout": f"{draw.choice((50, 60, 80))} ms",
    }
    plcs = [
        {
            "name": f"plc{number}",
            "scan": f"{draw.randint(4, 20)} ms",
            "nn": {"bus": "link", "port": "COM4", "station": number},
        }
        for number in range(slaves + 1)
    ]
    plcs[0]["nn"] |= settings
    seed = draw.randint(1, 10_000)
    base = {
        "schema": 1,
        "name": "a line",
        "duration": "20 s",
        "seed": seed,
        "buses": [{"name": "link", "nn": True}],
    }
    return {**base, "plcs": plcs, **changes}


def _a_time(draw: random.Random, what: str, of: Any, **when: Any) -> list[Data]:
    """A fault that acts for a few seconds in the middle of a run."""
    return [{"at": f"{draw.randint(4, 8)} s", "for": f"{draw.randint(3, 6)} s", what: of, **when}]


def _slave(draw: random.Random, line: Data) -> str:
    return f"plc{draw.randint(1, len(line['plcs']) - 1)}"


def _of(name: str) -> str:
    return f"station {name[3:]} ({name})"


#: What follows where the master is not in RUN.
_MASTER_GONE = frozenset({"master_lost", "master_still_lost", "master_paused", "master_stopped", "no_scan"})
#: What follows where the master's frames do not reach slaves.
_NOT_HEARD = frozenset({"master_not_received", "cause_cut", "cause_format", "undetected"})


def dead_master(draw: random.Random) -> Case:
    line = link(draw)
    line["faults"] = _a_time(draw, "power_off", "plc0")
    others = frozenset({"not_running"})
    return Case(line, "master_lost", {"master": "plc0", "stations": _names(line)}, others)


def dead_master_to_the_end(draw: random.Random) -> Case:
    line = link(draw)
    line["faults"] = [{"at": "8 s", "power_off": "plc0"}]
    others = frozenset({"still_not_running"})
    return Case(line, "master_still_lost", {"master": "plc0", "stations": _names(line)}, others)


def dead_master_that_no_watchdog_finds(draw: random.Random) -> Case:
    line = link(draw)
    line["plcs"][0]["nn"]["timeout"] = "2250 ms"
    line["faults"] = [{"at": "16 s", "power_off": "plc0"}]
    return Case(line, "master_stopped", {"master": "plc0", "stations": []}, frozenset({"still_not_running"}))


def master_in_stop(draw: random.Random) -> Case:
    line = link(draw)
    line["faults"] = _a_time(draw, "stop", "plc0")
    return Case(line, "not_running", {"plc": "plc0"}, _MASTER_GONE)


def late_master(draw: random.Random) -> Case:
    line = link(draw, faults=[{"power_on": {"plc0": "4 s"}}])
    return Case(line, "not_running", {"plc": "plc0"}, _MASTER_GONE)


def master_dead_from_the_start(draw: random.Random) -> Case:
    line = link(draw, faults=[{"at": "0 s", "power_off": "plc0"}])
    return Case(line, "no_scan", {"master": "plc0"}, frozenset({"still_not_running"}))


def slave_then_master(draw: random.Random) -> Case:
    """The only slave dies, then the master before it has found that: no station shows anything."""
    line = link(draw)
    line["plcs"] = line["plcs"][:2]
    line["plcs"][0]["nn"] |= {"slaves": 1, "timeout": "2250 ms"}
    line["faults"] = [{"at": "7 s", "power_off": "plc1"}, {"at": "8 s", "power_off": "plc0"}]
    return Case(line, "still_not_running", {"plc": "plc1"}, _MASTER_GONE | {"still_not_running"})


def dead_slave(draw: random.Random) -> Case:
    line = link(draw)
    name = _slave(draw, line)
    line["faults"] = _a_time(draw, "power_off", name)
    return Case(line, "not_running", {"plc": name})


def dead_slave_to_the_end(draw: random.Random) -> Case:
    line = link(draw)
    name = _slave(draw, line)
    line["faults"] = [{"at": "9 s", "power_off": name}]
    return Case(line, "still_not_running", {"plc": name})


def slave_that_dies_last(draw: random.Random) -> Case:
    line = link(draw)
    name = _slave(draw, line)
    line["plcs"][0]["nn"] |= {"retries": 10, "timeout": "80 ms"}
    line["faults"] = [{"at": "19700 ms", "power_off": name}]
    return Case(line, "still_not_running", {"plc": name})


def slave_in_stop(draw: random.Random) -> Case:
    line = link(draw)
    name = _slave(draw, line)
    line["faults"] = _a_time(draw, "stop", name)
    return Case(line, "not_running", {"plc": name})


def slave_without_replies(draw: random.Random) -> Case:
    line = link(draw)
    name = _slave(draw, line)
    line["faults"] = _a_time(draw, "drop_reply", name)
    return Case(line, "cause_no_reply", {"station": _of(name)})


def slave_without_replies_from_the_start(draw: random.Random) -> Case:
    line = link(draw)
    name = _slave(draw, line)
    line["faults"] = [{"at": "0 s", "drop_reply": name}]
    return Case(line, "cause_no_reply", {"station": _of(name)})


def slow_slave(draw: random.Random) -> Case:
    line = link(draw)
    name = _slave(draw, line)
    line["plcs"][0]["nn"]["retries"] = 0
    line["faults"] = _a_time(draw, "slow", {"station": name, "extra": "85 ms"})
    return Case(line, "late_replies", {"node": name})


def slow_slave_made_good(draw: random.Random) -> Case:
    line = link(draw)
    name = _slave(draw, line)
    line["plcs"][0]["nn"] |= {"retries": 4, "timeout": "50 ms"}
    line["faults"] = _a_time(draw, "slow", {"station": name, "extra": "60 ms"})
    return Case(line, "late_replies", {"node": name})


def pause_in_replies(draw: random.Random) -> Case:
    line = link(draw)
    name = _slave(draw, line)
    line["faults"] = _a_time(draw, "pause", {"station": name, "by": f"{draw.choice((3, 60))} ms"})
    return Case(line, "pauses", {"node": name}, frozenset({"master_not_received"}))


def pause_in_the_masters_frames(draw: random.Random) -> Case:
    line = link(draw)
    line["faults"] = [{"at": "5 s", "pause": {"station": "plc0", "by": "3 ms"}}]
    return Case(line, "pauses", {"node": "plc0"}, _NOT_HEARD)


def master_with_another_format(draw: random.Random) -> Case:
    line = link(draw)
    line["faults"] = _a_time(draw, "wrong_format", {"station": "plc0", "format": "7O1"})
    return Case(line, "other_rate", {"node": "plc0"}, _NOT_HEARD)


def master_whose_clock_is_off(draw: random.Random) -> Case:
    line = link(draw)
    line["faults"] = [{"at": "0 s", "clock_ppm": {"station": "plc0", "ppm": 90_000}}]
    return Case(line, "other_rate", {"node": "plc0"}, _NOT_HEARD)


def jabbering_master(draw: random.Random) -> Case:
    line = link(draw)
    line["faults"] = [{"at": "9 s", "jabber": "plc0"}]
    return Case(line, "no_frame", {"node": "plc0"}, _NOT_HEARD)


def noise_at_the_masters_driver(draw: random.Random) -> Case:
    line = link(draw)
    line["plcs"][0]["nn"]["retries"] = 1
    line["noise"] = [{"bus": "link", "station": "plc0", "direction": "tx", "ber": 0.03, "at": "5 s"}]
    return Case(line, "cause_master", {"master": "plc0"}, _NOT_HEARD)


def noise_at_a_slaves_receiver(draw: random.Random) -> Case:
    line = link(draw)
    noise = {"bus": "link", "station": "plc1", "direction": "rx", "ber": 0.001, "at": "5 s"}
    line["noise"] = [noise]
    others = frozenset({"master_not_received", "undetected", "cause_no_reply", "cause_format", "cause_noisy"})
    return Case(line, "master_damaged", {"master": "plc0"}, others)


def noise_at_the_masters_receiver(draw: random.Random) -> Case:
    line = link(draw)
    line["noise"] = [{"bus": "link", "station": "plc0", "direction": "rx", "ber": 0.03, "at": "5 s"}]
    return Case(line, "cause_receiver", {"master": "plc0"}, frozenset({"undetected"}))


def clock_of_a_slave(draw: random.Random) -> Case:
    line = link(draw)
    name = _slave(draw, line)
    line["faults"] = _a_time(draw, "clock_ppm", {"station": name, "ppm": 90_000})
    return Case(line, "cause_format", {"station": _of(name)}, frozenset({"master_not_received"}))


def board_error(draw: random.Random) -> Case:
    line = link(draw)
    name = _slave(draw, line)
    line["faults"] = [{"at": "5 s", "for": "4 s", "board_error": {"plc": name, "port": "COM4", "code": 41}}]
    return Case(line, "serial_error", {"plc": name, "code": 7441})


def two_masters(draw: random.Random) -> Case:
    line = link(draw)
    line["plcs"].append({"name": "other", "scan": "7 ms", "nn": {**line["plcs"][0]["nn"]}})
    others = frozenset({"master_not_received", "undetected"})
    return Case(line, "two_masters", {"masters": ["plc0", "other"]}, others)


def same_number(draw: random.Random) -> Case:
    line = link(draw)
    line["plcs"].append(
        {"name": "other", "scan": "7 ms", "nn": {"bus": "link", "port": "COM4", "station": 1}}
    )
    return Case(line, "same_number", {"plcs": ["plc1", "other"], "station": 1})


def number_not_polled(draw: random.Random) -> Case:
    line = link(draw)
    line["plcs"].append({"name": "last", "scan": "7 ms", "nn": {"bus": "link", "port": "COM4", "station": 6}})
    return Case(line, "not_polled", {"plc": "last", "station": 6})


def bad_parameter_of_the_master(draw: random.Random) -> Case:
    line = link(draw)
    _by_registers(line["plcs"][0], D8176=0, D8177=draw.choice((0, 9)))
    return Case(line, "settings_refused", {"plc": "plc0", "code": 7448}, frozenset({"no_master"}))


def bad_parameter_of_a_slave(draw: random.Random) -> Case:
    line = link(draw)
    _by_registers(line["plcs"][1], D8176=9)
    return Case(line, "settings_refused", {"plc": "plc1", "code": 7448}, frozenset({"cause_missing"}))


def wrong_format(draw: random.Random) -> Case:
    line = link(draw)
    name = _slave(draw, line)
    line["faults"] = _a_time(draw, "wrong_format", {"station": name, "format": "7O1"})
    return Case(line, "cause_format", {"station": _of(name)}, frozenset({"master_not_received"}))


def cable_cut(draw: random.Random) -> Case:
    line = link(draw)
    last = line["plcs"][-1]["name"]
    line["faults"] = _a_time(draw, "cable_cut", {"bus": "link", "after": line["plcs"][-2]["name"]})
    return Case(line, "cause_cut", {"station": _of(last)}, frozenset({"master_not_received"}))


def cable_cut_from_the_start(draw: random.Random) -> Case:
    line = link(draw)
    last = line["plcs"][-1]["name"]
    line["faults"] = [{"at": "0 s", "cable_cut": {"bus": "link", "after": line["plcs"][-2]["name"]}}]
    return Case(line, "cause_cut", {"station": _of(last)})


def late_release(draw: random.Random) -> Case:
    line = link(draw)
    name = f"plc{draw.randint(1, len(line['plcs']) - 2)}"  # after the last one's frame the bus is idle for longer
    line["faults"] = _a_time(draw, "late_release", {"station": name, "by": "2 ms"})
    others = frozenset({"master_not_received", "undetected"})
    return Case(line, "late_release", {"node": name}, others)


def jabber(draw: random.Random) -> Case:
    line = link(draw)
    name = _slave(draw, line)
    line["faults"] = _a_time(draw, "jabber", name)
    others = frozenset({"master_not_received", "undetected"})
    return Case(line, "no_frame", {"node": name}, others)


def damaged_replies(draw: random.Random) -> Case:
    line = link(draw)
    name = _slave(draw, line)
    line["noise"] = [
        {"bus": "link", "station": name, "direction": "tx", "ber": 0.01, "at": "5 s", "for": "8 s"}
    ]
    return Case(line, "cause_damaged", {"station": _of(name)}, frozenset({"undetected"}))


def _by_registers(plc: Data, **registers: int) -> None:
    """Set a PLC's link by raw registers, which may be bad."""
    del plc["nn"]
    plc["registers"] = {"M8179": 1, **registers}
    plc["ports"] = {"COM4": {"bus": "link"}}


def _names(line: Data) -> list[str]:
    return [plc["name"] for plc in line["plcs"][1:]]


ONE_THING_WRONG: tuple[Callable[[random.Random], Case], ...] = (
    dead_master,
    dead_master_to_the_end,
    dead_master_that_no_watchdog_finds,
    master_in_stop,
    late_master,
    master_dead_from_the_start,
    slave_then_master,
    dead_slave,
    dead_slave_to_the_end,
    slave_that_dies_last,
    slave_in_stop,
    slave_without_replies,
    slave_without_replies_from_the_start,
    slow_slave,
    slow_slave_made_good,
    pause_in_replies,
    pause_in_the_masters_frames,
    master_with_another_format,
    master_whose_clock_is_off,
    jabbering_master,
    noise_at_the_masters_driver,
    noise_at_the_masters_receiver,
    clock_of_a_slave,
    board_error,
    two_masters,
    same_number,
    number_not_polled,
    bad_parameter_of_the_master,
    bad_parameter_of_a_slave,
    wrong_format,
    cable_cut,
    cable_cut_from_the_start,
    late_release,
    jabber,
    damaged_replies,
    mistaken_responses,
    late_responses,
    two_modbus_masters,
    dead_device,
    wrong_format_of_a_device,
    dead_modbus_master,
    modbus_master_dead_to_the_end,
    wrong_address,
    wrong_addresses_alone,
    noise_at_a_slaves_receiver,
    *PORT_CASES,
)


def healthy(seed: int) -> Data:
    """A scenario in which nothing is wrong: a link, a Modbus bus, or readers with a protocol of their own."""
    draw = random.Random(seed)
    if seed % 4 == 3:
        return readers(draw)
    if seed % 3 == 2:
        return modbus(draw, delay=draw.randint(1, 40))
    line = link(draw)
    line["plcs"][0]["nn"]["retries"] = 4
    return line
