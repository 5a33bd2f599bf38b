"""Random scenarios of ports with fixed seeds in which one thing is wrong."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any, NamedTuple

Data = dict[str, Any]


class Case(NamedTuple):
    """A scenario with one thing wrong.

    ``key`` is the sentence that must name the cause, ``values`` what it must say of it; ``others`` are
    sentences about what follows from it.
    """

    scenario: Data
    key: str
    values: Data
    others: frozenset[str] = frozenset()


def modbus(draw: random.Random, delay: int = 5, **port: Any) -> Data:
    """A healthy Modbus bus: a PLC polls two registers of a drive."""
    settings = {
        "bus": "drives",
        "protocol": "modbus-rtu-master",
        "timeout": "100 ms",
        "interval": "5 ms",
        **port,
    }
    polls = [
        {"name": name, "port": "COM3", "station": 1, "function": 3, "address": address, "count": 2, "to": to}
        for name, address, to in (("vfd_status", 0, "D400"), ("vfd_speed", 8, "D410"))
    ]
    drive = {
        "name": "drive",
        "model": "map",
        "bus": "drives",
        "station": 1,
        "delay": f"{delay} ms",
        "registers": [{"address": 0, "count": 16, "value": 7}],
    }
    return {
        "schema": 1,
        "name": "a drive",
        "duration": "10 s",
        "seed": draw.randint(1, 10_000),
        "buses": [{"name": "drives", "baud": draw.choice((9600, 19200, 38400)), "format": "8N1"}],
        "plcs": [
            {
                "name": "press",
                "scan": f"{draw.randint(2, 15)} ms",
                "ports": {"COM3": settings},
                "polls": polls,
            }
        ],
        "devices": [drive],
    }


def mistaken_responses(draw: random.Random) -> Case:
    bus = modbus(draw, delay=60, timeout="40 ms")
    bus["buses"][0]["baud"] = 38400
    return Case(bus, "mistaken", {"node": "press.COM3"}, frozenset({"no_own_data", "late", "request_silent"}))


def late_responses(draw: random.Random) -> Case:
    bus = modbus(draw, delay=draw.randint(90, 120), timeout="60 ms", interval="200 ms")
    return Case(
        bus, "late", {"node": "press.COM3", "timeout_ms": 60}, frozenset({"no_own_data", "request_silent"})
    )


def two_modbus_masters(draw: random.Random) -> Case:
    bus = modbus(draw)
    other = {**bus["plcs"][0], "name": "packer", "scan": "3 ms"}
    bus["plcs"].append(other)
    others = frozenset(
        {
            "mistaken",
            "damaged_responses",
            "requests_ignored",
            "no_response",
            "late",
            "undetected",
            "no_own_data",
        }
    )
    return Case(bus, "two_masters", {"masters": ["press.COM3", "packer.COM3"]}, others)


def dead_device(draw: random.Random) -> Case:
    bus = modbus(draw)
    bus["faults"] = [{"at": "3 s", "for": "3 s", "power_off": "drive"}]
    return Case(
        bus,
        "no_response",
        {"node": "press.COM3", "polls": ["vfd_status", "vfd_speed"]},
        frozenset({"damaged_responses", "not_running"}),
    )


def wrong_format_of_a_device(draw: random.Random) -> Case:
    bus = modbus(draw)
    bus["faults"] = [{"at": "3 s", "for": "3 s", "wrong_format": {"station": "drive", "format": "8E1"}}]
    return Case(
        bus, "request_garbled", {"peer": "drive"}, frozenset({"damaged_responses", "requests_ignored"})
    )


def dead_modbus_master(draw: random.Random) -> Case:
    bus = modbus(draw)
    what = draw.choice(("power_off", "stop"))
    bus["faults"] = [{"at": "3 s", "for": "3 s", what: "press"}]
    others = frozenset({"requests_ignored", "damaged_responses"})
    return Case(bus, "not_running", {"plc": "press"}, others)


def modbus_master_dead_to_the_end(draw: random.Random) -> Case:
    bus = modbus(draw)
    bus["faults"] = [{"at": "3 s", "power_off": "press"}]
    others = frozenset({"requests_ignored", "damaged_responses"})
    return Case(bus, "still_not_running", {"plc": "press"}, others)


def wrong_address(draw: random.Random) -> Case:
    bus = modbus(draw)
    bus["plcs"][0]["polls"][1]["address"] = 0x1000
    return Case(bus, "exceptions", {"node": "press.COM3"})


def wrong_addresses_alone(draw: random.Random) -> Case:
    bus = modbus(draw)
    for poll in bus["plcs"][0]["polls"]:
        poll["address"] = 0x1000
    return Case(bus, "no_own_data", {"node": "press.COM3"}, frozenset({"exceptions"}))


def cut_to_a_device(draw: random.Random) -> Case:
    bus = modbus(draw)
    bus["faults"] = [{"at": "3 s", "for": "3 s", "cable_cut": {"bus": "drives", "after": "press.COM3"}}]
    return Case(bus, "request_deaf", {"node": "press.COM3", "peer": "drive"})


def device_without_replies(draw: random.Random) -> Case:
    bus = modbus(draw)
    bus["faults"] = [{"at": "3 s", "for": "3 s", "drop_reply": "drive"}]
    return Case(bus, "request_silent", {"node": "press.COM3", "peer": "drive"})


def replies_that_lose_a_character(draw: random.Random) -> Case:
    bus = modbus(draw)
    bus["faults"] = [{"at": "3 s", "for": "3 s", "lose_char": {"station": "drive"}}]
    return Case(bus, "request_reply_damaged", {"peer": "drive"}, frozenset({"damaged_responses"}))


def device_that_is_missing(draw: random.Random) -> Case:
    bus = modbus(draw)
    bus["plcs"][0]["polls"][1]["station"] = 2
    return Case(bus, "request_missing", {"node": "press.COM3", "peer": "2"})


def two_devices_with_one_number(draw: random.Random) -> Case:
    bus = modbus(draw)
    bus["devices"].append({**bus["devices"][0], "name": "twin", "delay": "6 ms"})
    others = frozenset({"no_own_data", "requests_ignored", "damaged_responses"})
    return Case(bus, "same_number", {"plcs": ["drive", "twin"], "station": 1}, others)


def panel_that_begins_too_early(draw: random.Random) -> Case:
    """A slave has the other one's reply and its own request as one frame."""
    polls = [{"station": station, "function": 3, "address": 0, "count": 10} for station in (1, 2)]
    panel = {"name": "panel", "model": "hmi", "bus": "drives", "silence": "1 ms", "interval": "0 ms"}
    slaves = [
        {
            "name": f"cpu{station}",
            "scan": f"{draw.randint(3, 12)} ms",
            "ports": {"COM2": {"bus": "drives", "protocol": "modbus-rtu-slave", "station": station}},
        }
        for station in (1, 2)
    ]
    bus = modbus(draw) | {"plcs": slaves, "devices": [{**panel, "polls": polls}]}
    bus["buses"][0]["baud"] = 9600
    return Case(
        bus, "request_joined", {"node": "panel", "peer": "cpu2.COM2"}, frozenset({"requests_ignored"})
    )


