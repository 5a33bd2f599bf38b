"""OUT SET RST PLS PLF, timers and counters, from their definitions in words."""

from __future__ import annotations

import pytest

from tests.plc.program.rigs import Rig


def test_out_follows_and_set_stays() -> None:
    rig = Rig("LD X0 / OUT Y0 / LD X0 / SET Y1 / LD X1 / RST Y1")
    assert rig.scan(X0=1).bits("Y0", "Y1") == [1, 1]
    assert rig.scan(X0=0).bits("Y0", "Y1") == [0, 1]
    assert rig.scan(X1=1).bits("Y0", "Y1") == [0, 0]


def test_of_two_coils_the_last_one_executed_wins() -> None:
    assert Rig("LD X0 / OUT Y0 / LD X1 / OUT Y0").scan(X0=1).bit("Y0") == 0


def test_rst_clears_words_and_the_registers() -> None:
    rig = Rig("LD X0 / RST D5 / RST V1 / RST Z / RST S3").put(D5=9, V1=8, Z0=7).scan(S3=1)
    assert (rig.word("D5"), rig.word("V1"), rig.word("Z0"), rig.bit("S3")) == (9, 8, 7, 1)
    rig.scan(X0=1)
    assert (rig.word("D5"), rig.word("V1"), rig.word("Z0"), rig.bit("S3")) == (0, 0, 0, 0)


@pytest.mark.parametrize(("name", "expected"), [("PLS", [0, 1, 0, 0, 1]), ("PLF", [0, 0, 0, 1, 0])])
def test_a_pulse_lasts_one_scan(name: str, expected: list[int]) -> None:
    rig = Rig(f"LD X0 / {name} M0")
    assert [rig.scan(X0=state).bit("M0") for state in (0, 1, 1, 0, 1)] == expected


@pytest.mark.parametrize(
    ("timer", "unit"), [("T0", 100), ("T199", 100), ("T200", 10), ("T245", 10), ("T246", 1), ("T249", 1), ("T250", 100), ("T255", 100)]
)  # fmt: skip
def test_a_timer_reaches_its_preset_within_its_last_unit_and_a_scan(timer: str, unit: int) -> None:
    for preset in (1, 2, 7):
        rig = Rig(f"LD X0 / OUT {timer} K{preset} / LD {timer} / OUT Y0")
        every = unit / 4
        rig.scan(3, every=every)  # the clock runs from power-on: it is not in step with the timer
        start = rig.ms
        rig.scan(X0=1, every=every)
        while not rig.bit("Y0"):
            assert rig.ms - start < 20 * unit
            rig.scan(every=every)
        took = rig.ms - every - start
        assert (preset - 1) * unit <= took <= preset * unit + every
        assert rig.word(timer) == preset
        assert rig.scan(8, every=unit).word(timer) == preset  # the clock stops there


def test_a_timer_begins_anew_where_its_condition_was_off() -> None:
    rig = Rig("LD X0 / OUT T0 K5").scan(4, every=100, X0=1)
    assert (rig.word("T0"), rig.bit("T0")) == (3, 0)
    assert (rig.scan(X0=0, every=100).word("T0"), rig.bit("T0")) == (0, 0)
    rig.scan(6, every=100, X0=1)
    assert (rig.word("T0"), rig.bit("T0")) == (5, 1)
    assert (rig.scan(X0=0).word("T0"), rig.bit("T0")) == (0, 0)


@pytest.mark.parametrize(("timer", "unit"), [("T246", 1), ("T250", 100)])
def test_a_retentive_timer_goes_on_where_it_was(timer: str, unit: int) -> None:
    rig = Rig(f"LD X0 / OUT {timer} K5 / LD X1 / RST {timer}").scan(4, every=unit, X0=1)
    assert rig.word(timer) == 3
    assert rig.scan(50, every=unit, X0=0).word(timer) == 3
    rig.scan(3, every=unit, X0=1)
    assert (rig.word(timer), rig.bit(timer)) == (5, 1)
    assert rig.scan(X0=0).bit(timer) == 1
    assert (rig.scan(X1=1).word(timer), rig.bit(timer)) == (0, 0)


