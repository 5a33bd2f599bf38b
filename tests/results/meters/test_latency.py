"""The latency meter on records made by hand: what overtakes what, and what every change is counted as."""

from __future__ import annotations

import json

from hypothesis import given
from hypothesis import strategies as st

from bussim.report.latency import in_words
from bussim.results.meters.latency import LatencyMeter, LatencySpec, Route
from bussim.results.meters.latency_record import LatencyRecord
from bussim.results.meters.plain_data import from_plain, to_plain
from bussim.results.summary.latency import LatencyBounds, latency_summary
from bussim.results.text.latency import latency_lines, part_names
from bussim.trace.records import DeviceValueRecord, InputRecord
from bussim.units import TICKS_PER_MS

FRAME = 10


def ms(number: float) -> int:
    return round(number * TICKS_PER_MS)


class Rig:
    """One entry from a.X0 to b.Y0 over a link on which a has position 0 and b position 1."""

    def __init__(
        self,
        *,
        edge: str = "both",
        inverted: bool = False,
        direct: bool = False,
        word: bool = False,
        way: str = "direct",
        reasons: tuple[str, ...] = (),
        source_scans: int = 0,
        target_scans: int = 0,
    ) -> None:
        source, target = ("D0", "D0") if word else ("X0", "M9" if direct else "Y0")
        route = Route("link", 0, 1, FRAME)
        self.target = target
        self.meter = LatencyMeter(
            [
                LatencySpec(
                    "e",
                    "a",
                    source,
                    "b",
                    target,
                    edge,
                    inverted,
                    word,
                    direct,
                    route,
                    way,
                    reasons,
                    source_scans,
                    target_scans,
                )
            ]
        )

    def change(self, tick: int, level: int, sampled: int, end: int, *, seen: bool = True) -> None:
        self.meter.input(InputRecord(tick, "a", "X0", level, sampled, seen, end))

    def frame(self, start: int, heard: tuple[int, ...] | None = None) -> None:
        self.meter.refreshed("link", 0, start + FRAME, heard)

    def end(self, tick: int, value: int | None = None) -> None:
        """An END of b, at which its target takes a value."""
        if value is not None:
            self.meter.value(DeviceValueRecord(tick, "b", self.target, value))
        self.meter.ends("b", [tick])

    @property
    def record(self) -> LatencyRecord:
        return self.meter.records()["e"]

    def counts(self) -> tuple[int, int, int, int, int]:
        """Changes, delivered, lost, unseen, open."""
        found = self.record
        assert found.changes == found.delivered + found.lost + found.unseen + found.open
        return found.changes, found.delivered, found.lost, found.unseen, found.open


def test_one_change_and_its_parts() -> None:
    rig = Rig()
    rig.change(100, 1, 104, 112)
    rig.frame(111)  # began before the END that let it out
    rig.frame(130)
    rig.end(141)
    rig.end(150, 1)
    assert rig.counts() == (1, 1, 0, 0, 0)
    sample = rig.record.longest
    assert sample is not None
    assert sample.parts == (12, 18, 10, 1, 9)
    assert sample.total == 50 == rig.record.histogram.maximum
    assert rig.record.shortest == sample


def test_an_end_and_a_frame_at_the_same_tick_as_what_they_wait_for() -> None:
    rig = Rig()
    rig.change(100, 1, 100, 112)
    rig.frame(112)
    rig.end(122)
    rig.end(130, 1)
    sample = rig.record.longest
    assert sample is not None
    assert sample.parts == (12, 0, 10, 0, 8)


def test_a_frame_that_the_target_does_not_hear_carries_nothing() -> None:
    rig = Rig()
    rig.change(100, 1, 104, 112)
    rig.frame(120, heard=(2,))
    rig.end(131)
    assert rig.counts() == (1, 0, 0, 0, 1)
    rig.frame(140, heard=(1, 2))
    rig.end(155)
    rig.end(160, 1)
    sample = rig.record.longest
    assert sample is not None
    assert sample.parts == (12, 28, 10, 5, 5)