def late_response_that_meets_a_request(draw: random.Random) -> Case:
    """A second device has a request and the first one's late reply as one frame."""
    bus = modbus(draw, delay=20, timeout="10 ms")
    bus["buses"][0]["baud"] = 19200
    bus["plcs"][0]["scan"] = "2 ms"
    bus["plcs"][0]["polls"][1]["station"] = 2
    bus["devices"].append({**bus["devices"][0], "name": "meter", "station": 2, "delay": "1 ms"})
    others = frozenset({"no_own_data", "late", "request_silent", "requests_ignored"})
    return Case(bus, "request_joined", {"peer": "meter"}, others)


def readers(draw: random.Random) -> Data:
    """Two barcode readers with a protocol of their own: one sends by itself, the other one replies."""
    port = {"protocol": "free", "end": "\r", "timeout": "200 ms", "eight_bit": True}
    return {
        "schema": 1,
        "name": "readers",
        "duration": "30 s",
        "seed": draw.randint(1, 10_000),
        "buses": [
            {"name": name, "baud": draw.choice((9600, 19200)), "format": "8N1"} for name in ("belt", "gate")
        ],
        "plcs": [
            {
                "name": "sorter",
                "scan": f"{draw.randint(2, 15)} ms",
                "ports": {"COM3": {"bus": "belt", **port}, "COM4": {"bus": "gate", "start": 2, **port}},
                "polls": [
                    {"name": "parcels", "port": "COM3", "to": "D300", "count": 20},
                    {
                        "name": "trigger",
                        "port": "COM4",
                        "send": "D340",
                        "text": "T",
                        "to": "D350",
                        "count": 16,
                        "every": "1 s",
                    },
                ],
            }
        ],
        "devices": [
            {
                "name": "reader1",
                "model": "free",
                "bus": "belt",
                "says": [{"text": "4006381333931\r", "at": "500 ms", "every": "700 ms", "jitter": "300 ms"}],
            },
            {
                "name": "reader2",
                "model": "free",
                "bus": "gate",
                "says": [{"reply_to": "\x02T\r", "text": "\x0212345678\r", "delay": "30 ms"}],
            },
        ],
    }


