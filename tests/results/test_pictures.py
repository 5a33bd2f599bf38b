"""The pictures of a run's folder."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import bussim
from bussim.errors import UsageError
from bussim.results.pictures import draw_run
from bussim.units import TICKS_PER_SECOND
from tests.results.fakes import quiet

ENVIRONMENT = {"PYTHONPATH": str(Path(__file__).parents[2])}

pytestmark = pytest.mark.usefixtures("pictures_undrawn")


def test_a_bus_with_an_odd_name(tmp_path: Path) -> None:
    drawn = draw_run(quiet(duration=3 * TICKS_PER_SECOND, bus="a/b: 1").run(), tmp_path)
    assert drawn == [tmp_path / "scan_time_a_b_1.png"]
    assert {path.name for path in tmp_path.iterdir()} == {"scan_time_a_b_1.png", "scan_time_a_b_1.svg"}


def test_a_link_without_scans_has_no_picture(tmp_path: Path) -> None:
    assert draw_run(quiet(duration=10).run(), tmp_path) == []
    assert not [*tmp_path.iterdir()]


def test_a_run_from_python_draws_when_it_is_asked(tmp_path: Path) -> None:
    scenario = bussim.load("two_stations", ["duration=1 s"])
    with pytest.raises(UsageError, match="has no folder for pictures; run it with out="):
        bussim.run(scenario).save_plots()
    result = bussim.run(scenario, out=tmp_path / "run")
    assert not [*(tmp_path / "run").glob("*.png")]
    assert result.save_plots() == [tmp_path / "run" / "scan_time_link.png"]


def test_without_pictures_and_programs_nothing_for_them_is_imported(tmp_path: Path) -> None:
    code = (
        "import sys; from bussim.cli import main; code = main(['run', 'two_stations', '--duration', '1s',"
        "'--no-plots', '--out', 'o']); sys.exit(code or 3 * bool({'matplotlib', 'bussim.plc.program.text', "
        "'bussim.plc.program.program'} & sys.modules.keys()))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=ENVIRONMENT, check=False)
    assert done.returncode == 0
    assert {path.name for path in (tmp_path / "o").iterdir()} == {
        "summary.json", "histograms.json", "scenario.yaml", "link_scans.csv"
    }  # fmt: skip


def test_a_command_draws_without_the_lists_in_the_docstrings_of_matplotlib() -> None:
    code = (
        "from bussim.commands.common.drawing import import_matplotlib; import_matplotlib()\n"
        "from matplotlib.artist import kwdoc; from matplotlib.axes import Axes\n"
        "assert 'xlabel' in kwdoc(Axes) and 'xlabel' not in Axes.set.__doc__, Axes.set.__doc__"
    )
    subprocess.run([sys.executable, "-c", code], env=ENVIRONMENT, check=True)


@pytest.mark.slow
def test_a_report_from_python_leaves_the_docstrings_of_matplotlib_whole(tmp_path: Path) -> None:
    code = (
        "import bussim; bussim.run(bussim.load('two_stations', ['duration=1 s']), out='o')\n"
        "bussim.report('o', exact=False)\n"
        "from matplotlib.axes import Axes; assert 'xlabel' in Axes.set.__doc__, Axes.set.__doc__"
    )
    subprocess.run([sys.executable, "-c", code], env=ENVIRONMENT, cwd=tmp_path, check=True)