def test_a_pulse_shorter_than_a_scan_is_not_seen() -> None:
    rig = Rig()
    rig.change(100, 1, 110, 120, seen=False)
    rig.change(102, 0, 110, 120)
    assert rig.counts() == (2, 0, 0, 2, 0)
    # Of three changes the last one is what the PLC sees.
    rig.change(111, 1, 120, 130, seen=False)
    rig.change(112, 0, 120, 130, seen=False)
    rig.change(113, 1, 120, 130)
    assert rig.counts() == (5, 0, 0, 4, 1)


def test_a_pulse_between_two_frames_is_lost_with_both_edges() -> None:
    rig = Rig()
    rig.change(1, 1, 2, 3)
    rig.frame(5)
    rig.end(16)
    rig.end(20, 1)
    rig.change(30, 0, 32, 34)
    rig.change(40, 1, 42, 44)
    rig.frame(50)
    rig.end(61)
    assert rig.counts() == (3, 1, 2, 0, 0)


def test_a_pulse_between_two_ends_of_the_target_is_lost() -> None:
    rig = Rig()
    rig.change(1, 1, 2, 3)
    rig.frame(5)
    rig.end(16)
    rig.end(20, 1)
    rig.change(30, 0, 32, 34)
    rig.frame(36)
    rig.change(40, 1, 42, 44)
    rig.frame(47)
    rig.end(61)
    assert rig.counts() == (3, 1, 2, 0, 0)


def test_the_latest_of_several_changes_goes_on() -> None:
    rig = Rig()
    for number in range(5):
        rig.change(10 * number, (number & 1) ^ 1, 10 * number + 2, 10 * number + 4)
    rig.frame(60)
    rig.end(71)
    rig.end(75, 1)
    assert rig.counts() == (5, 1, 4, 0, 0)
    assert rig.record.longest is not None
    assert rig.record.longest.at == 40


def test_only_one_edge() -> None:
    rig = Rig(edge="falling")
    for number, level in enumerate((1, 0, 1, 0)):
        at = 100 * number
        rig.change(at, level, at + 2, at + 4)
        rig.frame(at + 10)
        rig.end(at + 21)
        rig.end(at + 30, level)
    assert rig.counts() == (2, 2, 0, 0, 0)


def test_an_inverted_target() -> None:
    rig = Rig(inverted=True)
    rig.end(5, 1)  # as the program sets it at first: no change explains it
    rig.change(10, 1, 12, 14)
    rig.frame(15)
    rig.end(26)
    rig.end(30, 0)
    assert rig.counts() == (1, 1, 0, 0, 0)


def test_a_target_that_does_not_follow() -> None:
    """An interlock keeps the output off: the change never arrives, and a later one does."""
    rig = Rig()
    for at, level in ((0, 1), (100, 0), (200, 1)):
        rig.change(at, level, at + 2, at + 4)
        rig.frame(at + 10)
        rig.end(at + 21)
        rig.end(at + 30, 1 if at == 200 else None)
    assert rig.counts() == (3, 1, 2, 0, 0)
    assert rig.record.longest is not None
    assert rig.record.longest.at == 200


def test_a_shared_device_follows_at_once_and_an_output_one_scan_later() -> None:
    rig = Rig(direct=True)
    rig.change(0, 1, 2, 4)
    rig.frame(10)
    rig.end(21, 1)
    sample = rig.record.longest
    assert sample is not None
    assert sample.parts == (4, 6, 10, 1, 0)
    # An output that takes the level at that very END cannot have it from there.
    rig = Rig()
    rig.change(0, 1, 2, 4)
    rig.frame(10)
    rig.end(21, 1)
    assert rig.counts() == (1, 0, 0, 0, 1)


def test_a_change_that_another_has_overtaken_is_never_matched() -> None:
    rig = Rig()
    rig.change(0, 1, 2, 4)
    rig.frame(10)
    rig.end(21)
    rig.change(30, 0, 32, 34)
    rig.frame(40)
    rig.end(51)
    rig.end(61, 1)  # something else: what is visible is off
    assert rig.counts() == (2, 0, 1, 0, 1)
    rig.end(71, 0)
    assert rig.counts() == (2, 1, 1, 0, 0)