def test_a_preset_may_be_a_register_and_one_below_1_is_reached_at_once() -> None:
    rig = Rig("LD X0 / OUT T0 D0").put(D0=2).scan(3, every=100, X0=1)
    assert rig.bit("T0") == 1
    for preset in (0, -1):
        rig = Rig("LD X0 / OUT T0 D0").put(D0=preset).scan(X0=1)
        assert (rig.bit("T0"), rig.word("T0")) == (1, 0)


def test_a_reset_timer_that_stays_driven_begins_anew() -> None:
    rig = Rig("LD X0 / OUT T0 K2 / LD X1 / RST T0").scan(4, every=100, X0=1)
    assert rig.bit("T0") == 1
    assert rig.scan(X1=1, every=100).bits("T0") == [0]
    # Its OUT stands in front of the RST that lets go of it: it begins in the scan after.
    rig.scan(3, every=100, X1=0)
    assert (rig.word("T0"), rig.bit("T0")) == (1, 0)
    assert rig.scan(every=100).bit("T0") == 1


@pytest.mark.parametrize(
    "order", ["OUT {d} K2 / LD X1 / RST {d}", "OUT Y7 / LD X1 / RST {d} / LD X0 / OUT {d} K2"]
)
@pytest.mark.parametrize("device", ["T0", "T199", "T250", "C0", "C100", "C200", "C234"])
def test_what_an_rst_holds_neither_counts_nor_closes(device: str, order: str) -> None:
    rig = Rig(f"LD X0 / {order.format(d=device)}")
    for _ in range(5):
        rig.scan(2, every=200, X0=1, X1=1)
        assert (rig.word(device), rig.bit(device)) == (0, 0)
        rig.scan(every=200, X0=0)
    rig.scan(X1=0)
    for _ in range(3):
        rig.scan(2, every=200, X0=1)
        rig.scan(X0=int(device[0] == "T"))
    assert rig.bit(device) == 1


@pytest.mark.parametrize("device", ["C0", "C200"])
def test_an_input_that_came_on_during_the_hold_is_no_edge_after_it(device: str) -> None:
    rig = Rig(f"LD X1 / RST {device} / LD X0 / OUT {device} K9").scan(X1=1).scan(2, X0=1).scan(3, X1=0)
    assert rig.word(device) == 0
    assert rig.scan(X0=0).scan(X0=1).word(device) == 1


@pytest.mark.parametrize("device", ["T250", "C0", "C200"])
def test_an_rst_that_is_jumped_over_while_it_is_on_goes_on_holding(device: str) -> None:
    text = f"LD X2 / CJ P0 / LD X1 / RST {device} / P0 / LD X0 / OUT {device} K9"
    rig = Rig(text).scan(X1=1).scan(X1=0, X2=1)
    for _ in range(3):
        rig.scan(3, every=100, X0=1).scan(X0=0)
    assert rig.word(device) == 0
    rig.scan(X2=0)  # now the RST is carried out, with its contact off
    assert rig.scan(3, every=100, X0=1).word(device) == (2 if device[0] == "T" else 1)


def test_master_control_that_is_off_lets_go() -> None:
    rig = Rig("LD X2 / MC N0 M50 / LD X1 / RST C0 / MCR N0 / LD X0 / OUT C0 K9").scan(X1=1, X2=1)
    assert rig.scan(X0=1).scan(X0=0).word("C0") == 0
    assert rig.scan(X2=0).scan(X0=1).word("C0") == 1


def test_of_two_rsts_the_last_one_carried_out_decides() -> None:
    rig = Rig("LD X1 / RST C0 / LD X2 / RST C0 / LD X0 / OUT C0 K9").scan(X1=1, X0=1)
    assert rig.word("C0") == 1
    assert rig.scan(X0=0, X1=0, X2=1).scan(X0=1).word("C0") == 0


def test_zrst_holds_nothing() -> None:
    rig = Rig("LD X1 / ZRST C0 C1 / LD X0 / OUT C0 K9 / OUT T250 K9 / LD X1 / ZRST T250 T250").scan(
        X1=1, X0=1
    )
    assert rig.word("C0") == 1
    assert rig.scan(3, every=100, X1=0).word("T250") == 2


