"""Texts about a run name the devices of each station's own family."""

from __future__ import annotations

import html
import io
import re

import pytest
from rich.console import Console

import bussim
from bussim.report.page import report_page
from bussim.report.runs import Source
from bussim.results.result import Result
from bussim.results.text.run import show_result
from bussim.scenario.loader import loads

SCENARIO = """
schema: 1
name: families
duration: 1 s
seed: 1
buses: [{name: link, nn: true}]
plcs:
  - {name: a, profile: FIRST, scan: 5 ms, nn: {bus: link, port: COM3, station: 0, slaves: 2, timeout: 50 ms}}
  - {name: b, profile: SECOND, scan: 5 ms, nn: {bus: link, port: COM3, station: 1}}
  - {name: c, profile: SECOND, scan: 5 ms, nn: {bus: link, port: COM3, station: 2}}
noise: [{bus: link, ber: 1.0e-3}]
faults:
  - {at: 200 ms, for: 300 ms, power_off: b}
  - {at: 600 ms, for: 300 ms, stop: a}
"""
COMMON = re.compile(r"D82[01][0-9]|M81(?:8[3-9]|9[01])")
OWN = re.compile(r"\bD2[01][0-9]\b|\bM5(?:0[3-9]|1[01])\b")


def run(first: str, second: str) -> Result:
    return bussim.run(loads(SCENARIO.replace("FIRST", first).replace("SECOND", second)), rows=False)


def texts(result: Result) -> str:
    output = io.StringIO()
    show_result(Console(file=output, width=120), result.record, {})
    page = html.unescape(report_page([Source("run", "run", result.record, "schema: 1\n")]))
    return output.getvalue() + re.sub(r' data-path="[^"]*"', "", page)


@pytest.mark.parametrize(("family", "wrong", "right"), [("fx1s", COMMON, OWN), ("fx2n", OWN, COMMON)])
def test_a_link_of_one_family_has_its_names(
    family: str, wrong: re.Pattern[str], right: re.Pattern[str]
) -> None:
    text = texts(run(family, family))
    assert not wrong.findall(text)
    assert len(right.findall(text)) > 10
    assert "LD M8038" in text
    assert "M8002" not in text


def test_a_link_of_two_families_has_the_names_of_each_station() -> None:
    result = run("fx2n", "fx1s")
    text = texts(result)
    lost = next(item["text"] for item in result.summary["verdict"] if item["key"] == "master_lost")
    assert "in each D211 = 11H and D203 counted, M504 on" in lost
    assert "D8201/D8202      a " in text
    assert "D201/D202        b " in text
    assert result.summary["plcs"]["b"]["own_names"]["M8191"] == "M503"
    assert "own_names" not in result.summary["plcs"]["a"]


def test_the_second_channel_of_an_fx3u_has_errors_of_its_own() -> None:
    text = SCENARIO.replace("FIRST", "fx3u").replace("SECOND", "fx3u").replace("COM3", "COM4")
    raw = "registers: {D8176: 9, M8179: 1}, ports: {COM4: {bus: link}}"
    text = text.replace("nn: {bus: link, port: COM4, station: 1}", raw)
    result = bussim.run(loads(text), rows=False)
    (refused,) = (item["text"] for item in result.summary["verdict"] if item["key"] == "settings_refused")
    assert "M8438 is on, D8438 = 38" in refused
