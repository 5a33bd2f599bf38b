"""A served slave and a line that sends it anything but requests: it stays, and responds to the next good one."""

from __future__ import annotations

import contextlib
import os
import random
import sys
import tracemalloc
from collections.abc import Iterator

import pytest

from bussim.devices.v80.map import V80
from bussim.engines.modbus.adu import Mode, encode_adu
from bussim.engines.modbus.pdu import Request as Ask
from bussim.engines.modbus.pdu import encode_request
from bussim.line.characters import CharFormat, LineTiming
from bussim.live.modbus import slave_runner
from bussim.live.options import PortOptions
from bussim.live.runner import EngineRunner
from bussim.live.wire import Wire
from bussim.units import TICKS_PER_MS

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")

both_modes = pytest.mark.parametrize("mode", list(Mode))


def request(mode: Mode, station: int = 1) -> bytes:
    return encode_adu(mode, station, encode_request(Ask(3, 0, 2))).chars


def response(mode: Mode) -> bytes:
    return encode_adu(mode, 1, bytes((3, 4, 0, 0, 0, 0))).chars


#: Chunk from which on memory is measured, which takes its time.
_TRACED_FROM = 450


class Bench:
    """A slave on a pseudo-terminal, stepped by the test itself, so that nothing depends on threads."""

    def __init__(self, mode: Mode, **options: int) -> None:
        self.mode = mode
        line = LineTiming(115200, CharFormat(8, "N", 1))
        self.wire = Wire("pty", line, PortOptions(tolerance=options.get("tolerance", 2 * TICKS_PER_MS)))
        self.runner: EngineRunner = slave_runner(self.wire, mode, {1: V80()})
        self.runner.start()
        self.end = self.open()

    def open(self) -> int:
        return os.open(self.wire.name, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)

    def send(self, data: bytes) -> None:
        while data:
            with contextlib.suppress(BlockingIOError):
                data = data[os.write(self.end, data) :]
            self.step()

    def step(self, times: int = 1) -> None:
        for _ in range(times):
            self.runner.step(self.wire.clock.now() + TICKS_PER_MS)

    def quiet(self) -> None:
        """Until the line has been quiet for longer than silence and tolerance."""
        until = self.wire.clock.now() + 10 * TICKS_PER_MS
        while self.wire.clock.now() < until:
            self.step()

    def read(self) -> bytes:
        try:
            return os.read(self.end, 65536)
        except BlockingIOError:
            return b""

    def ask(self) -> bytes:
        while self.read():
            self.step()
        self.send(request(self.mode))
        data = b""
        for _ in range(2000):
            self.step()
            data += self.read()
            if len(data) >= len(response(self.mode)):
                break
        return data

    def close(self) -> None:
        os.close(self.end)
        self.runner.close()


@pytest.fixture(params=list(Mode))
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    made = Bench(request.param)
    yield made
    made.close()


@pytest.mark.slow
def test_a_million_random_bytes(bench: Bench) -> None:
    rng = random.Random(1)
    chunk = 2000
    for number in range(1_000_000 // chunk):
        if number == _TRACED_FROM:
            tracemalloc.start()
        bench.send(rng.randbytes(chunk))
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 200_000  # what is allocated in the last tenth and kept
    bench.quiet()
    assert bench.ask() == response(bench.mode)


def test_an_endless_stream_without_a_gap_keeps_memory_bounded(bench: Bench) -> None:
    good = request(bench.mode)
    for _ in range(200):
        bench.send(good[:-1] * 100)
    bench.quiet()
    assert bench.ask() == response(bench.mode)


@pytest.mark.parametrize("size", [1, 3, 5, 7])
def test_half_a_request_is_forgotten(bench: Bench, size: int) -> None:
    bench.send(request(bench.mode)[:size])
    bench.quiet()
    assert bench.ask() == response(bench.mode)


def test_a_frame_over_256_bytes_is_ignored(bench: Bench) -> None:
    longest = request(bench.mode)[:-2] + bytes(600)
    bench.send(longest)
    bench.quiet()
    assert bench.ask() == response(bench.mode)


def test_a_request_in_pieces_is_one_request(bench: Bench) -> None:
    """The system delivers as it likes: gaps below the tolerance are its own."""
    bench.close()
    bench.__init__(bench.mode, tolerance=1000 * TICKS_PER_MS)  # type: ignore[misc] # the same bench anew
    for byte in request(bench.mode):
        bench.send(bytes((byte,)))
        until = bench.wire.clock.now() + 4 * TICKS_PER_MS  # longer than the silence that ends a frame
        while bench.wire.clock.now() < until:
            bench.step()
    data = b""
    for _ in range(100):
        bench.step()
        data += bench.read()
    assert data == response(bench.mode)


def test_a_master_that_closes_in_the_middle(bench: Bench) -> None:
    for _ in range(3):
        bench.send(request(bench.mode)[:4])
        os.close(bench.end)
        bench.quiet()
        bench.end = bench.open()
        assert bench.ask() == response(bench.mode)
    assert bench.wire.counts.losses == 0


def test_responses_that_no_program_reads(bench: Bench) -> None:
    """They fill the terminal; then they are lost, and nothing stands still."""
    for _ in range(600):
        bench.send(request(bench.mode))
        bench.step(3)
    bench.quiet()
    assert bench.ask().endswith(response(bench.mode))
