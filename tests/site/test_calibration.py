"""Calibrations: what simulated machines decide, what is open by its nature, and what no rule explains."""

from itertools import product
from pathlib import Path
from typing import Any

import pytest

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
