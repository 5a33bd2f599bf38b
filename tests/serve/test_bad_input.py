"""Whatever comes on a wire: memory stays bounded, and the next good request gets its response."""

from __future__ import annotations

import os
import random
import select
import sys
import time
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from bussim.engines.modbus.adu import Mode, encode_adu
from bussim.engines.modbus.codes import Rejection
from bussim.engines.nn.frames import LinkSettings, encode_parameters, encode_poll
from bussim.live.options import PortOptions
from bussim.units import TICKS_PER_SECOND
from tests.serve.serving import HEAD, PATIENCE, SLAVES, Serving

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
if sys.platform != "win32":
    import tty

LINK = f"""{HEAD}
buses: [{{name: link, nn: true}}]
plcs:
  - {{name: press, nn: {{bus: link, port: COM4, station: 0, slaves: 1, mode: 1, timeout: 2250 ms}}}}
  - {{name: feeder, scan: 6 ms, nn: {{bus: link, port: COM4, station: 1}}}}
"""
NODES = {Mode.RTU: "v80", Mode.ASCII: "ascii"}
both_modes = pytest.mark.parametrize("mode", list(Mode))


@contextmanager
def opened(device: str) -> Iterator[int]:
    handle = os.open(device, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(handle)
    try:
        yield handle
    finally:
        os.close(handle)


def pour(serving: Serving, handle: int, data: bytes) -> None:
    """Write all, and wait until it was read."""
    counts = serving.session.wires[0].counts
    before = counts.received
    for at in range(0, len(data), 1024):
        os.write(handle, data[at : at + 1024])
    serving.wait_for(lambda: counts.received >= before + len(data))


def ask(handle: int, mode: Mode) -> bytes:
    os.write(handle, encode_adu(mode, 1, bytes((3, 0, 0, 0, 1))).chars)
    response, until = b"", time.monotonic() + PATIENCE
    wanted = encode_adu(mode, 1, bytes((3, 2, 0, 0))).chars
    while len(response) < len(wanted) and time.monotonic() < until:
        if select.select((handle,), (), (), 1.0)[0]:
            response += os.read(handle, 512)
    return response


def responds(handle: int, mode: Mode) -> bool:
    """The line is quiet for longer than any tolerance, then the request gets its response."""
    time.sleep(0.5)
    while select.select((handle,), (), (), 0)[0]:
        os.read(handle, 4096)  # responses to what random bytes happened to say
    return ask(handle, mode) == encode_adu(mode, 1, bytes((3, 2, 0, 0))).chars


@pytest.mark.slow
@both_modes
@pytest.mark.parametrize("traced", [False, True])
def test_random_bytes_without_end(mode: Mode, traced: bool) -> None:
    rng = random.Random(1)
    with Serving(SLAVES, NODES[mode], traced=traced) as serving, opened(serving.device) as handle:
        for _ in range(2 if traced else 10):  # a million, in the end
            pour(serving, handle, rng.randbytes(100_000))
        tracemalloc.start()
        try:
            pour(serving, handle, rng.randbytes(100_000))
            _, peak = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
        assert responds(handle, mode)
    assert peak < 4_000_000


@both_modes
def test_half_frames_long_frames_and_a_good_one(mode: Mode) -> None:
    request = encode_adu(mode, 1, bytes((3, 0, 0, 0, 1))).chars
    with Serving(SLAVES, NODES[mode]) as serving, opened(serving.device) as handle:
        for bad in (request[:1], request[:5], request[:-1], request[:1] * 300, b"\x00" * 257, request[2:]):
            pour(serving, handle, bad)
            assert responds(handle, mode)
    (device,) = [one for one in serving.totals().devices if one.name == NODES[mode]]
    assert device.answered == 6
    if mode is Mode.RTU:
        assert device.rejected[Rejection.OVERFLOW.value] == 2


def test_a_master_that_closes_in_the_middle() -> None:
    request = encode_adu(Mode.RTU, 1, bytes((3, 0, 0, 0, 1))).chars
    with Serving(SLAVES, "v80") as serving:
        for cut in (3, len(request), 5):
            with opened(serving.device) as handle:
                pour(serving, handle, request[:cut])
            with opened(serving.device) as handle:
                assert responds(handle, Mode.RTU)
    assert serving.session.wires[0].counts.losses == 0


def test_a_request_in_pieces_is_one_request_as_long_as_its_pieces_are_late_by_the_system() -> None:
    request = encode_adu(Mode.RTU, 1, bytes((3, 0, 0, 0, 1))).chars
    # However much else the machine has to do.
    patient = PortOptions(tolerance=int(PATIENCE) * TICKS_PER_SECOND)
    with Serving(SLAVES, "v80", options=patient) as serving, opened(serving.device) as handle:
        for at in range(len(request) - 1):
            pour(serving, handle, request[at : at + 1])
            time.sleep(0.004)  # ten times the silence that would end it
        os.write(handle, request[-1:])
        assert select.select((handle,), (), (), PATIENCE)[0]
    (device,) = [one for one in serving.totals().devices if one.name == "v80"]
    assert (device.answered, device.rejected) == (1, {})


def test_random_bytes_on_a_link_and_its_slave_replies_to_the_next_poll() -> None:
    """The engines of the link are served, too: what they hear is 7 bits of anything."""
    rng = random.Random(2)
    with Serving(LINK, "feeder") as serving, opened(serving.device) as handle:
        # Settings, then a poll: what a slave needs before it replies.
        opening = encode_parameters(1, LinkSettings(1, 1, 3, 225)).chars
        for _ in range(3):
            pour(serving, handle, rng.randbytes(50_000))
            time.sleep(0.5)  # longer than any tolerance
            while select.select((handle,), (), (), 0)[0]:
                os.read(handle, 4096)
            pour(serving, handle, opening)
            heard, until = b"", time.monotonic() + PATIENCE
            while not heard and time.monotonic() < until:
                os.write(handle, encode_poll(1, 1).chars)
                if select.select((handle,), (), (), 1.0)[0]:
                    heard = os.read(handle, 4096)
            assert heard
    assert not [text for text in serving.reported if "cannot keep up" not in text]
