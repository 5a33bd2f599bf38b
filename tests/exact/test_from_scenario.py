"""Links as scenarios describe them, and why some have no distribution."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

import bussim
from bussim.exact.from_scenario import from_scenario
from bussim.exact.link import LinkModel
from bussim.exact.metrics import figures_of
from bussim.plc.profiles import AbsentStation
from bussim.scenario.loader import from_data
from tests.exact.links import MS

Changes = Callable[[dict[str, Any]], None]


def scenario(*changes: Changes, **more: object) -> dict[str, Any]:
    data: dict[str, Any] = {
        "schema": 1,
        "name": "test",
        "duration": "60 s",
        "seed": 1,
        "buses": [{"name": "link", "nn": True}],
        "plcs": [
            {
                "name": "master",
                "profile": "pw10",
                "scan": "8 ms",
                "nn": {
                    "bus": "link",
                    "port": "COM4",
                    "station": 0,
                    "slaves": 2,
                    "mode": 2,
                    "retries": 5,
                    "timeout": "60 ms",
                },
            },
            {
                "name": "one",
                "profile": "pw10",
                "scan": {"mean": "10 ms", "jitter": "2 ms"},
                "nn": {"bus": "link", "station": 1},
            },
            {"name": "two", "profile": "pw10", "scan": "5 ms", "nn": {"bus": "link", "station": 2}},
        ],
        **more,
    }
    for change in changes:
        change(data)
    return data


def read(
    *changes: Changes, ignore_faults: bool = False, bound_end: bool = False, **more: object
) -> LinkModel:
    links = from_scenario(
        from_data(scenario(*changes, **more)), ignore_faults=ignore_faults, bound_end=bound_end
    )
    assert list(links) == ["link"]
    return links["link"]


def test_the_numbers_of_a_link() -> None:
    link = read()
    assert link.valid
    assert (link.master, link.mode, link.retries, link.attempts, link.timeout) == ("master", 2, 5, 6, 60 * MS)
    assert (link.gap, link.overhead, link.data, link.poll, link.parameters) == (
        30_060,
        253_440,
        1_012_500,
        93_750,
        262_500,
    )
    assert [(s.number, s.name, s.alive, s.hears, s.reply) for s in link.stations] == [
        (1, "one", True, True, 1_012_500),
        (2, "two", True, True, 1_012_500),
    ]
    # The longest PLC scan, with the factor 1.1 of N:N.
    assert [s.scan for s in link.stations] == [950_400, 396_000]
    assert link.scan == 633_600
    assert link.noise.sources == ()
    assert link.data_bits == 540
    assert link.timeout_range == (5, 225)


def test_profiles_of_master_and_slaves() -> None:
    def changed(data: dict[str, Any]) -> None:
        data["plcs"][0]["profile"] = {
            "base": "fx2n",
            "attempts": "retries",
            "absent_station": "probe",
            "master_gap": "1 ms",
        }
        data["plcs"][1]["profile"] = {"base": "fx2n", "turnaround": {"mean": "2 ms", "jitter": "0.5 ms"}}
        data["plcs"][2]["profile"] = "fx2n"

    link = read(changed)
    assert (link.attempts, link.absent, link.gap, link.timeout_range) == (
        5,
        AbsentStation.PROBE,
        MS,
        (5, 255),
    )
    assert (link.stations[0].turnaround.mean, link.stations[1].turnaround.mean) == (2 * MS, 30_060)


def test_stations_that_are_not_there() -> None:
    def changed(data: dict[str, Any]) -> None:
        data["plcs"][0]["nn"]["slaves"] = 4
        data["plcs"][1]["nn"]["station"] = 3
        data["plcs"].append(
            {"name": "five", "profile": "pw10", "scan": "5 ms", "nn": {"bus": "link", "station": 5}}
        )

    link = read(changed)
    assert [(s.number, s.name, s.alive) for s in link.stations] == [
        (1, "", False),
        (2, "two", True),
        (3, "one", True),
        (4, "", False),
    ]
    assert [s.name for s in link.listeners] == ["five"]
    assert "master->five" in figures_of(link).refresh
    assert link.valid


def test_a_slave_without_the_masters_mode_stays_out() -> None:
    def changed(data: dict[str, Any]) -> None:
        data["plcs"][0]["nn"]["mode"] = 4
        data["plcs"][1]["profile"] = "fx2n"

    first, second = read(changed).stations
    assert (first.alive, first.hears, second.alive) == (False, False, True)


def test_noise_becomes_sources() -> None:
    link = read(
        noise=[
            {"bus": "link", "ber": 1e-6},
            {"bus": "link", "station": "one", "ber": 1e-5},
            {"bus": "link", "station": "two", "direction": "tx", "ber": 1e-4},
            {"bus": "link", "burst": {"good": "10 s", "bad": "20 ms", "ber_good": 0, "ber_bad": 0.01}},
            {"bus": "link", "burst": {"good": "1 s", "bad": "20 ms", "ber_good": 1e-7, "ber_bad": 1e-7}},
            {"bus": "link", "reply_loss": 0.1},
            {"bus": "link", "station": "two", "reply_loss": 0.5},
            {"bus": "link", "ber": 0},
        ]
    )
    assert [(s.part, s.station, s.good, s.bad, s.chain) for s in link.noise.sources] == [
        ("bus", None, 1e-6, 0.0, None),
        ("rx", 1, 1e-5, 0.0, None),
        ("tx", 2, 1e-4, 0.0, None),
        ("bus", None, 0.0, 0.01, 0),
        ("bus", None, 1e-7, 0.0, None),
    ]
    assert link.noise.chains == ((10_000.0 * MS, 20.0 * MS),)
    assert [s.loss for s in link.stations] == [pytest.approx(0.1), pytest.approx(0.55)]
    assert link.valid


@pytest.mark.parametrize(
    ("fault", "states"),
    [
        ({"power_off": "one"}, [(False, False), (True, True)]),
        ({"stop": "two"}, [(True, True), (False, False)]),
        ({"drop_reply": "one", "for": "60 s"}, [(False, True), (True, True)]),
        ({"cable_cut": {"bus": "link", "after": "one"}}, [(True, True), (False, False)]),
        ({"board_error": {"plc": "one", "port": "COM3", "code": 10}}, [(True, True), (True, True)]),
    ],
)
def test_faults_that_last_become_part_of_the_link(
    fault: dict[str, object], states: list[tuple[bool, bool]]
) -> None:
    link = read(faults=[{"at": "0 s", **fault}])
    assert link.obstacles == ()
    assert [(s.alive, s.hears) for s in link.stations] == states


def test_slow_stations_and_clocks() -> None:
    link = read(
        faults=[
            {"at": "0 s", "slow": {"station": "one", "extra": "3 ms"}},
            {"at": "0 s", "clock_ppm": {"station": "two", "ppm": 10_000}},
            {"at": "0 s", "late_release": {"station": "one", "by": "0.2 ms"}},
        ]
    )
    assert link.valid
    assert link.stations[0].extra == 3 * MS
    assert link.stations[1].reply == round(1_012_500 / 1.01)


REASONS: dict[str, tuple[dict[str, Any], str]] = {
    "power_off": ({"at": "10 s", "for": "5 s", "power_off": "one"}, "changes the link during the run"),
    "power_off of the master": ({"at": "0 s", "power_off": "master"}, "keeps the master off"),
    "drop_reply": ({"at": "0 s", "count": 3, "drop_reply": "one"}, "changes the link during the run"),
    "cable_cut": (
        {"at": "1 s", "cable_cut": {"bus": "link", "after": "one"}},
        "(cable_cut) changes the link",
    ),
    "jabber": ({"at": "0 s", "jabber": "one"}, "collides with every frame"),
    "wrong_format": ({"at": "0 s", "wrong_format": {"station": "one", "format": "8N1"}}, "wrong format"),
    "clock": (
        {"at": "0 s", "clock_ppm": {"station": "one", "ppm": 45_000}},
        "moves samples out of their bits",
    ),
    "late_release": (
        {"at": "0 s", "late_release": {"station": "one", "by": "1 ms"}},
        "collides with the next frame",
    ),
    "power_on": ({"power_on": {"two": "4 s"}}, "the late power-on of two changes the link"),
}


@pytest.mark.parametrize("name", REASONS)
def test_faults_that_have_no_law(name: str) -> None:
    fault, reason = REASONS[name]
    link = read(faults=[fault])
    assert not link.valid
    assert any(reason in said for said in link.reasons), link.reasons
    assert figures_of(link).to_json()["mean_ms"] is None


@pytest.mark.parametrize("name", ["power_off", "drop_reply", "cable_cut", "power_on"])
def test_passing_faults_may_be_left_out(name: str) -> None:
    link = read(faults=[REASONS[name][0]], ignore_faults=True)
    assert link.valid
    assert len(link.notes) == 1
    assert "left out" in link.notes[0]
    assert figures_of(link).mean == figures_of(read()).mean


def test_a_sizing_takes_a_station_of_a_wrong_format_for_silent() -> None:
    data = scenario(faults=[REASONS["wrong_format"][0]])
    link = from_scenario(from_data(data), ignore_faults=True, bound_end=True)["link"]
    assert link.valid
    assert [station.name for station in link.dead] == ["one"]
    assert "neither hears nor replies" in link.notes[0]
    assert link.complete.stations == read().stations


@pytest.mark.parametrize(
    ("port", "replies"),
    [
        ({"format": "7E2"}, True),
        ({"format": "7O1"}, False),
        ({"baud": 19_200}, False),
    ],
)
def test_a_station_that_reads_polls_with_another_format_is_not_sized_as_silent(
    port: dict[str, Any], replies: bool
) -> None:
    """The simulation tells which these are: there they reply."""
    data = scenario(faults=[{"at": "0 s", "wrong_format": {"station": "one", **port}}], duration="2 s")
    link = from_scenario(from_data(data), bound_end=True)["link"]
    assert link.valid != replies
    assert ("hears depends on the data" in str(link.obstacles)) == replies
    errors = bussim.run(from_data(data), rows=False).summary["links"]["link"]["station_errors"]
    assert (errors["1"] == 0) == replies


def test_a_station_that_does_not_exist_would_be_as_slow_as_any() -> None:
    def more(data: dict[str, Any]) -> None:
        data["plcs"][0]["nn"]["slaves"] = 3

    link = read(more)
    (absent,), present = link.dead, link.alive
    assert absent.scan == max(link.scan, *(station.scan for station in present))
    assert absent.slowest == max(station.slowest for station in present)
    assert link.complete.lines == (link.complete,)


def test_faults_on_other_stations_do_not_matter() -> None:
    def changed(data: dict[str, Any]) -> None:
        data["plcs"].append({"name": "aside", "profile": "pw10", "scan": "5 ms"})

    assert read(changed, faults=[{"at": "1 s", "power_off": "aside"}]).valid


def test_noise_that_has_no_law() -> None:
    impulse = read(noise=[{"bus": "link", "impulse": {"every": "20 ms", "width": "50 us", "ber": 0.5}}])
    assert "periodic impulses keep their phase" in impulse.reasons[0]
    window = [{"bus": "link", "ber": 1e-5, "at": "10 s", "for": "5 s"}]
    assert "changes the link during the run" in read(noise=window).reasons[0]
    assert read(noise=window, ignore_faults=True).noise.sources == ()
    assert read(noise=[{**window[0], "at": "0 s", "for": "60 s"}]).valid
    burst = {"bus": "link", "burst": {"good": "10 s", "bad": "20 ms", "ber_good": 0, "ber_bad": 0.01}}
    assert read(noise=[burst] * 3).valid
    assert "more than 3 bursts" in read(noise=[burst] * 4).reasons[0]


def test_links_that_collide_or_have_no_master() -> None:
    def twins(data: dict[str, Any]) -> None:
        data["plcs"][2]["nn"]["station"] = 1

    def masters(data: dict[str, Any]) -> None:
        data["plcs"][2]["nn"] = {"bus": "link", "station": 0, "slaves": 1}

    def headless(data: dict[str, Any]) -> None:
        data["plcs"][0]["nn"] = {"bus": "link", "station": 3}

    def refused(data: dict[str, Any]) -> None:
        data["plcs"][0]["nn"] = {"bus": "link", "station": 0}
        data["plcs"][0]["registers"] = {"D8177": 0}

    assert "one and two are both stations 1: their frames collide" in read(twins).reasons
    assert "master and two are both masters (station 0): their frames collide" in read(masters).reasons
    for change in (headless, refused):
        link = read(change)
        assert link.reasons == ("no station 0 with valid settings: no master polls",)
        assert figures_of(link).to_json()["mean_ms"] is None


def test_replies_at_end() -> None:
    def changed(data: dict[str, Any]) -> None:
        data["plcs"][1]["profile"] = {"base": "pw10", "reply": "end"}

    link = read(changed)
    assert (
        "station 1 (one) replies at END: the phase of its PLC scan persists from poll to poll" in link.reasons
    )
    bound = read(changed, bound_end=True)
    assert bound.valid
    assert bound.stations[0].extra == bound.stations[0].scan
    assert "upper bounds" in bound.notes[0]


def test_timeouts_that_are_too_short() -> None:
    def slow(data: dict[str, Any]) -> None:
        data["plcs"][0]["nn"] |= {"timeout": "50 ms", "mode": 4}

    late = [{"at": "0 s", "slow": {"station": "one", "extra": "11 ms"}}]
    assert "late replies are taken for later attempts" in read(slow, faults=late).reasons[0]
    tight = [{"at": "0 s", "slow": {"station": "one", "extra": "10.3 ms"}}]
    assert read(slow, faults=tight).valid
    noisy = read(slow, faults=tight, noise=[{"bus": "link", "ber": 1e-6}])
    assert "a damaged reply may end at the deadline" in noisy.reasons[0]


def test_too_many_laws_of_the_turnaround() -> None:
    def changed(data: dict[str, Any]) -> None:
        data["plcs"][0]["nn"]["slaves"] = 5
        del data["plcs"][1:]
        for k in range(1, 6):
            profile = {"base": "pw10", "turnaround": {"mean": "1 ms", "jitter": f"0.{k} ms"}}
            data["plcs"].append(
                {"name": f"p{k}", "profile": profile, "scan": "5 ms", "nn": {"bus": "link", "station": k}}
            )

    assert read(changed).reasons == ("5 different distributions of the turnaround, at most 4 are worked out",)


def test_a_short_gap_on_a_noisy_line() -> None:
    def changed(data: dict[str, Any]) -> None:
        data["plcs"][0]["profile"] = {"base": "pw10", "master_gap": "0.1 ms"}

    assert read(changed).valid
    assert "less than a character" in read(changed, noise=[{"bus": "link", "ber": 1e-6}]).reasons[0]
