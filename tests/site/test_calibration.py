"""Calibrations: what simulated machines decide, what is open by its nature, and what no rule explains."""

from itertools import product
from pathlib import Path
from typing import Any

import pytest

from bussim.errors import ScenarioError
from bussim.plc.profiles import AbsentStation, Attempts, ErrorCount, Reply
from bussim.scenario.yaml.dump import dumped
from bussim.site.calibration import Found, calibrate
from bussim.site.file import load
from bussim.site.readout import Calibration
from tests.site.calibrated_machines import machine

#: A scan of 3 slaves in mode 2: 66.6 ms; of one: 34.2 ms; a slave that is off costs 4 × 101.7 - 16.2 + 4.1 ms.
EXAMPLE: dict[str, dict[str, Any]] = {
    "all": {"retries": 3, "timeout": "100 ms", "slaves": 3, "D8201": [67, 66, 67]},
    "one": {"retries": 3, "timeout": "100 ms", "slaves": 1, "D8201": [34, 34]},
    "one_slow": {"retries": 3, "timeout": "150 ms", "slaves": 1, "slow_plc": {"number": 1, "scan": "60 ms"}, "D8201": 34},
    "off_3_100": {
        "retries": 3, "timeout": "100 ms", "slaves": 3, "D8201": 461, "D8202": 462,
        "cut": {"number": 2, "times": 3, "last_for": "60 s"}, "D8205": 140,
    },
}  # fmt: skip


def found(folder: Path, **changed: dict[str, Any] | None) -> Found:
    experiments = {name: given for name, given in (EXAMPLE | changed).items() if given is not None}
    listed = [{"name": name, **given} for name, given in experiments.items()]
    data = {
        "schema": 1,
        "kind": "calibration",
        "profile": "pw10",
        "settings": {"slaves": 3, "mode": 2},
        "experiments": listed,
    }
    return decoded(data, folder)


def decoded(data: dict[str, Any], folder: Path) -> Found:
    path = folder / "calibration.yaml"
    path.write_text(dumped(data), encoding="utf-8")
    given = load(path)
    assert isinstance(given, Calibration)
    return calibrate(given)


def test_the_readings_of_a_pw10_decide_its_fields(tmp_path: Path) -> None:
    fields = {
        "attempts": "retries+1", "absent_station": "full", "error_count": "per_scan", "reply": "interrupt", "link_scan_unit": "1 ms",
    }  # fmt: skip
    here = found(tmp_path)
    assert here.fields == fields
    assert not here.unexplained
    for name, true in (("master_gap", 0.4175), ("turnaround", 0.4175), ("scan_overhead", 3.52)):
        _, low, high = here.times[name]
        assert low <= true <= high


@pytest.mark.parametrize(
    ("experiment", "change", "field", "value"),
    [
        ("off_3_100", {"D8201": 359}, "attempts", "retries"),
        ("off_3_100", {"D8201": 156, "D8202": 461}, "absent_station", "probe"),
        ("off_3_100", {"D8205": 3}, "error_count", "on_edge"),
        ("one_slow", {"D8201": 66}, "reply", "end"),
        ("all", {"D8201": 7}, "link_scan_unit", "10 ms"),
        ("all", {"D8201": 666}, "link_scan_unit", "100 us"),
    ],
)
def test_each_field_has_its_reading(
    experiment: str, change: dict[str, Any], field: str, value: str, tmp_path: Path
) -> None:
    assert found(tmp_path, **{experiment: EXAMPLE[experiment] | change}).fields[field] == value


@pytest.mark.parametrize(
    ("changed", "left"),
    [
        ({"off_3_100": EXAMPLE["off_3_100"] | {"retries": 0, "D8201": 156}}, {"attempts", "absent_station"}),
        (
            {"off_3_100": {k: v for k, v in EXAMPLE["off_3_100"].items() if k != "D8202"} | {"D8201": 156}},
            {"attempts"},
        ),
        ({"off_3_100": EXAMPLE["off_3_100"] | {"D8201": 156, "D8202": 255}}, {"attempts"}),
        ({"off_3_100": None}, {"attempts", "absent_station", "error_count"}),
        ({"one_slow": None}, {"reply", "master_gap", "turnaround", "scan_overhead"}),
        ({"one_slow": EXAMPLE["one_slow"] | {"D8201": 66}}, {"master_gap", "turnaround", "scan_overhead"}),
        ({"one": None}, {"master_gap", "turnaround", "scan_overhead"}),
    ],
)
def test_what_readings_cannot_tell_is_open_and_keeps_the_assumed_value(
    changed: dict[str, dict[str, Any] | None], left: set[str], tmp_path: Path
) -> None:
    here = found(tmp_path, **changed)
    assert left <= {*here.open}
    assert not left & ({*here.fields} | {*here.times})
    assert not left & {*here.profile({"base": "pw10"})["profile"]}


@pytest.mark.parametrize(
    ("experiment", "change", "text"),
    [
        ("off_3_100", {"D8201": 410}, "has room for 3.50 attempts"),
        (
            "one_slow",
            {"D8201": 50},
            "D8201 is 50.0 ms with a PLC scan of 66.0 ms at the slave, neither that nor 34.0 ms",
        ),
        ("off_3_100", {"D8205": 20}, "20 errors after 3 cuts"),
    ],
)
def test_where_no_rule_fits_the_model_is_wrong_and_no_profile_is_made(
    experiment: str, change: dict[str, Any], text: str, tmp_path: Path
) -> None:
    assert text in " ".join(found(tmp_path, **{experiment: EXAMPLE[experiment] | change}).unexplained)


