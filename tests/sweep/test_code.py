"""A sweep of a scenario that names functions of the user: with permission, in whatever process runs it."""

from __future__ import annotations

import csv
import pickle
import sys
from pathlib import Path

import pytest

from bussim.cli import main
from bussim.errors import ScenarioError
from bussim.sweep.jobs import run_job
from bussim.sweep.plan import Plan
from tests.selection import quick

# The function raises where it is asked: what comes of a poll shows whether the very function ran.
TEXT = """\
schema: 1
name: sensors
duration: 1 s
buses: [{name: line, baud: 9600}]
plcs: []
devices:
  - {name: sensor, model: map, bus: line, station: 2, registers: [{address: 0, call: 'MODULE:level'}]}
  - name: panel
    model: hmi
    bus: line
    polls: [{station: 2, function: 3, address: 0, every: 100 ms}]
"""
FAILS = "def level(tick):\n    raise ValueError\n"
WORKS = "def level(tick):\n    return tick // 72_000_000\n"
VARY = "devices.panel.interval=5 ms,10 ms"


def scenario(folder: Path, module: str, code: str) -> Path:
    """The scenario, whose function lies beside it in a module that no other test has."""
    (folder / f"{module}.py").write_text(code, encoding="utf-8")
    path = folder / "x.yaml"
    path.write_text(TEXT.replace("MODULE", module), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("module", "code", "fails"), quick(1, (("sweep_bad", FAILS, 10), ("sweep_good", WORKS, 0)))
)
def test_workers_run_the_function(
    module: str, code: str, fails: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "else").mkdir()
    monkeypatch.chdir(tmp_path / "else")
    path = scenario(tmp_path, module, code)
    asked = ["sweep", str(path), "--vary", VARY, "--repeat", "2", "--workers", "2", "--out", "swept"]
    assert main([*asked, "--allow-code"]) == 0
    with Path("swept/runs.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 4
    # Ten polls in a second, one each 100 ms; the response to each is an exception where the function fails.
    assert [int(row["panel.ok"]) for row in rows] == [10 - fails] * 4


def test_without_permission_nothing_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    path = scenario(tmp_path, "sweep_refused", WORKS)
    assert main(["sweep", str(path), "--vary", VARY, "--out", "swept"]) == 2
    assert "that takes --allow-code" in capsys.readouterr().err
    assert "sweep_refused" not in sys.modules
    assert not Path("swept").exists()


def test_a_job_takes_the_permission_along(tmp_path: Path) -> None:
    path = scenario(tmp_path, "sweep_job", WORKS)
    with pytest.raises(ScenarioError, match="--allow-code"):
        Plan(path, [VARY])
    job = pickle.loads(pickle.dumps(Plan(path, [VARY], allow_code=True).job(0)))  # noqa: S301 - just written
    sys.modules.pop("sweep_job")
    assert run_job(job).error == ""
    sys.modules.pop("sweep_job")
    assert "--allow-code" in run_job(job.__class__(0, job.text, job.name, job.overrides, 1)).error


def test_another_function_is_another_sweep(tmp_path: Path) -> None:
    path = scenario(tmp_path, "sweep_other", WORKS)
    before = Plan(path, [VARY], allow_code=True).manifest()
    assert Plan(path, [VARY], allow_code=True).manifest() == before
    sys.modules.pop("sweep_other")
    scenario(tmp_path, "sweep_other", WORKS + "# changed\n")
    assert Plan(path, [VARY], allow_code=True).manifest()["source"] != before["source"]
