"""Ports, polls and devices that are odd but possible: simulated, with a warning and its place."""

from __future__ import annotations

from pathlib import Path

import pytest

from bussim.scenario.loader import examine, loads
from tests.scenario.port_samples import DRIVE, FREE_POLL, MASTER, POLL, PORTS, SLAVE, changed, more

CASES: dict[str, tuple[str, list[str]]] = {
    "interval0": (
        changed((MASTER, "COM3: {bus: line, protocol: modbus-rtu-master, interval: 0 s}")),
        ["13:64: interval of press1.COM3 is 0, which the PLC takes as 5 ms (CPAVL word +2)"],
    ),
    "other line": (
        changed((MASTER, "COM3: {bus: line, protocol: modbus-rtu-master, baud: 19200}")),
        ["13:13: press1.COM3 runs at 19200 8N1, line at 9600 8N1: no station there understands it"],
    ),
    "raw bad station": (
        changed(
            ("scan: 5 ms", "scan: 5 ms\n    registers: {D100: 0x81, D101: 0, D106: 2}"),
            (SLAVE, "COM3: {bus: line, cpavl: {words: D100, bits: M100}}"),
        ),
        [
            "23:13: press2.COM3 refuses its parameters (COM3 has the station number 0, allowed 1..247): M8063 on, D8063 = 7300, and it is silent"
        ],
    ),
    "raw bad code": (
        changed(
            ("scan: 5 ms", "scan: 5 ms\n    registers: {D100: 0x81, D101: 0, D106: 5}"),
            (SLAVE, "COM3: {bus: line, cpavl: {words: D100, bits: M100}}"),
        ),
        [
            "23:13: press2.COM3 refuses its parameters (COM3 has no protocol 05H): M8063 on, D8063 = 7306, and it is silent"
        ],
    ),
    "raw nothing": (
        changed((SLAVE, "COM3: {bus: line, cpavl: {words: D100, bits: M100}}")),
        [
            "22:13: D106 of press2 is 0: port COM3 does nothing (give it a protocol, or D106 one of 02H modbus-rtu-slave, 03H modbus-ascii-slave, 10H free, 20H modbus-rtu-master, 30H modbus-ascii-master)"
        ],
    ),
    "raw 7 bits": (
        changed(
            ("scan: 5 ms", "scan: 5 ms\n    registers: {D100: 0x86, D101: 3, D106: 2}"),
            (SLAVE, "COM3: {bus: line, cpavl: {words: D100, bits: M100}}"),
        ),
        [
            "23:13: press2.COM3 refuses its parameters (COM3 has 7 data bits, RTU needs 8): M8063 on, D8063 = 7306, and it is silent"
        ],
    ),
    "com2": (
        changed((SLAVE, "COM2: {bus: line}")),
        [
            "22:13: the monitoring protocol of an HMI is not simulated: press2.COM2 stays silent (an HMI that speaks Modbus needs protocol: modbus-rtu-slave)"
        ],
    ),
    "special": (
        changed((POLL, "{port: COM3, station: 1, function: 3, address: 0, to: D8000}")),
        ["16:63: press1 writes 1 register to D8000: devices from D8000 on are special"],
    ),
    "block": (
        changed((POLL, "{port: COM3, station: 1, function: 3, address: 0, count: 10, to: D30}")),
        [
            "16:74: press1 writes 10 registers to D30 to D39, into the shared block of another station: the link overwrites them"
        ],
    ),
    "cpavl": (
        changed((POLL, "{port: COM3, station: 1, function: 3, address: 0, count: 10, to: D7915}")),
        ["16:74: press1 writes 10 registers to D7915 to D7924, over the parameters (CPAVL) of COM3"],
    ),
    "no such station": (
        changed((POLL, "{port: COM3, station: 9, function: 3, address: 0, to: D400}")),
        ["16:31: press1.COM3 asks station 9, which is not on line (it has 1, 2)"],
    ),
    "stepper f1": (
        changed((POLL, "{port: COM3, station: 1, function: 1, address: 0, to: D400}")),
        ["16:44: drive does not have function 1: it responds with exception 01"],
    ),
    "stepper map": (
        changed((POLL, "{port: COM3, station: 1, function: 3, address: 50, count: 12, to: D400}")),
        ["16:56: drive does not have all of the registers 50 to 61: it responds with exception 02"],
    ),
    "stepper ro": (
        changed((POLL, "{port: COM3, station: 1, function: 6, address: 12, values: [1]}")),
        ["16:56: drive does not let register 12 be written: it responds with exception 02"],
    ),
    "lx limit": (
        changed((POLL, "{port: COM3, station: 2, function: 0x10, address: 0, count: 121, from: D400}")),
        ["16:69: press2.COM3 takes at most 120 in function 16: it responds with exception 03"],
    ),
    "lx f2": (
        changed((POLL, "{port: COM3, station: 2, function: 2, address: 0, count: 12, to: M400}")),
        ["16:44: press2.COM3 does not have function 2: it responds with exception 01"],
    ),
    "no polls": (
        changed(
            (
                "    polls:\n      - {port: COM3, station: 1, function: 3, address: 0, count: 2, to: D400}\n      - {port: COM5, to: D300, count: 20}\n",
                "    polls:\n",
            )
        ),
        [
            "13:13: press1.COM3 is a Modbus master without polls: it sends nothing",
            "14:13: no poll drives press1.COM5: it neither sends nor receives",
        ],
    ),
    "short timeout": (
        changed((MASTER, "COM3: {bus: line, protocol: modbus-rtu-master, timeout: 40 ms}")),
        [
            "16:9: the timeout of press1.COM3 is 40 ms, but the answer of drive to function 3 at 0 takes at least 44.375 ms: it never comes in time"
        ],
    ),
    "an exception is short": (
        changed(
            (MASTER, "COM3: {bus: line, protocol: modbus-rtu-master, timeout: 50 ms}"),
            (POLL, "{port: COM3, station: 1, function: 3, address: 0, count: 90, to: D400}"),
        ),
        ["16:56: drive does not have all of the registers 0 to 89: it responds with exception 02"],
    ),
    "late timeout": (
        changed(
            (MASTER, "COM3: {bus: line, protocol: modbus-rtu-master, timeout: 10 ms}"),
            (POLL, "{port: COM3, station: 2, function: 3, address: 0, count: 2, to: D400}"),
        ),
        [
            "16:9: the timeout of press1.COM3 is 10 ms, but the answer of press2.COM3 to function 3 at 0 takes at least 13.021 ms: it never comes in time"
        ],
    ),
    "eight": (
        changed((FREE_POLL, '{port: COM5, send: D300, data: "41 FF"}')),
        ["17:40: press1.COM5 sends 7 bits a character (7E1): 80H on lose one"],
    ),
    "free: more than the line carries": (
        changed(
            (
                "every: 1 s}",
                'every: 2 ms}, {text: "AB", every: 2 ms, times: 65}, {text: "C", every: 1 us, times: 64}',
            )
        ),
        [
            "25:98: reader sends 2 characters every 2 ms, which take 2.083 ms beside what else is sent: codes cannot carry it; 64 messages wait, what is due beyond them is never sent"
        ],
    ),
    "free: special": (
        changed((FREE_POLL, "{port: COM5, to: D7990, count: 40}")),
        ["17:26: press1 writes 40 bytes to D7990 to D8009: devices from D8000 on are special"],
    ),
    "same station": (
        changed((DRIVE, "{name: drive, model: stepper, bus: line, station: 2}")),
        [
            "16:31: press1.COM3 asks station 1, which is not on line (it has 2)",
            "24:55: press2.COM3 and drive on line are both station 2: they reply at once",
        ],
    ),
    "other": (
        changed((DRIVE, "{name: drive, model: stepper, bus: line, baud: 4800}")),
        ["24:5: drive runs at 4800 8N1, line at 9600 8N1: no station there understands it"],
    ),
    "hmi none": (
        changed((DRIVE, "{name: drive, model: hmi, bus: line}")),
        [
            "16:31: press1.COM3 asks station 1, which is not on line (it has 2)",
            "24:5: drive has no polls: it sends nothing",
            "24:5: line has more than one master, press1.COM3 and drive: their requests can collide",
        ],
    ),
    "hmi ascii": (
        changed(
            (
                DRIVE,
                "{name: drive, model: hmi, bus: line, mode: ascii, polls: [{station: 2, function: 3, address: 0}]}",
            )
        ),
        [
            "16:31: press1.COM3 asks station 1, which is not on line (it has 2)",
            "24:5: line has more than one master, press1.COM3 and drive: their requests can collide",
            "24:73: drive asks station 2 in Modbus ASCII, but press2.COM3 speaks Modbus RTU",
        ],
    ),
    "v80 ascii on line": (
        changed((DRIVE, "{name: drive, model: v80, bus: line, mode: ascii}")),
        ["16:31: press1.COM3 asks station 1 in Modbus RTU, but drive speaks Modbus ASCII"],
    ),
    "lx jitter": (
        changed((DRIVE, "{name: drive, model: lx, bus: line, jitter: 200 ms}")),
        [
            "16:9: the timeout of press1.COM3 is 100 ms, but the answer of drive to function 3 at 0 may take 223.021 ms: it can come too late"
        ],
    ),
    "no devices": (
        changed(
            (
                'devices:\n  - {name: drive, model: stepper, bus: line, station: 1}\n  - {name: reader, model: free, bus: codes, says: [{text: "A", every: 1 s}]}\n',
                "devices:\n",
            )
        ),
        ["16:31: press1.COM3 asks station 1, which is not on line (it has 2)"],
    ),
    "two masters": (
        more("  - {name: panel, model: hmi, bus: line, polls: [{station: 2, function: 3, address: 0}]}\n"),
        ["26:5: line has more than one master, press1.COM3 and panel: their requests can collide"],
    ),
    "no master": (
        changed(
            ("COM3: {bus: line, protocol: modbus-rtu-master}\n", "COM6: {bus: line, protocol: free}\n"),
            (
                "port: COM3, station: 1, function: 3, address: 0, count: 2, to: D400",
                "port: COM6, to: D500, count: 1",
            ),
        ),
        ["6:5: line has no Modbus master: no station asks press2.COM3, drive"],
    ),
    "reply_loss": (
        more(
            "noise:\n  - {bus: line, station: drive, reply_loss: 0.1}\n  - {bus: line, station: press1, reply_loss: 0.1}\n  - {bus: codes, station: reader, reply_loss: 0.1}\n"
        ),
        [
            "28:26: press1.COM3 is a master: it sends no replies that could be lost",
            "29:27: reader is no slave: it sends no replies that could be lost",
        ],
    ),
    "format": (
        more(
            "faults:\n  - {wrong_format: {station: drive, format: 8N1}}\n  - {wrong_format: {station: drive, baud: 4800}}\n"
        ),
        ["27:20: wrong_format of drive is 9600 8N1, which is right: it does nothing"],
    ),
}

