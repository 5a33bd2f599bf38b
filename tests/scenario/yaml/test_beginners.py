"""Beginners' mistakes in a packing line's scenario: what is said of each, where, and that no more is said."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from bussim.cli import main
from bussim.scenario.yaml import parser as yaml
from tests.scenario.samples import mistakes
from tests.selection import quick

LINE = """\
schema: 1
name: packing line
duration: 60 s
buses:
  - {name: link, nn: true}
  - {name: hmi, baud: 19200, format: 8N1}
  - {name: vfd, baud: 9600, format: 8N1}
plcs:
  - name: main
    profile: pw10
    scan: {mean: 10 ms, jitter: 2 ms}
    nn: {bus: link, port: COM4, station: 0, slaves: 4, mode: 2, retries: 3, timeout: 50 ms}
    ports:
      COM2: {bus: hmi, protocol: modbus-rtu-slave}
      COM3: {bus: vfd, protocol: modbus-rtu-master, timeout: 100 ms}
    polls:
      - {name: vfd_status, port: COM3, station: 1, function: 3, address: 0x2100, count: 4, to: D400, every: 100 ms, retries: 2}
      - {name: vfd_cmd, port: COM3, station: 1, function: 16, address: 0x2000, count: 2, from: D410, every: 200 ms, retries: 2}
  - {name: feeder, scan: 6 ms, nn: {bus: link, port: COM4, station: 1}}
  - {name: wrapper, scan: 12 ms, nn: {bus: link, port: COM4, station: 2}}
  - {name: labeler, scan: 5 ms, nn: {bus: link, port: COM4, station: 3}}
  - {name: palletizer, scan: 20 ms, nn: {bus: link, port: COM4, station: 4}}
devices:
  - name: panel
    model: hmi
    bus: hmi
    polls:
      - {station: 1, function: 3, address: 0, count: 20, every: 250 ms}
      - {station: 1, function: 1, address: 0, count: 16, every: 500 ms}
  - name: vfd1
    model: map
    bus: vfd
    station: 1
    delay: 5 ms
    registers:
      - {address: 0x2000, count: 2, value: 0, writable: true}
      - {address: 0x2100, count: 4, value: 0}
