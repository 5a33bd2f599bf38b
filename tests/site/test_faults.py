"""Diagnoses of what a technician meets: wrong D8177, counters that stopped, registers that climb, cuts that are over."""

from pathlib import Path
from typing import Any

import pytest

from bussim.site.diagnosis.diagnose import Diagnosis, diagnose
from bussim.site.link import SiteLink
from tests.site.examples import healthy, readout, seen
from tests.site.test_diagnosis import found, lost


def of(data: dict[str, Any], folder: Path) -> tuple[Diagnosis, str, int | None]:
    """The diagnosis with its first cause and the station of that."""
    told = found(data, folder)
    return told, told.causes[0].cause.value, told.causes[0].station


def missing(data: dict[str, Any], number: int) -> None:
    """A polled number that nobody replies to."""
    for other in range(len(data["stations"])):
        silent = {
            f"D{8203 + number}": 900,
            f"D{8211 + number}": 21 if other else 1,
            f"M{8183 + number}": "on",
        }
        seen(data, other, D8202=400, D8201=400, **silent)


def damaged(data: dict[str, Any], *counts: int) -> None:
    for number, count in enumerate(counts, 1):
        seen(data, number, D8203=count, D8211=14)


def climbing(data: dict[str, Any], registers: dict[int, list[str]]) -> None:
    """Readings in words alone: no counts, what climbs, and that the link runs."""
    for number, station in enumerate(data["stations"]):
        station["after"] = {"M8191": "on"}
        station["rising"] = registers.get(number, [])


def test_a_polled_number_that_no_station_has_is_asked_for(tmp_path: Path) -> None:
    data = healthy()
    del data["stations"][3], data["order"]
    missing(data, 3)
    told, cause, station = of(data, tmp_path)
    assert (cause, station) == ("station_off", 3)
    assert "is D8177 = 3 right?" in told.causes[0].evidence[0]
    assert told.causes[0].score >= 5


def test_a_station_that_was_not_read_and_is_silent_is_off(tmp_path: Path) -> None:
    data = healthy()
    data["stations"][3] = {"place": "saw", "number": 3}
    data["stations"] = [*data["stations"][:3], data["stations"][3]]
    for other in range(3):
        silent = {"D8206": 900, "D8214": 21 if other else 1, "M8186": "on"}
        seen(data, other, D8202=400, D8201=400, **silent)
    assert of(data, tmp_path)[1:] == ("station_off", 3)


def test_a_number_above_d8177_is_never_polled_and_no_cut(tmp_path: Path) -> None:
    data = healthy()
    data["settings"]["slaves"] = 2
    for number in range(4):
        seen(data, number, D8174=2)
    seen(data, 3, M8191="off")
    told = found(data, tmp_path)
    assert not {"cable_cut", "wrong_format"} & {one.cause.value for one in told.causes}
    notes = " ".join(readout(data, tmp_path).notes)
    assert "saw (station 3) is never polled: D8177 is 2 at the master" in notes
    assert "order has 4 stations, and the master polls 2 (D8177)" in notes


def test_settings_are_compared_with_what_was_read(tmp_path: Path) -> None:
    data = healthy()
    seen(data, 1, D8174=4, D8175=1)
    notes = " ".join(readout(data, tmp_path).notes)
    assert "feeder has D8174 = 4, and settings say 3" in notes
    assert "feeder has D8175 = 1, and settings say 2" in notes


def test_two_stations_that_are_off_are_both_named(tmp_path: Path) -> None:
    data = healthy()
    for number in (2, 3):
        lost(data, number, state="off")
    for number in (2, 3):
        del data["stations"][number]["after"]
    told, cause, station = of(data, tmp_path)
    assert (cause, station) == ("station_off", 2)
    assert any(
        "the same at station 3: saw was found in the state off" in why for why in told.causes[0].evidence
    )


def test_code_11_at_every_slave_is_of_a_master_that_was_away(tmp_path: Path) -> None:
    data = healthy()
    for number in (1, 2, 3):
        seen(data, number, D8203=1, D8211=11)
    assert of(data, tmp_path)[1] == "master_away"


