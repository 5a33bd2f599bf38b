"""The replies of a running session to requests; see :mod:`bussim.serve.control`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bussim.errors import UsageError
from bussim.serve.injecting import checked, entry
from bussim.serve.session import Session
from bussim.sim.faults import describe
from bussim.units import format_time, seconds

#: Seconds that a fault may take to begin.
_LONGEST_WAIT = 5.0


class SessionRequests:
    """Carries out requests to a session; called from the control server's thread."""

    def __init__(self, session: Session, *, allow_code: bool = False, folder: Path | None = None) -> None:
        self._session = session
        self._allow_code = allow_code
        self._folder = folder
        self._number = 0

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
        self._number += 1
        fault, odd = checked(
            scenario,
            entry(scenario, node, kind, texts),
            self._number,
            allow_code=self._allow_code,
            folder=self._folder,
        )
        if not self._session.inject(fault).wait(_LONGEST_WAIT):
            raise UsageError(f"{describe(fault.kind)}: it has not begun, for the simulation is very late")
        lasting = f" for {format_time(fault.window.duration)}" if fault.window.duration is not None else ""
        return {"text": f"{fault.name}: {describe(fault.kind)}{lasting}", "odd": list(odd)}