# end
"""

#: What stands in the scenario, what is written instead, and all that is said.
CASES: dict[str, tuple[str, str, list[str]]] = {
    "no blank after a colon": (
        "duration: 60 s",
        "duration:60 s",
        [
            "3:1: duration has no blank after its colon; write duration: 60 s",
        ],
    ),
    "no blank after a colon in a list entry": (
        "  - name: main",
        "  - name:main",
        [
            "9:5: name has no blank after its colon; write name: main",
        ],
    ),
    "no blank after a colon below": (
        "    profile: pw10",
        "    profile:pw10",
        [
            "10:5: profile has no blank after its colon; write profile: pw10",
        ],
    ),
    "no blank after a colon in braces": (
        "{name: feeder,",
        "{name:feeder,",
        [
            "19:6: name has no blank after its colon; write name: feeder",
        ],
    ),
    "no blank after the last colon": (
        "delay: 5 ms",
        "delay:5 ms",
        [
            "34:5: delay has no blank after its colon; write delay: 5 ms",
        ],
    ),
    "no blank after a dash": (
        "  - {name: link",
        "  -{name: link",
        [
            "5:3: a list entry has no blank after its dash; write - {name: link",
        ],
    ),
    "no colon after a section": (
        "buses:\n",
        "buses\n",
        [
            "4:1: buses has no colon; write buses:",
        ],
    ),
    "no colon after a key": (
        "duration: 60 s",
        "duration 60 s",
        [
            "3:1: duration has no colon; write duration: 60 s",
        ],
    ),
    "tab": (
        "    profile: pw10",
        "\tprofile: pw10",
        [
            "10:1: a tab indents the line; YAML takes blanks only",
        ],
    ),
    "tab after a dash": (
        "  - name: main",
        "  -\tname: main",
        [
            "9:5: there is a tab; write a blank",
        ],
    ),
    "tab after a colon": (
        "duration: 60 s",
        "duration:\t60 s",
        [
            "3:11: there is a tab; write a blank",
        ],
    ),
    "indented less": (
        "    profile: pw10",
        "   profile: pw10",
        [
            "10:4: the line begins in column 4; expected column 5, as a line above it",
        ],
    ),
    "indented more": (
        "    profile: pw10",
        "     profile: pw10",
        [
            "10:6: the line begins in column 6; expected column 5, as a line above it",
        ],
    ),
    "key at the top indented": (
        "duration: 60 s",
        " duration: 60 s",
        [
            "3:2: the line begins in column 2; expected column 1, as a line above it",
        ],
    ),
    "list entry indented": (
        "  - {name: feeder",
        "   - {name: feeder",
        [
            "19:4: the line begins in column 4; expected column 3, as a line above it",
        ],
    ),
    "key not indented": (
        "    nn: {bus: link, port: COM4, station: 0",
        "nn: {bus: link, port: COM4, station: 0",
        [
            "12:1: the line begins in column 1; expected column 5, as a line above it",
        ],
    ),
    "keys beside the one they belong to": (
        "nn: {bus: link, port: COM4, station: 3}",
        "nn: {bus: link, station: 3}, port: COM4",
        [
            "21:62: port is not a key here; allowed are name, profile, scan, phase, nn, registers, ports, polls, sources, program, inputs, comments; it belongs into nn",
        ],
    ),
    "brace never closed": (
        "timeout: 50 ms}",
        "timeout: 50 ms",
        [
            "12:91: a { is never closed; write } here",
        ],
    ),
    "outer brace never closed": (
        "station: 2}}",
        "station: 2}",
        [
            "20:73: a { is never closed; write } here",
        ],
    ),
    "bracket never closed": (
        "duration: 60 s",
        "observe: [main.D400, main.D401\nduration: 60 s",
        [
            "3:31: a [ is never closed; write ] here",
        ],
    ),
    "bracket never closed at the end": (
        "value: 0}\n#",
        "value: 0}\nobserve: [main.D400, main.D401\n#",
        [
            "38:31: a [ is never closed; write ] here",
        ],
    ),
    "brace too many": (
        "station: 1}}",
        "station: 1}}}",
        [
            "19:70: there is a } too many: it closes nothing",
        ],
    ),
    "bracket for a brace": (
        "station: 2}}",
        "station: 2]}",
        [
            "20:72: ] closes a {; write }",
        ],
    ),
    "round brackets": (
        "{name: link, nn: true}",
        "(name: link, nn: true)",
        [
            "5:5: (name: link, nn: true) has round brackets; write {name: link, nn: true}",
        ],
    ),
    "quote never closed": (
        "name: packing line",
        'name: "packing line',
        [
            '2:7: the " is never closed; write "packing line"',
        ],
    ),
    "single quote never closed": (
        "name: packing line",
        "name: 'packing line",
        [
            "2:7: the ' is never closed; write 'packing line'",
        ],
    ),
    "quote never closed in braces": (
        "{name: feeder,",
        '{name: "feeder,',
        [
            '19:12: the " is never closed; write "feeder"',
        ],
    ),
    "comma missing": (
        "{name: feeder, scan",
        "{name: feeder scan",
        [
            "19:19: a comma is missing before scan",
        ],
    ),
    "two commas": (
        "COM4, station: 2",
        "COM4,, station: 2",
        [
            "20:60: there is a comma too many",
        ],
    ),
    "semicolon": (
        "COM4, station: 2",
        "COM4; station: 2",
        [
            "20:60: there is a ; for a comma; write ,",
        ],
    ),
    "equals sign": (
        "duration: 60 s",
        "duration = 60 s",
        [
            "3:1: duration has a = instead of a colon; write duration: 60 s",
        ],
    ),
    "equals sign in braces": (
        "station: 2}",
        "station = 2}",
        [
            "20:62: station has a = instead of a colon; write station: 2",
        ],
    ),
    "two keys in a line": (
        "duration: 60 s",
        "duration: 60 s, seed: 4",
        [
            "3:1: seed stands in the same line as duration; give it a line of its own",
        ],
    ),
    "colon in a name": (
        "name: packing line",
        "name: packing: line 2",
        [
            "2:1: name is a text with a colon in it; write it in quotes",
        ],
    ),
    "at sign": (
        "name: packing line",
        "name: @packing",
        [
            '2:7: @packing begins with a sign of YAML; write "@packing"',
        ],
    ),
    "comment with slashes": (
        "duration: 60 s",
        "// a minute\nduration: 60 s",
        [
            "3:1: a comment begins with //; write #",
        ],
    ),
    "comment without a blank": (
        "duration: 60 s",
        "duration: 60 s# a minute",
        [
            "3:11: duration is '60 s# a minute', not a time; write a number and a unit, such as 8 ms; a comment begins with a blank and #",
        ],
    ),
    "comma at the end": (
        "duration: 60 s",
        "duration: 60 s,",
        [
            "3:11: duration is '60 s,', not a time; write a number and a unit, such as 8 ms; leave the , at its end out",
        ],
    ),
    "mapping among list entries": (
        "  - {name: labeler, ",
        "  labeler: {",
        [
            "21:3: labeler is a mapping among list entries; write - {name: labeler, scan: 5 ms …",
        ],
    ),
    "mapping first among list entries": (
        "      - {name: vfd_status, ",
        "      vfd_status: {",
        [
            "17:7: vfd_status is a mapping among list entries; write - {name: vfd_status, port: COM3 …",
        ],
    ),
    "dash missing": (
        "  - name: vfd1\n",
        "  name: vfd1\n",
        [
            "30:3: name begins no list entry; for one write - name: vfd1",
        ],
    ),
    "blanks for a dash": (
        "  - name: vfd1\n",
        "    name: vfd1\n",
        [
            "30:5: name is given twice, first in line 24; name begins no list entry; for one write - name: vfd1",
        ],
    ),
    "mapping for a list": (
        "buses:\n  - {name: link, nn: true}\n  - {name: hmi, baud: 19200, format: 8N1}\n  - {name: vfd, baud: 9600, format: 8N1}",
        "buses:\n  link: {nn: true}\n  hmi: {baud: 19200, format: 8N1}\n  vfd: {baud: 9600, format: 8N1}",
        [
            "5:3: buses is a mapping, expected a list, each entry with a dash: - {name: link, nn: true}",
        ],
    ),
    "list for a mapping": (
        "      COM2: {bus: hmi, protocol: modbus-rtu-slave}\n      COM3: {bus: vfd,",
        "      - COM2: {bus: hmi, protocol: modbus-rtu-slave}\n      - COM3: {bus: vfd,",
        [
            "14:7: ports is a list, expected a mapping such as {COM3: {bus: feeder, protocol: modbus-rtu-master}}",
        ],
    ),
    "word for a mapping": (
        "nn: {bus: link, port: COM4, station: 1}",
        "nn: link",
        [
            "19:36: nn is 'link', expected {bus: link, port: COM4, station: 1}",
        ],
    ),
    "key given twice": (
        "    profile: pw10",
        "    profile: pw10\n    profile: fx2n",
        [
            "11:5: profile is given twice, first in line 10",
        ],
    ),
    "key of another word": (
        "    profile: pw10",
        "    Profile: pw10",
        [
            "10:5: Profile is not a key here; allowed are name, profile, scan, phase, nn, registers, ports, polls, sources, program, inputs, comments; did you mean profile?",
        ],
    ),
    "wide colon": (
        "duration: 60 s",
        "duration：60 s",
        [
            "3:9: there is ： (fullwidth colon); write :",
        ],
    ),
    "wide colon and blank": (
        "duration: 60 s",
        "duration： 60 s",
        [
            "3:9: there is ： (fullwidth colon); write :",
        ],
    ),
    "wide colon in braces": (
        "{name: feeder",
        "{name：feeder",
        [
            "19:10: there is ： (fullwidth colon); write :",
        ],
    ),
    "wide comma": (
        "scan: 6 ms, nn",
        "scan: 6 ms，nn",
        [
            "19:30: there is ， (fullwidth comma); write ,",
        ],
    ),
    "wide semicolon": (
        "COM4, station: 2",
        "COM4； station: 2",
        [
            "20:60: there is ； (fullwidth semicolon); write ,",
        ],
    ),
    "enumeration comma": (
        "COM4, station: 2",
        "COM4、 station: 2",
        [
            "20:60: there is 、 (ideographic comma); write ,",
        ],
    ),
    "wide braces": (
        "{bus: link, port: COM4, station: 3}",
        "｛bus: link, port: COM4, station: 3｝",
        [
            "21:37: there is ｛ (fullwidth left curly bracket); write {",
            "21:71: there is ｝ (fullwidth right curly bracket); write }",
        ],
    ),
    "wide brackets": (
        "{bus: link, port: COM4, station: 3}",
        "（bus: link, port: COM4, station: 3）",
        [
            "21:37: there is （ (fullwidth left parenthesis); write {",
            "21:71: there is ） (fullwidth right parenthesis); write }",
        ],
    ),
    "lenticular brackets": (
        "duration: 60 s",
        "duration: 60 s\nobserve: 【main.D400】",
        [
            "4:10: observe is '【main.D400】', expected a list, each entry with a dash: - press1.D8201; there is 【 (left black lenticular bracket), write [",
        ],
    ),
    "wide quotes of a name": (
        "{name: feeder",
        "{name: “feeder”",
        [
            "19:12: name is '“feeder”', not a name; allowed are letters, digits, _ and -, with at least one letter; did you mean feeder?; there is “ (left double quotation mark), write \"",
        ],
    ),
    "German quotes of a profile": (
        "profile: pw10",
        "profile: „pw10“",
        [
            "10:14: profile is '„pw10“', allowed pw10, fx2n, fx3u, fx1s; did you mean pw10?; there is „ (double low-9 quotation mark), write \"",
        ],
    ),
    "wide blanks that indent": (
        "    profile: pw10",
        "\u3000\u3000profile: pw10",
        [
            "10:1: U+3000 (ideographic space) indents the line; YAML takes blanks only",
        ],
    ),
    "no-break spaces that indent": (
        "    profile: pw10",
        "\u00a0\u00a0\u00a0\u00a0profile: pw10",
        [
            "10:1: U+00A0 (no-break space) indents the line; YAML takes blanks only",
        ],
    ),
    "wide blank after a colon": (
        "duration: 60 s",
        "duration:\u300060 s",
        [
            "3:10: there is U+3000 (ideographic space); write a blank",
        ],
    ),
    "wide dash": (
        "  - name: panel",
        "  － name: panel",
        [
            "24:3: there is － (fullwidth hyphen-minus); write -",
        ],
    ),
    "long dash": (
        "  - {name: feeder",
        "  – {name: feeder",
        [
            "19:3: there is – (en dash); write -",
        ],
    ),
    "wide number sign": (
        "duration: 60 s",
        "duration: 60 s ＃ a minute",
        [
            "3:11: duration is '60 s ＃ a minute', not a time; write a number and a unit, such as 8 ms; there is ＃ (fullwidth number sign), write #",
        ],
    ),
    "wide letter in a key": (
        "duration: 60 s",
        "ｄuration: 60 s",
        [
            "1:1: duration is missing",
            "3:1: ｄuration is not a key here; allowed are schema, name, duration, seed, buses, plcs, devices, noise, faults, observe, latency, warnings, allow_unsimulated; did you mean duration?; there is ｄ (fullwidth latin small letter d), write d",
        ],
    ),
    "decimal comma": (
        "delay: 5 ms",
        "delay: 5,5 ms",
        [
            "34:12: delay is '5,5 ms', not a time; write a number and a unit, such as 5.5 ms",
        ],
    ),
    "decimal comma in braces": (
        "mean: 10 ms,",
        "mean: 10,5 ms,",
        [
            "11:18: the comma of 10,5 begins another key; write 10.5 ms",
        ],
    ),
    "comma in a rate": (
        "baud: 9600",
        "baud: 9,600",
        [
            "7:23: the comma of 9,600 begins another key; write 9600",
        ],
    ),
    "point in a rate": (
        "baud: 9600",
        "baud: 9.600",
        [
            "7:23: baud is 9.600, allowed 4800, 9600, 19200, 38400, 57600, 115200; did you mean 9600?",
        ],
    ),
    "unit of a rate": (
        "baud: 9600",
        "baud: 9.6k",
        [
            "7:23: baud is '9.6k', allowed 4800, 9600, 19200, 38400, 57600, 115200; did you mean 9600?",
        ],
    ),
    "no unit": (
        "scan: 5 ms",
        "scan: 5",
        [
            "21:27: scan is 5, a time without a unit; write one of ns, us, ms, s, min, h, d, y, such as 5 ms",
        ],
    ),
    "unit in capitals": (
        "scan: 5 ms",
        "scan: 5 MS",
        [
            "21:27: scan has the unit 'MS'; allowed are ns, us, ms, s, min, h, d, y; did you mean ms?",
        ],
    ),
    "seconds in full": (
        "duration: 60 s",
        "duration: 60 seconds",
        [
            "3:11: duration has the unit 'seconds'; allowed are ns, us, ms, s, min, h, d, y; did you mean s?",
        ],
    ),
    "milliseconds in Chinese": (
        "scan: 5 ms",
        "scan: 5 毫秒",
        [
            "21:27: scan has the unit '毫秒'; allowed are ns, us, ms, s, min, h, d, y; did you mean ms?",
        ],
    ),
    "minutes in Chinese": (
        "duration: 60 s",
        "duration: 10分钟",
        [
            "3:11: duration has the unit '分钟'; allowed are ns, us, ms, s, min, h, d, y; did you mean min?",
        ],
    ),
    "unit with two meanings": (
        "duration: 60 s",
        "duration: 1 m",
        [
            "3:11: duration has the unit 'm'; allowed are ns, us, ms, s, min, h, d, y; did you mean ms or min?",
        ],
    ),
    "station as text": (
        "station: 1}}",
        'station: "1"}}',
        [
            "19:69: nn.station is '1', expected a whole number 0..7; did you mean 1?",
        ],
    ),
    "station with a point": (
        "station: 1}}",
        "station: 1.0}}",
        [
            "19:69: nn.station is 1.0, expected a whole number 0..7; did you mean 1?",
        ],
    ),
    "station as a constant of a program": (
        "station: 1}}",
        "station: K1}}",
        [
            "19:69: nn.station is 'K1', expected a whole number 0..7; did you mean 1?",
        ],
    ),
    "address in hexadecimal": (
        "address: 0x2100",
        "address: 2100H",
        [
            "17:74: polls.0.address is '2100H', expected a whole number 0..65535; did you mean 0x2100?",
        ],
    ),
    "per cent": (
        "devices:",
        "noise:\n  - {bus: link, reply_loss: 1%}\ndevices:",
        [
            "24:29: reply_loss is '1%', expected a number 0..1; did you mean 0.01?",
        ],
    ),
    "yes": (
        "nn: true",
        "nn: yes",
        [
            "5:22: nn is 'yes', allowed true, false; did you mean true?",
        ],
    ),
    "yes in Chinese": (
        "nn: true",
        "nn: 是",
        [
            "5:22: nn is '是', allowed true, false; did you mean true?",
        ],
    ),
    "truth in quotes": (
        "nn: true",
        'nn: "true"',
        [
            "5:22: nn is 'true', allowed true, false; did you mean true?",
        ],
    ),
    "name true": (
        "{name: feeder",
        "{name: true",
        [
            "19:12: name is true, not a name; allowed are letters, digits, _ and -, with at least one letter; true and false are names in quotes",
        ],
    ),
    "name with a blank": (
        "{name: feeder",
        "{name: feed er",
        [
            "19:12: name is 'feed er', not a name; allowed are letters, digits, _ and -, with at least one letter; did you mean feed_er?",
        ],
    ),
    "port in small letters": (
        "port: COM4, station: 1",
        "port: com4, station: 1",
        [
            "19:54: nn.port is 'com4', allowed COM3, COM4; did you mean COM4?",
        ],
    ),
    "port as a number": (
        "port: COM4, station: 1",
        "port: 4, station: 1",
        [
            "19:54: nn.port is 4, allowed COM3, COM4; did you mean COM4?",
        ],
    ),
    "protocol with underscores": (
        "modbus-rtu-slave",
        "modbus_rtu_slave",
        [
            "14:34: ports.COM2.protocol is 'modbus_rtu_slave', allowed hmi, modbus-rtu-slave, modbus-ascii-slave, free, modbus-rtu-master, modbus-ascii-master; did you mean modbus-rtu-slave?",
        ],
    ),
    "bus in capitals": (
        "bus: link, port: COM4, station: 1",
        "bus: Link, port: COM4, station: 1",
        [
            "19:42: nn.bus is 'Link', which is no bus; did you mean link?",
        ],
    ),
    "schema as text": (
        "schema: 1",
        'schema: "1"',
        [
            "1:9: schema is '1', allowed 1; did you mean 1?",
        ],
    ),
}


def test_the_line_itself_is_right() -> None:
    assert mistakes(LINE) == []


@pytest.mark.parametrize(("right", "wrong", "said"), CASES.values(), ids=CASES.keys())
def test_a_mistake_is_named_with_its_place_and_what_is_right(right: str, wrong: str, said: list[str]) -> None:
    assert right in LINE
    assert mistakes(LINE.replace(right, wrong, 1)) == [f"x.yaml:{message}" for message in said]


def test_whole_texts_with_wide_colons() -> None:
    assert mistakes("schema: 1\nname: 测试\nduration： 60 s\n") == [
        "x.yaml:1:1: plcs is missing",
        "x.yaml:3:9: there is ： (fullwidth colon); write :",
    ]
    assert mistakes("schema：1\nname：测试\nduration：10 s\n") == [
        "x.yaml:1:1: plcs is missing",
        "x.yaml:1:7: there is ： (fullwidth colon); write :",
        "x.yaml:2:5: there is ： (fullwidth colon); write :",
        "x.yaml:3:9: there is ： (fullwidth colon); write :",
    ]


def test_wide_comma_in_a_short_scenario() -> None:
    text = (
        "schema: 1\nname: a\nduration: 60 s\nbuses: [{name: link, nn: true}]\nplcs:\n"
        "  - {name: m, scan: 5 ms，nn: {bus: link, port: COM4, station: 0, slaves: 1}}\n"
    )
    assert mistakes(text) == ["x.yaml:6:25: there is ， (fullwidth comma); write ,"]


def test_wide_punctuation_that_is_meant_is_left_alone() -> None:
    text = LINE.replace("name: packing line", "name: 包装线，第二条：测试（一）")
    assert mistakes(text) == []
    assert mistakes(text.replace("duration: 60 s", "duration:60 s")) == [
        "x.yaml:3:1: duration has no blank after its colon; write duration: 60 s"
    ]


def test_every_mistake_is_named_and_those_of_values_beside_them_at_their_own_places() -> None:
    text = LINE
    for right, wrong in (
        ("duration: 60 s", "duration:60 s"),
        ("{name: hmi, baud: 19200", "{name：hmi, baud: 19201"),
        ("retries: 3,", "retries: 30,"),
        ("timeout: 50 ms}", "timeout: 55 ms"),
        ("  - {name: labeler, ", "  labeler: {"),
        ("bus: link, port: COM4, station: 4", "bus: lnk，port: COM4, station: 4"),
        ("    station: 1\n    delay: 5 ms", "    station: 1\n\tdelay: 5 msec"),
    ):
        assert right in text
        text = text.replace(right, wrong, 1)
    assert mistakes(text) == [
        "x.yaml:3:1: duration has no blank after its colon; write duration: 60 s",
        "x.yaml:6:10: there is ： (fullwidth colon); write :",
        "x.yaml:6:22: baud is 19201, allowed 4800, 9600, 19200, 38400, 57600, 115200",
        "x.yaml:12:74: nn.retries is 30, allowed 0..10",
        "x.yaml:12:87: nn.timeout is 55 ms, allowed are multiples of 10 ms, here 50 ms or 60 ms",
        "x.yaml:12:92: a { is never closed; write } here",
        "x.yaml:21:3: labeler is a mapping among list entries; write - {name: labeler, scan: 5 ms …",
        "x.yaml:22:47: nn.bus is 'lnk', which is no bus; did you mean link?",
        "x.yaml:22:50: there is ， (fullwidth comma); write ,",
        "x.yaml:34:1: a tab indents the line; YAML takes blanks only",
        "x.yaml:34:9: delay has the unit 'msec'; allowed are ns, us, ms, s, min, h, d, y; did you mean ms?",
    ]


def _lines_named(text: str) -> set[int]:
    return {int(message.split(":")[1]) for message in mistakes(text)}


#: Lines that begin with a key whose value stands beside it, and what may stand for the colon and the blank.
COLONS = [
    (number, wrong)
    for wrong in (":", "：", " ", " = ")
    for number, line in enumerate(LINE.splitlines(), 1)
    if re.match(r"( *(?:- )?\w+): (?=\S)", line)
]


@pytest.mark.parametrize(("number", "wrong"), quick(20, COLONS))
def test_the_line_is_the_right_one_whatever_stands_for_its_first_colon(number: int, wrong: str) -> None:
    lines = LINE.splitlines()
    lines[number - 1] = lines[number - 1].replace(": ", wrong, 1)
    assert _lines_named("\n".join(lines)) == {number}


@pytest.mark.parametrize(
    "number", quick(5, [number for number, line in enumerate(LINE.splitlines(), 1) if "}" in line])
)
def test_the_line_is_the_right_one_where_a_brace_is_missing_or_too_many(number: int) -> None:
    lines = LINE.splitlines()
    cut, doubled = list(lines), list(lines)
    cut[number - 1] = lines[number - 1].rstrip()[:-1]
    doubled[number - 1] = lines[number - 1].rstrip() + "}"
    assert _lines_named("\n".join(cut)) == _lines_named("\n".join(doubled)) == {number}


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_places_do_not_depend_on_line_ends_or_a_byte_order_mark(end: str) -> None:
    text = LINE.replace("duration: 60 s", "duration:60 s").replace("\n", end)
    for source in (text, "\ufeff" + text, text.encode("utf-8-sig")):
        _, _, problems = yaml.read(source, "x.yaml")
        assert [(problem.line, problem.column) for problem in problems] == [(3, 1)]


@pytest.mark.parametrize(
    ("coding", "said"),
    [
        ("utf-16", "1:1: is UTF-16 text; save the file as UTF-8"),
        ("utf-16-le", "1:1: is UTF-16 text; save the file as UTF-8"),
        ("utf-16-be", "1:1: is UTF-16 text; save the file as UTF-8"),
        (
            "gbk",
            "2:7: the byte 0xB0 is not UTF-8 text; save the file as UTF-8 (is it in GBK, Big5, Shift-JIS or Latin-1?)",
        ),
    ],
)
def test_other_codings(
    coding: str,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("x.yaml").write_bytes(LINE.replace("packing line", "包装线").encode(coding))
    assert main(["check", "x.yaml"]) == 2
    assert capsys.readouterr().err == f"x.yaml:{said}\n"


@pytest.mark.parametrize("name", ["README.md", "pyproject.toml", "bussim/cli.py"])
def test_of_another_kind_of_file_one_thing_is_said(name: str) -> None:
    text = Path(__file__).parents[3].joinpath(name).read_text(encoding="utf-8")
    assert len(mistakes(text)) == 1


@pytest.mark.slow
def test_of_very_many_mistakes_some_are_named_and_the_search_ends() -> None:
    assert 50 < len(mistakes(re.sub(": ", ":", LINE * 5))) < 1000


@pytest.mark.parametrize(
    ("device", "said"),
    [
        (
            'model: free, bus: hmi, says: [{data: "11 12 13 14", at: 500 ms}]',
            [
                "50: says.0.data is not a key here; allowed are text, bytes, at, every, times, jitter, reply_to, delay"
            ],
        ),
        (
            'model: free, bus: hmi, says: [{text: "A", reply_too: "B"}]',
            [
                (
                    "61: says.0.reply_too is not a key here; allowed are text, bytes, at, every, times, "
                    "jitter, reply_to, delay; did you mean reply_to?"
                )
            ],
        ),
        (
            "model: stepper, bus: vfd, station: 2, switches: [{inptu: 1, low: -100, high: 0}]",
            [
                "68: switches.0.input is missing",
                "69: switches.0.inptu is not a key here; allowed are input, low, high; did you mean input?",
            ],
        ),
    ],
)
def test_the_keys_of_the_entries_of_a_list_are_offered(device: str, said: list[str]) -> None:
    text = LINE.replace("# end", f"  - {{name: extra, {device}}}")
    assert mistakes(text) == [f"x.yaml:38:{message}" for message in said]
