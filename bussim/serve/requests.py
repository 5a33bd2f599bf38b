"""The replies of a running session to requests; see :mod:`bussim.serve.control`."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

from bussim.errors import ScenarioError, UsageError
from bussim.scenario import loader, model
from bussim.scenario.schema.disturbances import FaultIn
from bussim.scenario.yaml import parser as yaml
from bussim.serve.session import Session
from bussim.sim.faults import describe
from bussim.units import format_time, seconds
from bussim.wording import nearest, shorten
from bussim.words.values import suggest

#: Seconds that a fault may take to begin.
_LONGEST_WAIT = 5.0


class SessionRequests:
    """Carries out requests to a session; called from the control server's threads."""

    def __init__(self, session: Session, *, allow_code: bool = False, folder: Path | None = None) -> None:
        self._session = session
        self._allow_code = allow_code
        self._folder = folder
        self._numbers = count(1)

    def __call__(self, request: dict[str, Any]) -> dict[str, Any]:
        """The reply to a request. Raises UsageError."""
        asked = request.get("do")
        if asked == "list":
            session = self._session
            return {
                "scenario": session.scenario.name,
                "nodes": list(session.described()),
                "now_s": round(seconds(session.now), 3),
            }
        if asked == "inject":
            return self._inject(request)
        raise UsageError(f"{asked!r} is no request; allowed are list and inject")

    def _inject(self, request: dict[str, Any]) -> dict[str, Any]:
        node, kind, values = request.get("node"), request.get("kind"), request.get("values", {})
        if not isinstance(node, str) or not isinstance(kind, str) or not isinstance(values, dict):
            raise UsageError("a fault needs node, kind and values")
        texts = {str(key): str(value) for key, value in values.items()}
        scenario = self._session.scenario
        fault, odd = checked(
            scenario,
            entry(scenario, node, kind, texts),
            next(self._numbers),
            allow_code=self._allow_code,
            folder=self._folder,
        )
        if not self._session.inject(fault).wait(_LONGEST_WAIT):
            raise UsageError(f"{describe(fault.kind)}: it has not begun, for the simulation is very late")
        lasting = f" for {format_time(fault.window.duration)}" if fault.window.duration is not None else ""
        return {"text": f"{fault.name}: {describe(fault.kind)}{lasting}", "odd": list(odd)}


#: What belongs to the fault itself, not to its kind.
_OWN = ("count", "for")


def entry(scenario: model.Scenario, node: str, kind: str, values: Mapping[str, str]) -> dict[str, object]:
    """The fault as an entry of ``faults:``. Raises UsageError."""
    kinds = [each for each in FaultIn.kinds if each != "power_on"]  # whose time is its own
    if kind not in kinds:
        hint = suggest(kind, kinds) if nearest(kind, kinds) else f"allowed are {', '.join(kinds)}"
        raise UsageError(f"no fault {shorten(kind)!r}; {hint}")
    given = {key: _value(key, text) for key, text in values.items()}
    whole = {key: given.pop(key) for key in _OWN if key in given}
    if kind == "cable_cut":
        bus = next((bus.name for bus in scenario.buses if node in scenario.nodes_on(bus.name)), None)
        if bus is None:
            raise UsageError(f"{node} is on no bus: there is no cable behind it")
        return {**whole, kind: {"bus": bus, "after": node, **given}}
    if kind == "board_error":
        plc, _, port = node.partition(".")
        return {**whole, kind: {"plc": plc, "port": port, **given}}
    return {**whole, kind: {"station": node, **given}}


def _value(key: str, text: str) -> object:
    value, _, problems = yaml.read(text, f"--{key}")
    if problems:
        raise UsageError(f"--{key}: {problems[0].message}")
    return value


def checked(
    scenario: model.Scenario,
    fault: Mapping[str, object],
    number: int,
    *,
    allow_code: bool = False,
    folder: Path | None = None,
) -> tuple[model.Fault, tuple[str, ...]]:
    """The fault of an entry, and warnings about it. Raises UsageError with every mistake.

    ``number`` distinguishes it from other injected faults: it has random streams of its own.
    """
    named = {"name": f"injected_{number}", **fault}
    data = {**scenario.source, "faults": [named]}
    try:
        found = loader.from_data(data, name="inject", allow_code=allow_code, folder=folder)
    except ScenarioError as error:
        own = f"faults.injected_{number}."
        texts = (problem.message.removeprefix(own) for problem in error.problems)
        raise UsageError("; ".join(texts)) from error
    usual = set(loader.from_data({**data, "faults": []}, allow_code=allow_code, folder=folder).warnings)
    odd = tuple(text for text in found.warnings if text not in usual)
    return replace(found.faults[-1], name=f"injected {number}"), odd
