"""``bussim new``."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from bussim.cli import main
from bussim.commands.new import new_scenario
from bussim.commands.size.uniform_link import uniform_link
from bussim.plc.profiles import PROFILES
from bussim.scenario.loader import loads


@pytest.mark.parametrize("profile", PROFILES)
def test_the_text_is_the_link_of_the_options_and_nothing_is_odd_about_it(profile: str) -> None:
    for stations in (2, 8):
        for mode in PROFILES[profile].modes:
            made = loads(new_scenario(stations, mode, profile=profile, scan="8ms", ber=1.25e-6))
            asked = uniform_link(stations, mode, profile=profile, scan="8 ms", ber=1.25e-6)
            assert all("refresh mode" in warning for warning in made.warnings)  # 3 and 4 of a PW10
            assert not made.warnings or mode not in PROFILES[profile].documented_modes
            assert [noise.kind for noise in made.noise] == [noise.kind for noise in asked.noise]
            for plc, like in zip(made.plcs, asked.plcs, strict=True):
                there = {key: value for key, value in like.registers.items() if key != "M8179"}
                assert there.items() <= plc.registers.items()
                assert plc.link is not None
                assert like.link is not None
                assert replace(plc, link=like.link, registers=like.registers, origins={}) == replace(
                    like, origins={}
                )
                assert plc.link.port in PROFILES[profile].board_ports


def test_what_it_shows_in_comments_can_be_used() -> None:
    text = new_scenario(3, 0)
    plain, used = loads(text), loads(re.sub(r"(?m)^# (?=noise:|faults:|  - )", "", text))
    assert (len(plain.noise), len(plain.faults), len(used.noise), len(used.faults)) == (0, 0, 1, 1)


def test_it_is_written_once_and_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["new", "--stations", "5", "--mode", "2", "--scan", "8ms", "-o", "my_line.yaml"]) == 0
    assert capsys.readouterr().out == "my_line.yaml\n"
    text = Path("my_line.yaml").read_text(encoding="utf-8")
    comments = {line.index(" # ") for line in text.splitlines() if re.match(r"[^#]+ # ", line)}
    assert comments == {27}  # one below the other
    assert main(["check", "my_line.yaml"]) == 0
    assert main(["run", "my_line.yaml", "--duration", "1s", "--no-rows", "--no-plots", "--out", "out"]) == 0
    assert main(["new", "-o", "my_line.yaml"]) == 2
    assert "my_line.yaml exists" in capsys.readouterr().err
    assert Path("my_line.yaml").read_text(encoding="utf-8") == text
    assert main(["new", "-o", "my_line.yaml", "--force"]) == 0
    capsys.readouterr()
    assert main(["new"]) == 0
    assert capsys.readouterr().out == Path("my_line.yaml").read_text(encoding="utf-8") == new_scenario(4, 0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--stations", "9"], "--stations is 9, allowed 2..8 with the master"),
        (["--mode", "3", "--profile", "fx2n"], "--mode is 3, allowed 0..2 in profile fx2n"),
        (["--profile", "pw1"], "--profile is 'pw1'; did you mean pw10?"),
        (["--scan", "8"], "--scan is 8, a time without a unit"),
        (["--ber", "2"], "--ber is 2, allowed 0..1"),
        (["--force"], "--force goes with --out"),
    ],
)
def test_an_option_out_of_range_is_named(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["new", *arguments]) == 2
    assert message in capsys.readouterr().err
