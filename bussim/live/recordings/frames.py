"""Frames of a trace as a listener beside the wire would have heard them."""

from __future__ import annotations

from typing import assert_never

from bussim.engines.modbus.adu import Adu, decode_ascii, decode_rtu
from bussim.engines.nn.frames import Frame
from bussim.engines.nn.frames import decode as decode_nn
from bussim.live.sniff.heard import Heard, LineProtocol
from bussim.trace.records import FrameRecord

#: Kind of a frame that a listener could not read.
DAMAGED = "damaged"

_PROTOCOLS = {protocol.value: protocol for protocol in LineProtocol}


def heard_of(record: FrameRecord) -> Heard | None:
    """What a listener heard of a frame; None for a protocol that is not recognised (free).

    Bits that were inverted on the wire for all receivers, a collision and a frame that was cut off are
    damage; what was inverted in one receiver only is not heard by others.
    """
    protocol = _PROTOCOLS.get(record.protocol)
    if protocol is None:
        return None
    frame: Frame | Adu | None = None
    reason = ""
    if record.collided:
        reason = "collision"
    elif record.cut:
        reason = "cut off"
    elif record.damaged_bits:
        reason = "damaged bits"
    elif record.kind == DAMAGED:
        reason = "damaged"  # a recording keeps what was sent, not what became of it
    else:
        frame = _decoded(protocol, record.chars)
        reason = "" if frame is not None else "damaged"
    return Heard(protocol, record.start, record.end, record.chars, frame, reason, record.sender)


def _decoded(protocol: LineProtocol, chars: bytes) -> Frame | Adu | None:
    match protocol:
        case LineProtocol.NN:
            return decode_nn(chars)
        case LineProtocol.RTU:
            found = decode_rtu(chars)
        case LineProtocol.ASCII:
            found = decode_ascii(chars)
        case _:
            assert_never(protocol)
    return found if isinstance(found, Adu) else None
