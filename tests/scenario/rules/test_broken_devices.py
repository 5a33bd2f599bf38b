"""Devices, and noise and faults of any node: each mistake with its place and its message."""

from __future__ import annotations

import pytest

from tests.scenario.port_samples import DRIVE, PORTS, changed, more
from tests.scenario.samples import mistakes

CASES: dict[str, tuple[str, list[str]]] = {
    "model": (
        changed((DRIVE, "{name: drive, model: steper, bus: line, foo: 1}")),
        ["x.yaml:24:26: model is 'steper', allowed lx, v80, stepper, map, hmi, free; did you mean stepper?"],
    ),
    "no model": (changed((DRIVE, "{name: drive, bus: line}")), ["x.yaml:24:5: model is missing"]),
    "no name": (changed((DRIVE, "{model: stepper, bus: line}")), ["x.yaml:24:5: name is missing"]),
    "bus": (
        changed((DRIVE, "{name: drive, model: stepper, bus: lin, station: 1}")),
        ["x.yaml:24:40: bus is 'lin', which is no bus; did you mean link?"],
    ),
    "nn": (
        changed((DRIVE, "{name: drive, model: stepper, bus: link, station: 1}")),
        ["x.yaml:24:40: bus is link, an N:N link, on which there are PLCs only (nn:)"],
    ),
    "name plc": (
        changed((DRIVE, "{name: press1, model: stepper, bus: line, station: 1}")),
        ["x.yaml:24:12: name is 'press1', which is used already (in line 9)"],
    ),
    "name case": (
        changed((DRIVE, "{name: Press1, model: stepper, bus: line, station: 1}")),
        ["x.yaml:24:12: name is 'Press1', which differs only in case from 'press1' (in line 9)"],
    ),
    "station": (
        changed((DRIVE, "{name: drive, model: stepper, bus: line, station: 248}")),
        ["x.yaml:24:55: station is 248, allowed 1..247"],
    ),
    "ascii": (
        changed((DRIVE, "{name: drive, model: stepper, bus: line, mode: ascii}")),
        ["x.yaml:24:52: mode is ascii, allowed rtu (stepper)"],
    ),
    "delay": (
        changed((DRIVE, "{name: drive, model: stepper, bus: line, delay: 20 ms}")),
        ["x.yaml:24:53: delay is 20 ms, but a stepper responds no sooner than 35 ms"],
    ),
    "rtu 7": (
        changed((DRIVE, "{name: drive, model: stepper, bus: codes}")),
        ["x.yaml:24:40: bus is codes, whose format is 7E1, but Modbus RTU needs 8 data bits"],
    ),
    "rtu 7 own": (
        changed((DRIVE, "{name: drive, model: stepper, bus: line, format: 7E1}")),
        ["x.yaml:24:54: format is 7E1, but Modbus RTU needs 8 data bits"],
    ),
    "baud": (
        changed((DRIVE, "{name: drive, model: stepper, bus: line, baud: 57600}")),
        ["x.yaml:24:52: baud is 57600, allowed 4800, 9600, 19200, 38400, 115200 (stepper)"],
    ),
    "key": (
        changed((DRIVE, "{name: drive, model: stepper, bus: line, coils: {1: 1}}")),
        [
            "x.yaml:24:46: coils is not a key here; allowed are name, model, bus, baud, format, station, mode, delay, jitter, rtu_gaps, registers, steps, switches, profile"
        ],
    ),
    "register": (
        changed(
            (
                DRIVE,
                "{name: drive, model: stepper, bus: line, registers: {pich: 1, station: 3, position: 5, step_number: 1, pitch: 5000000000}}",
            )
        ),
        [
            "x.yaml:24:58: registers.pich is no register; did you mean pitch?",
            "x.yaml:24:67: registers.station is given with the device itself (station:)",
            "x.yaml:24:79: registers.position is not saved by the controller; allowed are step_angle, microsteps, start_frequency, acceleration, pitch, home_input, stop_mode, speed, distance, direction, forward_limit_input, reverse_limit_input, …",
            "x.yaml:24:92: registers.step_number is not saved by the controller; did you mean step_angle?",
            "x.yaml:24:115: registers.pitch is 5000000000, allowed -2147483648..4294967295",
        ],
    ),
    "register range": (
        changed(
            (
                DRIVE,
                "{name: drive, model: stepper, bus: line, registers: {direction: 2, distance: -500, loop_first: 34}}",
            )
        ),
        [
            "x.yaml:24:69: registers.direction is 2, allowed 0..1 (40012)",
            "x.yaml:24:100: registers.loop_first is 34, allowed 0..33 (40037)",
        ],
    ),
    "switch": (
        changed(
            (
                DRIVE,
                "{name: drive, model: stepper, bus: line, switches: [{input: 6}, {input: 1, low: 5, high: 1}, {low: 1}]}",
            )
        ),
        [
            "x.yaml:24:65: switches.0.input is 6, allowed 1..5",
            "x.yaml:24:94: switches.1.high is 1, below low (5)",
            "x.yaml:24:98: switches.2.input is missing",
        ],
    ),
    "profile": (
        changed(
            (
                DRIVE,
                "{name: drive, model: stepper, bus: line, profile: {save_coil: 8, refused_command: 5, step_output: dely}}",
            )
        ),
        [
            "x.yaml:24:67: profile.save_coil is 8, the coil of run_once",
            "x.yaml:24:87: profile.refused_command is 5, allowed 0..4",
            "x.yaml:24:103: profile.step_output is 'dely', allowed delay, step; did you mean delay?",
        ],
    ),
    "save_coil": (
        changed((DRIVE, "{name: drive, model: stepper, bus: line, profile: {save_coil: 8}}")),
        ["x.yaml:24:67: profile.save_coil is 8, the coil of run_once"],
    ),
    "lx": (
        changed((DRIVE, "{name: drive, model: lx, bus: line, scan: 5, registers: {D9000: 1, M5: 2}}")),
        [
            "x.yaml:24:47: scan is 5, a time without a unit; write one of ns, us, ms, s, min, h, d, y, such as 5 ms",
            "x.yaml:24:62: a device of registers is 'D9000', allowed D0–D8255",
            "x.yaml:24:76: registers.M5 is 2, allowed 0, 1",
        ],
    ),
    "lx scan": (
        changed((DRIVE, "{name: drive, model: lx, bus: line, scan: {mean: 5 ms, jitter: 6 ms}}")),
        ["x.yaml:24:68: scan.jitter must be less than the mean"],
    ),
    "v80": (
        changed(
            (
                DRIVE,
                "{name: drive, model: v80, bus: line, coils: {00127: 2, 40001: 1, x: 1}, registers: {30001: 1, 108: 5, 40108: 6, 0: 1}}",
            )
        ),
        [
            "x.yaml:24:57: coils.00127 is 2, allowed 0..1",
            "x.yaml:24:60: coils.40001 is no reference number of coils but of registers; allowed 00001..09999",
            "x.yaml:24:70: coils.x is no reference number; allowed 00001..09999",
            "x.yaml:24:89: registers.30001 is no reference number of registers but of input_registers; allowed 40001..49999 or 1..9999",
            "x.yaml:24:107: registers.40108 is the same item as 108",
            "x.yaml:24:117: registers.0 is no reference number of registers; allowed 40001..49999 or 1..9999",
        ],
    ),
    "v80 b": (
        changed(
            (
                DRIVE,
                "{name: drive, model: v80, bus: line, coils: {00127: 1, 40001: 1, x: 1}, registers: {30001: 1, 108: 5, 40108: 6, 0: 1, 00108: 2}}",
            )
        ),
        [
            "x.yaml:24:60: coils.40001 is no reference number of coils but of registers; allowed 00001..09999",
            "x.yaml:24:70: coils.x is no reference number; allowed 00001..09999",
            "x.yaml:24:89: registers.30001 is no reference number of registers but of input_registers; allowed 40001..49999 or 1..9999",
            "x.yaml:24:107: registers.40108 is the same item as 108",
            "x.yaml:24:117: registers.0 is no reference number of registers; allowed 40001..49999 or 1..9999",
            "x.yaml:24:123: registers.00108 is no reference number of registers but of coils; allowed 40001..49999 or 1..9999",
        ],
    ),
    "map": (
        changed((DRIVE, "{name: drive, model: map, bus: line}")),
        [
            "x.yaml:24:5: devices.0 has nothing in it; expected one of coils, inputs, input_registers, registers"
        ],
    ),
    "map2": (
        changed(
            (DRIVE, "{name: drive, model: map, bus: line, functions: [3, 7], registers: [{address: 0}]}")
        ),
        ["x.yaml:24:57: functions.1 is 7, allowed 1, 2, 3, 4, 5, 6, 15 (0x0F), 16 (0x10)"],
    ),
    "map3": (
        changed(
            (
                DRIVE,
                "{name: drive, model: map, bus: line, registers: [{address: 0, count: 5}, {address: 4, value: 70000}, {address: 65535, words: 2}]}",
            )
        ),
        [
            "x.yaml:24:88: registers.1.address is 4, where the item at 0 already lies (in line 24)",
            "x.yaml:24:98: registers.1.value is 70000, allowed -32768..65535",
            "x.yaml:24:116: registers.2.address is 65535; its items end at 65536, beyond 65535",
        ],
    ),
    "map4": (
        changed(
            (
                DRIVE,
                "{name: drive, model: map, bus: line, registers: [{address: 0, value: 1, ramp: {from: 1, to: 2, over: 1 s}}]}",
            )
        ),
        ["x.yaml:24:83: registers.0.ramp excludes value in the same entry"],
    ),
    "map5": (
        changed(
            (
                DRIVE,
                "{name: drive, model: map, bus: line, registers: [{address: 0, low: 5, high: 2, high_first: true}], coils: [{address: 1, words: 2}, {address: 5, value: 2}]}",
            )
        ),
        [
            "x.yaml:24:96: registers.0.high_first needs words: 2",
            "x.yaml:24:132: coils.0.words is 2, but bits have one",
            "x.yaml:24:156: coils.1.value is 2, allowed 0..1",
        ],
    ),
    "map6": (
        changed(
            (
                DRIVE,
                "{name: drive, model: map, bus: line, inputs: [{address: 0, writable: true}], registers: [{address: 9, writable: true, low: -1}]}",
            )
        ),
        [
            "x.yaml:24:74: inputs.0.writable is true, but Modbus cannot write inputs, only coils, registers",
            "x.yaml:24:128: registers.0.low is -1, allowed 0..65535 (unsigned)",
        ],
    ),
    "map call": (
        changed(
            (
                DRIVE,
                "{name: drive, model: map, bus: line, registers: [{address: 0, call: 'os:getpid'}, {address: 1, call: os.getpid}]}",
            )
        ),
        ["x.yaml:24:106: registers.1.call is 'os.getpid', expected module:function, such as sensors:level"],
    ),
    "hmi": (
        changed((DRIVE, "{name: drive, model: hmi, bus: line, station: 1}")),
        [
            "x.yaml:24:42: station is not a key here; allowed are name, model, bus, baud, format, mode, timeout, interval, turnaround, silence, polls"
        ],
    ),
    "hmi polls": (
        changed(
            (
                DRIVE,
                "{name: drive, model: hmi, bus: line, polls: [{station: 2, function: 3}, {station: 2, function: 3, address: 0, count: 126, to: D0}, {station: 2, function: 6, address: 3}]}",
            )
        ),
        [
            "x.yaml:24:50: polls.0.address is missing",
            "x.yaml:24:122: polls.1.count is 126, allowed 1..125 (function 3)",
            "x.yaml:24:127: polls.1.to is not a key here; allowed are name, station, function, address, count, values, every, at, times, retries, skip_after_failure",
            "x.yaml:24:136: polls.2 writes nothing; expected values (function 6)",
        ],
    ),
    "free": (changed((DRIVE, "{name: drive, model: free, bus: line}")), ["x.yaml:24:5: says is missing"]),
    "free2": (
        changed(
            (
                DRIVE,
                "{name: drive, model: free, bus: line, says: [{text: a, bytes: '01'}, {at: 1 s}, {text: a, reply_to: b, every: 1 s}, {text: a, delay: 1 s}, {text: a, times: 3}]}",
            )
        ),
        [
            "x.yaml:24:67: says.0.bytes excludes text in the same entry",
            "x.yaml:24:74: says.1 says nothing; expected one of text, bytes",
            "x.yaml:24:115: says.2.every excludes reply_to in the same entry",
            "x.yaml:24:138: says.3.delay needs reply_to",
            "x.yaml:24:161: says.4.times needs every",
        ],
    ),
    "noise of a station": (
        more(
            "noise:\n  - {bus: line, station: drve, ber: 0.1}\n  - {bus: line, station: press1, ber: 0.1}\n  - {bus: line, station: press1.COM5, ber: 0.1}\n  - {bus: line, station: press1.COM6, ber: 0.1}\n  - {bus: line, station: reader, ber: 0.1}\n  - {bus: link, station: press1.COM4, ber: 0.1}\n  - {bus: line, station: 'a b', ber: 0.1}\n"
        ),
        [
            "x.yaml:27:26: station is 'drve', which is no PLC and no device; did you mean drive?",
            "x.yaml:29:26: station is press1.COM5, which is not on line; did you mean press1.COM3?",
            "x.yaml:30:26: station is press1.COM6, which is on no bus; did you mean press1.COM5?",
            "x.yaml:31:26: station is reader, which is not on line; allowed are press1.COM3, press2.COM3, drive",
            "x.yaml:33:26: station is 'a b', expected the name of a PLC, a port such as press1.COM3, or a device; did you mean a_b?",
        ],
    ),
    "power": (
        more(
            "faults:\n  - {power_off: drive}\n  - {power_off: press1.COM3}\n  - {stop: drive}\n  - {stop: press1.COM3}\n  - {power_off: drvie}\n  - {power_on: {drive: 1 s, drvie: 2 s, press1.COM3: 3 s}}\n"
        ),
        [
            "x.yaml:28:17: power_off is press1.COM3, but this happens to the whole of press1",
            "x.yaml:29:12: stop is drive, a device, but this happens to PLCs only; allowed are press1, press2",
            "x.yaml:30:12: stop is press1.COM3, but this happens to the whole of press1",
            "x.yaml:31:17: power_off is 'drvie', which is no PLC and no device; did you mean drive?",
            "x.yaml:32:29: power_on.drvie is no PLC and no device; did you mean drive?",
            "x.yaml:32:41: power_on.press1.COM3 is no PLC and no device; did you mean press1?",
        ],
    ),
    "nodes": (
        more(
            "faults:\n  - {drop_reply: press1}\n  - {drop_reply: press2.COM3}\n  - {slow: {station: drive, extra: 5 ms}}\n  - {slow: {station: reader, extra: 5 ms}}\n  - {jabber: press2.COM3}\n  - {jabber: press2.COM5}\n"
        ),
        ["x.yaml:32:14: jabber is press2.COM5, which is on no bus; did you mean press2.COM4?"],
    ),
    "cut": (
        more(
            "faults:\n  - {cable_cut: {bus: line, after: press2}}\n  - {cable_cut: {bus: line, after: drive}}\n  - {cable_cut: {bus: line, after: reader}}\n"
        ),
        [
            "x.yaml:29:36: cable_cut.after is reader, which is not on line; allowed are press1.COM3, press2.COM3, drive"
        ],
    ),
    "chars": (
        more(
            "faults:\n  - {insert_char: {station: press1, value: 200}}\n  - {insert_char: {station: drive, value: 200, index: 300}}\n  - {insert_char: {station: reader, value: 200, index: 300}}\n  - {lose_char: {station: press1, index: 200}}\n"
        ),
        [
            "x.yaml:27:44: insert_char.value is 200, allowed 0..127",
            "x.yaml:29:44: insert_char.value is 200, allowed 0..127",
            "x.yaml:30:42: lose_char.index is 200, allowed 0..149",
        ],
    ),
    "pause": (
        more(
            "faults:\n  - {pause: {station: press1, index: 149, by: 1 ms}}\n  - {pause: {station: drive, index: 255, by: 1 ms}}\n  - {pause: {station: reader, index: 512, by: 0 s}}\n  - {pause: {station: press1, index: 148, by: 1 us}}\n  - {pause: drive}\n"
        ),
        [
            "x.yaml:27:38: pause.index is 149, allowed 0..148: no frame of press1 goes on after it",
            "x.yaml:28:37: pause.index is 255, allowed 0..254: no frame of drive goes on after it",
            "x.yaml:29:38: pause.index is 512, allowed 0..511",
            "x.yaml:29:47: pause.by is 0 s, allowed more than 0 up to 10 y",
            "x.yaml:31:13: pause.by is missing",
        ],
    ),
    "flip": (
        more(
            "faults:\n  - {flip_bits: {station: press1, bits: [2000]}}\n  - {flip_bits: {station: press1, bits: [1], frame: request}}\n  - {flip_bits: {station: drive, bits: [2000], frame: poll}}\n  - {flip_bits: {station: drive, bits: [5642]}}\n  - {flip_bits: {station: reader, bits: [1], frame: request}}\n"
        ),
        [
            "x.yaml:27:41: flip_bits.bits has 2000, allowed 0..1499",
            "x.yaml:28:53: flip_bits.frame is request, but press1 speaks N:N; allowed data, poll, parameters",
            "x.yaml:29:55: flip_bits.frame is poll, but drive speaks Modbus; allowed request, response",
            "x.yaml:31:53: flip_bits.frame is request, but reader speaks no protocol with kinds of frames",
        ],
    ),
    "board": (
        more(
            "faults:\n  - {board_error: {plc: press1.COM3, port: COM3, code: 10}}\n  - {board_error: {plc: drive, port: COM3, code: 10}}\n"
        ),
        [
            "x.yaml:27:25: board_error.plc is 'press1.COM3', not a name; allowed are letters, digits, _ and -, with at least one letter",
            "x.yaml:28:25: board_error.plc is drive, a device, but this happens to PLCs only; allowed are press1, press2",
        ],
    ),
}


