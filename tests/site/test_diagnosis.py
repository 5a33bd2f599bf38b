"""Diagnoses of readouts by hand, from what each cause does by the link's rules, and of simulated machines."""

from pathlib import Path
from typing import Any

import pytest

from bussim.site.diagnosis.diagnose import Diagnosis, diagnose
from bussim.site.link import SiteLink
from tests.site.acceptance import machines
from tests.site.examples import healthy, readout, seen


def found(data: dict[str, Any], folder: Path) -> Diagnosis:
    paper = readout(data, folder)
    return diagnose(paper, SiteLink.of(paper))


def first(data: dict[str, Any], folder: Path) -> tuple[str, int | None]:
    cause = found(data, folder).causes[0]
    return cause.cause.value, cause.station


def lost(
    data: dict[str, Any], number: int, *, state: str = "run", rd: str = "dark", master: str = "on"
) -> None:
    """A station that no longer hears the others, as they and it see it."""
    for other in range(4):
        if other != number:
            seen(
                data,
                other,
                **{
                    f"D{8203 + number}": 500,
                    f"D{8211 + number}": 21 if other else 1,
                    f"M{8183 + number}": "on",
                },
            )
    seen(data, number, D8203=1, D8211=11, M8183=master, M8191="off")
    data["stations"][number] |= {"state": state, "lamps": {"RD": rd}}


def test_a_healthy_link(tmp_path: Path) -> None:
    assert first(healthy(), tmp_path) == ("healthy", None)


def test_a_station_that_is_off_cannot_be_read_and_that_is_evidence(tmp_path: Path) -> None:
    data = healthy()
    lost(data, 2, state="off")
    del data["stations"][2]["after"]
    assert first(data, tmp_path) == ("station_off", 2)


@pytest.mark.parametrize(("rd", "cause"), [("dark", "cable_cut"), ("flickers", "wrong_format")])
def test_the_rd_lamp_tells_a_cut_at_the_last_plug_from_a_wrong_format(
    rd: str, cause: str, tmp_path: Path
) -> None:
    data = healthy()
    lost(data, 3, rd=rd)
    assert first(data, tmp_path) == (cause, 3)
    before = found(data, tmp_path).causes[0].score
    data["stations"][3]["lamps"]["SD"] = "dark"
    assert found(data, tmp_path).causes[0].score == before + (rd == "flickers")
    del data["stations"][3]["lamps"]
    unseen = found(data, tmp_path)
    assert {one.cause.value for one in unseen.causes[:2]} == {"cable_cut", "wrong_format"}
    assert "RD lamp" in unseen.next[-1]


def test_a_cable_may_be_cut_on_either_side_of_the_master(tmp_path: Path) -> None:
    data = healthy()
    data["order"] = ["lift", "feeder", "press", "saw"]
    lost(data, 2)
    assert first(data, tmp_path) == ("cable_cut", 2)


def test_two_numbers_alike_decide_by_themselves(tmp_path: Path) -> None:
    data = healthy()
    data["stations"][3]["number"] = 2
    assert first(data, tmp_path) == ("number_twice", 2)


def test_a_slave_with_a_masters_code_is_a_second_master(tmp_path: Path) -> None:
    data = healthy()
    seen(data, 2, D8204=30, D8212=1, D8206=30, D8214=4)
    assert first(data, tmp_path) == ("two_masters", 2)


def test_equal_counts_are_on_the_wire_and_unequal_ones_in_the_receivers(tmp_path: Path) -> None:
    data = healthy()
    for number, count in ((1, 201), (2, 203), (3, 200)):
        seen(data, number, D8203=count, D8211=14)
    assert first(data, tmp_path) == ("noise_wire", None)
    for number, count in ((1, 20), (2, 203), (3, 95)):
        seen(data, number, D8203=count)
    assert first(data, tmp_path) == ("noise_receivers", None)
    for number, count in ((1, 0), (2, 203), (3, 1)):
        seen(data, number, D8203=count)
    assert first(data, tmp_path) == ("noise_receiver", 2)


