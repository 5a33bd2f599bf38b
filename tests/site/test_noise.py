"""How much noise: single readings against theory and published figures, then all of them on simulated links."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import binom, poisson

from bussim.plc.profiles import AbsentStation, Attempts, ErrorCount
from bussim.site.link import SiteLink
from bussim.site.noise.lenses import measure, poisson_mean, root
from bussim.site.noise.picture import Picture, picture
from bussim.site.noise.sizing import sizes
from bussim.site.plan import EVENTS, plan
from tests.site.acceptance import links, plans
from tests.site.examples import PLACES, healthy, readout, seen

EIGHT = (*PLACES, "oven", "washer", "packer", "stacker")


def quiet(*, retries: int, watched: str) -> dict[str, Any]:
    """Eight stations in mode 2 that counted nothing at all; a scan takes 131.5 ms."""
    zeros = {f"D{8203 + k}": 0 for k in range(8)} | {"D8201": 131, "D8202": 132, "D8174": 7, "M8191": "on"}
    stations = [
        {"place": place, "number": k, "state": "run", "before": zeros, "after": zeros}
        for k, place in enumerate(EIGHT)
    ]
    settings = {"slaves": 7, "mode": 2, "retries": retries, "timeout": "50 ms"}
    return {
        "schema": 1,
        "kind": "readout",
        "profile": "pw10",
        "settings": settings,
        "watched": watched,
        "stations": stations,
    }


def of(data: dict[str, Any], folder: Path) -> Picture:
    paper = readout(data, folder)
    return picture(paper, SiteLink.of(paper))


def test_a_day_without_errors_says_what_was_computed_for_it(tmp_path: Path) -> None:
    """At D8179 = 3: p < 4.6 % by the master, BER < 5.1e-9 by the slaves, p < 6.5e-7 by D8202; an hour at 0: 1.1e-4."""
    day = of(quiet(retries=3, watched="1 d"), tmp_path).measured
    assert [round(lens.high, 3) for lens in day.named("M")] == [0.046] * 7
    assert all(lens.high == pytest.approx(5.1e-9, rel=0.01) for lens in day.named("S"))
    # All stations together are seen in one D8202, so each is bounded by a seventh of that.
    assert all(lens.high == pytest.approx(6.5e-7, rel=0.05) for lens in day.named("X"))
    hour = of(quiet(retries=0, watched="1 h"), tmp_path).measured
    assert all(lens.high == pytest.approx(1.1e-4, rel=0.03) for lens in hour.named("M"))


def test_intervals_are_garwoods() -> None:
    for count in (1, 7, 260):
        low, high = poisson_mean(count)
        assert poisson.sf(count - 1, low) == pytest.approx(0.025)
        assert poisson.cdf(count, high) == pytest.approx(0.025)
    assert poisson.cdf(0, poisson_mean(0)[1]) == pytest.approx(0.05)


@pytest.mark.parametrize("absent", AbsentStation)
@pytest.mark.parametrize("counted", ErrorCount)
def test_station_errors_by_the_masters_rules(
    absent: AbsentStation, counted: ErrorCount, tmp_path: Path
) -> None:
    """Scan by scan with random numbers: a flagged station has one attempt (probe) or all, and counts or not."""
    data = healthy() | {
        "profile": {"base": "pw10", "absent_station": absent.value, "error_count": counted.value}
    }
    link, rng, p = SiteLink.of(readout(data, tmp_path)), np.random.default_rng(4), 0.6
    failed, flag, count = rng.random((200_000, 4)) < p, False, 0
    for attempts in failed:
        error = bool(attempts[0] if flag and absent.probes else attempts.all())
        count += error and not (flag and counted.on_edge)
        flag = error
    assert link.station_errors(p) == pytest.approx(count / len(failed), rel=0.03)


def test_counts_of_a_start_widen_the_interval_where_there_is_no_before(tmp_path: Path) -> None:
    data = healthy()
    seen(data, 0, D8204=2, D8212=1)
    lens = of(data, tmp_path).measured.of("M", 1)
    assert lens is not None
    assert (lens.low, lens.count) == (0.0, 2)


def test_the_wire_is_what_all_slaves_share_and_the_rest_is_in_a_receiver(tmp_path: Path) -> None:
    """18,000 scans: 60 damaged frames at each slave, 400 more and 350 missed replies a station at lift alone."""
    data = healthy()
    for number, count in ((1, 60), (2, 460), (3, 60)):
        seen(data, number, D8203=count, D8211=14)
    seen(data, 2, D8204=350, D8206=350, D8212=4, D8214=4)
    found = of(data, tmp_path)
    assert found.noise.wire == pytest.approx(60 / 18_000 / (540 + 3 * 50), rel=0.1)
    assert set(found.noise.receivers) == {2}
    assert found.noise.receivers[2] == pytest.approx(350 / 18_000 / 540, rel=0.1)
    entries = found.entries()
    assert [(entry.get("station"), entry.get("direction")) for entry in entries] == [
        (None, None),
        ("lift", "rx"),
    ]


@pytest.mark.parametrize(
    ("rises", "bursts"), [([900, 90, 8], "not seen"), ([900, 90, 90], "seen"), ([9, 1, 0], "cannot tell")]
)
def test_bursts_are_failures_that_come_together(rises: list[int], bursts: str, tmp_path: Path) -> None:
    """Of 18,000 scans 5 % fail: together, if all failures were one station's, at most 45 or so by chance."""
    data = healthy() | {"ladder": {"thresholds_ms": [70, 101, 125], "rises": rises}}
    found = of(data, tmp_path)
    assert found.bursts == bursts
    if bursts == "seen":
        assert found.entries() == []
        assert sizes(found)["likeliest"].choice is None