@pytest.mark.parametrize(("text", "expected"), CASES.values(), ids=CASES.keys())
def test_the_message_says_what_where_and_what_is_allowed(text: str, expected: list[str]) -> None:
    assert mistakes(text) == expected


def test_devices_that_are_no_list() -> None:
    text = PORTS[: PORTS.index("devices:")] + "devices: {}\n"
    assert mistakes(text) == [
        (
            "x.yaml:23:10: devices is a mapping, expected a list, each entry with a dash: "
            "- {name: feeder1, model: stepper, bus: feeder, station: 1}"
        )
    ]


def test_too_many_devices() -> None:
    text = changed((DRIVE, "\n  - ".join(f"{{name: d{n}, model: lx, bus: line}}" for n in range(256))))
    assert mistakes(text) == ["x.yaml:24:3: devices has 257 entries, allowed 0..256"]


def test_a_name_that_means_several_ports() -> None:
    text = changed(
        ("COM5: {bus: codes, protocol: free}", "COM5: {bus: line, protocol: modbus-rtu-slave, station: 7}"),
        ("      - {port: COM5, to: D300, count: 20}\n", ""),
    )
    text += "noise:\n  - {bus: line, station: press1, ber: 0.1}\nfaults:\n  - {jabber: press1}\n"
    assert mistakes(text) == [
        "x.yaml:26:26: station is press1, which has several ports there; write press1.COM3 or press1.COM5"
    ]


def test_a_name_that_means_several_ports_and_no_link() -> None:
    text = changed(("    nn: {bus: link, port: COM4, station: 0, slaves: 1}\n", ""))
    assert mistakes(text + "faults:\n  - {jabber: press1}\n") == [
        "x.yaml:26:14: jabber is press1, which has several ports; write press1.COM3 or press1.COM5"
    ]