def test_a_jump_pauses_a_timer_but_not_those_of_subroutines() -> None:
    rig = Rig("LD X1 / CJ P0 / LD X0 / OUT T0 K50 / OUT T192 K50 / P0").scan(4, every=100, X0=1)
    assert (rig.word("T0"), rig.word("T192")) == (3, 3)
    rig.scan(5, every=100, X1=1)
    rig.scan(every=100, X1=0)
    assert (rig.word("T0"), rig.word("T192")) == (3, 9)
    rig.scan(every=100)
    assert (rig.word("T0"), rig.word("T192")) == (4, 10)


@pytest.mark.parametrize(("timer", "goes_on"), [(191, False), (192, True), (199, True), (200, False)])
def test_the_timers_of_subroutines_are_t192_to_t199(timer: int, goes_on: bool) -> None:
    unit = 100 if timer < 200 else 10
    rig = Rig(f"LD X1 / CJ P0 / LD X0 / OUT T{timer} K90 / P0").scan(4, every=unit, X0=1)
    assert rig.word(f"T{timer}") == 3
    rig.scan(5, every=unit, X1=1)
    assert rig.scan(every=unit, X1=0).word(f"T{timer}") == (9 if goes_on else 3)


def test_a_scan_that_takes_several_units_counts_them_all() -> None:
    assert Rig("LD X0 / OUT T200 K100").scan(3, every=250, X0=1).word("T200") == 50


@pytest.mark.parametrize("counter", ["C0", "C99", "C100", "C199"])
def test_a_counter_counts_edges_and_stops_at_its_preset(counter: str) -> None:
    rig = Rig(f"LD X1 / RST {counter} / LD X0 / OUT {counter} K3 / LD {counter} / OUT Y0")
    seen = []
    for _ in range(5):
        rig.scan(2, X0=1).scan(X0=0)
        seen.append((rig.word(counter), rig.bit("Y0")))
    assert seen == [(1, 0), (2, 0), (3, 1), (3, 1), (3, 1)]
    rig.scan(X1=1)
    assert (rig.word(counter), rig.bit("Y0")) == (0, 0)


def test_a_counter_that_is_reset_while_its_condition_stays_on_waits_for_an_edge() -> None:
    rig = Rig("LD X0 / OUT C0 K9 / LD X1 / RST C0").scan(X0=1).scan(X1=1).scan(3, X1=0)
    assert rig.word("C0") == 0
    assert rig.scan(X0=0).scan(X0=1).word("C0") == 1


def test_preset_0_is_as_1() -> None:
    for preset in ("K0", "K1"):
        rig = Rig(f"LD X0 / OUT C0 {preset}").scan()
        assert rig.bit("C0") == 0
        assert rig.scan(X0=1).bit("C0") == 1


def test_a_32_bit_counter_counts_backwards() -> None:
    rig = Rig("LD X1 / OUT M8200 / LD X0 / OUT C200 K-3").put(C200=-5)
    seen = []
    for down in (0, 0, 0, 0, 1, 1, 1):
        rig.scan(X0=0, X1=down).scan(X0=1)
        value = rig.word("C200")
        seen.append((value - (1 << 32) if value >> 31 else value, rig.bit("C200")))
    # On where it comes up to -3, off where it goes down below -3.
    assert seen == [(-4, 0), (-3, 1), (-2, 1), (-1, 1), (-2, 1), (-3, 1), (-4, 0)]


def test_a_32_bit_counter_goes_round() -> None:
    rig = Rig("LD X0 / OUT C234 D0").put(C234=(1 << 31) - 1).scan(X0=1)
    assert rig.word("C234") == 1 << 31
    rig = Rig("LD X0 / OUT C201 K0").put(C201=1 << 31).scan(X0=1, M8201=1)
    assert rig.word("C201") == (1 << 31) - 1


def test_a_32_bit_preset_is_a_pair_of_registers() -> None:
    rig = Rig("LD X0 / OUT C200 D0").put_pair("D0", 70_000).put(C200=69_998)
    assert rig.scan(X0=1).bit("C200") == 0
    assert rig.scan(X0=0).scan(X0=1).bit("C200") == 1


