"""Noise and faults: each mistake with its place and its message."""

from __future__ import annotations

import pytest

from tests.scenario.samples import added, mistakes

CASES: dict[str, tuple[str, list[str]]] = {
    "noise bus": (
        added("noise:\n  - {bus: lin, ber: 1e-5}\n"),
        ["x.yaml:13:11: bus is 'lin', which is no bus; did you mean link?"],
    ),
    "noise ber": (
        added("noise:\n  - {bus: link, ber: 2}\n"),
        ["x.yaml:13:22: ber is 2, allowed 0..1"],
    ),
    "noise nan": (
        added("noise:\n  - {bus: link, ber: .nan}\n"),
        ["x.yaml:13:22: ber is .nan, allowed 0..1"],
    ),
    "noise two": (
        added("noise:\n  - {bus: link, ber: 0.1, reply_loss: 0.1}\n"),
        ["x.yaml:13:39: reply_loss excludes ber in the same entry"],
    ),
    "noise none": (
        added("noise:\n  - {bus: link}\n"),
        ["x.yaml:13:5: noise.0 says nothing; expected one of ber, burst, impulse, reply_loss"],
    ),
    "noise station": (
        added("noise:\n  - {bus: link, station: press9, ber: 0.1}\n"),
        ["x.yaml:13:26: station is 'press9', which is no PLC; did you mean press3?"],
    ),
    "noise direction": (
        added("noise:\n  - {bus: link, direction: rx, ber: 0.1}\n"),
        ["x.yaml:13:28: direction needs a station"],
    ),
    "noise direction2": (
        added("noise:\n  - {bus: link, station: press1, direction: up, ber: 0.1}\n"),
        ["x.yaml:13:45: direction is 'up', allowed rx, tx"],
    ),
    "noise mapping": (
        added("noise: {bus: link}\n"),
        [
            "x.yaml:12:8: noise is a mapping, expected a list, each entry with a dash: - {bus: link, ber: 1.0e-6}"
        ],
    ),
    "burst": (
        added("noise:\n  - {bus: link, burst: {good: 1 s, bad: 0 s}}\n"),
        [
            "x.yaml:13:24: burst.ber_bad is missing",
            "x.yaml:13:41: burst.bad is 0 s, allowed more than 0 up to 10 y",
        ],
    ),
    "impulse": (
        added("noise:\n  - {bus: link, impulse: {every: 20 ms, width: 30 ms, phase: 25 ms}}\n"),
        ["x.yaml:13:48: impulse.width must not be more than every"],
    ),
    "impulse2": (
        added("noise:\n  - {bus: link, impulse: {every: 20 ms, width: 30 us, phase: 25 ms}}\n"),
        ["x.yaml:13:62: impulse.phase must be less than every"],
    ),
    "fault unknown": (
        added("faults:\n  - {at: 1 s, power_of: press2}\n"),
        ["x.yaml:13:15: power_of is not a key here; did you mean power_off?"],
    ),
    "fault none": (
        added("faults:\n  - {at: 1 s}\n"),
        [
            "x.yaml:13:5: faults.0 says nothing; expected one of power_off, stop, drop_reply, slow, jabber, cable_cut, wrong_format, clock_ppm, late_release, lose_char, insert_char, pause, flip_bits, board_error, power_on"
        ],
    ),
    "fault two": (
        added("faults:\n  - {at: 1 s, stop: press2, power_off: press2}\n"),
        ["x.yaml:13:21: stop excludes power_off in the same entry"],
    ),
    "fault station": (
        added("faults:\n  - {at: 1 s, stop: pres2}\n"),
        ["x.yaml:13:21: stop is 'pres2', which is no PLC; did you mean press2?"],
    ),
    "fault count": (
        added("faults:\n  - {at: 1 s, stop: press2, count: 2}\n"),
        [
            "x.yaml:13:36: count has no meaning for stop; use for (count goes with drop_reply, lose_char, insert_char, pause, flip_bits)"
        ],
    ),
    "fault count for": (
        added("faults:\n  - {at: 1 s, drop_reply: press2, count: 2, for: 1 s}\n"),
        ["x.yaml:13:42: count excludes for; give one of them"],
    ),
    "fault count 0": (
        added("faults:\n  - {at: 1 s, drop_reply: press2, count: 0}\n"),
        ["x.yaml:13:42: count is 0, allowed 1..1000000"],
    ),
    "fault slow": (
        added("faults:\n  - {at: 1 s, slow: press2}\n"),
        ["x.yaml:13:21: slow.extra is missing"],
    ),
    "fault slow2": (
        added("faults:\n  - {at: 1 s, slow: {station: press7, extra: 5}}\n"),
        [
            "x.yaml:13:46: slow.extra is 5, a time without a unit; write one of ns, us, ms, s, min, h, d, y, such as 5 ms"
        ],
    ),
    "fault cut": (
        added("faults:\n  - {cable_cut: {bus: link, after: press5}}\n"),
        ["x.yaml:13:36: cable_cut.after is 'press5', which is no PLC; did you mean press3?"],
    ),
    "fault cut2": (
        added("faults:\n  - {cable_cut: press2}\n"),
        ["x.yaml:13:17: cable_cut is 'press2', expected {bus: link, after: press1}"],
    ),
    "wrong format": (
        added("faults:\n  - {wrong_format: {station: press2, format: 9N1}}\n"),
        [
            "x.yaml:13:46: wrong_format.format is '9N1', not a character format; write data bits 7 or 8, parity N, E or O, stop bits 1 or 2, such as 8N1"
        ],
    ),
    "wrong format none": (
        added("faults:\n  - {wrong_format: press2}\n"),
        ["x.yaml:13:20: wrong_format.format is missing"],
    ),
    "ppm": (
        added("faults:\n  - {clock_ppm: {station: press2, ppm: 1e7}}\n"),
        ["x.yaml:13:40: clock_ppm.ppm is 1e7, allowed -100000..100000"],
    ),
    "flip": (
        added("faults:\n  - {flip_bits: {station: press2, bits: [1, 1]}}\n"),
        ["x.yaml:13:41: flip_bits.bits names a bit twice, which would leave it as it is"],
    ),
    "flip4": (
        added("faults:\n  - {flip_bits: {station: press2, bits: 5, frame: dta}}\n"),
        [
            "x.yaml:13:41: flip_bits.bits is 5, expected a list in brackets",
            "x.yaml:13:51: flip_bits.frame is 'dta', allowed data, poll, parameters, request, response; did you mean data?",
        ],
    ),
    "insert": (
        added("faults:\n  - {insert_char: {station: press2, value: 200}}\n"),
        ["x.yaml:13:44: insert_char.value is 200, allowed 0..127"],
    ),
    "board": (
        added("faults:\n  - {board_error: {plc: press8, port: COM7, code: 48}}\n"),
        [
            "x.yaml:13:39: board_error.port is 'COM7', allowed COM3, COM4, COM5, COM6; did you mean COM6?",
            "x.yaml:13:51: board_error.code is 48, allowed 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 40, 41, 42, 43, 44, 45, 46, 47, 49",
        ],
    ),
    "power_on": (
        added("faults:\n  - {power_on: {pres2: 4 s}}\n"),
        ["x.yaml:13:17: power_on.pres2 is no PLC; did you mean press2?"],
    ),
    "power_on twice": (
        added("faults:\n  - {power_on: {press2: 4 s}}\n  - {power_on: {press2: 5 s}}\n"),
        ["x.yaml:14:17: power_on.press2 is given twice, first in line 13"],
    ),
    "power_on at": (
        added("faults:\n  - {at: 1 s, power_on: {press2: 4 s}}\n"),
        ["x.yaml:13:10: at has no meaning beside power_on, whose times are its own"],
    ),
    "power_on no map": (
        added("faults:\n  - {power_on: press2}\n"),
        ["x.yaml:13:16: power_on is 'press2', expected a mapping such as {press2: 4 s}"],
    ),
    "fault no link": (
        added("  - {name: press4}\nfaults:\n  - {drop_reply: press4}\n"),
        ["x.yaml:14:18: drop_reply is press4, which is on no bus: there is nothing for drop_reply to act on"],
    ),
}


@pytest.mark.parametrize(("text", "expected"), CASES.values(), ids=CASES.keys())
def test_the_message_says_what_where_and_what_is_allowed(text: str, expected: list[str]) -> None:
    assert mistakes(text) == expected