def test_a_cut_that_is_over_is_no_late_power_up(tmp_path: Path) -> None:
    """Stations 2 and 3 were on: they missed the master. Their own D8202 saw none of the long scans."""
    data = healthy()
    for number in (0, 1):
        away = {f"D{8203 + k}": 20 for k in (2, 3)} | {f"D{8211 + k}": 21 if number else 1 for k in (2, 3)}
        seen(data, number, D8202=500, **away)
    for number in (2, 3):
        seen(data, number, D8203=1, D8211=11)
    told, cause, station = of(data, tmp_path)
    assert (cause, station) == ("was_away", 2)
    assert "lift missed the master (code 11): it was on, and cut off" in told.causes[0].evidence


def test_of_two_with_number_0_neither_is_called_the_second(tmp_path: Path) -> None:
    data = healthy()
    data["stations"][2]["number"] = 0
    paper = readout(data, tmp_path)
    assert paper.label(0) == "press (station 0) or lift (station 0)"


def test_damage_of_the_masters_frames_alone_is_in_its_driver(tmp_path: Path) -> None:
    """At D8179 = 0 noise on the wire that damages 300 frames of the master damages 770 replies or so, seen by all."""
    data = healthy()
    data["settings"]["retries"] = 0
    damaged(data, 300, 301, 300)
    assert of(data, tmp_path)[1:] == ("noise_sender", 0)
    for number in range(4):
        others = {f"D{8203 + k}": 255 for k in range(1, 4) if k != number}
        seen(data, number, **others, **{f"D{8211 + k}": 4 for k in range(1, 4) if k != number})
    assert of(data, tmp_path)[1] == "noise_wire"


def test_a_count_of_the_master_that_slaves_do_not_share_is_not_passed_over(tmp_path: Path) -> None:
    data = healthy()
    damaged(data, 3, 3, 3)
    seen(data, 0, D8204=9000)
    del data["stations"][0]["after"]["D8212"]
    told, cause, station = of(data, tmp_path)
    assert (cause, station) == ("noise_receiver", 0)
    assert "the master counts 9000 failed replies that no slave misses" in told.causes[0].evidence


@pytest.mark.parametrize(
    ("registers", "cause", "said"),
    [
        ({1: ["D8203"], 2: ["D8203"], 3: ["D8203"]}, "noise_wire", "(1: climbs, 2: climbs, 3: climbs)"),
        ({2: ["D8203"]}, "noise_receiver", "D8203 was read at one slave only"),
        (
            {0: ["D8205"], 1: ["D8205"], 3: ["D8205"]},
            "replies_lost",
            "(it climbs), with its code not read at press",
        ),
        ({0: ["D8204", "D8205", "D8206"]}, "healthy", "1"),
    ],
)
def test_readings_in_words_are_told_in_words(
    registers: dict[int, list[str]], cause: str, said: str, tmp_path: Path
) -> None:
    data = healthy()
    climbing(data, registers)
    told = found(data, tmp_path).causes
    if cause == "healthy":  # station errors at all slaves, and no slave was asked for its own
        assert "healthy" not in {one.cause.value for one in told}
        return
    assert cause in {one.cause.value for one in told[:2]}
    assert said in " ".join(why for one in told for why in one.evidence)
    assert "counts 3" not in " ".join(why for one in told for why in one.evidence)


def test_counters_that_have_stopped_are_not_compared(tmp_path: Path) -> None:
    data = healthy() | {"watched": "3 d"}
    damaged(data, 32767, 32767, 9000)
    evidence = " ".join(why for one in found(data, tmp_path).causes for why in one.evidence)
    assert "how many is not known at feeder, lift" in evidence
    assert "is the same at all slaves" not in evidence


def test_a_slave_with_a_long_plc_scan_is_that_which_replies_late(tmp_path: Path) -> None:
    data = healthy()
    for number in range(4):
        seen(data, number, D8201=[104, 105, 106], D8202=120)
    data["stations"][2]["plc_scan"] = "90 ms"
    told, cause, station = of(data, tmp_path)
    assert (cause, station) == ("slow_reply", 2)
    assert "the PLC scan of lift takes 90 ms" in told.causes[0].evidence[0]


