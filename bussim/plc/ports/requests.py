"""Requests for the Modbus engines, made of polls and values."""

from collections.abc import Sequence

from bussim.engines.modbus.pdu import COIL_OFF, COIL_ON, WRITES, Function, Request
from bussim.engines.modbus.polls import Poll
from bussim.plc.ports.device_layout import is_bits
from bussim.plc.ports.spec import PollSpec


def make_request(function: int, address: int, count: int, values: Sequence[int] = ()) -> Request:
    """A request. Of a write, ``values`` are its coils (any but 0 is ON) or registers (their low 16 bits).

    Nothing is checked here: a function that is unknown, or a count that is impossible, goes into the
    request as it is, and the engine refuses it.
    """
    if function not in WRITES:
        return Request(function, address, count)
    if function == Function.WRITE_COIL:
        return Request(function, address, count, tuple(COIL_ON if value else COIL_OFF for value in values))
    if is_bits(function):
        return Request(function, address, count, tuple(1 if value else 0 for value in values))
    return Request(function, address, count, tuple(value & 0xFFFF for value in values))


def poll_of(spec: PollSpec) -> Poll:
    """The poll of a master without a PLC's memory (an HMI), which writes the poll's own ``values``.

    Raises ValueError for a write whose values are not as many as its items.
    """
    if spec.function in WRITES and len(spec.values) != spec.count:
        raise ValueError(f"poll {spec.name} of {spec.count} has so many values: {len(spec.values)}")
    request = make_request(spec.function, spec.address, spec.count, spec.values)
    return Poll(
        spec.station,
        request,
        spec.every,
        spec.retries,
        spec.at,
        spec.times,
        spec.name,
        spec.skip_after_failure,
    )
