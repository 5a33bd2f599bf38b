"""Our slave against pymodbus's server: the same requests, one after the other, must get the same responses.

Both keep what was written, so that a difference in memory shows in the reads that follow; requests beyond
the map must be refused alike.
"""

from __future__ import annotations

import asyncio
import random
from typing import Any

import pytest

from bussim.devices.map.map import Entry, UserMap
from bussim.devices.map.values import Fixed
from bussim.engines.modbus.adu import Mode, encode_adu
from bussim.engines.modbus.framing import Framing
from bussim.engines.modbus.pdu import Request, encode_request
from bussim.engines.modbus.server import Space
from bussim.engines.modbus.slave import Slave, SlaveConfig
from tests.engines.modbus.test_peers import peer, pymodbus_framer, random_request
from tests.engines.modbus.wire import ASCII_LINE, RTU_LINE, receive_by_character

COUNT = 1500
#: Items of each space: whole words of bits, since theirs come in sixteens.
ITEMS = 320


def our_map() -> UserMap:
    return UserMap(
        [
            Entry(Space.COILS, 0, count=ITEMS, writable=True),
            Entry(Space.INPUTS, 0, Fixed(1), count=ITEMS),
            Entry(Space.INPUT_REGISTERS, 0, Fixed(7), count=ITEMS),
            Entry(Space.HOLDING, 0, count=ITEMS, writable=True),
        ]
    )


def their_core() -> Any:
    simulator = peer("pymodbus.simulator")
    bits, words = simulator.DataType.BITS, simulator.DataType.REGISTERS
    blocks = tuple(
        [simulator.SimData(0, values=[value] * ITEMS, datatype=kind)]
        for value, kind in ((False, bits), (True, bits), (0, words), (7, words))
    )
    return peer("pymodbus.simulator.simcore").SimCore([simulator.SimDevice(1, simdata=blocks)])


def somewhere(rng: random.Random) -> Request:
    """A request mostly inside the map, often across its end, sometimes far away."""
    last = rng.choice([ITEMS - 1, ITEMS - 1, ITEMS + 20, 0xFFFF])
    return random_request(rng)._replace(address=rng.randint(0, last))


@pytest.mark.parametrize("mode", list(Mode))
def test_the_same_responses_to_the_same_requests(mode: Mode) -> None:
    rng = random.Random(f"server {mode}")
    framer, core = pymodbus_framer(mode, server=True), their_core()
    line = RTU_LINE if mode is Mode.RTU else ASCII_LINE
    slave = Slave(SlaveConfig(Framing.rtu(line) if mode is Mode.RTU else Framing.ascii()), {1: our_map()})
    slave.start(0)
    refused, at = 0, 0

    async def theirs(chars: bytes) -> bytes:
        _, request = framer.handleFrame(chars, 0, 0)
        response = await request.datastore_update(core, 1)
        response.dev_id = 1
        return bytes(framer.buildFrame(response))

    async def all_of_them() -> None:
        nonlocal refused, at
        for _ in range(COUNT):
            request = somewhere(rng)
            chars = encode_adu(mode, 1, encode_request(request)).chars
            _, end = receive_by_character(slave, chars, at, line)
            if mode is Mode.RTU:
                slave.line_idle(end + slave.quiet)
            response = slave.begin_transmit(end + slave.quiet)
            at = end + 2 * slave.quiet + line.characters(len(response.chars))
            slave.transmit_done(at - slave.quiet)
            while slave.poll() is not None:
                pass
            assert response.chars == await theirs(chars), request
            refused += response.pdu[0] >> 7

    asyncio.run(all_of_them())
    assert COUNT // 10 < refused < COUNT // 2
