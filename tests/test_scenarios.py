"""Every built-in scenario against its recorded summary.

After a change that is meant to change results, record them anew with ``python -m tests.test_scenarios``
and read the difference before committing it.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import bussim
from bussim.scenario import builtin
from tests.selection import quick_names

RECORDED = Path(__file__).parent / "recorded"
#: The kinds of line that a user must find among the built-in scenarios.
WANTED = {
    "two_stations",
    "late_power_up",
    "eight_stations_mode0",
    "eight_stations_mode1",
    "eight_stations_mode2",
    "eight_stations_mode3",
    "eight_stations_mode4",
    "dead_from_start",
    "drops_out_and_rejoins",
    "electrical_noise",
    "drive_impulses",
    "bursts",
    "same_number_twice",
    "cable_cut",
    "slow_slave_short_timeout",
    "wrong_parity",
    "bad_parameter",
}
#: What takes longest to simulate: in the slow pass.
LONG = {
    "bursts",
    "counter_preset",
    "drive_impulses",
    "electrical_noise",
    "feeder_off",
    "interlock",
    "nn_with_modbus",
    "registers_on_site",
    "same_number_twice",
    "slow_slave_short_timeout",
    "two_masters",
}


def summary_text(name: str) -> str:
    summary = dict(bussim.run(name, rows=False).summary)
    del summary["bussim"]  # the version may go on while the results stay
    del summary["rests_on"]  # of the scenario, not of the run
    return json.dumps(summary, indent=1, ensure_ascii=False) + "\n"


def test_nothing_is_missing() -> None:
    assert set(builtin.names()) >= WANTED
    assert {path.stem for path in RECORDED.glob("*.json")} == set(builtin.names())


@pytest.mark.parametrize("name", quick_names(set(builtin.names()) - LONG, builtin.names()))
def test_summary(name: str) -> None:
    assert summary_text(name) == (RECORDED / f"{name}.json").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", builtin.names())
def test_scenario_says_what_to_look_at(name: str) -> None:
    comments = [line for line in builtin.read(name).splitlines() if line.startswith("#")]
    assert any("Look at" in line for line in comments)


if __name__ == "__main__":
    RECORDED.mkdir(exist_ok=True)
    for scenario in builtin.names():
        (RECORDED / f"{scenario}.json").write_text(summary_text(scenario), encoding="utf-8")