def test_station_errors_beyond_what_steady_noise_gives_are_bursts(tmp_path: Path) -> None:
    """30 damaged frames of the master in 18,000 scans are p = 1.5e-3 or so: p^4 gives no station error."""
    data = healthy()
    for number in range(4):
        seen(data, number, D8202=260, **{f"D{8203 + k}": 3 for k in range(1, 4) if k != number})
        seen(data, number, **{f"D{8211 + k}": 4 for k in range(1, 4) if k != number})
        if number:
            seen(data, number, D8203=30, D8211=14)
    assert first(data, tmp_path) == ("noise_bursts", None)


@pytest.mark.parametrize(("code", "heard", "cause"), [(4, 4, "noise_sender"), (1, 21, "replies_lost")])
def test_one_station_that_all_count_sends_badly_or_not_at_all(
    code: int, heard: int, cause: str, tmp_path: Path
) -> None:
    data = healthy()
    for number in (0, 1, 3):
        seen(data, number, D8202=260, D8205=12, D8213=heard if number else code)
    seen(data, 2, D8202=260)
    assert first(data, tmp_path) == (cause, 2)


def test_a_master_that_alone_counts_damaged_replies_has_noise_in_its_receiver(tmp_path: Path) -> None:
    data = healthy()
    for number in range(4):
        seen(data, number, D8202=135)
    seen(data, 0, D8204=9, D8205=8, D8206=11, D8212=4, D8213=4, D8214=4)
    assert first(data, tmp_path) == ("noise_receiver", 0)


def test_who_came_late_and_who_was_away(tmp_path: Path) -> None:
    """Feeder saw no long scan; lift, late itself by 12 scans, counts as much about it as the master."""
    data = healthy()
    for number in range(4):
        seen(data, number, D8202=500)
    for number in (0, 2, 3):
        seen(data, number, D8204=90, D8212=21 if number else 1)
    for number in (0, 3):
        seen(data, number, D8205=12, D8213=21 if number else 1)
    seen(data, 1, D8202=67)
    assert first(data, tmp_path) == ("was_away", 1)


def test_a_master_that_stopped(tmp_path: Path) -> None:
    data = healthy()
    for number in (1, 2, 3):
        seen(data, number, D8203=1, D8211=11, M8183="on", M8191="off")
    data["stations"][0]["state"] = "stop"
    assert first(data, tmp_path) == ("master_away", 0)


def test_the_master_alone_is_told_to_read_the_slaves(tmp_path: Path) -> None:
    data = healthy()
    data["stations"] = data["stations"][:1]
    assert found(data, tmp_path).next[0].startswith("read the slaves")


def test_symptoms_weigh_in(tmp_path: Path) -> None:
    data = healthy()
    for number in (1, 2, 3):
        seen(data, number, D8203=200, D8211=14)
    before = found(data, tmp_path).causes[0]
    after = found({**data, "symptoms": ["when_drive_runs"]}, tmp_path).causes[0]
    assert (after.cause, after.score) == (before.cause, before.score + 1)


def test_what_is_only_seen_to_climb_is_evidence(tmp_path: Path) -> None:
    data = healthy()
    for number in (1, 2, 3):
        del data["stations"][number]["after"]["D8203"]
        data["stations"][number]["rising"] = ["D8203"]
        seen(data, number, D8211=14)
    assert first(data, tmp_path) == ("noise_wire", None)


@pytest.mark.slow
def test_random_machines_are_diagnosed() -> None:
    """Of all stations with RUN state and lamps: 95 % among three, 86 % the first group, a lead of 3 right in 90 %.

    15 causes on 6 machines each, seeds that the rules were not made with.
    """
    tally = machines(range(6))
    for name, share in {"among three": 0.95, "first group": 0.86, "first with a lead of 3": 0.90}.items():
        assert tally.right[name] >= share * tally.tried[name], name
