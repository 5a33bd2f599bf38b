from __future__ import annotations

from pathlib import Path

import pytest

from bussim.sweep.run import sweep as run_sweep
from tests.sweep.samples import REPEAT, VARY, contents, noisy


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, bytes]]:
    """A scenario, and the files of the whole sweep over it by a single process."""
    folder = tmp_path_factory.mktemp("undisturbed")
    scenario = noisy(folder)
    result = run_sweep(scenario, VARY, out=folder / "out", repeat=REPEAT, workers=1)
    assert result.already_there == 0
    return scenario, contents(result.folder)
