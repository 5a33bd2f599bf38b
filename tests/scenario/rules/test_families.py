"""What a PLC's family or firmware lacks, and special devices that do nothing there."""

from __future__ import annotations

from pathlib import Path

import pytest

from bussim.scenario.loader import examine


def test_special_devices_of_a_plc_without_a_program_are_warned_of(tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    path.write_text(
        "schema: 1\nname: x\nduration: 1 s\nplcs:\n  - name: p\n"
        "    registers: {D8120: 129, M8034: 1, D8013: 5, D8121: 2, D100: 3, M8160: 0}\n"
    )
    nothing = "it changes nothing, and nothing drives it"
    assert [(each.column, each.message) for each in examine(path).warnings] == [
        (17, f"p: D8120 is for RS, which no program of the PLC has: {nothing}"),
        (29, f"p: M8034, which switches all outputs off, is not simulated: {nothing}"),
    ]


@pytest.mark.parametrize(
    ("profile", "lacks"),
    [
        ("pw10", ""),
        ("{base: pw10, firmware: [25009, 16003]}", "pw10 with 25009, 16003"),
        ("{base: pw10, firmware: [25010, 16002]}", "pw10 with 25010, 16002"),
        ("{base: fx3u, firmware: [26000, 17000]}", "fx3u with 26000, 17000"),
        ("fx1s", "fx1s with 22300, 0"),
    ],
)
def test_cpavl_and_rs2_are_a_pw10s(tmp_path: Path, profile: str, lacks: str) -> None:
    text = (
        f"schema: 1\nname: x\nduration: 1 s\nbuses: [{{name: b}}]\nplcs:\n  - name: p\n    profile: {profile}\n"
        "    ports: {COM3: {bus: b}}\n    program: |\n      LD M8000\n      CPAVL D100 M100 K3\n"
        "      RS2 D0 K1 D9 K1 K3\n      RS2 D0 K1 D9 K1 K3\n      END\n"
    )
    path = tmp_path / "x.yaml"
    path.write_text(text)
    found = [
        each.message for each in examine(path).warnings if "have" in each.message or "lacks" in each.message
    ]
    assert found == [
        f"p: a PW10 has {name} for COM2–COM6 from firmware 25010, 16003 on (D8001, D8101); profile {lacks} lacks it: "
        "it is simulated as if it were there"
        for name in ("CPAVL", "RS2")
        if lacks
    ]
