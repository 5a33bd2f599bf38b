"""Names of devices: from the scenario, from the exports of programming tools, and where they are shown."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import bussim
from bussim.cli import main
from bussim.scenario.loader import examine, load

TEXT = """\
schema: 1
name: named
duration: 1 s
plcs:
  - name: p
    profile: fx3u
    scan: 10 ms
    inputs: {X0: {square: 400 ms}}
    comments: names.csv
    program: |
      LD X0
      OUT T5 K1
      LD T5
      OUT M7500
      MOV K1 D8500
      END
latency: [{from: p.X0, to: p.M7500, edge: rising}]
"""
NAMES = {"X0": "门关", "T5": "ドア タイマ", "M7500": "release", "D8500": "spare", "R7": "recipe"}
#: Exports of device comments: GX Works2 in UTF-16 with tabs, GX Developer in code pages with commas.
EXPORTS = {
    "GX Works2": ("utf-16", "\t", ("Device Name", "Comment"), "X000"),
    "GX Works2, Chinese": ("utf-16", "\t", ("软元件名", "注释"), "X000"),
    "GX Developer": ("gbk", ",", ("Device", "Label", "Comment"), "X0"),
    "GX Developer, Japanese": ("cp932", ",", ("デバイス名", "コメント"), "X000"),
}


def written(folder: Path, text: str = TEXT, *, export: str = "GX Works2") -> str:
    coding, delimiter, head, first = EXPORTS[export]
    names = (
        {**NAMES, "X0": "戸閉"}
        if coding == "cp932"
        else {**NAMES, "T5": "门定时"}
        if coding == "gbk"
        else NAMES
    )
    blanks = [""] * (len(head) - 2)
    rows = [head, *([first if name == "X0" else name, *blanks, said] for name, said in names.items())]
    lines = [delimiter.join(f'"{cell}"' for cell in row) for row in rows]
    (folder / "names.csv").write_bytes("\r\n".join([*lines, ""]).encode(coding))
    (folder / "s.yaml").write_text(text, encoding="utf-8")
    return str(folder / "s.yaml")


def test_the_heading_says_which_column_has_the_devices(tmp_path: Path) -> None:
    path = Path(written(tmp_path))
    rows = ["No,Comment,Device", "1,release,M7500", "2,door,X0", ""]
    (tmp_path / "names.csv").write_text("\n".join(rows))
    assert load(path).plcs[0].comments == {"M7500": "release", "X0": "door"}


def test_a_file_without_a_comment_of_these_devices_is_warned_of(tmp_path: Path) -> None:
    path = Path(written(tmp_path))
    (tmp_path / "names.csv").write_text("Device,Comment\nQ4,other\n")
    loaded = load(path)
    assert loaded.plcs[0].comments == {}
    assert any("has no comment of a device that this PLC has" in each for each in loaded.warnings)


@pytest.mark.parametrize("export", EXPORTS)
def test_an_export_of_any_tool_names_devices(tmp_path: Path, export: str) -> None:
    (plc,) = load(written(tmp_path, export=export)).plcs
    assert list(plc.comments) == list(NAMES)
    assert {plc.comments["M7500"], plc.comments["R7"]} == {"release", "recipe"}
    assert plc.comments["X0"] in ("门关", "戸閉")
    assert plc.comment("TN5") == plc.comment("T5") != ""
    assert plc.comment("TN6") == plc.comment("D0") == ""


def test_the_scenario_s_own_come_before_those_of_its_file(tmp_path: Path) -> None:
    text = TEXT.replace("comments: names.csv", "comments: {file: names.csv, x000: stop, D0: count}")
    (plc,) = load(written(tmp_path, text)).plcs
    assert plc.comments == {**NAMES, "X0": "stop", "D0": "count"}
    alone = TEXT.replace("comments: names.csv", "comments: {Y0: lamp}")
    assert load(written(tmp_path, alone)).plcs[0].comments == {"Y0": "lamp"}


def test_those_of_devices_that_a_plc_lacks_are_passed_over(tmp_path: Path) -> None:
    text = TEXT.replace("fx3u", "fx2n").replace("M7500", "M500").replace("D8500", "D500")
    name = written(tmp_path, text)
    (tmp_path / "names.csv").write_text("Device\tComment\nR7\trecipe\nZ1\toffset\nM500\trelease\nX9\tno\n")
    assert load(name).plcs[0].comments == {"Z1": "offset", "M500": "release"}
    assert main(["run", name, "--out", str(tmp_path / "run")]) == 0
    assert load(str(tmp_path / "run" / "scenario.yaml")).plcs[0].comments == {
        "Z1": "offset",
        "M500": "release",
    }


def test_mistakes_are_named_all_at_once(tmp_path: Path) -> None:
    text = TEXT.replace("comments: names.csv", 'comments: {file: name.csv, Q4: a, M1: ""}')
    found = [str(problem) for problem in examine(written(tmp_path, text)).errors]
    assert len(found) == 3
    assert "did you mean names.csv?" in "".join(found)
    assert "a device of comments is 'Q4'" in "".join(found)
    assert "comments.M1 is ''" in "".join(found)
    text = TEXT.replace("comments: names.csv", "comments: s.yaml")
    (problem,) = examine(written(tmp_path, text)).errors
    assert problem.message == "comments is s.yaml, an instruction list, and no device comments"
    text = TEXT.replace("program: |", "program: names.csv").partition("      LD X0")[0]
    (problem,) = examine(written(tmp_path, text)).errors
    assert "it goes to comments: names.csv" in problem.message


def test_more_than_a_scenario_holds_are_cut_with_a_warning(tmp_path: Path) -> None:
    name = written(tmp_path)
    rows = [f"D{number}\tword {number}" for number in range(2001)]
    (tmp_path / "names.csv").write_text("\n".join(["Device Name\tComment", *rows]), encoding="utf-8")
    found = examine(name)
    assert found.scenario is not None
    assert len(found.scenario.plcs[0].comments) == 2000
    assert any("more than 2000 devices" in warning.message for warning in found.warnings)


def test_where_they_are_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name = written(tmp_path)
    assert main(["watch", name, "--devices", "p.X0,p.TN5,p.D0", "--to-time", "300ms"]) == 0
    heads = capsys.readouterr().out.splitlines()[:2]
    assert heads[0].split() == ["p.X0", "p.TN5"]
    assert heads[1].split() == ["time", "(s)", "门关", "ドア", "タイマ", "p.D0"]
    assert main(["watch", name, "--devices", "p.M7500,p.D0", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["devices"]
    assert found["p.M7500"]["comment"] == "release"
    assert "comment" not in found["p.D0"]
    assert main(["run", name, "--out", str(tmp_path / "run")]) == 0
    assert "p.X0 (门关) to p.M7500 (release), rising edge" in capsys.readouterr().out
    again = load(str(tmp_path / "run" / "scenario.yaml"))
    assert again.plcs[0].comments == NAMES
    assert main(["report", str(tmp_path / "run")]) == 0
    assert "p.X0 (门关) to p.M7500 (release)" in (tmp_path / "run" / "report.html").read_text(
        encoding="utf-8"
    )


def test_warnings_of_programs_show_them(tmp_path: Path) -> None:
    text = TEXT.replace("MOV K1 D8500", "LD M8002\n      MOV K1 D8176").replace(
        "comments: names.csv", "comments: {D8176: our number}"
    )
    found = [warning.message for warning in examine(written(tmp_path, text)).warnings]
    assert any("MOV writes D8176 (our number), but not under M8038" in message for message in found)


def test_names_come_with_a_run(tmp_path: Path) -> None:
    result = bussim.run(load(written(tmp_path)))
    (entry,) = result.summary["latency"].values()
    assert entry["comments"] == {"p.X0": "门关", "p.M7500": "release"}
