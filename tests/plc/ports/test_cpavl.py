from __future__ import annotations

import pytest

from bussim.engines.modbus.codes import PortError
from bussim.line.characters import BAUDS, CharFormat, LineTiming
from bussim.plc.memory import Device, Memory
from bussim.plc.ports.cpavl import (
    BITS,
    PORT_PROTOCOLS,
    PROTOCOL_CODES,
    WORDS,
    BadSettings,
    PortSettings,
    decode_format,
    default_devices,
    format_word,
    read_settings,
)

MS = 72_000
FORMATS = [CharFormat(bits, parity, stops) for bits in (7, 8) for parity in "NOE" for stops in (1, 2)]


def settings(port: str = "COM4", **offsets: int) -> PortSettings | BadSettings:
    memory = Memory()
    memory.set_word("D", 8121, 1)
    for name, value in offsets.items():
        memory.set_word("D", 8121 if name == "d8121" else 100 + int(name[1:]), value)
    return read_settings(port, memory, Device("D", 100))


@pytest.mark.parametrize(
    ("word", "baud", "fmt", "eight_bit"),
    [
        (0x0081, 9600, "8N1", False),  # both of the manual's examples
        (0x8081, 9600, "8N1", True),
        (0x0000, 9600, "8N1", False),  # default
        (0x0070, 4800, "7N1", False),
        (0x0087, 9600, "8E1", False),
        (0x0093, 19200, "8O1", False),
        (0x00A6, 38400, "7E1", False),
        (0x00B9, 57600, "8N2", False),
        (0x00CF, 115200, "8E2", False),
    ],
)
def test_format_words(word: int, baud: int, fmt: str, eight_bit: bool) -> None:
    assert decode_format(word) == (LineTiming(baud, CharFormat.parse(fmt)), eight_bit)


@pytest.mark.parametrize("baud", BAUDS)
@pytest.mark.parametrize("fmt", FORMATS, ids=str)
@pytest.mark.parametrize("eight_bit", [False, True])
def test_every_format_goes_there_and_back(baud: int, fmt: CharFormat, eight_bit: bool) -> None:
    timing = LineTiming(baud, fmt)
    assert decode_format(format_word(timing, eight_bit=eight_bit)) == (timing, eight_bit)


def test_every_other_word_is_impossible() -> None:
    good = {format_word(LineTiming(baud, fmt), eight_bit=False) for baud in BAUDS for fmt in FORMATS} | {0}
    for word in range(256):
        if word in good:
            decode_format(word)
        else:
            with pytest.raises(ValueError, match=f"{word:04X}H names no (rate|parity)"):
                decode_format(word)


def test_default_devices_do_not_overlap() -> None:
    assert default_devices("COM2") == (Device("D", 7900), Device("M", 2900))
    assert default_devices("COM6") == (Device("D", 7980), Device("M", 2980))
    assert WORDS == BITS == 20


def test_words_that_are_not_set() -> None:
    line = LineTiming(9600, CharFormat(8, "N", 1))
    assert settings() == PortSettings(line, False, None, 0, 5 * MS, 0, 0, 100 * MS)
    assert settings("COM2") == PortSettings(line, False, "hmi", 1, 5 * MS, 0, 0, 100 * MS)


def test_words_and_their_units() -> None:
    found = settings(w0=0x80C1, w1=17, w2=25, w4=0x102, w5=13, w6=0x10, w9=3)
    line = LineTiming(115200, CharFormat(8, "N", 1))
    assert found == PortSettings(line, True, "free", 17, 5 * MS // 2, 2, 13, 30 * MS)


@pytest.mark.parametrize("port", [f"COM{number}" for number in range(1, 7)])
@pytest.mark.parametrize("protocol", [name for name in PROTOCOL_CODES if name != "hmi"])
def test_which_port_has_which_protocol(port: str, protocol: str) -> None:
    found = settings(port, w1=5, w6=PROTOCOL_CODES[protocol])
    if port == "COM1":
        assert isinstance(found, BadSettings)
        assert found.error is PortError.DATA
    else:
        assert isinstance(found, PortSettings)
        assert found.protocol == protocol
    assert (protocol in PORT_PROTOCOLS[port]) is (port != "COM1")
    assert ("hmi" in PORT_PROTOCOLS[port]) is (port == "COM2")


def test_the_slave_on_com2_has_its_number_in_d8121() -> None:
    found = settings("COM2", d8121=44, w1=5, w6=2)
    assert isinstance(found, PortSettings)
    assert found.station == 44


@pytest.mark.parametrize(
    ("port", "offsets", "error", "text"),
    [
        ("COM4", {"w1": 0, "w6": 2}, 0, "COM4 has the station number 0, allowed 1..247"),
        ("COM5", {"w1": 248, "w6": 3}, 0, "COM5 has the station number 248, allowed 1..247"),
        ("COM2", {"d8121": 0, "w1": 5, "w6": 2}, 0, "COM2 has the station number 0, allowed 1..247"),
        ("COM3", {"w6": 0x21}, 6, "COM3 has no protocol 21H"),
        ("COM3", {"w6": 0x20, "w0": 0x0085}, 6, "COM3: the format word 0085H names no parity"),
        ("COM3", {"w6": 0x20, "w0": 0x0001}, 6, "COM3: the format word 0001H names no rate"),
        ("COM3", {"w6": 0x20, "w0": 0x0086}, 6, "COM3 has 7 data bits, RTU needs 8"),
        ("COM3", {"w6": 0x02, "w1": 1, "w0": 0x0086}, 6, "COM3 has 7 data bits, RTU needs 8"),
    ],
)
def test_refused_words(port: str, offsets: dict[str, int], error: int, text: str) -> None:
    assert settings(port, **offsets) == BadSettings(PortError(error), text)


@pytest.mark.parametrize("protocol", [0x10, 0x30, 0x03])
def test_other_protocols_take_7_data_bits(protocol: int) -> None:
    assert isinstance(settings(w0=0x0086, w1=1, w6=protocol), PortSettings)


def test_a_masters_own_station_number_does_not_matter() -> None:
    assert isinstance(settings(w1=0, w6=0x20), PortSettings)