def test_where_failures_may_come_together_lower_limits_allow_for_it(tmp_path: Path) -> None:
    """40 station errors in 18,000 scans at n = 4: one by one p = 0.22; all in bursts, p = 40 / 18,000. Repeats make fewer scans."""
    data = healthy()
    seen(data, 0, D8204=40, D8212=4)
    unknown = of(data, tmp_path).fails[1]
    assert unknown.low == pytest.approx((poisson_mean(38)[0]) / 18_000, rel=0.2)
    assert unknown.high == pytest.approx((poisson_mean(40)[1] / 18_000) ** 0.25, rel=0.08)
    steady = of(data | {"ladder": {"thresholds_ms": [70, 101, 125], "rises": [900, 90, 8]}}, tmp_path).fails[
        1
    ]
    assert steady.low == pytest.approx((poisson_mean(38)[0] / 18_000) ** 0.25, rel=0.08)


def test_damage_of_the_masters_frames_alone_is_entered_at_its_driver(tmp_path: Path) -> None:
    """300 of its frames in 18,000 scans, and no reply: 1.3e-5 to 2.9e-5 at 690 bits; a poll has 50 of them."""
    data = healthy()
    data["settings"]["retries"] = 0
    for number in (1, 2, 3):
        seen(data, number, D8203=300, D8211=14)
    seen(data, 0, D8204=15, D8205=14, D8206=16, D8212=1, D8213=1, D8214=1)
    found = of(data, tmp_path)
    assert found.entries() == [
        {"bus": "link", "station": "press", "direction": "tx", "ber": pytest.approx(2.4e-5, rel=0.1)}
    ]
    assert found.fails[1].low <= 50 * 2.4e-5 <= found.fails[1].high
    assert "the master's own frames are" in found.unexplained[0]


def test_what_a_station_misses_alone_is_of_replies_that_came(tmp_path: Path) -> None:
    """At D8179 = 0 half of the replies are damaged on the wire: of the other half each tenth is missed by lift alone."""
    data = healthy()
    data["settings"]["retries"] = 0
    for number in (1, 2, 3):
        seen(data, number, D8203=7000, D8211=14)
    for number in (0, 1, 3):
        seen(data, number, **{f"D{8203 + k}": 5000 for k in (1, 3) if k != number})
    seen(data, 2, D8204=5300, D8206=5300)
    found = of(data, tmp_path).measured
    wire, own = found.of("S", 1), found.of("L", 2)
    assert wire is not None
    assert own is not None
    came = (1 - wire.value) ** (540 + 50)
    assert own.value == pytest.approx(300 / found.scans[1] / came / 540, rel=0.05)


