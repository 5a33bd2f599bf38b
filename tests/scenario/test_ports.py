"""What the ports and polls of a good scenario become: the PLC's registers, and frozen values."""

from __future__ import annotations

import pytest

from bussim.line.characters import CharFormat, LineTiming
from bussim.plc.memory import Device, Memory
from bussim.plc.ports.cpavl import PortSettings, decode_format, read_settings
from bussim.plc.ports.spec import FreeSpec, PollSpec, PortSpec
from bussim.scenario.loader import loads
from bussim.scenario.model import Plc
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND
from tests.scenario.port_samples import FREE_POLL, FREE_PORT, MASTER, POLL, PORTS, SLAVE, changed

MS, S = TICKS_PER_MS, TICKS_PER_SECOND


def _plc(number: int, *changes: tuple[str, str]) -> Plc:
    return loads(changed(*changes)).plcs[number]


def _settings(plc: Plc, port: str) -> PortSettings:
    """What the PLC itself reads at STOP→RUN."""
    memory = Memory()
    for name, value in plc.registers.items():
        memory.set(Device(name[0], int(name[1:])), value)
    words = next(spec.words for spec in plc.ports if spec.name == port)
    settings = read_settings(port, memory, words)
    assert isinstance(settings, PortSettings)
    return settings


def test_the_friendly_keys_are_cpavl_words() -> None:
    port = "COM3: {bus: line, protocol: modbus-rtu-master, timeout: 250 ms, interval: 1.2 ms}"
    plc = _plc(0, (MASTER, port))
    words = {name: value for name, value in plc.registers.items() if name.startswith("D792")}
    assert words == {"D7920": 0x81, "D7922": 12, "D7926": 0x20, "D7929": 25}
    assert _settings(plc, "COM3") == PortSettings(
        timing=LineTiming(9600, CharFormat(8, "N", 1)),
        eight_bit=False,
        protocol="modbus-rtu-master",
        station=0,
        interval=round(1.2 * MS),
        start=0,
        end=0,
        timeout=250 * MS,
    )


def test_a_master_without_times_has_the_manuals() -> None:
    settings = _settings(_plc(0), "COM3")
    assert (settings.timeout, settings.interval) == (100 * MS, 5 * MS)


def test_a_free_port() -> None:
    port = 'COM5: {bus: codes, protocol: free, start: 0x02, end: "\\r", eight_bit: true, timeout: 200 ms}'
    settings = _settings(_plc(0, (FREE_PORT, port)), "COM5")
    assert (settings.start, settings.end, settings.eight_bit) == (2, 13, True)
    assert (settings.protocol, settings.timeout) == ("free", 200 * MS)
    assert settings.timing == LineTiming(9600, CharFormat(7, "E", 1))  # the bus's
    sixteen = _settings(_plc(0), "COM5")
    assert (sixteen.start, sixteen.end, sixteen.eight_bit) == (0, 0, False)


def test_a_slave_has_its_station_in_its_words_and_com2_in_d8121() -> None:
    assert _plc(1).registers["D7921"] == 2
    plc = _plc(1, (SLAVE, "COM2: {bus: line, protocol: modbus-rtu-slave, station: 9}"))
    assert plc.registers["D8121"] == 9
    assert "D7901" not in plc.registers
    assert _settings(plc, "COM2").station == 9


def test_com2_has_its_station_from_power_on() -> None:
    port = "COM2: {bus: line, protocol: modbus-rtu-slave}"
    plc = _plc(1, (SLAVE, port))
    assert plc.registers["D8121"] == _settings(plc, "COM2").station == 1
    plc = _plc(1, (SLAVE, port), ("scan: 5 ms", "scan: 5 ms\n    profile: {base: pw10, com2_station: 33}"))
    assert plc.registers["D8121"] == _settings(plc, "COM2").station == 33
    raw = "COM2: {bus: line, cpavl: {words: D100, bits: M100}}"
    text = changed((SLAVE, raw), ("scan: 5 ms", "scan: 5 ms\n    registers: {D100: 0x81, D106: 2}"))
    found = loads(text)
    assert "D8121" not in found.plcs[1].registers  # the profile's, which the check knows
    assert any("press2.COM2 and drive on line are both station 1" in text for text in found.warnings)


def test_a_port_may_have_a_line_of_its_own() -> None:
    plc = _plc(0, (MASTER, "COM3: {bus: line, protocol: modbus-rtu-master, baud: 115200, format: 8E2}"))
    assert decode_format(plc.registers["D7920"]) == (LineTiming(115200, CharFormat(8, "E", 2)), False)


def test_where_the_words_lie() -> None:
    plc = _plc(0, (MASTER, MASTER.replace("}", ", cpavl: {words: D500, bits: M700}}")))
    assert plc.ports == (
        PortSpec("COM3", "line", Device("D", 500), Device("M", 700)),
        PortSpec("COM5", "codes", Device("D", 7960), Device("M", 2960)),
    )
    assert plc.registers["D506"] == 0x20
    assert not any(name.startswith("D792") for name in plc.registers)


