"""Top-level keys, buses and PLCs: each mistake with its place and its message."""

from __future__ import annotations

import pytest

from tests.scenario.samples import added, changed, mistakes

CASES: dict[str, tuple[str, list[str]]] = {
    "retries out of range": (
        changed("slaves: 2", "slaves: 2, retries: 12"),
        ["x.yaml:9:65: nn.retries is 12, allowed 0..10"],
    ),
    "no schema": (
        changed("schema: 1\n", ""),
        ["x.yaml:1:1: schema is missing"],
    ),
    "duration without unit": (
        changed("duration: 10 s", "duration: 10"),
        [
            "x.yaml:3:11: duration is 10, a time without a unit; write one of ns, us, ms, s, min, h, d, y, such as 10 s"
        ],
    ),
    "duration unknown unit": (
        changed("duration: 10 s", "duration: 10 sec"),
        [
            "x.yaml:3:11: duration has the unit 'sec'; allowed are ns, us, ms, s, min, h, d, y; did you mean s?"
        ],
    ),
    "duration word": (
        changed("duration: 10 s", "duration: soon"),
        ["x.yaml:3:11: duration is 'soon', not a time; write a number and a unit, such as 8 ms"],
    ),
    "duration zero": (
        changed("duration: 10 s", "duration: 0 s"),
        ["x.yaml:3:11: duration is 0 s, allowed more than 0 up to 10 y"],
    ),
    "duration too long": (
        changed("duration: 10 s", "duration: 11 y"),
        ["x.yaml:3:11: duration is 11 y, allowed more than 0 up to 10 y"],
    ),
    "negative scan": (
        changed("scan: 8 ms", "scan: -8 ms"),
        ["x.yaml:8:11: scan is -8 ms, allowed 100 us..10 s"],
    ),
    "scan bool": (
        changed("scan: 8 ms", "scan: true"),
        ["x.yaml:8:11: scan is true, expected a time, or {mean: 8 ms, jitter: 1 ms}"],
    ),
    "scan list": (
        changed("scan: 8 ms", "scan: [8 ms]"),
        ["x.yaml:8:11: scan is a list, expected a time, or {mean: 8 ms, jitter: 1 ms}"],
    ),
    "jitter": (
        changed("scan: 8 ms", "scan: {mean: 8 ms, jitter: 8 ms}"),
        ["x.yaml:8:32: scan.jitter must be less than the mean"],
    ),
    "scan without mean": (
        changed("scan: 8 ms", "scan: {jitter: 8 ms}"),
        ["x.yaml:8:11: scan.mean is missing"],
    ),
    "seed": (
        added("seed: -1\n"),
        ["x.yaml:12:7: seed is -1, allowed 0..9223372036854775807"],
    ),
    "seed float": (
        added("seed: 1.5\n"),
        ["x.yaml:12:7: seed is 1.5, expected a whole number 0..9223372036854775807"],
    ),
    "seed bool": (
        added("seed: true\n"),
        ["x.yaml:12:7: seed is true, expected a whole number 0..9223372036854775807"],
    ),
    "name empty": (
        changed("name: test", "name:"),
        ["x.yaml:2:1: name is empty, expected a line of text"],
    ),
    "unknown top key": (
        added("noises: []\n"),
        [
            "x.yaml:12:1: noises is not a key here; allowed are schema, name, duration, seed, buses, plcs, devices, noise, faults, observe, latency, warnings, allow_unsimulated; did you mean noise?"
        ],
    ),
    "unknown nn key": (
        changed("slaves: 2", "slave: 2"),
        [
            "x.yaml:9:45: nn.slave is not a key here; allowed are bus, port, station, slaves, mode, retries, timeout; did you mean slaves?"
        ],
    ),
    "unknown plc key": (
        changed("scan: 8 ms", "scann: 8 ms"),
        [
            "x.yaml:8:5: scann is not a key here; allowed are name, profile, scan, phase, nn, registers, ports, polls, sources, program, inputs, comments; did you mean scan?"
        ],
    ),
    "duplicate name": (
        changed("name: press3", "name: press2"),
        ["x.yaml:11:12: name is 'press2', which is used already (in line 10)"],
    ),
    "case name": (
        changed("name: press3", "name: Press2"),
        ["x.yaml:11:12: name is 'Press2', which differs only in case from 'press2' (in line 10)"],
    ),
    "bad name": (
        changed("name: press3", "name: press.3"),
        [
            "x.yaml:11:12: name is 'press.3', not a name; allowed are letters, digits, _ and -, with at least one letter"
        ],
    ),
    "timeout 55": (
        changed("50 ms", "55 ms"),
        ["x.yaml:9:65: nn.timeout is 55 ms, allowed are multiples of 10 ms, here 50 ms or 60 ms"],
    ),
    "timeout range": (
        changed("50 ms", "3 s"),
        ["x.yaml:9:65: nn.timeout is 3 s, allowed 50 ms..2250 ms (profile pw10)"],
    ),
    "timeout no unit": (
        changed("50 ms", "50"),
        [
            "x.yaml:9:65: nn.timeout is 50, a time without a unit; write one of ns, us, ms, s, min, h, d, y, such as 50 ms"
        ],
    ),
    "unknown bus": (
        changed("{bus: link, port: COM4, station: 1}", "{bus: lnk, port: COM4, station: 1}"),
        ["x.yaml:10:42: nn.bus is 'lnk', which is no bus; did you mean link?"],
    ),
    "not nn": (
        changed(", nn: true", ""),
        [
            "x.yaml:9:15: nn.bus is link, which is not an N:N link; give that bus nn: true",
            "x.yaml:10:42: nn.bus is link, which is not an N:N link; give that bus nn: true",
            "x.yaml:11:42: nn.bus is link, which is not an N:N link; give that bus nn: true",
        ],
    ),
    "baud": (
        changed("nn: true", "nn: true, baud: 9600"),
        ["x.yaml:5:34: baud is 9600, but an N:N link is always 38400 7E1 (leave it out)"],
    ),
    "format": (
        changed("nn: true", "nn: true, format: 8E1"),
        ["x.yaml:5:36: format is 8E1, but an N:N link is always 38400 7E1 (leave it out)"],
    ),
    "baud value": (
        changed("nn: true}", "nn: true}\n  - {name: b2, baud: 12345}"),
        ["x.yaml:6:22: baud is 12345, allowed 4800, 9600, 19200, 38400, 57600, 115200"],
    ),
    "nn word": (
        changed("nn: true", "nn: yes"),
        ["x.yaml:5:22: nn is 'yes', allowed true, false; did you mean true?"],
    ),
    "port COM5": (
        changed("port: COM4, station: 1", "port: COM5, station: 1"),
        ["x.yaml:10:54: nn.port is COM5, which M8179 cannot select (0: COM3, 1: COM4); allowed COM3, COM4"],
    ),
    "station 8": (
        changed("station: 2", "station: 8"),
        ["x.yaml:11:69: nn.station is 8, allowed 0..7"],
    ),
    "station missing": (
        changed(", station: 2", ""),
        ["x.yaml:11:36: nn.station is missing"],
    ),
    "station text": (
        changed("station: 2", 'station: "2"'),
        ["x.yaml:11:69: nn.station is '2', expected a whole number 0..7; did you mean 2?"],
    ),
    "slaves 0": (
        changed("slaves: 2", "slaves: 0"),
        ["x.yaml:9:53: nn.slaves is 0, allowed 1..7"],
    ),
    "mode 5": (
        changed("slaves: 2", "slaves: 2, mode: 5"),
        ["x.yaml:9:62: nn.mode is 5, allowed 0..4 (profile pw10)"],
    ),
    "mode 5 of an FX3U": (
        changed("slaves: 2", "slaves: 2, mode: 5").replace("scan: 8 ms", "scan: 8 ms\n    profile: fx3u"),
        ["x.yaml:10:62: nn.mode is 5, allowed 0..2 (profile fx3u)"],
    ),
    "mode text": (
        changed("slaves: 2", "slaves: 2, mode: two"),
        ["x.yaml:9:62: nn.mode is 'two', expected a whole number"],
    ),
    "mode fx1s": (
        changed("slaves: 2", "slaves: 2, mode: 1").replace("scan: 8 ms", "scan: 8 ms\n    profile: fx1s"),
        ["x.yaml:10:62: nn.mode is 1, allowed 0 (profile fx1s)"],
    ),
    "profile": (
        changed("scan: 8 ms", "scan: 8 ms\n    profile: pw11"),
        ["x.yaml:9:14: profile is 'pw11', allowed pw10, fx2n, fx3u, fx1s; did you mean pw10?"],
    ),
    "profile override": (
        changed("scan: 8 ms", "scan: 8 ms\n    profile: {base: pw10, turnarround: 1 ms}"),
        ["x.yaml:9:27: profile.turnarround is not a key here; did you mean turnaround?"],
    ),
    "profile attempts": (
        changed("scan: 8 ms", "scan: 8 ms\n    profile: {base: pw10, attempts: retries+2}"),
        ["x.yaml:9:37: profile.attempts is 'retries+2', allowed retries+1, retries; did you mean retries+1?"],
    ),
    "profile blocks overlap": (
        changed("scan: 8 ms", "scan: 8 ms\n    profile: {base: fx2n, modes: [0, 3]}"),
        ["x.yaml:9:34: profile.modes lets the stations' blocks of 16 words overlap: they are 10 apart"],
    ),
    "profile of ports": (
        changed(
            "scan: 8 ms",
            "scan: 8 ms\n    profile: {base: pw10, com2_station: 0, rtu_gaps: {inner: 4}, ascii_gap: 1 us, "
            "slave_backlog: 101, begun_holds: 1, instruction_times: {basic: 80, MOV: 1 us, others: {MOVE: 1 us}}}",
        ),
        [
            "x.yaml:9:41: profile.com2_station is 0, allowed 1..247",
            "x.yaml:9:62: profile.rtu_gaps.inner is 4, more than what ends a frame (3.5)",
            "x.yaml:9:77: profile.ascii_gap is 1 us, allowed 1 ms..60 s",
            "x.yaml:9:98: profile.slave_backlog is 101, allowed 0..100",
            "x.yaml:9:116: profile.begun_holds is 1, allowed true, false; did you mean true?",
            (
                "x.yaml:9:146: profile.instruction_times.basic is 80, a time without a unit; "
                "write one of ns, us, ms, s, min, h, d, y, such as 80 ms"
            ),
            "x.yaml:9:150: profile.instruction_times.MOV is not a key here; allowed are basic, timer, comparison, idle, move, arithmetic, block, each, serial, wide, others; did you mean move?",
            "x.yaml:9:169: profile.instruction_times.others names 'MOVE', no instruction; did you mean MOV?",
        ],
    ),
    "profile silences": (
        changed(
            "scan: 8 ms", "scan: 8 ms\n    profile: {base: pw10, rtu_gaps: {end: 1, fast_character: 0 us}}"
        ),
        [
            "x.yaml:9:62: profile.rtu_gaps.fast_character is 0 us, allowed more than 0..1 s",
        ],
    ),
    "profile silence at the end": (
        changed("scan: 8 ms", "scan: 8 ms\n    profile: {base: pw10, rtu_gaps: {end: 1}}"),
        [
            "x.yaml:9:43: profile.rtu_gaps.end is 1, less than what a frame may have inside (1.5)",
        ],
    ),
    "profile timeouts": (
        changed("scan: 8 ms", "scan: 8 ms\n    profile: {base: fx2n, timeout_range: [10, 9], reply: never}"),
        ["x.yaml:9:58: profile.reply is 'never', allowed interrupt, end"],
    ),
    "profile timeout range": (
        changed("scan: 8 ms", "scan: 8 ms\n    profile: {base: fx2n, timeout_range: [10, 9]}"),
        ["x.yaml:9:42: profile.timeout_range is [10, 9]; the first must not be more than the second"],
    ),
    "profile default timeout": (
        changed("scan: 8 ms", "scan: 8 ms\n    profile: {base: pw10, default_timeout: 230}"),
        ["x.yaml:9:44: profile.default_timeout is 230, allowed 5..225"],
    ),
    "turnaround": (
        changed(
            "scan: 8 ms", "scan: 8 ms\n    profile: {base: pw10, turnaround: {mean: 1 ms, jitter: 2 ms}}"
        ),
        ["x.yaml:9:60: profile.turnaround.jitter must not be more than the mean"],
    ),
    "turnaround weights": (
        changed(
            "scan: 8 ms",
            "scan: 8 ms\n    profile: {base: pw10, turnaround: {values: [1 ms], weights: [1, 2]}}",
        ),
        ["x.yaml:9:65: profile.turnaround.weights has 2 entries, values has 1"],
    ),
    "contradiction": (
        changed("scan: 8 ms", "scan: 8 ms\n    registers: {D8177: 3, D8180: 5}"),
        ["x.yaml:9:24: registers.D8177 is 3, but nn.slaves makes it 2"],
    ),
    "contradiction port": (
        changed("scan: 8 ms", "scan: 8 ms\n    registers: {M8179: 0}"),
        ["x.yaml:9:24: registers.M8179 is 0, but nn.port makes it 1"],
    ),
    "ports contradiction": (
        changed("nn: true}", "nn: true}\n  - {name: link2, nn: true}").replace(
            "scan: 8 ms", "scan: 8 ms\n    ports: {COM4: {bus: link2}}"
        ),
        ["x.yaml:10:25: ports.COM4.bus is link2, but nn.bus is link"],
    ),
    "raw without port": (
        added("  - {name: press4, registers: {D8176: 3}}\n"),
        [
            "x.yaml:12:31: press4 sets D8176 and so takes part in N:N on COM3 (M8179 is 0), but ports does not name the bus; write ports: {COM3: {bus: link}}"
        ],
    ),
    "raw unknown bus": (
        added("  - {name: press4, registers: {D8176: 3}, ports: {COM3: {bus: like}}}\n"),
        ["x.yaml:12:63: ports.COM3.bus is 'like', which is no bus; did you mean link?"],
    ),
    "port COM2": (
        added("  - {name: press4, ports: {COM2: {bus: link}}}\n"),
        [
            "x.yaml:12:40: ports.COM2.bus is link, an N:N link, which COM2 does not have: N:N runs on COM3 or COM4"
        ],
    ),
    "port COM9": (
        added("  - {name: press4, ports: {COMM4: {bus: link}}}\n"),
        ["x.yaml:12:28: ports.COMM4 is not a port; did you mean COM4?"],
    ),
    "port protocol": (
        added("  - {name: press4, ports: {COM3: {bus: link, protocol: modbus-rtu-master}}}\n"),
        [
            "x.yaml:12:56: ports.COM3.protocol is modbus-rtu-master, but link is an N:N link, on which nothing else can run"
        ],
    ),
    "register value": (
        added("  - {name: press4, registers: {D100: 70000}}\n"),
        ["x.yaml:12:38: registers.D100 is 70000, allowed -32768..65535"],
    ),
    "register bit": (
        added("  - {name: press4, registers: {M8179: 2}}\n"),
        [
            "x.yaml:12:31: press4 sets M8179 and so takes part in N:N on COM4 (M8179 is 2), but ports does not name the bus; write ports: {COM4: {bus: link}}",
            "x.yaml:12:39: registers.M8179 is 2, allowed 0, 1",
        ],
    ),
    "register device": (
        added("  - {name: press4, registers: {D9000: 1, X8: 1, Q1: 1}}\n"),
        [
            "x.yaml:12:32: a device of registers is 'D9000', allowed D0–D8255",
            "x.yaml:12:42: a device of registers is 'X8', but X is numbered in octal (no 8 or 9); point 8 of X is X10",
            "x.yaml:12:49: a device of registers is 'Q1', not a device; write a letter of X Y M S T C D and a number",
        ],
    ),
    "register twice": (
        added("  - {name: press4, registers: {D7: 1, D07: 1}}\n"),
        ["x.yaml:12:39: registers.D07 is the same device as D7"],
    ),
    "source device": (
        changed("scan: 8 ms", "scan: 8 ms\n    sources: {Y0: {toggle: 1 s}}"),
        ["x.yaml:9:15: sources.Y0 cannot be driven: a station shares M and D devices only"],
    ),
    "source special": (
        changed("scan: 8 ms", "scan: 8 ms\n    sources: {D8177: {counter: 1 s}}"),
        ["x.yaml:9:15: sources.D8177 is a special device; set it in registers"],
    ),
    "source bit const": (
        changed("scan: 8 ms", "scan: 8 ms\n    sources: {M1000: {constant: 2}}"),
        ["x.yaml:9:33: sources.M1000.constant is 2, allowed 0, 1 (M1000 is a bit)"],
    ),
    "source bit ramp": (
        changed("scan: 8 ms", "scan: 8 ms\n    sources: {M1000: {ramp: {from: 0, to: 1, over: 1 s}}}"),
        ["x.yaml:9:23: sources.M1000.ramp needs a word; M1000 is a bit"],
    ),
    "source two": (
        changed("scan: 8 ms", "scan: 8 ms\n    sources: {D0: {constant: 2, toggle: 1 s}}"),
        ["x.yaml:9:30: sources.D0.constant excludes toggle in the same entry"],
    ),
    "source none": (
        changed("scan: 8 ms", "scan: 8 ms\n    sources: {D0: {}}"),
        ["x.yaml:9:19: sources.D0 says nothing; expected one of toggle, counter, constant, ramp"],
    ),
    "source plain": (
        changed("scan: 8 ms", "scan: 8 ms\n    sources: {D0: 5}"),
        [
            "x.yaml:9:19: sources.D0 is 5, expected {toggle: 1 s}, {counter: 100 ms}, {constant: 5} or {ramp: {from: 0, to: 1000, over: 10 s}}"
        ],
    ),
    "source toggle": (
        changed("scan: 8 ms", "scan: 8 ms\n    sources: {D0: {toggle: 5}}"),
        [
            "x.yaml:9:28: sources.D0.toggle is 5, a time without a unit; write one of ns, us, ms, s, min, h, d, y, such as 5 ms"
        ],
    ),
    "ramp range": (
        changed("scan: 8 ms", "scan: 8 ms\n    sources: {D0: {ramp: {from: 0, to: 100000, over: 1 s}}}"),
        ["x.yaml:9:40: sources.D0.ramp.to is 100000, allowed -32768..65535"],
    ),
}


@pytest.mark.parametrize(("text", "expected"), CASES.values(), ids=CASES.keys())
def test_the_message_says_what_where_and_what_is_allowed(text: str, expected: list[str]) -> None:
    assert mistakes(text) == expected
