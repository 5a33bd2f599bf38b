from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.engines.modbus.pdu import Request
from bussim.engines.modbus.polls import Poll
from bussim.plc.memory import Device, Memory
from bussim.plc.ports.device_layout import fetch, fits, store
from bussim.plc.ports.requests import make_request, poll_of
from bussim.plc.ports.spec import FreeSpec, PollSpec


@pytest.mark.parametrize(
    ("function", "count", "values", "carried"),
    [
        (3, 2, (), ()),
        (1, 2, (1, 0), ()),
        (5, 1, (1,), (0xFF00,)),
        (5, 1, (7,), (0xFF00,)),
        (5, 1, (0,), (0,)),
        (6, 1, (-1,), (0xFFFF,)),
        (15, 3, (5, 0, 1), (1, 0, 1)),
        (16, 2, (1, 65536), (1, 0)),
    ],
)
def test_requests(function: int, count: int, values: tuple[int, ...], carried: tuple[int, ...]) -> None:
    assert make_request(function, 7, count, values) == Request(function, 7, count, carried)


def test_the_poll_of_an_hmi() -> None:
    spec = PollSpec("run", "", 3, 5, 7, 1, None, (1,), every=100, at=20, times=4, retries=2)
    assert poll_of(spec) == Poll(3, Request(5, 7, 1, (0xFF00,)), 100, 2, 20, 4, "run")
    with pytest.raises(ValueError, match="poll run of 2 has so many values: 1"):
        poll_of(PollSpec("run", "", 3, 15, 7, 2, None, (1,)))


def test_a_free_turn_has_no_retries() -> None:
    assert FreeSpec("x", "COM3").retries == 0


@pytest.mark.parametrize(
    ("device", "function", "count", "good"),
    [
        ("D8255", 3, 1, True),
        ("D8255", 3, 2, False),
        ("D8255", 1, 16, True),
        ("D8255", 1, 17, False),
        ("M3071", 1, 1, True),
        ("M3071", 1, 2, False),
        ("M8000", 15, 256, True),
        ("M8000", 15, 257, False),
        ("S999", 1, 1, True),
        ("S999", 1, 2, False),
        ("Y255", 5, 1, True),
        ("X0", 15, 8, True),
        ("X0", 1, 8, False),
        ("M0", 3, 1, False),
        ("T0", 1, 1, False),
        ("C0", 15, 1, False),
    ],
)
def test_what_lies_in_memory(device: str, function: int, count: int, good: bool) -> None:
    assert fits(Device(device[0], int(device[1:])), function, count) is good


@given(
    device=st.sampled_from([Device("D", 100), Device("M", 0), Device("S", 17), Device("Y", 8)]),
    bits=st.lists(st.integers(0, 1), min_size=1, max_size=70),
    before=st.integers(0, 1),
)
def test_coils_go_there_and_back(device: Device, bits: list[int], before: int) -> None:
    memory = Memory()
    if not device.is_word:
        store(memory, device, 1, [before] * 80)
    store(memory, device, 1, bits)
    assert fetch(memory, device, 15, len(bits)) == bits
    after = fetch(memory, device, 15, 80)[len(bits) :]
    # Packed in D the rest of the last word is 0; bit devices behind the last one stay.
    assert set(after) <= ({0} if device.is_word else {before})


@given(words=st.lists(st.integers(0, 65535), min_size=1, max_size=20))
def test_registers_go_there_and_back(words: list[int]) -> None:
    memory = Memory()
    store(memory, Device("D", 50), 3, words)
    assert fetch(memory, Device("D", 50), 16, len(words)) == words
