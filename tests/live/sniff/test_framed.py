"""One opening of a port, 8N1, hears what has seven data bits and parity, and what has eight."""

from __future__ import annotations

import pytest

from bussim.engines.modbus.adu import Mode, encode_adu
from bussim.engines.nn.frames import LinkSettings, encode_data, encode_parameters, encode_poll
from bussim.line.characters import NN_LINE, CharFormat, LineTiming
from bussim.live.arrival import Arrivals, characters_of
from bussim.live.sniff.heard import LineProtocol
from bussim.live.sniff.listener import Listener
from bussim.live.sniff.reading import Settings
from bussim.live.sniff.recognise import Recogniser
from bussim.results.collector import Collector


def with_parity(data: bytes) -> bytes:
    """Even parity in the eighth bit."""
    return bytes(value | (bin(value).count("1") % 2) << 7 for value in data)


def link() -> list[bytes]:
    frames = [encode_parameters(1, LinkSettings(1, 1, 3, 225)).chars]
    for counter in range(1, 9):
        frames += [encode_data(0, counter, bytes(16)).chars, encode_poll(1, counter).chars]
        frames.append(encode_data(1, counter, bytes(range(16))).chars)
    return [with_parity(frame) for frame in frames]


def modbus(mode: Mode) -> list[bytes]:
    request, response = bytes((3, 0, 0, 0, 2)), bytes((3, 4, 0xAB, 0xCD, 0x12, 0x34))
    return [encode_adu(mode, 1, pdu).chars for _ in range(8) for pdu in (request, response)]


@pytest.mark.parametrize(
    ("protocol", "frames"),
    [
        (LineProtocol.NN, link()),
        (LineProtocol.RTU, modbus(Mode.RTU)),
        (LineProtocol.ASCII, [with_parity(frame) for frame in modbus(Mode.ASCII)]),
    ],
)
def test_one_opening_hears_all_protocols(protocol: LineProtocol, frames: list[bytes]) -> None:
    heard: list[Listener] = []

    def make(found: LineProtocol) -> Listener:
        heard.append(Listener("b", NN_LINE, Collector(), found, exact=False, tolerance=0))
        return heard[-1]

    recogniser = Recogniser(make, NN_LINE, 0)
    recogniser.framed = characters_of(NN_LINE.format, framed=True)
    arrivals, now = Arrivals(NN_LINE), 0
    for frame in frames:
        now += NN_LINE.characters(len(frame) + 6)
        recogniser.chars(arrivals.chunk(frame, now))
    recogniser.close(now)
    assert [listener.protocol for listener in heard] == [protocol]


def test_a_port_without_parity_is_opened_with_eight_data_bits() -> None:
    """With seven an adapter would take the last bit of RTU's characters for their stop bit."""
    assert Settings(parity="N").timing(None) == LineTiming(19200, CharFormat(8, "N", 1))
    assert Settings(parity="N", protocol=LineProtocol.ASCII).timing(None).format.data_bits == 7
    assert Settings(parity="O").timing(None) == LineTiming(38400, CharFormat(7, "O", 1))
