"""Engines of every protocol on wires: N:N between two pseudo-terminals, free protocol on a loop, paced bytes."""

from __future__ import annotations

import sys
import threading
import time

import pytest

from bussim.engines.contract import RxChar, Transmit
from bussim.engines.free.engine import FreeConfig, FreePort
from bussim.engines.free.events import Received, Sent
from bussim.engines.nn.events import ScanEnded
from bussim.engines.nn.frames import MODES, QUIET_CHARS, LinkSettings
from bussim.engines.nn.master import Master, MasterConfig
from bussim.engines.nn.monitor import SlaveConfig
from bussim.engines.nn.slave import Slave
from bussim.line.characters import NN_LINE, CharFormat, LineTiming
from bussim.live.arrival import Arrivals, Timed
from bussim.live.options import PortOptions
from bussim.live.port import LivePort
from bussim.live.runner import EngineRunner, Handling
from bussim.live.sniff.heard import LineProtocol
from bussim.live.sniff.listener import Listener
from bussim.live.wire import Wire
from bussim.results.collector import Collector
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND

posix = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
PATIENCE = 30.0
QUIET = NN_LINE.characters(QUIET_CHARS)


class Noted(Handling):
    """Keeps events; a block's image counts the frames that carried it."""

    def __init__(self, size: int) -> None:
        self.events: list[object] = []
        self._size = size
        self.sent = 0

    def prepare(self, engine: object, now: int) -> None:
        del now
        if isinstance(engine, (Master, Slave)) and engine.wants_image:
            self.sent += 1
            engine.image = (self.sent & 0xFF).to_bytes(1, "big") * self._size

    def event(self, event: object, now: int) -> None:
        del now
        self.events.append(event)

    def when(self, transmit: Transmit, now: int) -> int | None:
        del now
        return transmit.at + TICKS_PER_MS if transmit.reply else transmit.at


@pytest.mark.slow
@posix
def test_the_two_halves_of_an_nn_link_on_one_wire() -> None:
    """Master here, slaves there, a listener on what went over: they agree about the link."""
    from tests.live.peers import TerminalPair

    settings, block = LinkSettings(2, 1, 2, 100), MODES[1].size
    master = Master(
        MasterConfig(settings, attempts=3, timeout=TICKS_PER_SECOND, gap=30_000, overhead=200_000)
    )
    stop = threading.Event()
    heard = Collector()
    listener = Listener("link", NN_LINE, heard, LineProtocol.NN, tolerance=20 * TICKS_PER_MS)
    with TerminalPair() as pair:
        sides = [
            (Slave(SlaveConfig(1, (0, 1, 2), 10 * TICKS_PER_MS, 100_000, 18_750)), pair.right, Noted(block)),
            (master, pair.left, Noted(block)),
        ]
        runners = [
            EngineRunner(engine, Wire(url, NN_LINE), quiet=QUIET, mode=None, handling=noted)
            for engine, url, noted in sides
        ]
        for runner in runners:
            runner.start()
        threads = [threading.Thread(target=runner.run, args=(stop.is_set,)) for runner in runners]
        for thread in threads:
            thread.start()
        noted = sides[1][2]
        until = time.monotonic() + PATIENCE
        while sum(isinstance(e, ScanEnded) for e in noted.events) < 3 and time.monotonic() < until:
            time.sleep(0.01)
        stop.set()
        for thread in threads:
            thread.join()
        for runner in runners:
            runner.close()
        arrivals, now = Arrivals(NN_LINE), 0
        for data in pair.carried:
            now += TICKS_PER_SECOND
            listener.chars(arrivals.chunk(bytes(data), now))
    scans = [event for event in noted.events if isinstance(event, ScanEnded)]
    assert len(scans) >= 3
    # Station 1 responds, station 2 does not exist.
    assert all(scan.in_error == (2,) for scan in scans[1:])
    assert {station for station, _ in scans[-1].failures} == {2}
    assert sides[0][2].sent >= 3
    assert not master.status.flags[1]
    assert listener.protocol is not None
    assert listener.protocol.value == "nn"


def test_the_free_protocol_on_a_loop() -> None:
    line = LineTiming(115200, CharFormat(8, "N", 1))
    engine = FreePort(FreeConfig(line, timeout=TICKS_PER_SECOND))
    noted = Noted(0)
    runner = EngineRunner(engine, Wire("loop://", line), quiet=0, mode=None, handling=noted)
    runner.start()
    engine.drive(5, runner.clock.now())
    engine.send(b"hello", runner.clock.now())
    runner._collect()  # as the methods of the engine were called from outside of it
    until = time.monotonic() + PATIENCE
    while not any(isinstance(e, Received) for e in noted.events) and time.monotonic() < until:
        runner.step(runner.clock.now() + TICKS_PER_MS)
    runner.close()
    assert [type(event) for event in noted.events] == [Sent, Received]
    received = noted.events[1]
    assert isinstance(received, Received)
    assert received.data == b"hello"


def test_paced_bytes_never_come_earlier_than_the_line_could_carry_them() -> None:
    line = LineTiming(1200, CharFormat(8, "N", 1))
    got: list[Timed] = []
    sent: list[tuple[int, int]] = []
    wire = Wire("loop://", line, PortOptions(paced=True))
    port = LivePort(wire, on_chars=got.extend, on_sent=lambda start, end: sent.append((start, end)))
    wire.open()
    begun = wire.clock.now()
    port.send(b"abcd", begun)
    until = time.monotonic() + PATIENCE
    while (len(got) < 4 or not sent) and time.monotonic() < until:
        port.step(wire.clock.now() + TICKS_PER_MS)
    wire.close()
    assert bytes(char.value for char, _, _ in got) == b"abcd"
    for index, (_, _, end) in enumerate(got):
        assert end >= begun + line.characters(index + 1)
    ((start, end),) = sent
    assert end - start == line.characters(4)


def test_echo_is_dropped() -> None:
    line = LineTiming(115200, CharFormat(8, "N", 1))
    got: list[Timed] = []
    wire = Wire("loop://", line, PortOptions(echo=True))
    port = LivePort(wire, on_chars=got.extend)
    wire.open()
    port.send(b"mine", wire.clock.now())
    for _ in range(50):
        port.step(wire.clock.now() + TICKS_PER_MS)
    wire.write(b"others")
    for _ in range(50):
        port.step(wire.clock.now() + TICKS_PER_MS)
    wire.close()
    assert bytes(char.value for char, _, _ in got) == b"others"


def test_seven_bits_are_sent_and_heard_as_seven() -> None:
    got: list[Timed] = []
    wire = Wire("loop://", NN_LINE)
    port = LivePort(wire, on_chars=got.extend)
    wire.open()
    port.send(b"\xc1B", wire.clock.now())
    for _ in range(50):
        port.step(wire.clock.now() + TICKS_PER_MS)
    wire.close()
    assert [char for char, _, _ in got] == [RxChar(0x41), RxChar(0x42)]


def test_characters_of_chunks_are_in_order_and_never_in_the_future() -> None:
    arrivals, before = Arrivals(NN_LINE), 0
    for data, arrived in (
        (b"abc", 100),
        (b"d", 200),
        (b"e" * 50, 210),
        (b"f", 10_000_000),
        (b"gh", 10_000_001),
    ):
        chars = arrivals.chunk(data, arrived)
        assert bytes(char.value for char, _, _ in chars) == data
        for _, start, end in chars:
            assert before <= start <= end <= arrived
            before = end
    (first, *_) = Arrivals(NN_LINE).chunk(b"abc", 10_000_000)
    assert first[1] == 10_000_000 - NN_LINE.characters(3)
