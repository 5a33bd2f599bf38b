"""On a Dask cluster: the same results, with a worker and the sweep itself killed in the middle."""

from __future__ import annotations

import os
import signal
import socket
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from bussim.errors import RunError, UsageError
from bussim.sweep import executors, plots
from bussim.sweep.folder import JOURNAL
from bussim.sweep.run import sweep as run_sweep
from tests.sweep.samples import REPEAT, RETRIES, VARY, contents, noisy
from tests.sweep.test_run import arguments, killed_after

distributed = pytest.importorskip("distributed")

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there is no SIGKILL")


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Two worker processes of one thread each."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50
    ) as running:
        yield running


@pytest.fixture(autouse=True)
def _no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plots, "draw", lambda *_: [])


def worker_processes(cluster: Any) -> dict[str, int]:
    with distributed.Client(cluster.scheduler_address, set_as_default=False) as client:
        client.wait_for_workers(2)
        found: dict[str, int] = client.run(os.getpid)
        return found


@pytest.mark.slow
def test_a_worker_and_the_sweep_killed_in_the_middle_change_nothing(
    cluster: Any, undisturbed: tuple[Path, dict[str, bytes]], tmp_path: Path
) -> None:
    scenario, wanted = undisturbed
    out, address = tmp_path / "out", cluster.scheduler_address
    for killed in (40, 40):
        killed_after(killed, *arguments(scenario, out, "--scheduler", address))
    assert (tmp_path / "out.incomplete" / JOURNAL).read_bytes().count(b"\n") == 2 * 39
    before = worker_processes(cluster)
    assert len(before) == 2
    victims = [next(iter(before.values()))]

    def progress(what: str, done: int, _: int) -> None:
        if what == "running" and done == 120:
            os.kill(victims.pop(), signal.SIGKILL)

    result = run_sweep(scenario, VARY, out=out, repeat=REPEAT, scheduler=address, progress=progress)
    assert victims == []
    assert worker_processes(cluster) != before
    assert result.already_there == 2 * 39
    assert contents(out) == {name: data for name, data in wanted.items() if "sweep_" not in name}


@pytest.mark.slow
def test_workers_that_die_again_and_again_are_reported(
    cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(*_: object) -> Iterator[Any]:
        raise distributed.KilledWorker("task", None, 3)
        yield

    monkeypatch.setattr(executors.DaskExecutor, "_outcomes", killed)
    with pytest.raises(RunError, match="died again and again; kept: 0 of 2 runs"):
        run_sweep(
            noisy(tmp_path), [f"{RETRIES}=0,1"], out=tmp_path / "out", scheduler=cluster.scheduler_address
        )


@pytest.mark.slow
def test_what_goes_wrong_on_the_cluster_is_reported(
    cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(executors, "run_job", _missing)
    with pytest.raises(RunError, match=r"tcp://.* failed: ModuleNotFoundError: No module named 'bussim'"):
        run_sweep(
            noisy(tmp_path), [f"{RETRIES}=0,1"], out=tmp_path / "out", scheduler=cluster.scheduler_address
        )


def _missing(_: object) -> None:
    raise ModuleNotFoundError("No module named 'bussim'")


def test_a_scheduler_without_workers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "_WORKER_SECONDS", 0.2)
    with (
        distributed.LocalCluster(n_workers=0, dashboard_address=":0", silence_logs=50) as empty,
        pytest.raises(
            RunError, match=r"the scheduler tcp://.* has no workers; start one with dask worker tcp://"
        ),
    ):
        run_sweep(
            noisy(tmp_path), [f"{RETRIES}=0,1"], out=tmp_path / "out", scheduler=empty.scheduler_address
        )
    assert not list(tmp_path.glob("out*"))


def test_where_no_scheduler_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "_CONNECT_SECONDS", 0.3)
    scenario = noisy(tmp_path)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        for address, message in (
            (f"tcp://127.0.0.1:{silent.getsockname()[1]}", r"no Dask scheduler responds there \("),
            ("tcp://127.0.0.1:1", r"no Dask scheduler responds there \("),
            ("127.0.0.1:8786", "expected an address such as tcp://"),
            ("tcp://127.0.0.1", "expected an address such as tcp://"),
        ):
            with pytest.raises(UsageError, match=message):
                run_sweep(scenario, [f"{RETRIES}=0,1"], out=tmp_path / "out", scheduler=address)
    assert list(tmp_path.iterdir()) == [scenario]


def test_without_dask_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(
        UsageError, match=r"install bussim with the extra dask \(pip install 'bussim\[dask\]'\)"
    ):
        run_sweep(noisy(tmp_path), [f"{RETRIES}=0,1"], out=tmp_path / "out", scheduler="tcp://127.0.0.1:1")
