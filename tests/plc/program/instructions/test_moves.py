"""MOV CML XCH BMOV FMOV BCD BIN, logic and MEAN, from their definitions in words."""

from __future__ import annotations

import pytest

from tests.plc.program.rigs import Rig, always


def test_mov_copies_16_bits_while_its_condition_is_on() -> None:
    rig = Rig("LD X0 / MOV D0 D1").put(D0=5).scan()
    assert rig.word("D1") == 0
    assert rig.scan(X0=1).word("D1") == 5
    assert rig.put(D0=6).scan().word("D1") == 6
    assert rig.put(D0=7).scan(X0=0).word("D1") == 6


def test_movp_copies_once_per_edge() -> None:
    rig = Rig("LD X0 / MOVP D0 D1").put(D0=5).scan(X0=1)
    assert rig.put(D0=6).scan(3).word("D1") == 5
    assert rig.scan(X0=0).scan(X0=1).word("D1") == 6


@pytest.mark.parametrize(
    ("text", "value"),
    [("MOV K-1 D1", -1), ("MOV K-32768 D1", -32768), ("MOV H8000 D1", -32768), ("MOV H1F D1", 31), ("MOV K32767 D1", 32767),
     ("mov k+7 d1", 7)],
)  # fmt: skip
def test_constants(text: str, value: int) -> None:
    assert always(text).value("D1") == value


def test_dmov_moves_pairs() -> None:
    assert always("DMOV K-70000 D0").pair("D0") == -70_000
    assert always("DMOV HFFFFFFFF D0").pair("D0") == -1
    assert always("DMOV D0 D4", D0=1, D1=2).pair("D4") == 0x20001
    assert always("DMOV D0 C200", D0=1, D1=0x8000).word("C200") == 0x80000001
    assert always("DMOV C200 D0", C200=0x12345678).pair("D0") == 0x12345678
    rig = always("DMOV H12345678 Z1 / DMOV Z1 D0")
    assert (rig.word("Z1"), rig.word("V1"), rig.pair("D0")) == (0x5678, 0x1234, 0x12345678)


def test_groups_hold_the_lowest_bit_at_the_lowest_address() -> None:
    rig = Rig("LD M8000 / MOV K1X0 D0 / MOV K2X0 D1 / MOV K3X0 D2 / MOV K4X0 D3 / DMOV K8X0 D4")
    rig.scan(X0=1, X3=1, X4=1, X10=1, X17=1, X37=1)
    assert [rig.word(f"D{n}") for n in range(4)] == [0x9, 0x19, 0x119, 0x8119]
    assert rig.pair("D4") == 0x80008119 - (1 << 32)
    # A group of less than 16 bits is never negative; K4 is a signed word.
    rig = Rig("LD< K3M0 K0 / OUT Y0 / LD< K4M0 K0 / OUT Y1").scan(**{f"M{n}": 1 for n in range(16)})
    assert rig.bits("Y0", "Y1") == [0, 1]


def test_a_group_as_destination_takes_the_low_bits_and_nothing_beyond() -> None:
    rig = always("MOV HFFFF K1Y1")
    assert rig.bits("Y0", "Y1", "Y2", "Y3", "Y4", "Y5") == [0, 1, 1, 1, 1, 0]
    rig = always("MOV HA5C3 K3M10")
    assert sum(rig.bit(f"M{10 + n}") << n for n in range(12)) == 0x5C3
    assert rig.bit("M22") == 0
    rig = always("DMOV H89ABCDEF K8S0")
    assert sum(rig.bit(f"S{n}") << n for n in range(32)) == 0x89ABCDEF