def cut_to_a_reader(draw: random.Random) -> Case:
    line = readers(draw)
    line["faults"] = [{"at": "8 s", "for": "9 s", "cable_cut": {"bus": "belt", "after": "sorter.COM3"}}]
    return Case(line, "message_deaf", {"node": "sorter.COM3", "peer": "reader1"})


def cut_to_a_reader_that_replies(draw: random.Random) -> Case:
    line = readers(draw)
    line["faults"] = [{"at": "8 s", "for": "9 s", "cable_cut": {"bus": "gate", "after": "sorter.COM4"}}]
    others = frozenset({"messages_ended"})
    return Case(line, "message_deaf", {"node": "reader2", "peer": "sorter.COM4"}, others)


def codes_that_lose_a_character(draw: random.Random) -> Case:
    line = readers(draw)
    fault = {"station": "reader1", "index": draw.randint(0, 12)}
    line["faults"] = [{"at": "8 s", "for": "9 s", "lose_char": fault}]
    return Case(line, "message_wrong", {"node": "sorter.COM3", "peer": "reader1"})


def codes_that_lose_their_end(draw: random.Random) -> Case:
    line = readers(draw)
    line["faults"] = [{"at": "8 s", "for": "9 s", "lose_char": {"station": "reader1", "index": 13}}]
    return Case(line, "message_damaged", {"node": "sorter.COM3", "peer": "reader1"})


def dead_reader(draw: random.Random) -> Case:
    line = readers(draw)
    line["faults"] = [{"at": "8 s", "for": "9 s", "power_off": "reader2"}]
    values = {"plc": "reader2", "state": "without_supply"}
    return Case(line, "not_running", values, frozenset({"messages_ended"}))


def reader_without_replies(draw: random.Random) -> Case:
    line = readers(draw)
    line["devices"][1]["says"][0]["delay"] = "400 ms"  # longer than the port waits
    others = frozenset({"message_not_ready"})
    return Case(line, "messages_ended", {"node": "sorter.COM4"}, others)


#: Those of why requests and messages fail.
PORT_CASES: tuple[Callable[[random.Random], Case], ...] = (
    cut_to_a_device,
    device_without_replies,
    replies_that_lose_a_character,
    device_that_is_missing,
    two_devices_with_one_number,
    panel_that_begins_too_early,
    late_response_that_meets_a_request,
    cut_to_a_reader,
    cut_to_a_reader_that_replies,
    codes_that_lose_a_character,
    codes_that_lose_their_end,
    dead_reader,
    reader_without_replies,
)