def test_nothing_is_matched_late_where_the_level_has_come_again() -> None:
    """Two changes to the level in two frames, and the target follows after the second: nothing shows which."""
    rig = Rig()
    rig.change(0, 1, 2, 4)
    rig.frame(10)
    rig.end(21)
    rig.end(30)  # it could have followed
    rig.change(31, 0, 32, 34)
    rig.change(35, 1, 36, 38)
    rig.frame(40)
    rig.end(51)
    rig.end(60, 1)
    assert rig.counts() == (3, 0, 3, 0, 0)


def test_a_source_that_takes_more_scans_is_out_so_many_ends_later() -> None:
    rig = Rig(source_scans=2)
    rig.change(100, 1, 104, 112)
    rig.meter.ends("a", [112])
    rig.frame(113)
    rig.end(124)
    rig.meter.ends("a", [120])
    rig.frame(125)
    rig.end(136)
    rig.meter.ends("a", [140])
    rig.frame(139)  # began before the END
    rig.end(150)
    assert rig.counts() == (1, 0, 0, 0, 1)
    rig.frame(152)
    rig.end(163)
    rig.end(170, 1)
    sample = rig.record.longest
    assert sample is not None
    assert sample.parts == (40, 12, 10, 1, 7)


def test_a_target_that_takes_more_scans_follows_what_was_visible_before() -> None:
    rig = Rig(target_scans=1)
    rig.change(0, 1, 2, 4)
    rig.frame(10)
    rig.end(21)
    rig.change(22, 0, 23, 24)
    rig.frame(25)
    rig.end(36)
    rig.end(40, 1)  # of what was visible at 21, not of what is since 36
    rig.end(50, 0)
    assert rig.counts() == (2, 2, 0, 0, 0)
    assert rig.record.shortest is not None
    assert rig.record.shortest.parts == (2, 1, 10, 1, 14)
    # Nothing follows sooner than its program can.
    rig = Rig(target_scans=1)
    rig.change(0, 1, 2, 4)
    rig.frame(10)
    rig.end(21)
    rig.end(30, 1)
    assert rig.counts() == (1, 0, 0, 0, 1)


def test_within_one_plc_the_link_has_no_part() -> None:
    meter = LatencyMeter([LatencySpec("e", "a", "X0", "a", "Y0", "both", False, False, True, None)])
    meter.input(InputRecord(100, "a", "X0", 1, 104, True, 112))
    meter.ends("a", [104])
    meter.value(DeviceValueRecord(112, "a", "Y0", 1))
    meter.ends("a", [112])
    sample = meter.records()["e"].longest
    assert sample is not None
    assert sample.parts == (12, 0, 0, 0, 0)


def test_the_age_of_a_word() -> None:
    rig = Rig(word=True)
    rig.meter.ends("a", [100])
    rig.end(105)  # nothing has come yet
    rig.meter.ends("a", [110])
    rig.frame(112)
    rig.meter.ends("a", [120])
    rig.end(125)
    rig.end(135)
    rig.frame(130)
    rig.end(145)
    assert rig.record.delivered == 3
    assert (rig.record.histogram.minimum, rig.record.histogram.maximum) == (15, 25)
    assert rig.record.longest is not None
    assert rig.record.longest.parts == (0, 2, 10, 13, 0)


def test_a_word_that_never_travels_has_no_age() -> None:
    rig = Rig(word=True, way="none", reasons=("no age: D0 never travels",))
    rig.meter.ends("a", [100])
    rig.frame(112)
    rig.end(125)
    rig.meter.value(DeviceValueRecord(130, "a", "D0", 5))
    rig.meter.ends("a", [130])
    assert (rig.record.changes, rig.record.delivered) == (1, 0)
    entry = latency_summary(rig.record, LatencyBounds({}, ("D0 never travels",)))
    assert entry["reads"] == 0
    assert entry["ms"]["max"] is None
    assert list(latency_lines({"latency": {"e": entry}}))[1:] == [
        "e: a.D0 to b.D0, age of the word whenever it is read",
        "  1 change of the source; read 0 times",
        "  no age: D0 never travels",
    ]
    assert "e: no age: D0 never travels." in list(in_words("e", entry))


