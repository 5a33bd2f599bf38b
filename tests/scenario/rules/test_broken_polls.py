"""Polls, Modbus and free: each mistake with its place and its message."""

from __future__ import annotations

import pytest

from tests.scenario.port_samples import FREE_POLL, POLL, changed
from tests.scenario.samples import mistakes

CASES: dict[str, tuple[str, list[str]]] = {
    "function": (
        changed((POLL, "{port: COM3, station: 1, function: 7, address: 0, to: D400}")),
        ["x.yaml:16:44: polls.0.function is 7, allowed 1, 2, 3, 4, 5, 6, 15 (0x0F), 16 (0x10)"],
    ),
    "function10": (
        changed((POLL, "{port: COM3, station: 1, function: 10, address: 0, to: D400}")),
        [
            "x.yaml:16:44: polls.0.function is 10, allowed 1, 2, 3, 4, 5, 6, 15 (0x0F), 16 (0x10); did you mean 0x10?"
        ],
    ),
    "126": (
        changed((POLL, "{port: COM3, station: 1, function: 3, address: 0, count: 126, to: D400}")),
        ["x.yaml:16:66: polls.0.count is 126, allowed 1..125 (function 3)"],
    ),
    "0": (
        changed((POLL, "{port: COM3, station: 1, function: 3, address: 0, count: 0, to: D400}")),
        ["x.yaml:16:66: polls.0.count is 0, allowed 1..125 (function 3)"],
    ),
    "2001": (
        changed((POLL, "{port: COM3, station: 1, function: 1, address: 0, count: 2001, to: M0}")),
        ["x.yaml:16:66: polls.0.count is 2001, allowed 1..2000 (function 1)"],
    ),
    "06 2": (
        changed((POLL, "{port: COM3, station: 1, function: 6, address: 0, count: 2, from: D0}")),
        ["x.yaml:16:66: polls.0.count is 2, allowed 1 (function 6)"],
    ),
    "values": (
        changed((POLL, "{port: COM3, station: 1, function: 0x10, address: 0, count: 3, values: [1, 2]}")),
        ["x.yaml:16:80: polls.0.values has 2 entries, count is 3"],
    ),
    "values6": (
        changed((POLL, "{port: COM3, station: 1, function: 6, address: 0, values: [1, 2]}")),
        ["x.yaml:16:67: polls.0.values has 2 entries, allowed 1 (function 6)"],
    ),
    "values5": (
        changed((POLL, "{port: COM3, station: 1, function: 5, address: 0, values: [5]}")),
        ["x.yaml:16:67: polls.0.values has 5, allowed 0, 1 (coils)"],
    ),
    "values read": (
        changed((POLL, "{port: COM3, station: 1, function: 3, address: 0, values: [5], to: D0, from: D7}")),
        [
            "x.yaml:16:59: polls.0.values has no meaning for function 3, which reads",
            "x.yaml:16:80: polls.0.from has no meaning for function 3, which reads",
        ],
    ),
    "nothing": (
        changed((POLL, "{port: COM3, station: 1, function: 6, address: 0}")),
        ["x.yaml:16:9: polls.0 writes nothing; expected from or values (function 6)"],
    ),
    "end": (
        changed((POLL, "{port: COM3, station: 1, function: 3, address: 65530, count: 10, to: D0}")),
        ["x.yaml:16:56: polls.0.address is 65530, whose 10 items end at 65539, beyond 65535"],
    ),
    "address": (
        changed((POLL, "{port: COM3, station: 1, function: 3, address: 65536, count: 10, to: D0}")),
        ["x.yaml:16:56: polls.0.address is 65536, allowed 0..65535"],
    ),
    "broadcast": (
        changed((POLL, "{port: COM3, station: 0, function: 3, address: 0, count: 10, to: D0}")),
        ["x.yaml:16:31: polls.0.station is 0, a broadcast, to which no station responds; function 3 reads"],
    ),
    "missing": (
        changed((POLL, "{port: COM3}")),
        [
            "x.yaml:16:9: polls.0.address is missing",
            "x.yaml:16:9: polls.0.function is missing",
            "x.yaml:16:9: polls.0.station is missing",
        ],
    ),
    "no to": (
        changed((POLL, "{port: COM3, station: 1, function: 3, address: 0}")),
        ["x.yaml:16:9: polls.0.to is missing"],
    ),
    "com4": (
        changed((POLL, "{port: COM4, station: 1, function: 3, address: 0, to: D0}")),
        [
            "x.yaml:16:16: polls.0.port is COM4, which runs N:N: only a Modbus master or a free port polls; did you mean COM5?"
        ],
    ),
    "com6": (
        changed((POLL, "{port: COM6, station: 1, function: 3, address: 0, to: D0}")),
        [
            "x.yaml:16:16: polls.0.port is COM6, which is not in ports: only a Modbus master or a free port polls; did you mean COM5?"
        ],
    ),
    "com9": (
        changed((POLL, "{port: COM9, station: 1, function: 3, address: 0, to: D0}")),
        ["x.yaml:16:16: polls.0.port is 'COM9', allowed COM2, COM3, COM4, COM5, COM6; did you mean COM6?"],
    ),
    "unknown key": (
        changed((POLL, "{port: COM3, station: 1, function: 3, adress: 0, to: D0}")),
        [
            "x.yaml:16:9: polls.0.address is missing",
            "x.yaml:16:47: polls.0.adress is not a key here; did you mean address?",
        ],
    ),
    "span": (
        changed((POLL, "{port: COM3, station: 1, function: 3, address: 0, count: 20, to: D8240}")),
        ["x.yaml:16:74: polls.0.to is D8240; its 20 registers would end beyond D8255"],
    ),
    "span2": (
        changed((POLL, "{port: COM3, station: 2, function: 1, address: 0, count: 200, to: M3000}")),
        ["x.yaml:16:75: polls.0.to is M3000; its 200 coils would end beyond M3071"],
    ),
    "letter": (
        changed((POLL, "{port: COM3, station: 1, function: 3, address: 0, to: M0}")),
        ["x.yaml:16:63: polls.0.to is M0, but function 3 moves registers: D only"],
    ),
    "letter2": (
        changed((POLL, "{port: COM3, station: 1, function: 1, address: 0, to: X0}")),
        ["x.yaml:16:63: polls.0.to is X0, allowed for coils are D, M, S, Y (function 1)"],
    ),
    "device": (
        changed((POLL, "{port: COM3, station: 1, function: 3, address: 0, to: D9999}")),
        ["x.yaml:16:63: polls.0.to is 'D9999', allowed D0–D8511"],
    ),
    "free keys": (
        changed((POLL, "{port: COM3, station: 1, function: 3, address: 0, to: D400, send: D5, text: a}")),
        [
            "x.yaml:16:69: polls.0.send has no meaning on COM3, whose protocol is modbus-rtu-master",
            "x.yaml:16:79: polls.0.text has no meaning on COM3, whose protocol is modbus-rtu-master",
        ],
    ),
    "name": (
        changed(
            (
                POLL,
                "{name: a, port: COM3, station: 1, function: 3, address: 0, to: D400}\n      - {name: A, port: COM3, station: 1, function: 3, address: 0, to: D400}",
            )
        ),
        ["x.yaml:17:16: polls.1.name is 'A', which differs only in case from 'a' (in line 16)"],
    ),
    "times": (
        changed(
            (
                POLL,
                "{port: COM3, station: 1, function: 3, address: 0, to: D400, times: 0, every: 5, retries: 101}",
            )
        ),
        [
            "x.yaml:16:76: polls.0.times is 0, allowed 1..1000000000",
            "x.yaml:16:86: polls.0.every is 5, a time without a unit; write one of ns, us, ms, s, min, h, d, y, such as 5 ms",
            "x.yaml:16:98: polls.0.retries is 101, allowed 0..100",
        ],
    ),
    "mapping": (
        changed((POLL, "5")),
        [
            "x.yaml:16:9: polls.0 is 5, expected {port: COM3, station: 1, function: 3, address: 0, count: 2, to: D400, every: 200 ms}"
        ],
    ),
    "null": (
        changed((POLL, "")),
        [
            "x.yaml:16:8: polls.0 is empty, expected {port: COM3, station: 1, function: 3, address: 0, count: 2, to: D400, every: 200 ms}"
        ],
    ),
    "polls mapping": (
        changed(
            (
                "    polls:\n      - {port: COM3, station: 1, function: 3, address: 0, count: 2, to: D400}\n      - {port: COM5, to: D300, count: 20}\n",
                "    polls: {}\n",
            )
        ),
        [
            "x.yaml:15:12: polls is a mapping, expected a list, each entry with a dash: - {station: 1, function: 3, address: 0, count: 2, every: 200 ms}"
        ],
    ),
    "poll on slave": (
        changed(
            (
                "nn: {bus: link, port: COM4, station: 1}",
                "nn: {bus: link, port: COM4, station: 1}\n    polls: [{port: COM3, station: 1, function: 3, address: 0, to: D0}]",
            )
        ),
        [
            "x.yaml:21:20: polls.0.port is COM3, which is modbus-rtu-slave: only a Modbus master or a free port polls"
        ],
    ),
    "modbus keys": (
        changed((FREE_POLL, "{port: COM5, station: 1, function: 3, to: D300, count: 20}")),
        [
            "x.yaml:17:22: polls.1.station has no meaning on COM5, whose protocol is free",
            "x.yaml:17:34: polls.1.function has no meaning on COM5, whose protocol is free",
        ],
    ),
    "free: nothing": (
        changed((FREE_POLL, "{port: COM5}")),
        ["x.yaml:17:9: polls.1 neither sends nor receives; expected send_count, data, text or count"],
    ),
    "both": (
        changed((FREE_POLL, '{port: COM5, send: D0, data: "01", text: "a"}')),
        ["x.yaml:17:50: polls.1.text excludes data in the same entry"],
    ),
    "no send": (
        changed((FREE_POLL, '{port: COM5, data: "01"}')),
        ["x.yaml:17:9: polls.1.send is missing, the first of the D registers that what is sent lies in"],
    ),
    "data": (
        changed((FREE_POLL, '{port: COM5, send: D300, data: "1"}')),
        ["x.yaml:17:40: polls.1.data is '1', expected bytes in hexadecimal such as \"02 41 0D\""],
    ),
    "text": (
        changed((FREE_POLL, '{port: COM5, send: D300, text: "€"}')),
        ["x.yaml:17:40: polls.1.text has the character '€', which is no byte; write it in hexadecimal"],
    ),
    "free: count": (
        changed((FREE_POLL, "{port: COM5, to: D300, count: 257}")),
        ["x.yaml:17:39: polls.1.count is 257, allowed 0..256 bytes"],
    ),
    "send_count": (
        changed((FREE_POLL, "{port: COM5, send: D300, text: abc, send_count: 2}")),
        ["x.yaml:17:57: polls.1.send_count is 2, fewer than the 3 bytes given"],
    ),
    "send M": (
        changed((FREE_POLL, "{port: COM5, send: M300, text: abc}")),
        ["x.yaml:17:28: polls.1.send is M300, but bytes lie in D registers"],
    ),
    "free: span": (
        changed((FREE_POLL, "{port: COM5, to: D8200, count: 200}")),
        ["x.yaml:17:26: polls.1.to is D8200; its 200 bytes would end beyond D8255"],
    ),
    "span send": (
        changed((FREE_POLL, "{port: COM5, send: D8250, send_count: 20}")),
        ["x.yaml:17:28: polls.1.send is D8250; its 20 bytes would end beyond D8255"],
    ),
}


@pytest.mark.parametrize(("text", "expected"), CASES.values(), ids=CASES.keys())
def test_the_message_says_what_where_and_what_is_allowed(text: str, expected: list[str]) -> None:
    assert mistakes(text) == expected


def test_too_many_polls() -> None:
    text = changed((POLL, "\n      - ".join([POLL] * 201)))
    assert mistakes(text) == ["x.yaml:16:7: polls has 202 entries, allowed 0..200"]


def test_too_many_bytes() -> None:
    text = changed((FREE_POLL, f"{{port: COM5, send: D300, text: {'x' * 257}}}"))
    assert mistakes(text) == ["x.yaml:17:40: polls.1.text has 257 bytes, allowed 1..256"]