def test_counts_of_onsets_limit_nothing_in_bursts(tmp_path: Path) -> None:
    data = healthy() | {"ladder": {"thresholds_ms": [70, 101, 125], "rises": [900, 90, 90]}}
    data["profile"] = {"base": "pw10", "error_count": "on_edge"}
    seen(data, 0, D8204=40, D8212=4)
    assert of(data, tmp_path).fails[1].high == 1.0
    data["ladder"]["rises"] = [900, 90, 8]
    assert of(data, tmp_path).fails[1].high < 0.3


def test_scans_shorter_than_the_law_allows_are_said_and_counted_with(tmp_path: Path) -> None:
    """With mode 4 entered a scan takes 167 ms, and 67 were seen: D8202 = 67 bounds nothing."""
    data = healthy()
    data["settings"]["mode"] = 4
    found = of(data, tmp_path)
    assert found.measured.scans[1] == pytest.approx(20 * 60 / 0.067, rel=0.01)
    assert found.measured.named("X") == []
    assert "scans of 67 were seen" in " ".join(found.unknown)
    assert found.fails[1].high == pytest.approx(0.11, rel=0.1)


def test_what_cannot_be_known_is_said_with_what_would_tell(tmp_path: Path) -> None:
    data = healthy()
    data["stations"] = data["stations"][:1]
    said = " ".join(of(data, tmp_path).unknown)
    assert "there is no count of a slave that works" in said
    assert "ladder" in said
    assert "master was not read" not in said


def test_an_open_field_is_worked_out_both_ways(tmp_path: Path) -> None:
    (tmp_path / "site.yaml").write_text(
        "{schema: 1, kind: profile, profile: {base: pw10}, open: [attempts]}", encoding="utf-8"
    )
    paper = readout(healthy() | {"profile": "site.yaml"}, tmp_path)
    assert paper.profile.open == ("attempts",)
    assert [SiteLink.of(paper, meaning).n for meaning in Attempts] == [4, 3]


def test_plans_reach_their_factor(tmp_path: Path) -> None:
    """Of 200 counts drawn for the planned time 90 % give an interval whose ends differ by a factor of 4 at most."""
    random, found = np.random.default_rng(7), of(quiet(retries=0, watched="1 d"), tmp_path)
    for watch in plan(found)[:2]:
        assert watch.seconds is not None
        counts = random.poisson(watch.events * watch.seconds, 200)
        reached = [poisson_mean(int(count)) for count in counts]
        assert sum(low > 0 and high <= 4 * low for low, high in reached) >= 180
        assert watch.events * watch.seconds == pytest.approx(EVENTS)


def test_what_climbs_is_no_number_of_events(tmp_path: Path) -> None:
    data = healthy()
    for number in (0, 1, 2):
        data["stations"][number] |= {"after": {"M8191": "on"}, "rising": ["D8203" if number else "D8204"]}
    found = of(data, tmp_path).measured
    assert [lens.station for lens in found.named("M")] == []
    assert [lens.station for lens in found.named("S")] == [3]


def test_a_station_that_came_late_has_no_failures_of_that(tmp_path: Path) -> None:
    """Saw came after 34 scans, lift after 9: neither their counts nor what early slaves count more is noise."""
    data = healthy()
    for number, longest in ((0, 680), (1, 680), (2, 363)):
        late = {"D8206": 34 if number < 2 else 25, "D8214": 21 if number else 1}
        seen(
            data,
            number,
            D8202=longest,
            **late,
            **({"D8205": 9, "D8213": 21 if number else 1} if number < 2 else {}),
        )
    found = of(data, tmp_path)
    assert [lens.station for lens in found.measured.named("M")] == [1]
    assert all(not lens.count for lens in found.measured.named("L"))
    assert {fails.low for fails in found.fails.values()} == {0.0}
    assert "what fails at saw (station 3) while it works" in " ".join(found.unknown)


def test_how_long_a_stopped_master_ran_is_not_known(tmp_path: Path) -> None:
    data = healthy()
    data["stations"][0]["state"] = "stop"
    found = of(data, tmp_path)
    assert found.measured.lenses == []
    assert found.measured.scans[0] == 0
    assert found.fails[1].high == 1.0
    assert "how many scans there were" in " ".join(found.unknown)
    assert sizes(found)["likeliest"].why == "nothing that was read tells how much noise there is"