def test_one_long_look_is_hardly_evidence(tmp_path: Path) -> None:
    data = healthy()
    data["stations"] = [data["stations"][0]]
    seen(data, 0, D8201=104, D8202=120)
    assert all(one.score <= 1 for one in found(data, tmp_path).causes if one.cause.value == "slow_reply")


def test_a_long_scan_from_before_the_first_reading_is_no_burst(tmp_path: Path) -> None:
    """D8202 is kept since the start: 165, two silences in a scan, are no wonder in a week, in the 20 minutes watched they were."""
    data = healthy()
    for number, station in enumerate(data["stations"]):
        station["before"] = {**station["after"], "D8202": 165}
        seen(data, number, D8202=165)
    damaged(data, 12, 12, 12)
    assert found(data, tmp_path).causes[0].cause.value == "noise_wire"
    paper = readout(data, tmp_path)
    assert paper.since is None
    data["started"] = "7 d before the first reading"
    week = readout(data, tmp_path)
    assert week.since == (7 * 86400 + 20 * 60) * 72_000_000
    assert diagnose(week, SiteLink.of(week)).causes[0].cause.value == "noise_wire"


def test_causes_two_points_apart_are_not_told_apart(tmp_path: Path) -> None:
    """Long scans that a lost reply explains: at 4, 2.5 and 2 points."""
    data = healthy()
    for number in range(4):
        seen(data, number, D8202=260)
    told = found(data, tmp_path)
    assert [one.score for one in told.causes] == [4, 2.5, 2]
    assert len(told.close) == 2


def test_counts_that_were_not_read_are_no_zeros(tmp_path: Path) -> None:
    """Scans of normal length make it likely that nothing is wrong; that nothing is counted nobody has seen."""
    data = healthy()
    for station in data["stations"]:
        station["after"] = {"D8201": 67, "D8202": 67, "M8191": "on"}
    told = found(data, tmp_path).causes
    assert told[0].cause.value == "healthy"
    assert "counted" not in " ".join(told[0].evidence)
    data["settings"]["retries"] = 0
    damaged(data, 300, 300, 300)
    assert "noise_sender" not in {one.cause.value for one in found(data, tmp_path).causes[:1]}


def test_a_dead_station_beside_noise_on_the_wire_is_no_burst(tmp_path: Path) -> None:
    data = healthy()
    lost(data, 2, state="off")
    del data["stations"][2]["after"]
    for number in (0, 1, 3):
        seen(data, number, D8201=261, D8202=330)
    for number in (1, 3):
        seen(data, number, D8203=30, D8211=14)
    causes = [one.cause.value for one in found(data, tmp_path).causes]
    assert causes[:2] == ["station_off", "noise_wire"]
    evidence = " ".join(why for one in found(data, tmp_path).causes for why in one.evidence)
    assert "D8202 is" not in evidence
    assert "station errors that all saw" not in evidence


def test_a_station_that_all_count_for_noise_was_not_late(tmp_path: Path) -> None:
    """Lift sends badly all the time; saw came after 3 scans and counts lift as the others do."""
    data = healthy()
    data["settings"]["retries"] = 0
    for number in (0, 1, 3):
        seen(data, number, D8205=509, D8213=4, D8202=139)
    for number in (0, 1, 2):
        seen(data, number, D8206=3, D8214=21 if number else 1, D8202=234)
    told = found(data, tmp_path).causes
    assert "it was away afterwards" not in " ".join(why for one in told for why in one.evidence)
    assert told[0].cause.value == "noise_sender"


def test_strong_noise_is_on_the_wire_although_approximations_differ(tmp_path: Path) -> None:
    """A bit error rate of 5.7e-4 at D8179 = 1, as a run of 300 s left it: 833 errors where 1,100 are expected."""
    data = healthy() | {"watched": "300 s"}
    data["settings"]["retries"] = 1
    damaged(data, 1130, 1119, 1119)
    for number, station in enumerate(data["stations"]):
        for k, count in ((1, 270), (2, 270), (3, 290)):
            if k != number:
                station["after"] |= {f"D{8203 + k}": count, f"D{8211 + k}": 4}
        seen(data, number, D8202=279)
    assert of(data, tmp_path)[1] in ("noise_wire", "noise_bursts")