def test_master_control_cuts_what_stands_under_it() -> None:
    rig = Rig(
        "LD X0 / MC N0 M100 / LD X1 / OUT Y0 / SET Y1 / INC D0 / OUT T0 K1 / OUT T250 K9 / OUT C0 K5 / "
        "LD X2 / MC N1 M101 / LD M8000 / OUT Y2 / MCR N1 / LD X1 / OUT Y3 / MCR N0 / LD X1 / OUT Y4"
    )
    rig.scan(3, every=100, X0=1, X1=1, X2=1)
    assert rig.bits("Y0", "Y1", "Y2", "Y3", "Y4", "M100", "M101", "T0") == [1] * 8
    assert (rig.word("D0"), rig.word("T250"), rig.word("C0")) == (3, 2, 1)
    rig.scan(2, every=100, X0=0)
    # Coils off and timers cleared; what was set, retentive timers and counters stay; nothing is carried out.
    assert rig.bits("Y0", "Y1", "Y2", "Y3", "Y4", "M100", "M101", "T0") == [0, 1, 0, 0, 1, 0, 0, 0]
    assert (rig.word("D0"), rig.word("T0"), rig.word("T250"), rig.word("C0")) == (3, 0, 2, 1)
    assert rig.scan(X0=1, X2=0).bits("Y0", "Y2", "Y3") == [1, 0, 1]


def test_a_jump_into_a_master_control_finds_it_on() -> None:
    rig = Rig("LD X1 / CJ P0 / LD X0 / MC N0 M100 / P0 / LD X2 / OUT Y0 / MCR N0").scan(X2=1)
    assert rig.bit("Y0") == 0
    assert rig.scan(X1=1).bit("Y0") == 1
    assert rig.scan(X1=0).bit("Y0") == 0


# -- timers that go on without their OUT ---------------------------------------------------------------------


@pytest.mark.parametrize("timer", [192, 199, 246, 249])
def test_timers_that_go_on_stop_where_they_are_reset_or_carried_out_with_their_contact_off(
    timer: int,
) -> None:
    unit = 100 if timer < 200 else 1
    text = f"LD X1 / CJ P0 / LD X0 / OUT T{timer} K90 / LD X2 / RST T{timer} / P0"
    rig = Rig(text).scan(4, every=unit, X0=1)
    assert rig.scan(5, every=unit, X1=1).word(f"T{timer}") == 8
    off = 0 if timer < 200 else 8
    assert rig.scan(every=unit, X1=0, X0=0).scan(5, every=unit, X1=1).word(f"T{timer}") == off
    rig = Rig(text).scan(4, every=unit, X0=1).scan(every=unit, X2=1)
    assert rig.scan(5, every=unit, X1=1, X2=0).word(f"T{timer}") == 0
    rig = Rig(text.replace("RST ", "ZRST T192 ")).scan(4, every=unit, X0=1).scan(every=unit, X2=1)
    assert rig.scan(5, every=unit, X1=1, X2=0).word(f"T{timer}") == 0


def test_a_preset_that_changes_while_a_timer_goes_on_counts_at_end() -> None:
    rig = Rig("LD X1 / CJ P0 / LD X0 / OUT T192 D0 / P0").put(D0=90).scan(4, every=100, X0=1)
    assert rig.scan(2, every=100, X1=1).bit("T192") == 0
    assert rig.put(D0=4).scan(every=100).bit("T192") == 1
    assert rig.word("T192") == 6 - 1


@pytest.mark.parametrize(
    ("value", "down", "contact", "after"),
    [
        (9, 0, 0, 1),  # up to the preset
        (10, 0, 0, 0),  # away from it
        (20, 0, 0, 0),
        (10, 1, 1, 0),  # down from it
        (9, 1, 1, 1),  # below it already
        (11, 1, 0, 0),  # down to it
    ],
)
def test_the_contact_of_a_32_bit_counter_changes_where_it_crosses(
    value: int, down: int, contact: int, after: int
) -> None:
    rig = Rig("LD X0 / OUT C200 K10").scan(M8200=down, C200=contact)
    rig.memory.set_word("C", 200, value)
    assert rig.scan(X0=1).bit("C200") == after
