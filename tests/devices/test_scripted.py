"""A device with a protocol of its own: what it sends, when, and in reply to what."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.devices.free.scripted import MOST_WAITING, Message, ScriptedDevice
from bussim.engines.contract import TRANSMIT, RxChar, Transmit
from bussim.engines.free.engine import FreeFrame
from bussim.engines.free.events import Received, Sent
from bussim.line.characters import CharFormat, LineTiming
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND

MS, S = TICKS_PER_MS, TICKS_PER_SECOND
LINE = LineTiming(9600, CharFormat(8, "N", 1))


def scripted(*messages: Message, draw: float = 0.0) -> ScriptedDevice:
    draws: Sequence[Iterator[float]] = [itertools.repeat(draw) for _ in messages]
    return ScriptedDevice(messages, LINE, draws)


def sent(device: ScriptedDevice, until: int, now: int = 0) -> list[tuple[int, bytes]]:
    """What it sends up to a tick, with the first edge of each, on a line of its own."""
    found: list[tuple[int, bytes]] = []
    busy: int | None = None  # when what is being sent will have left
    while True:
        item = device.poll()
        if isinstance(item, Transmit):
            now = max(item.at, now)
            if now > until:
                return found
            chars = device.begin_transmit(now).chars
            found.append((now, chars))
            busy = now + LINE.characters(len(chars))
            continue
        if isinstance(item, Received):
            assert item.chars in [message.reply_to for message in device._messages]
            continue
        if item is not None:
            assert isinstance(item, Sent)
            assert item.chars == found[-1][1]
            continue
        moments = [at for at in (busy, device.deadline()) if at is not None]
        if not moments or min(moments) > until:
            return found
        now = max(now, min(moments))
        if busy is not None and busy <= now:
            busy = None
            device.transmit_done(now)
        else:
            device.on_deadline(now)


def receive(device: ScriptedDevice, data: bytes, at: int) -> tuple[int, int]:
    """It hears these bytes from a tick on; returns the hints and the end."""
    hints = 0
    for number, value in enumerate(data):
        begin, end = (at + LINE.characters(number + k) for k in (0, 1))
        hints |= device.receive(RxChar(value), begin, end)
    return hints, at + LINE.characters(len(data))


def test_by_the_clock() -> None:
    device = scripted(Message(b"once", at=5 * MS), Message(b"often", at=20 * MS, every=100 * MS, times=3))
    device.start(0)
    assert sent(device, 10 * S) == [
        (5 * MS, b"once"),
        (20 * MS, b"often"),
        (120 * MS, b"often"),
        (220 * MS, b"often"),
    ]


def test_without_end_and_late_by_its_jitter() -> None:
    device = scripted(Message(b"x", at=MS, every=50 * MS, jitter=10 * MS), draw=0.5)
    device.start(0)
    late = int(0.5 * (10 * MS + 1))
    assert sent(device, 1000 * MS) == [(MS + late + turn * 50 * MS, b"x") for turn in range(20)]


def test_power_comes_back_in_the_middle_of_the_grid() -> None:
    device = scripted(Message(b"a", at=MS, every=100 * MS, times=5), Message(b"b", at=2 * MS))
    device.start(0)
    device.stop(3 * MS)
    assert (device.deadline(), device.due) == (None, -1)
    device.start(250 * MS)
    # The next points of the grid; what was due once, and is over, is not sent any more.
    assert sent(device, S, now=250 * MS) == [(301 * MS, b"a"), (401 * MS, b"a")]


def test_what_falls_due_meanwhile_follows() -> None:
    device = scripted(Message(b"0123456789", at=0), Message(b"ab", at=MS), Message(b"cd", at=2 * MS))
    device.start(0)
    first = LINE.characters(10)
    assert sent(device, S) == [(0, b"0123456789"), (first, b"ab"), (first + LINE.characters(2), b"cd")]


def test_a_device_that_sends_more_than_the_line_carries_takes_no_memory() -> None:
    # 20 characters are 20.8 ms, and every millisecond there is another.
    device = scripted(Message(bytes(20), every=MS))
    device.start(0)
    found = sent(device, 10 * S)
    assert len(device._queue) == MOST_WAITING
    assert len(found) == 1 + 10 * S // LINE.characters(20)


def test_it_replies_to_the_given_bytes() -> None:
    device = scripted(Message(b"7 kg\r", reply_to=b"W\r", delay=3 * MS), Message(b"ok", reply_to=b"T\r"))
    device.start(0)
    assert device.deadline() is None
    hints, end = receive(device, b"??W\r", 0)
    assert hints & TRANSMIT
    assert sent(device, S) == [(end + 3 * MS, b"7 kg\r")]
    hints, end = receive(device, b"W", 2 * S)
    assert not hints
    hints, end = receive(device, b"T\r", 3 * S)
    assert sent(device, 4 * S, now=3 * S) == [(end, b"ok")]
    # What has its reply does not count a second time.
    assert receive(device, b"\r", 5 * S)[0] == 0


@given(st.lists(st.sampled_from([b"W\r", b"W", b"\r", b"xx", b"WW\r\r"]), max_size=8))
def test_whole_or_one_by_one_is_all_the_same(pieces: list[bytes]) -> None:
    one, other = (scripted(Message(b"7", reply_to=b"W\r", delay=MS)) for _ in range(2))
    for device in (one, other):
        device.start(0)
    at = 0
    for piece in pieces:
        receive(one, piece, at)
        end = at + LINE.characters(len(piece))
        other.receive_frame(FreeFrame(piece), at, end)
        at = end + 5 * MS
    assert sent(one, 10 * S) == sent(other, 10 * S)


def test_switched_off_it_receives_and_sends_nothing() -> None:
    device = scripted(Message(b"7", reply_to=b"W"), Message(b"x", at=MS))
    assert receive(device, b"W", 0)[0] == 0
    device.start(0)
    device.on_deadline(MS)
    device.stop(2 * MS)
    assert device.poll() is None
    assert device.transmit_done(3 * MS) == 0
    with pytest.raises(RuntimeError, match="nothing waits to be sent"):
        device.begin_transmit(3 * MS)