def test_the_ladders_longest_scan_bounds_where_the_start_spoilt_d8202(tmp_path: Path) -> None:
    data = healthy()
    for number in range(4):
        seen(data, number, D8202=900)
    data |= {"ladder": {"thresholds_ms": [70, 101, 125], "rises": [0, 0, 0], "max_ms": 67}}
    lens = of(data, tmp_path).measured.named("X")[0]
    assert "the ladder's longest = 67" in lens.reading
    assert lens.high < 1e-3


def test_a_chance_that_no_number_shows_is_none(tmp_path: Path) -> None:
    data = healthy()
    data["settings"]["retries"] = 0
    seen(data, 0, D8204=9000, D8212=4)
    assert "D8204 of press = 9000 has no chance by the damage that slaves count" in " ".join(
        of(data, tmp_path).unexplained
    )


def test_a_root_outside_of_the_range_is_its_end() -> None:
    assert root(lambda x: x, 2.0, 1.0) == 1.0
    assert root(lambda x: x + 1, 0.5, 1.0) == 0.0
    assert root(lambda x: x * x, 0.25, 1.0) == pytest.approx(0.5)


@pytest.mark.slow
def test_intervals_cover_the_truth_of_simulated_links() -> None:
    """93 % of intervals with events, 97.5 % of upper bounds; bursts seen in 95 %, falsely in 1 %.

    So many links as a few minutes allow: what is asked for is that the shares are not significantly below. An
    interval is hardly wider than the number of its events has it.
    """
    tally = links(range(12))
    tried, covered = tally.tried, tally.right
    for name, wanted in {
        "N": 0.95,
        "fails": 0.95,
        "fails in bursts": 0.95,
        "bounds": 0.975,
        "bursts True": 0.95,
        **dict.fromkeys("MSLET", 0.93),
    }.items():
        assert binom.cdf(covered[name], tried[name], wanted) > 0.01, name
    assert covered["bursts False"] <= 1
    for name in ("S", "E", "M at n = 1"):
        widths, counts = tally.medians[f"width {name}"], tally.medians[f"width {name} by count"]
        assert np.median(widths) <= 1.05 * np.median(counts)
    assert np.median(tally.medians["width E"]) <= 1.5


@pytest.mark.slow
def test_simulated_plans_reach_their_factor() -> None:
    """90 % of the links watched for as long as planned give an interval of a factor of 4 at most."""
    tally = plans(range(40))
    for reading in ("D8203 of the slaves", "the ladder"):
        assert tally.tried[reading] >= 30
        assert binom.cdf(tally.right[reading], tally.tried[reading], 0.9) > 0.01


def test_lenses_stand_side_by_side(tmp_path: Path) -> None:
    paper = readout(healthy(), tmp_path)
    names = [lens.name for lens in measure(paper, SiteLink.of(paper)).lenses]
    assert names == ["M"] * 3 + ["S"] * 3 + ["L"] * 3 + ["X"] * 2


def test_what_a_dead_station_cost_is_no_time_of_other_scans(tmp_path: Path) -> None:
    """In 600 s 200 s of scans of 66.6 ms, then 400 s of scans with 4 silent attempts and parameters, 261 ms, each counted."""
    data = healthy() | {"watched": "600 s"}
    for number in (0, 1, 3):
        seen(data, number, D8205=1532, D8213=21 if number else 1, M8185="on", D8202=262, D8201=261)
    data["stations"][2] = {"place": "lift", "number": 2, "state": "off"}
    least, likeliest, most = of(data, tmp_path).measured.scans
    assert likeliest == pytest.approx(200 / 0.0666 + 1532, rel=0.01)
    assert least == pytest.approx(most, rel=0.01)
    data["profile"] = {"base": "pw10", "error_count": "on_edge"}
    unknown = of(data, tmp_path).measured.scans
    assert unknown[0] <= 600 / 0.261
    assert unknown[2] == pytest.approx(600 / 0.0666, rel=0.01)