def test_registers_fill_what_the_port_leaves_open() -> None:
    plc = _plc(0, ("scan: 8 ms", "scan: 8 ms\n    registers: {D7929: 30, D7920: 0x91, D7926: 0x20}"))
    settings = _settings(plc, "COM3")
    assert (settings.timeout, settings.timing.baud) == (300 * MS, 19200)


def test_a_port_by_its_words_alone_gets_no_defaults() -> None:
    plc = _plc(
        1,
        ("scan: 5 ms", "scan: 5 ms\n    registers: {D101: 2, D106: 2}"),
        (SLAVE, "COM3: {bus: line, cpavl: {words: D100, bits: M100}}"),
    )
    assert plc.registers == {"D101": 2, "D106": 2, "D8176": 1, "M8179": 1}
    assert _settings(plc, "COM3").station == 2


@pytest.mark.parametrize("protocol", ["modbus-rtu-master", "modbus-ascii-master", "free"])
def test_com2_is_the_hmis_unless_something_else_is_said(protocol: str) -> None:
    assert _settings(_plc(1, (SLAVE, "COM2: {bus: line}")), "COM2").protocol == "hmi"
    plc = _plc(1, (SLAVE, f"COM2: {{bus: line, protocol: {protocol}}}"))
    assert _settings(plc, "COM2").protocol == protocol


def test_the_names_of_ports_as_nodes_of_their_buses() -> None:
    found = loads(PORTS)
    assert found.nodes_on("link") == ("press1", "press2")
    assert found.nodes_on("line") == ("press1.COM3", "press2.COM3", "drive")
    assert found.nodes_on("codes") == ("press1.COM5", "reader")


def test_polls() -> None:
    polls = (
        "{name: where, port: COM3, station: 1, function: 3, address: 0x16, count: 2, to: D400, every: 200 ms, "
        "at: 1 s, times: 9, retries: 3}\n"
        "      - {port: COM3, station: 1, function: 0x10, address: 9, values: [20000, -1]}\n"
        "      - {port: COM3, station: 2, function: 0x0F, address: 5, count: 3, from: M100}\n"
        "      - {port: COM3, station: 2, function: 5, address: 5, from: Y10, values: [1]}"
    )
    press1 = _plc(0, (POLL, polls))
    assert press1.polls[:4] == (
        PollSpec("where", "COM3", 1, 3, 0x16, 2, Device("D", 400), (), 200 * MS, S, 9, 3),
        PollSpec("COM3 station 1 10 @9", "COM3", 1, 16, 9, 2, None, (20000, 65535)),
        PollSpec("COM3 station 2 0F @5", "COM3", 2, 15, 5, 3, Device("M", 100)),
        PollSpec("COM3 station 2 05 @5", "COM3", 2, 5, 5, 1, Device("Y", 8), (1,)),
    )


def test_names_that_polls_are_given_do_not_depend_on_other_polls() -> None:
    twice = _plc(0, (POLL, f"{POLL}\n      - {POLL}")).polls
    other = POLL.replace("address: 0", "address: 7")
    before = _plc(0, (POLL, f"{other}\n      - {POLL}\n      - {POLL}")).polls
    assert [poll.name for poll in twice] == [
        "COM3 station 1 03 @0",
        "COM3 station 1 03 @0 #2",
        "COM5 free",
    ]
    assert [poll.name for poll in before][1:] == [poll.name for poll in twice]


def test_free_polls() -> None:
    polls = (
        '{port: COM5, send: D200, data: "01 0x02 0d", to: D300, count: 20, every: 1 s}\n'
        '      - {port: COM5, send: D200, text: "AB\\r", send_count: 8, at: 2 s, times: 1}\n'
        "      - {port: COM5, send: D200, send_count: 5}"
    )
    d200, d300 = Device("D", 200), Device("D", 300)
    assert _plc(0, (FREE_POLL, polls)).polls[1:] == (
        FreeSpec("COM5 free", "COM5", d200, 3, b"\x01\x02\r", d300, 20, S),
        FreeSpec("COM5 free #2", "COM5", d200, 8, b"AB\r", at=2 * S, times=1),
        FreeSpec("COM5 free #3", "COM5", d200, 5),
    )


def test_one_plc_can_have_two_ports_on_one_bus() -> None:
    press1 = _plc(
        0,
        (FREE_PORT, "COM5: {bus: line, protocol: modbus-rtu-slave, station: 7}"),
        (f"      - {FREE_POLL}\n", ""),
    )
    assert [(spec.name, spec.bus) for spec in press1.ports] == [("COM3", "line"), ("COM5", "line")]
