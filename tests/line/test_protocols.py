"""The protocols of frames have the same names wherever they are told apart."""

from bussim.export.packets import LINK_TYPES
from bussim.line.protocols import FRAME_PROTOCOLS
from bussim.live.sniff.heard import LineProtocol


def test_what_tells_protocols_apart_knows_each() -> None:
    assert LINK_TYPES.keys() == set(FRAME_PROTOCOLS)
    assert {*LineProtocol, "free"} == set(FRAME_PROTOCOLS)
