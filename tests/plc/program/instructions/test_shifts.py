"""ROR ROL SFTR SFTL ALT ZRST from their definitions in words."""

from __future__ import annotations

import pytest

from tests.plc.program.rigs import Rig, always, problems


@pytest.mark.parametrize(
    ("text", "before", "after", "carry"),
    [
        ("ROL D0 K1", 0x8001, 0x0003, 1),
        ("ROL D0 K4", 0xF00F, 0x00FF, 1),
        ("ROL D0 K4", 0x0FFF, 0xFFF0, 0),
        ("ROR D0 K1", 0x8001, 0xC000, 1),
        ("ROR D0 K4", 0x00F0, 0x000F, 0),
        # The last bit that went round at the right end: bit n-1 of what was there.
        ("ROR D0 K1", 0x7FFE, 0x3FFF, 0),
        ("ROR D0 K4", 0x0008, 0x8000, 1),
        ("ROR D0 K4", 0xFFF7, 0x7FFF, 0),
        ("ROR D0 K16", 0x7FFF, 0x7FFF, 0),
        ("ROR D0 K16", 0x8123, 0x8123, 1),
        ("ROL D0 K16", 0x8123, 0x8123, 1),
    ],
)
def test_rotations(text: str, before: int, after: int, carry: int) -> None:
    rig = always(text, D0=before)
    assert (rig.word("D0"), rig.bit("M8022")) == (after, carry)


def test_rotations_of_32_bits_and_of_groups() -> None:
    rig = Rig("LD M8000 / DROL D0 K8").put_pair("D0", 0x12345678).scan()
    assert (rig.pair("D0"), rig.bit("M8022")) == (0x34567812, 0)
    rig = Rig("LD M8000 / RORP K4Y0 K1").scan(Y0=1)
    assert rig.bits("Y0", "Y17", "M8022") == [0, 1, 1]
    rig = Rig("LD M8000 / DROR D0 K20").put_pair("D0", 1 << 19).scan()
    assert (rig.word("D0"), rig.word("D1"), rig.bit("M8022")) == (0, 0x8000, 1)
    rig = Rig("LD M8000 / DROR D0 K20").put_pair("D0", 1 << 20).scan()
    assert (rig.pair("D0"), rig.bit("M8022")) == (1, 0)
    assert "K4" in problems("LD X0 / ROR K2Y0 K1 / END")[0]


def test_sftl_moves_a_row_up() -> None:
    rig = Rig("LD X7 / SFTLP X0 M0 K6 K2").scan(M0=1, M3=1, M5=1, X0=1, X1=0, X7=1)
    assert rig.bits(*(f"M{n}" for n in range(7))) == [1, 0, 1, 0, 0, 1, 0]


def test_sftr_moves_a_row_down() -> None:
    rig = Rig("LD X7 / SFTRP X0 M0 K6 K2").scan(M0=1, M3=1, M5=1, X0=1, X1=0, X7=1)
    assert rig.bits(*(f"M{n}" for n in range(7))) == [0, 1, 0, 1, 1, 0, 0]


def test_a_whole_row_may_be_replaced() -> None:
    for name in ("SFTL", "SFTR"):
        rig = Rig(f"LD M8000 / {name} X0 M0 K3 K3").scan(X0=1, X2=1, M1=1)
        assert rig.bits("M0", "M1", "M2", "M3") == [1, 0, 1, 0]


def test_alt_changes_over() -> None:
    rig = Rig("LD X0 / ALTP M0 / ALT M1").scan(3, X0=1)
    assert rig.bits("M0", "M1") == [1, 1]
    assert rig.scan(X0=0).scan(X0=1).bits("M0", "M1") == [0, 0]


def test_zrst_clears_from_one_device_to_another() -> None:
    rig = Rig("LD X0 / ZRST M2 M4 / ZRST D2 D4 / ZRST Y6 Y11 / ZRST C0 C1 / ZRST T0 T1")
    rig.put(**{f"D{n}": 5 for n in range(6)}, C0=3, C1=3, C2=3, T1=3, T2=3)
    rig.scan(X0=1, **{f"M{n}": 1 for n in range(6)}, **{f"Y{n:o}": 1 for n in range(5, 11)}, C1=1, C2=1)
    assert rig.bits(*(f"M{n}" for n in range(6))) == [1, 1, 0, 0, 0, 1]
    assert [rig.word(f"D{n}") for n in range(6)] == [5, 5, 0, 0, 0, 5]
    assert rig.bits("Y5", "Y6", "Y7", "Y10", "Y11", "Y12") == [1, 0, 0, 0, 0, 1]
    assert [rig.word(name) for name in ("C0", "C1", "C2", "T1", "T2")] == [0, 0, 3, 0, 3]
    assert rig.bits("C1", "C2") == [0, 1]


def test_zrst_the_wrong_way_round_clears_the_first_one() -> None:
    rig = Rig("LD X0 / ZRST M4 M2").scan(X0=1, M2=1, M3=1, M4=1)
    assert rig.bits("M2", "M3", "M4") == [1, 1, 0]
