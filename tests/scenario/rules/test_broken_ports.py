"""Ports of a PLC beside the link's: each mistake with its place and its message."""

from __future__ import annotations

import pytest

from tests.scenario.port_samples import FREE_PORT, MASTER, SLAVE, changed
from tests.scenario.samples import mistakes

CASES: dict[str, tuple[str, list[str]]] = {
    "com1": (
        changed((MASTER, "COM1: {bus: line, protocol: modbus-rtu-master}")),
        [
            "x.yaml:13:7: ports.COM1 serves programming and an HMI only: nothing can be set up on it; allowed are COM2, COM3, COM4, COM5, COM6",
            "x.yaml:16:16: polls.0.port is COM3, which is not in ports: only a Modbus master or a free port polls; did you mean COM5?",
        ],
    ),
    "com7": (
        changed((MASTER, "COM7: {bus: line, protocol: modbus-rtu-master}")),
        [
            "x.yaml:13:7: ports.COM7 is not a port; did you mean COM6?",
            "x.yaml:16:16: polls.0.port is COM3, which is not in ports: only a Modbus master or a free port polls; did you mean COM5?",
        ],
    ),
    "hmi on com3": (
        changed((MASTER, "COM3: {bus: line, protocol: hmi}")),
        [
            "x.yaml:13:35: ports.COM3.protocol is hmi, which only COM2 has; allowed modbus-rtu-slave, modbus-ascii-slave, free, modbus-rtu-master, modbus-ascii-master"
        ],
    ),
    "unknown protocol": (
        changed((MASTER, "COM3: {bus: line, protocol: modbus-rtu}")),
        [
            "x.yaml:13:35: ports.COM3.protocol is 'modbus-rtu', allowed hmi, modbus-rtu-slave, modbus-ascii-slave, free, modbus-rtu-master, modbus-ascii-master; did you mean modbus-rtu-slave?"
        ],
    ),
    "nnbus": (
        changed((MASTER, "COM3: {bus: link, protocol: modbus-rtu-master}")),
        [
            "x.yaml:13:35: ports.COM3.protocol is modbus-rtu-master, but link is an N:N link, on which nothing else can run"
        ],
    ),
    "com4": (
        changed((MASTER, "COM4: {bus: line, protocol: modbus-rtu-master}")),
        [
            "x.yaml:13:19: ports.COM4.bus is line, but nn.bus is link",
            "x.yaml:13:35: ports.COM4.protocol is modbus-rtu-master, but press1 runs N:N on COM4 (M8179 is 1), and a port does one thing",
            "x.yaml:16:16: polls.0.port is COM3, which is not in ports: only a Modbus master or a free port polls; did you mean COM5?",
        ],
    ),
    "com6 nn": (
        changed((MASTER, "COM6: {bus: link}")),
        [
            "x.yaml:13:19: ports.COM6.bus is link, an N:N link; M8179 cannot select COM6 (0: COM3, 1: COM4): N:N runs on COM3 or COM4",
            "x.yaml:16:16: polls.0.port is COM3, which is not in ports: only a Modbus master or a free port polls; did you mean COM5?",
        ],
    ),
    "timeout": (
        changed((MASTER, "COM3: {bus: line, protocol: modbus-rtu-master, timeout: 55 ms, interval: 150 us}")),
        [
            "x.yaml:13:63: ports.COM3.timeout is 55 ms, allowed are multiples of 10 ms, here 50 ms or 60 ms",
            "x.yaml:13:80: ports.COM3.interval is 150 us, allowed are multiples of 100 us, here 100 us or 200 us",
        ],
    ),
    "timeout0": (
        changed((MASTER, "COM3: {bus: line, protocol: modbus-rtu-master, timeout: 5 ms, interval: 7 s}")),
        [
            "x.yaml:13:63: ports.COM3.timeout is 5 ms, allowed 10 ms..655.35 s",
            "x.yaml:13:79: ports.COM3.interval is 7 s, allowed 0 s..6.5535 s",
        ],
    ),
    "keys": (
        changed(
            (MASTER, "COM3: {bus: line, protocol: modbus-rtu-master, station: 1, start: 2, eight_bit: true}")
        ),
        [
            "x.yaml:13:54: ports.COM3.station has no meaning for modbus-rtu-master, which has timeout, interval, baud, format",
            "x.yaml:13:66: ports.COM3.start has no meaning for modbus-rtu-master, which has timeout, interval, baud, format",
            "x.yaml:13:76: ports.COM3.eight_bit has no meaning for modbus-rtu-master, which has timeout, interval, baud, format",
        ],
    ),
    "7bits own": (
        changed((MASTER, "COM3: {bus: line, protocol: modbus-rtu-master, format: 7E1}")),
        ["x.yaml:13:62: ports.COM3.format is 7E1, but Modbus RTU needs 8 data bits"],
    ),
    "7bits bus": (
        changed((MASTER, "COM3: {bus: codes, protocol: modbus-rtu-master}")),
        [
            "x.yaml:13:36: ports.COM3.protocol is modbus-rtu-master, but the format of codes is 7E1: Modbus RTU needs 8 data bits"
        ],
    ),
    "noprotocol": (
        changed((MASTER, "COM3: {bus: line, timeout: 50 ms}")),
        [
            "x.yaml:13:34: ports.COM3.timeout needs a protocol; allowed on COM3: modbus-rtu-slave, modbus-ascii-slave, free, modbus-rtu-master, modbus-ascii-master",
            "x.yaml:16:16: polls.0.port is COM3, which has no protocol: only a Modbus master or a free port polls; did you mean COM5?",
        ],
    ),
    "bare": (
        changed((MASTER, "COM3: {bus: line}")),
        [
            "x.yaml:16:16: polls.0.port is COM3, which has no protocol: only a Modbus master or a free port polls; did you mean COM5?"
        ],
    ),
    "words": (
        changed((MASTER, "COM3: {bus: line, protocol: modbus-rtu-master, cpavl: {words: D7990, bits: X5}}")),
        [
            "x.yaml:13:69: ports.COM3.cpavl.words is D7990, the first of 20 words; allowed D0..D7980",
            "x.yaml:13:82: ports.COM3.cpavl.bits is X5, the first of 20 bits; allowed M0..M3052",
        ],
    ),
    "words type": (
        changed((MASTER, "COM3: {bus: line, protocol: modbus-rtu-master, cpavl: {words: D9990, bit: X5}}")),
        [
            "x.yaml:13:69: ports.COM3.cpavl.words is 'D9990', allowed D0–D8511",
            "x.yaml:13:76: ports.COM3.cpavl.bit is not a key here; allowed are words, bits; did you mean bits?",
        ],
    ),
    "words overlap": (
        changed((MASTER, "COM3: {bus: line, protocol: modbus-rtu-master, cpavl: {words: D7950}}")),
        [
            "x.yaml:14:13: ports.COM5.cpavl.words is D7960, the first of 20 words, which overlap those of COM3 (D7950 on)"
        ],
    ),
    "start": (
        changed((MASTER, "COM3: {bus: line, protocol: free, start: 256, end: ab}")),
        [
            'x.yaml:13:48: ports.COM3.start is 256, expected a character code 0..255 or one character such as "\\r"',
            "x.yaml:13:58: ports.COM3.end is 'ab', expected a character code 0..255 or one character such as \"\\r\"",
            "x.yaml:16:22: polls.0.station has no meaning on COM3, whose protocol is free",
            "x.yaml:16:34: polls.0.function has no meaning on COM3, whose protocol is free",
            "x.yaml:16:47: polls.0.address has no meaning on COM3, whose protocol is free",
        ],
    ),
    "no station": (changed((", station: 2", "")), ["x.yaml:22:13: ports.COM3.station is missing"]),
    "station 0": (
        changed((", station: 2", ", station: 0")),
        ["x.yaml:22:62: ports.COM3.station is 0, allowed 1..247"],
    ),
    "raw contradiction": (
        changed(
            ("scan: 8 ms", "scan: 8 ms\n    registers: {D7926: 0x30, D7929: 20, D7960: 0x91}"),
            (MASTER, "COM3: {bus: line, protocol: modbus-rtu-master, timeout: 100 ms}"),
            (FREE_PORT, "COM5: {bus: codes, protocol: free, format: 7E1}"),
        ),
        [
            "x.yaml:11:24: registers.D7926 is 48, but ports.COM3.protocol makes it 32 (0020H)",
            "x.yaml:11:37: registers.D7929 is 20, but ports.COM3.timeout makes it 10 (000AH)",
            "x.yaml:11:48: registers.D7960 is 145, but ports.COM5.format makes it 134 (0086H)",
        ],
    ),
    "com2 contradiction": (
        changed(
            (SLAVE, "COM2: {bus: line, protocol: modbus-rtu-slave, station: 8}"),
            ("scan: 5 ms", "scan: 5 ms\n    registers: {D8121: 7}"),
        ),
        ["x.yaml:20:24: registers.D8121 is 7, but ports.COM2.station makes it 8 (0008H)"],
    ),
}


@pytest.mark.parametrize(("text", "expected"), CASES.values(), ids=CASES.keys())
def test_the_message_says_what_where_and_what_is_allowed(text: str, expected: list[str]) -> None:
    assert mistakes(text) == expected
