"""Simulate PLCs that share an RS485 wire: link scan times, retries, timeouts, dead stations.

::

    import bussim

    result = bussim.run("press_line")
    result.summary["links"]
    result.plot_scan_times()

What is exported here is imported when it is first used, so that ``import bussim`` costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from bussim.version import __version__

if TYPE_CHECKING:
    from bussim.api import Result, load, open_run, run
    from bussim.errors import BussimError, RunError, ScenarioError, UsageError
    from bussim.scenario.model import Scenario

__all__ = [
    "BussimError",
    "Result",
    "RunError",
    "Scenario",
    "ScenarioError",
    "UsageError",
    "__version__",
    "load",
    "open_run",
    "run",
]

_HOMES = {
    "bussim.api": ("Result", "load", "open_run", "run"),
    "bussim.errors": ("BussimError", "RunError", "ScenarioError", "UsageError"),
    "bussim.scenario.model": ("Scenario",),
}


def __getattr__(name: str) -> Any:
    home = next((module for module, names in _HOMES.items() if name in names), None)
    if home is None:
        raise AttributeError(f"module 'bussim' has no attribute {name!r}")
    value = getattr(import_module(home), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