def test_lost_pulses_that_no_frame_need_have_carried_are_distinguished() -> None:
    rig = Rig()
    rig.change(ms(2), 1, ms(3), ms(4))
    rig.frame(ms(10))
    rig.change(ms(12), 0, ms(13), ms(14))  # off and on between two frames
    rig.change(ms(20), 1, ms(21), ms(22))
    rig.frame(ms(40))
    rig.frame(ms(50))
    rig.change(ms(200), 0, ms(201), ms(202))
    rig.meter.refreshed("link", 0, ms(520), (0,))  # that b does not hear makes no gap
    assert rig.counts() == (4, 0, 2, 0, 2)
    record = rig.record
    assert (record.longest_gap, record.lost_short) == (ms(30), 2)
    entry = latency_summary(record, None)
    assert (entry["lost_short"], entry["longest_gap_ms"]) == (2, 30)
    said = "of those that never arrived, 2 began or ended a pulse no longer than the longest gap"
    assert any(said in line for line in latency_lines({"latency": {"e": entry}}))
    assert any(said in line for line in in_words("e", entry))


def test_a_long_pulse_that_is_lost_is_no_short_one() -> None:
    rig = Rig()
    for start in (0, 30, 60):
        rig.frame(ms(start))
    rig.change(ms(200), 1, ms(201), ms(202))
    rig.change(ms(300), 0, ms(301), ms(302))
    assert rig.record.lost_short == 0
    rig.frame(ms(310))  # the first for 250 ms: now it is
    assert (rig.record.lost, rig.record.lost_short) == (1, 1)
    assert rig.record.longest_gap == ms(250)


def test_where_nothing_leads_to_the_target_its_moves_are_something_elses() -> None:
    reason = "nothing leads from a.X0 to b.Y0"
    rig = Rig(way="none", reasons=(reason,))
    rig.change(100, 1, 104, 112)
    rig.frame(130)
    rig.end(141)
    rig.end(150, 1)
    assert rig.counts() == (1, 0, 0, 0, 1)
    assert rig.record.examples() == {}
    entry = latency_summary(rig.record, LatencyBounds({}, (reason,)))
    assert entry["ms"]["max"] is None
    assert {value for part in entry["parts_ms"].values() for value in part.values()} == {None}
    lines = list(latency_lines({"latency": {"e": entry}}))
    assert lines[-1] == f"  {reason}"
    assert not any("on average" in line for line in lines)


def test_the_parts_of_an_age_have_their_own_words() -> None:
    assert part_names(word=True)["destination"] == "since the frame came, until it was read"
    assert part_names(word=False)["destination"] == "waiting for the destination's scan"


@given(
    st.lists(
        st.tuples(st.sampled_from(["change", "frame", "end", "follow"]), st.integers(1, 30)), max_size=80
    )
)
def test_whatever_happens_every_change_is_counted_once(events: list[tuple[str, int]]) -> None:
    rig, now, level, output = Rig(), 0, 0, 0
    for kind, later in events:
        now += later
        if kind == "change":
            level ^= 1
            rig.change(now, level, now + 1, now + 1 + later, seen=later % 3 > 0)
        elif kind == "frame":
            rig.frame(now)
            now += FRAME
        else:
            output ^= kind == "follow"
            rig.end(now, output if kind == "follow" else None)
        record = rig.record
        rig.counts()
        for sample in (record.shortest, record.longest):
            assert sample is None or min(sample.parts) >= 0


def test_a_record_survives_its_json() -> None:
    rig = Rig(edge="rising", way="none", reasons=("because",))
    rig.change(100, 1, 104, 112)
    rig.frame(130)
    rig.end(141)
    rig.end(150, 1)
    rig.frame(170)
    data = json.loads(json.dumps(to_plain(rig.record)))
    assert to_plain(from_plain(LatencyRecord, data)) == data
