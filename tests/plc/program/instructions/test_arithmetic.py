"""ADD SUB MUL DIV INC DEC NEG CMP ZCP from their definitions in words."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.plc.program.rigs import Rig, always

LEAST, MOST = -32768, 32767
LEAST_32, MOST_32 = -(1 << 31), (1 << 31) - 1


@pytest.mark.parametrize(
    ("name", "one", "other", "result", "flags"),
    [
        ("ADD", 2, 3, 5, ""),
        ("ADD", -2, 2, 0, "z"),
        ("ADD", MOST, 1, 0, "zc"),
        ("ADD", MOST, 2, 1, "c"),
        ("ADD", MOST, 0, MOST, ""),
        ("ADD", LEAST, -1, 0, "zb"),
        ("ADD", LEAST, -2, -1, "b"),
        ("ADD", LEAST, 0, LEAST, ""),
        ("ADD", LEAST, LEAST, -MOST, "b"),
        ("ADD", MOST, MOST, MOST - 1, "c"),
        ("SUB", 2, 3, -1, ""),
        ("SUB", 3, 3, 0, "z"),
        ("SUB", LEAST, 1, 0, "zb"),
        ("SUB", LEAST, 3, -2, "b"),
        ("SUB", MOST, -1, 0, "zc"),
        ("SUB", 0, LEAST, 0, "zc"),
        ("SUB", -1, MOST, LEAST, ""),
        ("SUB", LEAST, LEAST, 0, "z"),
    ],
)
@pytest.mark.parametrize("target", ["D9", "K4Y0", "D9Z7"])
def test_sums_and_their_flags(name: str, one: int, other: int, result: int, flags: str, target: str) -> None:
    rig = Rig(f"LD M8000 / {name} D0 D1 {target}").put(D0=one, D1=other).scan(M8020=1, M8021=1, M8022=1)
    got = rig.value("D9") if target[0] == "D" else sum(rig.bit(f"Y{n:o}") << n for n in range(16))
    assert got & 0xFFFF == result & 0xFFFF
    assert rig.flags() == flags


@pytest.mark.parametrize(
    ("name", "one", "other", "result", "flags"),
    [
        ("DADD", 70_000, -70_000, 0, "z"),
        ("DADD", MOST, 1, 32768, ""),
        ("DADD", MOST_32, 1, 0, "zc"),
        ("DADD", MOST_32, 5, 4, "c"),
        ("DADD", LEAST_32, -1, 0, "zb"),
        ("DSUB", LEAST_32, 2, -1, "b"),
        ("DSUB", MOST_32, -1, 0, "zc"),
        ("DSUB", 100_000, 1, 99_999, ""),
    ],
)
def test_sums_of_32_bits(name: str, one: int, other: int, result: int, flags: str) -> None:
    rig = Rig(f"LD M8000 / {name} D0 D2 D4").put_pair("D0", one).put_pair("D2", other).scan()
    assert (rig.pair("D4"), rig.flags()) == (result, flags)


def test_the_source_may_be_the_destination_and_counts_every_scan() -> None:
    rig = Rig("LD X0 / ADD D0 K10 D0 / SUBP D1 K10 D1").scan(3, X0=1)
    assert (rig.value("D0"), rig.value("D1")) == (30, -10)


def test_flags_keep_while_the_instruction_is_not_carried_out() -> None:
    rig = Rig("LD X0 / ADD K1 K-1 D0").scan(X0=1).scan(X0=0)
    assert rig.flags() == "z"


@pytest.mark.parametrize(("one", "other"), [(3, 4), (-3, 4), (LEAST, LEAST), (MOST, LEAST), (0, -5)])
def test_a_product_has_twice_the_width(one: int, other: int) -> None:
    assert always("MUL D0 D1 D2", D0=one, D1=other).pair("D2") == one * other
    rig = Rig("LD M8000 / DMUL D0 D2 D4").put_pair("D0", one * 65536).put_pair("D2", other * 32768).scan()
    pattern = sum(rig.word(f"D{4 + n}") << 16 * n for n in range(4))
    assert (pattern ^ 1 << 63) - (1 << 63) == one * 65536 * other * 32768
    rig = always("MUL D0 D1 K8M0", D0=one, D1=other)
    assert sum(rig.bit(f"M{n}") << n for n in range(32)) == one * other & 0xFFFFFFFF


@pytest.mark.parametrize(
    ("one", "other", "quotient", "rest"),
    [
        (7, 2, 3, 1),
        (-7, 2, -3, -1),
        (7, -2, -3, 1),
        (-7, -2, 3, -1),
        (0, 5, 0, 0),
        (1, 5, 0, 1),
        (LEAST, 1, LEAST, 0),
        (LEAST, LEAST, 1, 0),
    ],
)
def test_a_division_drops_the_fraction_and_its_rest_has_the_dividends_sign(
    one: int, other: int, quotient: int, rest: int
) -> None:
    rig = always("DIV D0 D1 D2", D0=one, D1=other)
    assert (rig.value("D2"), rig.value("D3"), rig.error()) == (quotient, rest, 0)
    rig = Rig("LD M8000 / DDIV D0 D2 D4").put_pair("D0", one).put_pair("D2", other).scan()
    assert (rig.pair("D4"), rig.pair("D6")) == (quotient, rest)
    rig = always("DIV D0 D1 K4M0", D0=one, D1=other)
    assert sum(rig.bit(f"M{n}") << n for n in range(16)) == quotient & 0xFFFF


@pytest.mark.parametrize(("one", "other"), [(5, 0), (0, 0), (LEAST, -1)])
def test_a_division_that_has_no_result_is_an_error(one: int, other: int) -> None:
    rig = always("DIV D0 D1 D2", D0=one, D1=other, D2=77)
    assert (rig.error(), rig.word("D2")) == (6706, 77)
    assert rig.word("D8069") == 1


def test_the_first_error_is_latched_with_its_step_and_the_latest_one_shown() -> None:
    rig = always("DIV D0 D0 D2 / BCD K-1 D1 / MOV K1 D3")
    assert (rig.word("D8067"), rig.word("D8069"), rig.word("D8068"), rig.bit("M8068")) == (6706, 8, 1, 1)
    assert rig.word("D3") == 1  # the program goes on
    assert rig.scan().bit("M8067") == 1
    rig.run.run(0)
    assert (rig.bit("M8067"), rig.bit("M8068"), rig.word("D8067"), rig.word("D8069")) == (0, 0, 0, 0)


def test_inc_and_dec_go_round_and_touch_no_flag() -> None:
    rig = (
        Rig("LD X0 / INC D0 / DEC D1 / DINC D2 / DDEC D4 / INC K1Y0")
        .put(D0=MOST, D1=LEAST)
        .put_pair("D2", MOST_32)
    )
    rig.put_pair("D4", LEAST_32).scan(X0=1, M8020=1, Y0=1, Y1=1, Y2=1, Y3=1)
    assert (rig.value("D0"), rig.value("D1"), rig.pair("D2"), rig.pair("D4")) == (
        LEAST,
        MOST,
        LEAST_32,
        MOST_32,
    )
    assert rig.flags() == "z"
    assert rig.bits("Y0", "Y1", "Y2", "Y3") == [0, 0, 0, 0]


def test_inc_counts_every_scan_and_incp_every_edge() -> None:
    rig = Rig("LD X0 / INC D0 / INCP D1 / DECP Z3").scan(3, X0=1).scan(X0=0).scan(2, X0=1)
    assert (rig.value("D0"), rig.value("D1"), rig.value("Z3")) == (5, 2, -2)


def test_dinc_of_a_long_counter() -> None:
    assert always("DINC C210", C210=0xFFFFFFFF).word("C210") == 0


@pytest.mark.parametrize(("value", "result"), [(5, -5), (-5, 5), (0, 0), (LEAST, LEAST)])
def test_neg(value: int, result: int) -> None:
    assert always("NEG D0", D0=value).value("D0") == result
    assert Rig("LD M8000 / DNEG D0").put_pair("D0", value).scan().pair("D0") == -value


@pytest.mark.parametrize("value", [-5, 3, 4, 40_000])
def test_cmp_reports_above_equal_below(value: int) -> None:
    expected = [int(value > 3), int(value == 3), int(value < 3)]
    if value < MOST:
        assert always("CMP D0 K3 M0", D0=value).bits("M0", "M1", "M2") == expected
        assert always("CMP D0 K3 M0Z0", D0=value, Z0=4).bits("M4", "M5", "M6") == expected
    assert Rig("LD M8000 / DCMP D0 K3 Y0").put_pair("D0", value).scan().bits("Y0", "Y1", "Y2") == expected


def test_cmp_leaves_its_bits_when_it_is_not_carried_out() -> None:
    rig = Rig("LD X0 / CMP D0 K3 M0").put(D0=9).scan(X0=1).put(D0=1).scan(X0=0)
    assert rig.bits("M0", "M1", "M2") == [1, 0, 0]


@pytest.mark.parametrize(
    ("value", "expected"),
    [(-11, [1, 0, 0]), (-10, [0, 1, 0]), (0, [0, 1, 0]), (10, [0, 1, 0]), (11, [0, 0, 1])],
)
def test_zcp_reports_below_within_above(value: int, expected: list[int]) -> None:
    assert always("ZCP K-10 K10 D0 M0", D0=value).bits("M0", "M1", "M2") == expected
    assert (
        Rig("LD M8000 / DZCP K-10 K10 D0 S0").put_pair("D0", value).scan().bits("S0", "S1", "S2") == expected
    )


@pytest.mark.parametrize(
    ("value", "expected"),
    [(-70_001, [1, 0, 0]), (-70_000, [0, 1, 0]), (0, [0, 1, 0]), (70_000, [0, 1, 0]), (70_001, [0, 0, 1])],
)
def test_zcp_of_32_bits_compares_all_of_them(value: int, expected: list[int]) -> None:
    """Limits and value that 16 bits cannot hold, in constants and in pairs of registers."""
    rig = Rig("LD M8000 / DZCP K-70000 K70000 D0 M0 / DZCP D2 D4 D0 M10")
    rig.put_pair("D0", value).put_pair("D2", -70_000).put_pair("D4", 70_000).scan()
    assert rig.bits("M0", "M1", "M2") == rig.bits("M10", "M11", "M12") == expected


def test_zcp_with_limits_the_wrong_way_round_has_the_lower_one_twice() -> None:
    assert always("ZCP K10 K0 K5 M0").bits("M0", "M1", "M2") == [1, 0, 0]
    assert always("ZCP K10 K0 K10 M0").bits("M0", "M1", "M2") == [0, 1, 0]


@given(st.integers(LEAST, MOST), st.integers(LEAST, MOST))
def test_beyond_a_limit_sums_go_on_from_0_with_its_sign(one: int, other: int) -> None:
    rig = always("ADD D0 D1 D2 / SUB D0 D1 D3 / ADD D0 D1 D4Z0", D0=one, D1=other)
    # Counted up one by one, 32767 is followed by 0; counted down, -32768 is.
    upwards, downwards = (
        [*range(LEAST, MOST + 1), *range(MOST + 1)],
        [*range(MOST, LEAST - 1, -1), *range(0, LEAST - 1, -1)],
    )
    for exact, device in ((one + other, "D2"), (one - other, "D3"), (one + other, "D4")):
        assert rig.value(device) == (upwards[exact - LEAST] if exact >= 0 else downwards[MOST - exact])
