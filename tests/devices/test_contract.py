"""What every device promises: nothing raises, every response fits a frame, asking changes nothing."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.devices.lx.map import LX_AREAS, LxMap
from bussim.devices.map.map import Entry, UserMap
from bussim.devices.map.values import Fixed, Noise, Sweep, noise_key
from bussim.devices.registry import form_of
from bussim.devices.stepper.axis import Switch
from bussim.devices.stepper.map import Stepper
from bussim.devices.stepper.registers import BY_NAME, COILS
from bussim.devices.v80.map import V80
from bussim.engines.modbus.pdu import (
    FUNCTIONS,
    MAX_PDU,
    ExceptionResponse,
    Request,
    encode_response,
    write_coil,
    write_coils,
    write_register,
    write_registers,
)
from bussim.engines.modbus.server import RegisterMap, Space, serve
from bussim.line.characters import CharFormat, LineTiming
from bussim.plc.memory import Memory
from bussim.units import TICKS_PER_SECOND
from tests.devices.ask import put
from tests.devices.stepper.steppers import next_change, set_input

S = TICKS_PER_SECOND


def user_map() -> UserMap:
    return UserMap(
        [
            Entry(Space.HOLDING, 0, Fixed(3), count=20, writable=True),
            Entry(Space.HOLDING, 20, Sweep(-5, 5, S), words=2, count=4),
            Entry(Space.INPUT_REGISTERS, 0, Noise(0, 9, S, noise_key(1)), count=20),
            Entry(Space.COILS, 0, count=20, writable=True),
            Entry(Space.INPUTS, 0, count=20),
        ]
    )


DEVICES: dict[str, Callable[[], RegisterMap]] = {
    "lx": lambda: LxMap(Memory()),
    "v80": V80,
    "stepper": Stepper,
    "map": user_map,
}
STARTS = sorted({area.start for area in LX_AREAS} | {area.end - 1 for area in LX_AREAS})
addresses = st.integers(0, 90) | st.integers(0, 0xFFFF) | st.sampled_from(STARTS)
words = st.integers(0, 0xFFFF)
quantities = st.integers(0, 12) | st.integers(0, 0xFFFF) | st.sampled_from([120, 125, 1024, 1968, 2000])
requests = st.one_of(
    st.builds(Request, st.integers(1, 4), addresses, quantities, st.just(())),
    st.builds(write_coil, addresses, on=st.booleans()),
    st.builds(lambda address, word: Request(5, address, 1, (word,)), addresses, words),
    st.builds(write_register, addresses, words),
    st.builds(write_coils, addresses, st.lists(st.integers(0, 1), min_size=1, max_size=30)),
    st.builds(write_registers, addresses, st.lists(words, min_size=1, max_size=30)),
)


@pytest.mark.parametrize("name", DEVICES)
@given(script=st.lists(st.tuples(requests, st.integers(0, 20 * S)), max_size=15))
def test_no_request_raises_and_every_response_fits(name: str, script: list[tuple[Request, int]]) -> None:
    device, now = DEVICES[name](), 0
    for request, later in script:
        now += later
        response = serve(device, request, now)
        if isinstance(response, ExceptionResponse):
            assert response.code in (1, 2, 3, 4)
        else:
            assert len(encode_response(response)) <= MAX_PDU
            if request.function < 5:
                assert len(response.values) == request.quantity
                most = 1 if request.function < 3 else 0xFFFF
                assert all(0 <= value <= most for value in response.values)


@pytest.mark.parametrize("name", ["lx", "v80", "map"])
@given(requests)
def test_what_was_written_is_read_back(name: str, request: Request) -> None:
    device = DEVICES[name]()
    if request.function < 5 or isinstance(serve(device, request, 0), ExceptionResponse):
        return
    bits = request.function in (5, 15)
    read = serve(device, Request(1 if bits else 3, request.address, request.quantity), 0)
    written = (int(request.values[0] == 0xFF00),) if request.function == 5 else request.values
    assert read.values == written


@pytest.mark.parametrize("name", DEVICES)
@pytest.mark.parametrize("function", [*sorted(FUNCTIONS), 0, 7, 8, 20, 22, 23, 43, 127])
def test_every_function_that_a_device_lacks_is_exception_01(name: str, function: int) -> None:
    device = DEVICES[name]()
    if function in device.functions:
        return
    values = {5: (0xFF00,), 6: (0,), 15: (0,), 16: (0,)}.get(function, ())
    response = serve(device, Request(function, 0, 1, values), 0)
    assert response == ExceptionResponse(function, 1)


@pytest.mark.parametrize("name", DEVICES)
def test_ports_speak_what_they_say(name: str) -> None:
    port, line = form_of({"model": name}).port, LineTiming(9600, CharFormat(8, "N", 1))
    assert all(port.framing(mode, line).mode is mode for mode in port.modes)


# -- the stepper in time ---------------------------------------------------------------------------

MOVES = [
    n - 1 for n, name in COILS.items() if name not in ("save", "read_project", "clear_project", "reset_basic")
]
WRITABLE = [
    r.address for r in BY_NAME.values() if r.writable and r.name not in ("project_loops", "step_number")
]
moments = st.integers(0, 5 * S)
actions = st.one_of(
    st.tuples(st.just("coil"), st.sampled_from(MOVES), st.booleans()),
    st.tuples(st.just("input"), st.integers(1, 5), st.booleans()),
    st.tuples(st.just("distance"), st.integers(-3000, 3000), st.booleans()),
    st.tuples(st.just("write"), st.sampled_from(WRITABLE), st.integers(0, 5) | st.integers(0, 5000)),
)


def prepared() -> Stepper:
    device = Stepper(switches=[Switch(1, high=-400), Switch(2, low=600), Switch(3, 100, 150)])

    def set_(**values: int) -> None:
        for name, value in values.items():
            register = BY_NAME[name]
            put(device, register.address, *(value >> 16 * k & 0xFFFF for k in range(register.words)))

    set_(home_input=1, forward_limit_input=2, forward_input=4, reverse_input=5, signal_mode=2, round_trips=1)
    set_(
        total_steps=2, project_loops=2, step_distance=300, step_speed=60, step_acceleration=900, step_output=3
    )
    set_(step_number=2)
    set_(step_distance=200, step_direction=1, step_speed=90, step_delay=40, step_stop_input=3)
    return device


def play(script: list[tuple[int, Any]], ask: Callable[[Stepper, int, int], None]) -> list[Any]:
    """Carry a script out; ``ask`` may ask the device anything between its moments."""
    device, now = prepared(), 0
    for later, (kind, number, flag) in script:
        ask(device, now, now + later)
        now += later
        if kind == "coil":
            serve(device, write_coil(number, on=flag), now)
        elif kind == "input":
            set_input(device, number, now, on=flag)
        elif kind == "distance":
            put(device, 9, number & 0xFFFF, number >> 16 & 0xFFFF, now=now)
        else:
            put(device, number, flag, now=now)
    ask(device, now, now + 60 * S)
    device.advance(now + 60 * S)
    seen: list[Any] = [device.value(name, now + 60 * S) for name in BY_NAME]
    while (event := device.poll()) is not None:
        seen.append(event)
    return seen


def step_by_step(device: Stepper, now: int, until: int) -> None:
    """As a driver that follows the device's deadlines."""
    while (at := next_change(device)) is not None and at <= until:
        assert at >= now
        now = at
        device.advance(at)


def now_and_then(device: Stepper, now: int, until: int) -> None:
    """As a master that polls, at moments that have nothing to do with the device's."""
    for tick in range(now, until, max((until - now) // 7, 1)):
        serve(device, Request(3, 0x16, 2), tick)


@given(st.lists(st.tuples(moments, actions), max_size=12))
def test_the_stepper_is_the_same_however_often_it_is_asked(script: list[tuple[int, Any]]) -> None:
    alone = play(script, lambda device, now, until: None)  # noqa: ARG005 - it asks nothing
    assert play(script, step_by_step) == alone
    assert play(script, now_and_then) == alone