#: What might look odd but is not.
RIGHT = {
    "the sample": PORTS,
    "a broadcast": changed((POLL, "{port: COM3, station: 0, function: 6, address: 0, from: D0}")),
    "data in the own block": changed(
        (POLL, "{port: COM3, station: 1, function: 3, address: 0, count: 4, to: D0}")
    ),
    "another timeout by its register": changed(("scan: 8 ms", "scan: 8 ms\n    registers: {D7929: 20}")),
    "a port by its words": changed(
        ("scan: 5 ms", "scan: 5 ms\n    registers: {D100: 0x81, D101: 2, D106: 2}"),
        (SLAVE, "COM3: {bus: line, cpavl: {words: D100, bits: M100}}"),
    ),
    "the station of COM2 by its register": changed(
        (SLAVE, "COM2: {bus: line, protocol: modbus-rtu-slave}"),
        ("scan: 5 ms", "scan: 5 ms\n    registers: {D8121: 7}"),
    ),
    "a source that a slave port shows": changed(
        ("scan: 5 ms", "scan: 5 ms\n    sources: {D500: {counter: 1 s}}")
    ),
}


@pytest.mark.parametrize(("text", "expected"), CASES.values(), ids=CASES.keys())
def test_a_warning_has_its_position_and_does_not_stop_the_scenario(
    text: str, expected: list[str], tmp_path: Path
) -> None:
    file = tmp_path / "odd.yaml"
    file.write_text(text, encoding="utf-8")
    examined = examine(file)
    assert examined.errors == ()
    assert [f"{w.line}:{w.column}: {w.message}" for w in examined.warnings] == expected
    assert set(loads(text).warnings) == {w.message for w in examined.warnings}


@pytest.mark.parametrize("text", RIGHT.values(), ids=RIGHT.keys())
def test_no_warning(text: str) -> None:
    assert loads(text).warnings == ()
