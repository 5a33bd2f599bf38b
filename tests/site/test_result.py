"""``bussim.site`` from Python, and lamps that a run leaves."""

import json
from pathlib import Path
from typing import Any

import pytest

import bussim
from bussim.scenario.yaml.dump import dumped
from bussim.site.writing import readout_data
from tests.site.examples import PLACES, healthy

CASES = Path(__file__).parent / "cases"


@pytest.mark.parametrize("name", ["diagnose_cable", "calibrate_probe_on_edge"])
def test_its_plain_data_is_what_the_command_prints(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    path = CASES / f"{name}.yaml"
    assert bussim.main(["site", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == json.loads(json.dumps(bussim.site(path).to_dict()))


def test_failed_attempts_are_a_table(tmp_path: Path) -> None:
    path = tmp_path / "readout.yaml"
    path.write_text(dumped(healthy()), encoding="utf-8")
    table = bussim.site(path).table()
    assert list(table.index) == [1, 2, 3]
    assert (table["low"] == 0).all()
    with pytest.raises(bussim.UsageError, match="a calibration has no table"):
        bussim.site(CASES / "calibrate_probe_on_edge.yaml").table()


def line(*faults: dict[str, Any]) -> dict[str, Any]:
    plcs = []
    for number, place in enumerate(PLACES):
        link: dict[str, Any] = {"bus": "link", "port": "COM4", "station": number}
        if not number:
            link |= {"slaves": 3, "mode": 0, "retries": 0, "timeout": "50 ms"}
        plcs.append({"name": place, "profile": "pw10", "scan": "9 ms", "nn": link})
    buses = [{"name": "link", "nn": True}]
    return {
        "schema": 1,
        "name": "lamps",
        "duration": "3 s",
        "buses": buses,
        "plcs": plcs,
        "faults": [*faults],
    }


@pytest.mark.parametrize(
    ("fault", "sd", "rd"),
    [
        ({"at": "1 s", "cable_cut": {"bus": "link", "after": "feeder"}}, "press feeder", "press feeder"),
        ({"at": "1 s", "for": "1 s", "cable_cut": {"bus": "link", "after": "feeder"}}, "all", "all"),
        ({"wrong_format": {"station": "saw", "baud": 9600}}, "press feeder lift", "all"),
        ({"at": "1 s", "power_off": "saw"}, "press feeder lift", "press feeder lift"),
        ({"at": "1 s", "stop": "saw"}, "press feeder lift", "all"),
        ({"at": "1 s", "stop": "press"}, "", ""),
    ],
)
def test_lamps_flicker_where_there_are_signals(fault: dict[str, Any], sd: str, rd: str) -> None:
    scenario = bussim.loads(dumped(line(fault)))
    totals = bussim.run(scenario, rows=False).totals
    assert totals is not None
    stations = readout_data(scenario, totals, as_seen=True)["stations"]
    for lamp, expected in (("SD", sd), ("RD", rd)):
        lit = [station["place"] for station in stations if station["lamps"][lamp] == "flickers"]
        assert lit == (list(PLACES) if expected == "all" else expected.split()), lamp
