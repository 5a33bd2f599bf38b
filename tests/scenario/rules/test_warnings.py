"""What is odd but possible: it is simulated, and the loader says so, with the place."""

from __future__ import annotations

from pathlib import Path

import pytest

from bussim.scenario.loader import examine, loads
from tests.scenario.samples import BASE, added, changed

CASES: dict[str, tuple[str, list[str]]] = {
    "modes 3 and 4": (
        changed("slaves: 2", "slaves: 2, mode: 3"),
        [
            "9:62: press1 uses refresh mode 3, which the manual describes but its table of settings (D8178: 0, 1, 2) leaves out"
        ],
    ),
    "two masters": (
        changed("station: 2", "station: 0, slaves: 1"),
        [
            "9:53: press1 polls 2 slaves (D8177), but link has no station 2: every link scan waits for what is not there",
            "11:69: link has two masters, press1 and press3 (station 0)",
        ],
    ),
    "equal numbers": (
        changed("station: 2", "station: 1").replace("slaves: 2", "slaves: 1"),
        ["11:69: press2 and press3 on link are both station 1"],
    ),
    "no master": (
        changed("station: 0, slaves: 2, timeout: 50 ms", "station: 3"),
        ["7:5: link has no master (station 0): no station is polled, nothing is sent"],
    ),
    "never polled": (
        changed("slaves: 2", "slaves: 1"),
        ["11:69: press3 is station 2, but press1 polls only 1 on link (D8177): it is never polled"],
    ),
    "no station there": (
        changed("slaves: 2, ", ""),
        [
            "7:5: press1 polls 7 slaves (D8177), but link has no station 3, 4, 5, 6, 7: every link scan waits for what is not there"
        ],
    ),
    "settings of a slave": (
        changed("station: 2", "station: 2, slaves: 3, retries: 1").replace(
            "name: press2,", "name: press2, registers: {D8180: 9},"
        ),
        [
            "10:5: press2 is a slave: it ignores D8180 and learns the master's",
            "11:5: press3 is a slave: it ignores nn.slaves, nn.retries and learns the master's",
        ],
    ),
    "refused, COM4": (
        changed("slaves: 2, timeout: 50 ms}", "timeout: 50 ms}\n    registers: {D8177: 0}"),
        [
            "10:24: press1 refuses its N:N settings (D8177 is 0, allowed 1..7): M8063 on, D8063 = 7448, and it sends nothing"
        ],
    ),
    "refused, COM3": (
        added("  - {name: press4, registers: {D8176: 8}, ports: {COM3: {bus: link}}}\n"),
        [
            "12:39: press4 refuses its N:N settings (D8176 is 8, allowed 0..7): M8063 on, D8063 = 7348, and it sends nothing"
        ],
    ),
    "a family without the mode": (
        changed("name: press2,", "name: press2, profile: fx1s,").replace("slaves: 2", "slaves: 2, mode: 1"),
        [
            "10:5: press2 (fx1s) does not have the master's refresh mode 1: it stays out of the link",
            "10:5: press2: a PLC of profile fx1s has COM3, not COM4, which is simulated as if it were there",
        ],
    ),
    "other addresses": (
        changed("name: press2,", "name: press2, profile: fx3u,"),
        [
            "10:5: press2 keeps the stations' words 10 apart, press1 32: the same data have other addresses there"
        ],
    ),
    "timeout shorter than a reply": (
        changed("name: press2,", "name: press2, profile: {base: pw10, turnaround: 45 ms},"),
        [
            "9:65: the timeout of press1 is 50 ms, but a reply of press2 may take 50.7 ms: it can come too late"
        ],
    ),
    "replies at END": (
        changed("name: press2, scan: 5 ms", "name: press2, scan: 40 ms, profile: {base: pw10, reply: end}"),
        [
            "9:65: the timeout of press1 is 50 ms, but a reply of press2 may take 50.2 ms: it can come too late"
        ],
    ),
    "sources outside of the own block": (
        changed(
            "scan: 8 ms",
            "scan: 8 ms\n    sources: {D0: {constant: 1}, D4: {constant: 1}, M1000: {constant: 1}}",
        ),
        [
            "9:34: press1 drives D4, which is not in its own block (D0 to D3): it is not sent, and in another station's block it is overwritten",
            "9:53: press1 drives M1000, which is not in its own block (D0 to D3): it is not sent, and in another station's block it is overwritten",
        ],
    ),
    "sources without a link": (
        added("  - {name: press4, sources: {D0: {constant: 1}}}\n"),
        ["12:29: press4 takes no part in N:N: what its sources drive is sent to no station"],
    ),
    "a port without use": (
        added("  - {name: press4, ports: {COM3: {bus: link}}}\n"),
        [
            "12:34: press4 takes no part in N:N (no nn, and none of M8179, D8176 to D8180 set) and COM3 has no protocol: its port COM3 does nothing"
        ],
    ),
    "a port that is not selected": (
        changed("scan: 8 ms", "scan: 8 ms\n    ports: {COM3: {bus: link}}"),
        ["9:19: port COM3 of press1 does nothing: M8179 selects COM4"],
    ),
    "a bus without a link": (
        changed("plcs:", "  - {name: spare}\n  - {name: spare2, nn: true}\nplcs:"),
        [
            "6:5: nothing is on spare: no port of a PLC and no device",
            "7:5: no PLC is on spare2: nothing is sent there",
        ],
    ),
    "after the end": (
        added(
            "noise:\n  - {at: 10 s, bus: link, ber: 0.1}\n"
            "faults:\n  - {at: 11 s, stop: press2}\n  - {power_on: {press3: 10 s}}\n"
        ),
        [
            "13:10: noise.0 begins at 10 s, after the end of the run (10 s)",
            "15:10: faults.0 begins at 11 s, after the end of the run (10 s)",
            "16:25: press3 is switched on at 10 s, after the end of the run",
        ],
    ),
    "faults of replies at the master": (
        added(
            "noise:\n  - {bus: link, station: press1, reply_loss: 0.1}\n"
            "faults:\n  - {slow: {station: press1, extra: 1 ms}}\n  - {drop_reply: press1}\n"
        ),
        [
            "13:26: press1 is a master: it sends no replies that could be lost",
            "15:22: press1 is a master: it sends no replies, and slow does nothing",
            "16:18: press1 is a master: it sends no replies, and drop_reply does nothing",
        ],
    ),
    "a cut behind the last": (
        added("faults:\n  - {cable_cut: {bus: link, after: press3}}\n"),
        ["13:36: press3 is the last station on link: a cut behind it changes nothing"],
    ),
    "a wrong format that is right": (
        added("faults:\n  - {wrong_format: {station: press3, format: 7E1}}\n"),
        ["13:20: wrong_format of press3 is 38400 7E1, which is right: it does nothing"],
    ),
}


def test_the_sample_itself_gives_none() -> None:
    assert loads(BASE).warnings == ()


@pytest.mark.parametrize(("text", "expected"), CASES.values(), ids=CASES.keys())
def test_a_warning_has_its_position_and_does_not_stop_the_scenario(
    text: str, expected: list[str], tmp_path: Path
) -> None:
    file = tmp_path / "odd.yaml"
    file.write_text(text, encoding="utf-8")
    examined = examine(file)
    assert examined.errors == ()
    assert [f"{w.line}:{w.column}: {w.message}" for w in examined.warnings] == expected
    assert sorted(loads(text).warnings) == sorted(w.message for w in examined.warnings)
