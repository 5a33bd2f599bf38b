"""What ``bussim`` exports is a promise: its signatures are recorded, so that a change is a decision.

Record them anew with ``python -m tests.test_public``, and write the change into CHANGELOG.md.
"""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import pandas as pd
import pytest

import bussim
from bussim.exact.metrics import figures_of
from bussim.sweep import run as sweep_module

RECORDED = Path(__file__).parent / "recorded_signatures.txt"


def signatures() -> str:
    """A line for each exported function, and for each public method of an exported class."""
    lines = []
    for name in bussim.__all__:
        value = getattr(bussim, name)
        if isinstance(value, type):
            if issubclass(value, Exception):
                lines.append(f"{name}({value.__base__.__name__})")  # type: ignore[union-attr]
                continue
            lines += [
                f"{name}.{key}{inspect.signature(member) if callable(member) else ''}"
                for key, member in sorted(vars(value).items())
                if not key.startswith("_")
            ]
        elif callable(value):
            lines.append(f"{name}{inspect.signature(value)}")
    return "".join(f"{line}\n" for line in lines)


def test_signatures_are_those_that_were_promised() -> None:
    assert signatures() == RECORDED.read_text("utf-8")


@pytest.mark.parametrize("name", [name for name in bussim.__all__ if not name.startswith("__")])
def test_each_is_documented(name: str) -> None:
    value = getattr(bussim, name)
    assert inspect.getdoc(getattr(value, "__wrapped__", value))


def test_a_function_and_a_folder_of_one_name_are_both_there() -> None:
    assert bussim.exact("two_stations", refresh=False).links["link"].valid
    assert inspect.ismodule(bussim.exact)
    assert figures_of.__module__ == "bussim.exact.metrics"
    assert bussim.sweep.run is sweep_module  # type: ignore[attr-defined]


def test_results_fit_into_a_line() -> None:
    """What a notebook shows of the last line of a cell; a field's whole content would be pages."""
    assert repr(bussim.exact("two_stations", refresh=False)) == (
        "<Exact of 'two stations': link: mean 34.200 ms, worst case 428.942 ms>"
    )
    said = repr(bussim.size("nn_with_modbus"))
    assert said.startswith(
        "<Sized of 'N:N with Modbus beside it': link: 4 retries, timeout 60 ms; press1.COM3: "
    )
    assert len(said) < 200


@pytest.mark.parametrize("name", ["exact", "report", "site", "sweep"])
def test_help_on_a_function_is_not_of_the_folder_of_its_name(name: str) -> None:
    called = getattr(bussim, name)
    assert inspect.getdoc(called) == inspect.getdoc(getattr(called, "__wrapped__", called))


def test_exact_is_what_the_command_prints(capsys: pytest.CaptureFixture[str]) -> None:
    import json

    for command, found in (
        ("exact", bussim.exact("feeder_off").to_dict()),
        ("size", bussim.size("feeder_off", ["dead<=2s"]).to_dict()),
    ):
        goals = ["--goal", "dead<=2s"] if command == "size" else []
        assert bussim.main([command, "feeder_off", "--json", *goals]) == 0
        assert json.loads(capsys.readouterr().out) == json.loads(json.dumps(found))


def test_tables_are_tables() -> None:
    sized = bussim.size("feeder_off")
    table = sized.table("press.COM5")
    assert isinstance(table, pd.DataFrame)
    assert {"timeout_ms", "retries", "failed_turns_per_year"} <= set(table)
    with pytest.raises(KeyError):
        sized.table("nothing")
    assert bussim.exact("two_stations", refresh=False).table().loc["link", "mean_ms"] > 0
    assert "D8179" in bussim.size("two_stations").table("link")


def test_what_is_no_goal_and_what_is_nothing_to_size() -> None:
    with pytest.raises(bussim.UsageError, match="whose goal 'ded'"):
        bussim.size("two_stations", ["ded<=1s"])
    with pytest.raises(bussim.UsageError, match="cycle is of Modbus poll lists"):
        bussim.size("two_stations", ["cycle<=1s"])


def test_a_timeline_of_a_run_and_a_page_of_its_folder(tmp_path: Path) -> None:
    result = bussim.run(bussim.load("two_stations", ["duration=1 s"]), out=tmp_path / "run", trace=True)
    assert bussim.timeline(result).axes
    assert bussim.timeline(tmp_path / "run", since="100 ms", span="50 ms").axes
    with pytest.raises(bussim.UsageError, match="since or span"):
        bussim.timeline(result, since="5")
    with pytest.raises(bussim.UsageError, match="beyond the end"):
        bussim.timeline(result, since="5 s")
    with pytest.raises(bussim.UsageError, match="has no bus 'x'"):
        bussim.timeline(result, bus="x")
    page = bussim.report(tmp_path / "run", exact=False)
    assert page == tmp_path / "run" / "report.html"
    assert page.read_text("utf-8").startswith("<!DOCTYPE html>")
    with pytest.raises(bussim.UsageError, match="exists"):
        bussim.report(tmp_path / "run", exact=False)
    with pytest.raises(bussim.UsageError, match="no run to report"):
        bussim.report()
    assert bussim.plot_scan_times({"one": result, "two": result.record}).axes
    with pytest.raises(bussim.UsageError, match="no run to draw"):
        bussim.plot_scan_times({})


def test_the_guide_has_each_of_them() -> None:
    page = (Path(bussim.__file__).parent / "guide" / "python.md").read_text("utf-8")
    functions = [name for name in bussim.__all__ if not name[0].isupper() and not name.startswith("_")]
    assert [name for name in functions if f"`bussim.{name}(" not in page] == []


@pytest.mark.slow
def test_the_examples_of_the_guide_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    page = (Path(bussim.__file__).parent / "guide" / "python.md").read_text("utf-8")
    examples = [
        code for code in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "def test_" not in code
    ]
    assert len(examples) > 4
    for code in examples:
        exec(compile(code, "python.md", "exec"), {"bussim": bussim})  # noqa: S102 - the guide's own


if __name__ == "__main__":
    RECORDED.write_text(signatures(), encoding="utf-8")