def test_a_group_to_a_wider_group_is_filled_with_zeros() -> None:
    rig = Rig("LD M8000 / MOV K1X0 K2M0").scan(X1=1, M5=1, M0=1)
    assert sum(rig.bit(f"M{n}") << n for n in range(8)) == 2
    rig = Rig("LD M8000 / MOV K2X0 K1M0").scan(X1=1, X4=1, M4=1)
    assert sum(rig.bit(f"M{n}") << n for n in range(8)) == 0x12
    rig = Rig("LD M8000 / MOV K2M0 K2M2").scan(M0=1, M7=1)
    assert sum(rig.bit(f"M{n}") << n for n in range(12)) == 0x81 << 2 | 1


def test_cml_inverts() -> None:
    assert always("CML D0 D1", D0=0x00FF).word("D1") == 0xFF00
    assert always("DCML D0 D2", D0=0xFFFF, D1=0x1234).pair("D2") == 0xEDCB0000 - (1 << 32)
    assert Rig("LD M8000 / CML K1X0 K1Y0").scan(X1=1).bits("Y0", "Y1", "Y2", "Y3") == [1, 0, 1, 1]


def test_xch_changes_places_in_every_scan_and_xchp_once() -> None:
    rig = Rig("LD X0 / XCH D0 D1").put(D0=1, D1=2).scan(X0=1)
    assert (rig.word("D0"), rig.word("D1")) == (2, 1)
    assert rig.scan().word("D0") == 1
    rig = Rig("LD X0 / DXCHP D0 D2").put_pair("D0", 70_000).put_pair("D2", -1).scan(3, X0=1)
    assert (rig.pair("D0"), rig.pair("D2")) == (-1, 70_000)
    # The register is exchanged with the word that it pointed at before.
    rig = always("XCH Z0 D0Z0", Z0=3, D3=500)
    assert (rig.word("Z0"), rig.word("D3"), rig.error()) == (500, 3, 0)


def test_bmov_copies_as_if_all_were_read_first() -> None:
    words = {f"D{n}": n + 1 for n in range(6)}
    up = always("BMOV D0 D2 K4", **words)
    assert [up.word(f"D{n}") for n in range(6)] == [1, 2, 1, 2, 3, 4]
    down = always("BMOV D2 D0 K4", **words)
    assert [down.word(f"D{n}") for n in range(6)] == [3, 4, 5, 6, 5, 6]
    assert always("BMOV D0 T0 K2", **words).word("T1") == 2


def test_bmov_of_groups_moves_group_after_group() -> None:
    rig = Rig("LD M8000 / BMOV K1X0 K1M10 K2").scan(X1=1, X7=1)
    assert sum(rig.bit(f"M{10 + n}") << n for n in range(8)) == 0x82
    rig = always("BMOV D0 K1M0 K3", D0=0x1F, D1=2, D2=3)
    assert sum(rig.bit(f"M{n}") << n for n in range(12)) == 0x32F


def test_m8024_turns_bmov_round() -> None:
    rig = Rig("LD X0 / OUT M8024 / LD M8000 / BMOV D0 D10 K3").put(D0=1, D1=2, D2=3, D10=7, D11=8, D12=9)
    rig.scan(X0=1)
    assert [rig.word(f"D{n}") for n in (0, 1, 2, 3, 10, 11, 12)] == [7, 8, 9, 0, 7, 8, 9]
    rig.put(D0=1).scan(X0=0)
    assert [rig.word(f"D{n}") for n in (0, 1, 2, 10, 11, 12, 13)] == [1, 8, 9, 1, 8, 9, 0]
    rig = Rig("LD M8000 / SET M8024 / BMOV K1M0 K1M10 K2").scan(M11=1, M17=1)
    assert sum(rig.bit(f"M{n}") << n for n in range(9)) == 0x82


def test_bmov_that_is_turned_round_has_its_errors_too() -> None:
    rig = Rig("LD M8000 / SET M8024 / BMOV K1X0 D0 K1").put(D0=5).scan()
    assert (rig.error(), rig.bits("X0", "X2")) == (6706, [0, 0])
    rig = Rig("LD M8000 / SET M8024 / BMOV D0 D8250 D9").put(D9=7, D8250=5).scan()
    assert (rig.error(), rig.word("D0")) == (6706, 0)


