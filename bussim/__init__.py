"""Simulate PLCs that share an RS485 wire: link scan times, retries, timeouts, dead stations.

::

    import bussim

    result = bussim.run("press_line")
    result.summary["links"]
    result.plot_scan_times()

What is exported here is imported when it is first used, so that ``import bussim`` costs nothing.
"""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

from bussim.version import __version__

if TYPE_CHECKING:
    from collections.abc import Callable
    from inspect import Signature

    from bussim.api import Result, examine, load, loads, open_run, plot_scan_times, profiles, run, timeline
    from bussim.cli import main
    from bussim.commands.fit.recording import fit
    from bussim.commands.report import report
    from bussim.errors import BussimError, Problem, RunError, ScenarioError, UsageError
    from bussim.exact.sizing.sized import Sized, size
    from bussim.exact.solution import Exact, exact
    from bussim.scenario.loader import Examined
    from bussim.scenario.model import Scenario
    from bussim.scenario.yaml.edit import edit
    from bussim.site.result import SiteResult, site
    from bussim.started import StartedRun, start
    from bussim.sweep.result import SweepResult
    from bussim.sweep.run import sweep

__all__ = [
    "BussimError",
    "Exact",
    "Examined",
    "Problem",
    "Result",
    "RunError",
    "Scenario",
    "ScenarioError",
    "SiteResult",
    "Sized",
    "StartedRun",
    "SweepResult",
    "UsageError",
    "__version__",
    "edit",
    "exact",
    "examine",
    "fit",
    "load",
    "loads",
    "main",
    "open_run",
    "plot_scan_times",
    "profiles",
    "report",
    "run",
    "site",
    "size",
    "start",
    "sweep",
    "timeline",
]

#: Where the names come from.
_HOMES = {
    "bussim.api": "Result examine load loads open_run plot_scan_times profiles run timeline",
    "bussim.cli": "main",
    "bussim.commands.fit.recording": "fit",
    "bussim.commands.report": "report",
    "bussim.errors": "BussimError Problem RunError ScenarioError UsageError",
    "bussim.exact.sizing.sized": "Sized size",
    "bussim.exact.solution": "Exact exact",
    "bussim.scenario.loader": "Examined",
    "bussim.scenario.model": "Scenario",
    "bussim.scenario.yaml.edit": "edit",
    "bussim.site.result": "SiteResult site",
    "bussim.started": "StartedRun start",
    "bussim.sweep.result": "SweepResult",
    "bussim.sweep.run": "sweep",
}


class _Folder(ModuleType):
    """A folder of this package that is called as the function of its name: exact, report, site, sweep."""

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return self.__wrapped__(*args, **kwargs)

    @property
    def __wrapped__(self) -> Callable[..., Any]:
        function: Callable[..., Any] = _exported(self.__name__.rpartition(".")[2])
        return function

    @property
    def __doc__(self) -> str | None:  # type: ignore[override] # of a class it is a text
        return self.__wrapped__.__doc__

    @property
    def __signature__(self) -> Signature:
        import inspect

        return inspect.signature(self.__wrapped__)


class _Package(ModuleType):
    """This package. Python sets a folder as an attribute of it whenever something in it is imported."""

    def __setattr__(self, name: str, value: object) -> None:
        if name in __all__ and type(value) is ModuleType:
            value.__class__ = _Folder
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def _exported(name: str) -> Any:
    home = next((module for module, names in _HOMES.items() if name in names.split()), None)
    if home is None:
        raise AttributeError(f"module 'bussim' has no attribute {name!r}")
    return getattr(import_module(home), name)


def __getattr__(name: str) -> Any:
    value = _exported(name)
    return globals().setdefault(name, value)  # a folder is there by now


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
