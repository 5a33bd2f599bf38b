"""Folders and files with names that are no text here, as those that were unpacked from a Chinese Windows."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from bussim.cli import main
from tests.undrawn import undrawn

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="elsewhere every name is a text"),
]

GBK = os.fsdecode("测试".encode("gbk"))
SHOWN = "\\udcb2\\udce2\\udcca\\udcd4"


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("names") / GBK
    with undrawn():
        assert (
            main(["run", "press_line", "--duration", "1s", "--trace", "--no-plots", "-o", str(folder)]) == 0
        )
    return folder


def test_a_report_shows_the_name_in_escapes(run: Path, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    assert main(["report", str(run), "--no-exact", "-o", str(page)]) == 0
    assert SHOWN in page.read_text(encoding="utf-8")


def test_a_fitted_scenario_is_named_by_it(run: Path, tmp_path: Path) -> None:
    fitted = tmp_path / "fitted.yaml"
    assert main(["fit", str(run), "--simulate", "0 s", "-o", str(fitted)]) == 0
    assert f"fitted to {SHOWN}" in fitted.read_text(encoding="utf-8").replace("\\\\", "\\")
    assert main(["check", str(fitted)]) == 0


def test_several_runs_are_drawn_and_a_sweep_is_written(run: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    assert main(["run", "press_line", "--duration", "2s", "--no-plots", "-o", str(other)]) == 0
    assert main(["plot", str(run), str(other), "--out", str(tmp_path / "plots")]) == 0
    vary = ["--vary", "plcs.press1.nn.retries=0,1", "--duration", "1s", "--workers", "1"]
    assert main(["sweep", "press_line", *vary, "--out", str(run.with_name(f"s{GBK}"))]) == 0