def test_listeners_that_count_otherwise_are_no_lenses(tmp_path: Path) -> None:
    check = {"retries": 3, "timeout": "100 ms", "slaves": 3, "cut": {"number": 0}, "D8203": 1, "D8211": 11}
    assert "listeners" not in found(tmp_path, listeners=check).open
    assert "listeners" in found(tmp_path, listeners=check | {"D8203": 9}).open


SLOW_MASTER = {
    "retries": 3,
    "timeout": "100 ms",
    "slaves": 3,
    "slow_plc": {"number": 0, "scan": "60 ms"},
    "D8201": 67,
}
#: Scans with a slave off at D8180 = 4: 54.5 + 4 × 41.7 ms as it is, 4 × 51.7 ms as 50 ms.
FLOOR = {"retries": 3, "timeout": "40 ms", "slaves": 3, "cut": {"number": 2}, "D8201": 221}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({}, "D8180 = 4 is taken as it is"),
        ({"D8201": 261}, "D8180 = 4 is taken as 50 ms"),
        ({"M8063": "on", "D8063": 7448}, "D8180 = 4 is a parameter error (D8063 = 7448)"),
    ],
)
def test_how_a_short_timeout_is_taken(change: dict[str, Any], said: str, tmp_path: Path) -> None:
    assert said in " ".join(found(tmp_path, floor_40=FLOOR | change).checked)


def test_a_short_timeout_that_no_rule_explains_or_no_slave_shows(tmp_path: Path) -> None:
    assert "a timeout of 44" in " ".join(found(tmp_path, floor_40=FLOOR | {"D8201": 241}).unexplained)
    whole = {key: value for key, value in FLOOR.items() if key != "cut"}
    assert "D8180 = 4" in found(tmp_path, floor_40=whole).open


def test_d8201_does_not_rise_with_the_masters_plc_scan_or_the_model_is_wrong(tmp_path: Path) -> None:
    here = found(tmp_path, master_slow=SLOW_MASTER)
    assert "D8201 does not rise with the master's PLC scan" in here.checked
    risen = " ".join(found(tmp_path, master_slow=SLOW_MASTER | {"D8201": 80}).unexplained)
    assert "D8201 rises with the master's PLC scan: it is 80.0 ms instead of 66.7 ms" in risen


def test_slaves_count_alike_about_one_that_was_cut_or_are_no_lenses(tmp_path: Path) -> None:
    cut = EXAMPLE["off_3_100"]
    assert "listeners" not in found(tmp_path, off_3_100=cut | {"at_slaves": [140, 139]}).open
    assert (
        "slaves count 140, 90" in found(tmp_path, off_3_100=cut | {"at_slaves": [140, 90]}).open["listeners"]
    )


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"one": EXAMPLE["one"] | {"D8201": 94}}, "an exchange takes -13.7 ms by all and one, and its frames alone"),
        ({"all": EXAMPLE["all"] | {"D8201": 6700}}, "D8201 is 6700, and frames and turnarounds take about 78 ms"),
        ({"off_3_100": EXAMPLE["off_3_100"] | {"D8201": 60}, "one_slow": None}, "D8201 has room for 0.0"),
    ],
)  # fmt: skip
def test_times_that_cannot_be_are_no_profile(changed: dict[str, Any], text: str, tmp_path: Path) -> None:
    assert text in " ".join(found(tmp_path, **changed).unexplained)


def test_a_short_last_cut_does_not_tell_how_errors_are_counted(tmp_path: Path) -> None:
    short = EXAMPLE["off_3_100"] | {"cut": {"number": 2, "times": 3, "last_for": "1 us"}}
    assert "lasted for 2e-06 scans only" in found(tmp_path, off_3_100=short).open["error_count"]


@pytest.mark.parametrize(
    ("experiment", "change", "text"),
    [
        ("all", {"D8201": 0}, "D8201 is 0, which is no scan"),
        ("one", {"slaves": 3}, "slaves is 3, allowed 1 in one"),
        ("off_3_100", {"cut": {"number": 6}}, "cut.number is 6, allowed 1..3 in off_3_100"),
        (
            "all",
            {"slow_plc": {"number": 1, "scan": "60 ms"}},
            "slow_plc belongs to another experiment than all",
        ),
    ],
)
def test_an_experiment_has_what_its_name_says(
    experiment: str, change: dict[str, Any], text: str, tmp_path: Path
) -> None:
    with pytest.raises(ScenarioError, match=text):
        found(tmp_path, **{experiment: EXAMPLE[experiment] | change})


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_simulated_machines_are_calibrated(seed: int, tmp_path: Path) -> None:
    """All 16 combinations of the discrete fields, with other times, units and noise each."""
    unit = ("1 ms", "100 us", "10 ms")[seed]
    for attempts, absent, counted, reply in product(Attempts, AbsentStation, ErrorCount, Reply):
        fields = {
            "attempts": attempts.value, "absent_station": absent.value, "error_count": counted.value,
            "reply": reply.value, "link_scan_unit": unit,
        }  # fmt: skip
        data, times = machine(fields, 100 + seed)
        here = decoded(data, tmp_path)
        assert not here.unexplained
        assert here.fields == fields
        for name, true in (
            ("master_gap", "gap"),
            ("turnaround", "turnaround"),
            ("scan_overhead", "overhead"),
        ):
            if name in here.times:
                _, low, high = here.times[name]
                assert low <= times[true] <= high
        if reply.at_end or unit == "10 ms":
            assert not here.times
