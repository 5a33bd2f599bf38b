"""A sweep of a scenario whose programs and tables are files: its jobs carry them along."""

from __future__ import annotations

import pickle
from pathlib import Path

import pytest

from bussim.errors import ScenarioError
from bussim.sweep.jobs import run_job
from bussim.sweep.plan import Plan

TEXT = """\
schema: 1
name: files
duration: 1 s
buses: [{name: link, nn: true}]
plcs:
  - name: one
    ports: {COM4: {bus: link}}
    program: one.il
    inputs: {X0: {csv: edges.csv}}
  - {name: two, nn: {bus: link, port: COM4, station: 1}}
"""
PROGRAM = "LD M8002\nMOV K0 D8176\nMOV K1 D8177\nMOV K5 D8180\nSET M8179\nLD X0\nOUT M1000\nEND\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "x.yaml").write_text(TEXT, encoding="utf-8")
    (tmp_path / "one.il").write_text(PROGRAM, encoding="utf-8")
    (tmp_path / "edges.csv").write_text("0.5\n", encoding="utf-8")
    return tmp_path


def test_a_job_needs_no_file(folder: Path) -> None:
    plan = Plan(folder / "x.yaml", ["plcs.one.scan=5 ms,10 ms"], repeat=2)
    assert dict(plan.job(0).files) == {"one.il": PROGRAM, "edges.csv": "0.5\n"}
    jobs = pickle.loads(pickle.dumps([plan.job(run) for run in range(plan.runs)]))  # noqa: S301 - just written
    for name in ("one.il", "edges.csv", "x.yaml"):
        (folder / name).unlink()
    for job in jobs:
        outcome = run_job(job)
        assert outcome.error == ""
        assert outcome.figures


def test_another_program_is_another_sweep(folder: Path) -> None:
    before = Plan(folder / "x.yaml", ["plcs.one.scan=5 ms,10 ms"]).manifest()
    assert Plan(folder / "x.yaml", ["plcs.one.scan=5 ms,10 ms"]).manifest() == before
    (folder / "one.il").write_text(PROGRAM.replace("OUT M1000", "OUT M1001"), encoding="utf-8")
    assert Plan(folder / "x.yaml", ["plcs.one.scan=5 ms,10 ms"]).manifest() != before


def test_a_mistake_in_the_file_stops_the_sweep(folder: Path) -> None:
    (folder / "one.il").write_text("LDD X0\nEND\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"one\.il:1:1"):
        Plan(folder / "x.yaml", ["plcs.one.scan=5 ms,10 ms"])
