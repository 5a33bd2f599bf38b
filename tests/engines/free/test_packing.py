"""How the bytes of the free protocol lie in registers."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.engines.free.packing import pack, unpack


def test_manuals_figure_sixteen_bit() -> None:
    assert unpack([0x0201, 0x0403, 0x0005], 5, eight_bit=False) == bytes((1, 2, 3, 4, 5))
    assert pack(bytes((0x11, 0x12, 0x13, 0x14)), eight_bit=False) == [0x1211, 0x1413]


def test_eight_bit_is_one_byte_a_word() -> None:
    assert unpack([0x0201, 0x0403, 0xFF05], 3, eight_bit=True) == bytes((1, 3, 5))
    assert pack(b"\x01\x02", eight_bit=True) == [1, 2]


@given(st.binary(max_size=256), st.booleans())
def test_there_and_back(data: bytes, eight_bit: bool) -> None:
    words = pack(data, eight_bit=eight_bit)
    assert len(words) == (len(data) if eight_bit else (len(data) + 1) // 2)
    assert unpack(words, len(data), eight_bit=eight_bit) == data


@pytest.mark.parametrize(("eight_bit", "count"), [(True, 3), (False, 5)])
def test_too_few_registers(eight_bit: bool, count: int) -> None:
    with pytest.raises(ValueError, match=f"2 registers do not hold {count} bytes"):
        unpack([1, 2], count, eight_bit=eight_bit)