@pytest.mark.parametrize("count", [0, -1, 513])
def test_a_count_out_of_range_is_an_error(count: int) -> None:
    rig = always("BMOV D0 D1 D9", D0=5, D9=count)
    assert (rig.error(), rig.word("D1")) == (6706, 0)


def test_bmov_beyond_the_last_register_moves_nothing() -> None:
    rig = always("BMOV D0 D8250 D9", D0=5, D9=7)
    assert (rig.error(), rig.word("D8250")) == (6706, 0)


def test_blocks_among_the_special_registers() -> None:
    assert always("BMOV D8100 D8200 K3 / FMOV K7 D8210 K2", D8102=9).word("D8202") == 9


def test_fmov_fills() -> None:
    rig = always("FMOV K-1 D0 K3")
    assert [rig.value(f"D{n}") for n in range(4)] == [-1, -1, -1, 0]
    rig = always("DFMOV H10002 D0 K2")
    assert [rig.word(f"D{n}") for n in range(5)] == [2, 1, 2, 1, 0]


@pytest.mark.parametrize(("value", "pattern"), [(0, 0), (9, 9), (10, 0x10), (9999, 0x9999), (1234, 0x1234)])
def test_bcd_and_back(value: int, pattern: int) -> None:
    assert always("BCD D0 D1 / BIN D1 D2", D0=value).put(D3=0).word("D1") == pattern
    assert always("BIN D0 D1", D0=pattern).word("D1") == value


def test_bcd_of_32_bits() -> None:
    rig = Rig("LD M8000 / DBCD D0 D2 / DBIN D2 D4").put_pair("D0", 98_765_432).scan()
    assert rig.pair("D2") == 0x98765432 - (1 << 32)
    assert rig.pair("D4") == 98_765_432


@pytest.mark.parametrize(
    "text",
    ["BCD K10000 D1", "BCD K-1 D1", "DBCD K100000000 D0", "BIN HA D1", "BIN H9F99 D1", "DBIN HA0000000 D0"],
)
def test_what_has_no_decimal_digits_is_an_error(text: str) -> None:
    rig = always(text, D0=7, D1=8)
    assert (rig.error(), rig.word("D0"), rig.word("D1")) == (6706, 7, 8)


def test_bcd_into_a_display_of_two_digits() -> None:
    rig = always("BCD K42 K2Y0")
    assert sum(rig.bit(f"Y{n:o}") << n for n in range(8)) == 0x42


def test_logic() -> None:
    for name, wide, expected in (("WAND", "DAND", 0x0F & 0x3C), ("WOR", "DOR", 0x3F), ("WXOR", "DXOR", 0x33)):
        assert always(f"{name} D0 D1 D2", D0=0x0F, D1=0x3C).word("D2") == expected
        assert always(f"{wide}P D0 D2 D4", D1=0x0F, D3=0x3C).pair("D4") == expected << 16
        rig = Rig(f"LD M8000 / {name} K1X0 K1X4 K1Y0").scan(X0=1, X1=1, X5=1, X6=1)
        assert rig.bits("Y0", "Y1", "Y2", "Y3") == [
            (0x3 & 0x6, 0x7, 0x5)[("WAND", "WOR", "WXOR").index(name)] >> n & 1 for n in range(4)
        ]


def test_mean_drops_its_fraction() -> None:
    assert always("MEAN D0 D9 K4", D0=1, D1=2, D2=3, D3=5).value("D9") == 2
    assert always("MEAN D0 D9 K2", D0=-1, D1=-2).value("D9") == -1
    assert (
        Rig("LD M8000 / DMEAN D0 D10 K2").put_pair("D0", 100_000).put_pair("D2", 200_001).scan().pair("D10")
        == 150_000
    )
    assert always("MEAN D0 D9 D20", D20=65).error() == 6706
