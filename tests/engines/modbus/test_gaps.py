"""The silences of RTU as exact fractions."""

from __future__ import annotations

from fractions import Fraction

import pytest

from bussim.devices.v80.map import V80_PORT
from bussim.engines.modbus.adu import Mode
from bussim.engines.modbus.framing import Framing
from bussim.engines.modbus.gaps import silences
from bussim.line.characters import BAUDS, CharFormat, LineTiming
from bussim.units import TICKS_PER_SECOND

BITS = {"8N1": 10, "8E1": 11, "8N2": 11}


@pytest.mark.parametrize("baud", BAUDS)
@pytest.mark.parametrize("name", BITS)
def test_table_of_silences(baud: int, name: str) -> None:
    timing = LineTiming(baud, CharFormat.parse(name))
    inner, end = silences(timing)
    if baud > 19200:
        assert (inner, end) == (
            Fraction(750, 10**6) * TICKS_PER_SECOND,
            Fraction(175, 10**5) * TICKS_PER_SECOND,
        )
    else:
        character = Fraction(BITS[name], baud)
        assert inner == Fraction(3, 2) * character * TICKS_PER_SECOND
        assert end == Fraction(7, 2) * character * TICKS_PER_SECOND


@pytest.mark.parametrize(
    ("baud", "name", "milliseconds"),
    [
        (4800, "8N1", Fraction(35, 10) * Fraction(10, 4800) * 1000),  # 7.29 ms
        (9600, "8N1", Fraction(35000, 9600)),  # 3.65 ms
        (9600, "8E1", Fraction(38500, 9600)),  # 4.01 ms: parity counts
        (19200, "8N2", Fraction(38500, 19200)),  # 2.01 ms
        (38400, "8E1", Fraction(7, 4)),
        (115200, "8N1", Fraction(7, 4)),
    ],
)
def test_figures(baud: int, name: str, milliseconds: Fraction) -> None:
    end = silences(LineTiming(baud, CharFormat.parse(name))).end
    assert end * 1000 / TICKS_PER_SECOND == milliseconds


@pytest.mark.parametrize("baud", BAUDS)
@pytest.mark.parametrize("name", BITS)
def test_v80_ends_frames_after_four_and_a_half_characters_at_every_rate(baud: int, name: str) -> None:
    timing = LineTiming(baud, CharFormat.parse(name))
    end = silences(timing, V80_PORT.gaps).end
    assert end == Fraction(9, 2) * Fraction(BITS[name], baud) * TICKS_PER_SECOND


def test_a_clock_that_is_fast_measures_short_characters() -> None:
    line = LineTiming(9600, CharFormat(8, "N", 1), Fraction(1000))
    assert silences(line).end == Fraction(7, 2) * 75_000 / (1 + Fraction(1000, 10**6))


def test_rtu_needs_eight_data_bits_and_rounds_once() -> None:
    with pytest.raises(ValueError, match="RTU needs 8 data bits, 7E1 has 7"):
        Framing.rtu(LineTiming(9600, CharFormat(7, "E", 1)))
    framing = Framing.rtu(LineTiming(4800, CharFormat(8, "N", 1), Fraction(7)))
    exact = Fraction(7, 2) * 150_000 / (1 + Fraction(7, 10**6))
    assert abs(framing.quiet - exact) <= Fraction(1, 2)
    assert framing.mode is Mode.RTU
