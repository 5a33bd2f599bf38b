"""Maps that a scenario defines: values over time, 32 bits, limits, functions."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.devices.map.map import Entry, UserMap
from bussim.devices.map.values import Computed, Fixed, Noise, Sweep, Value, noise_key
from bussim.engines.modbus.pdu import Request, write_coils, write_registers
from bussim.engines.modbus.server import Space
from bussim.plc.sources import Counter, Toggle
from bussim.units import TICKS_PER_SECOND
from tests.devices.ask import ask, code, put, registers

HOLDING = Space.HOLDING
S = TICKS_PER_SECOND


def test_fixed_values_and_names() -> None:
    device = UserMap([Entry(HOLDING, 5, Fixed(42), name="level"), Entry(HOLDING, 6, Fixed(-1))])
    assert registers(device, 5, 2) == (42, 0xFFFF)
    assert code(device, Request(3, 4, 1)) == 2
    assert put(device, 5, 1) == 2  # not writable
    assert device.areas[0].name == "level"


def test_writable_memory() -> None:
    device = UserMap([Entry(HOLDING, 0, Fixed(7), count=4, writable=True, low=1, high=100)])
    assert registers(device, 0, 4) == (7, 7, 7, 7)
    assert put(device, 1, 100, 1) == 0
    assert registers(device, 0, 4) == (7, 100, 1, 7)
    assert put(device, 0, 5, 101) == 3
    assert put(device, 0, 0) == 3
    assert registers(device, 0, 4) == (7, 100, 1, 7)


def test_the_last_address() -> None:
    device = UserMap([Entry(HOLDING, 65535, Fixed(9), writable=True), Entry(Space.COILS, 65535)])
    assert registers(device, 65535) == (9,)
    assert put(device, 65535, 8) == 0
    assert ask(device, Request(1, 65535, 1)) == (0,)
    assert code(device, Request(3, 65535, 2)) == 2


def test_32_bits_low_word_first_or_last() -> None:
    device = UserMap(
        [
            Entry(HOLDING, 0, Fixed(0x0001_0002), words=2, writable=True),
            Entry(HOLDING, 2, Fixed(-2), words=2, writable=True, high_first=True, count=2, high=0xDEADBEEF),
        ]
    )
    assert registers(device, 0, 6) == (2, 1, 0xFFFF, 0xFFFE, 0xFFFF, 0xFFFE)
    assert put(device, 4, 0xDEAD, 0xBEEF) == 0
    assert put(device, 4, 0xDEAD, 0xBEF0) == 3  # more than its highest value, as one number of 32 bits
    assert registers(device, 4, 2) == (0xDEAD, 0xBEEF)
    assert put(device, 0, 0xDEAD, 0xBEEF) == 0
    assert registers(device, 0, 2) == (0xDEAD, 0xBEEF)
    assert put(device, 0, 1) == 2  # half of it
    assert code(device, Request(3, 1, 2)) == 2


def test_bits() -> None:
    device = UserMap(
        [
            Entry(Space.COILS, 0, count=8, writable=True),
            Entry(Space.INPUTS, 0, Toggle(S)),
            Entry(Space.INPUTS, 1, Fixed(5)),
        ]
    )
    assert code(device, write_coils(2, (1, 1))) == 0
    assert ask(device, Request(1, 0, 8)) == (0, 0, 1, 1, 0, 0, 0, 0)
    assert ask(device, Request(2, 0, 2), 0) == (0, 1)
    assert ask(device, Request(2, 0, 2), S) == (1, 1)


def test_values_over_time() -> None:
    device = UserMap(
        [
            Entry(Space.INPUT_REGISTERS, 0, Sweep(100, 200, 10 * S)),
            Entry(Space.INPUT_REGISTERS, 1, Sweep(200, 100, 10 * S, repeat=True)),
            Entry(Space.INPUT_REGISTERS, 2, Counter(S)),
            Entry(Space.INPUT_REGISTERS, 3, Sweep(0, 1_000_000, 10 * S), words=2),
        ]
    )

    def at(tick: int) -> object:
        return ask(device, Request(4, 0, 5), tick)

    assert at(0) == (100, 200, 0, 0, 0)
    assert at(5 * S) == (150, 150, 5, 500_000 & 0xFFFF, 500_000 >> 16)
    assert at(10 * S) == (200, 200, 10, 1_000_000 & 0xFFFF, 1_000_000 >> 16)
    assert at(25 * S) == (200, 150, 25, 1_000_000 & 0xFFFF, 1_000_000 >> 16)


@given(st.integers(-1000, 1000), st.integers(-1000, 1000), st.integers(1, 10**6), st.integers(0, 2 * 10**6))
def test_a_sweep_stays_on_its_line(start: int, stop: int, over: int, tick: int) -> None:
    value = Sweep(start, stop, over).value(tick)
    exact = start + (stop - start) * min(tick, over) / over
    assert abs(value - exact) < 1 + 1e-6
    assert min(start, stop) <= value <= max(start, stop)
    assert Sweep(start, stop, over).value(over) == stop


def test_noise_is_a_function_of_key_and_time_alone() -> None:
    noise = Noise(500, 20, S, noise_key(7, "tank", "level"))
    forwards = [noise.value(k * S) for k in range(100)]
    backwards = [noise.value(k * S + S - 1) for k in reversed(range(100))]
    assert forwards == backwards[::-1]
    other = Noise(500, 20, S, noise_key(8, "tank", "level"))
    assert forwards != [other.value(k * S) for k in range(100)]
    # These very numbers in any process.
    assert forwards[:6] == NOISE


NOISE = [495, 488, 495, 490, 512, 503]


def test_uniform_noise_fills_its_range_evenly() -> None:
    count, spread = 8200, 20
    noise = Noise(0, spread, 1, noise_key(1, "u"))
    seen = [noise.value(k) for k in range(count)]
    buckets = [seen.count(value) for value in range(-spread, spread + 1)]
    assert sum(buckets) == count
    expected = count / 41
    chi2 = sum((bucket - expected) ** 2 / expected for bucket in buckets)
    assert chi2 < 40 + 4 * (2 * 40) ** 0.5  # four standard deviations of chi² with 40 degrees


def test_normal_noise_has_mean_and_deviation() -> None:
    count, sd = 10_000, 50
    noise = Noise(1000, sd, 1, noise_key(1, "n"), normal=True)
    seen = [noise.value(k) for k in range(count)]
    mean = sum(seen) / count
    variance = sum((value - mean) ** 2 for value in seen) / (count - 1)
    assert abs(mean - 1000) < 4 * sd / count**0.5
    assert abs(variance / (sd * sd + 1 / 12) - 1) < 4 * (2 / count) ** 0.5


def test_functions() -> None:
    device = UserMap([Entry(HOLDING, 0, Computed(lambda tick: tick // S * 3), name="f")])
    assert registers(device, 0, now=7 * S) == (21,)
    assert device.poll() is None


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (Computed(lambda tick: 1 // (tick - tick)), "ZeroDivisionError: integer division or modulo by zero"),
        (Computed(str), "TypeError: returned '9', not an integer"),
    ],
)
def test_functions_that_fail_are_a_device_failure(value: Value, message: str) -> None:
    device = UserMap([Entry(HOLDING, 0, value, name="f")])
    assert code(device, Request(3, 0, 1), 9) == 4
    failed = device.poll()
    assert failed is not None
    assert (failed.tick, failed.name, failed.error) == (9, "f", message)


def test_own_functions() -> None:
    device = UserMap([Entry(HOLDING, 0, count=50)], frozenset((3,)))
    assert code(device, Request(3, 0, 10)) == 0
    assert code(device, Request(1, 0, 1)) == 1
    assert code(device, write_registers(0, (1,))) == 1


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ([Entry(HOLDING, 0, count=2), Entry(HOLDING, 1)], "4xxxx address 1 overlaps 4xxxx address 0"),
        ([Entry(HOLDING, 65535, words=2)], "addresses 65535…65536, allowed 0…65535"),
        ([Entry(Space.INPUTS, 0, writable=True)], "Modbus cannot write 1xxxx"),
        ([Entry(Space.COILS, 0, words=2)], "items of 2 words; bits have 1, registers 1 or 2"),
        ([Entry(HOLDING, 0, words=3)], "items of 3 words"),
    ],
)
def test_maps_that_cannot_be(entries: list[Entry], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        UserMap(entries)


def test_functions_that_cannot_be() -> None:
    with pytest.raises(ValueError, match="functions 7, 8 are not known"):
        UserMap([], frozenset((3, 7, 8)))
