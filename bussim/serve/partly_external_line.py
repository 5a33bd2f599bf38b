"""A line of the simulation with external nodes, as its bridge sees it."""

from __future__ import annotations

from bussim.sim.wire.line import Line


class PartlyExternalLine(Line):
    """A line with nodes that are not simulated."""

    def external_name(self, station: int) -> str:
        """The name of a station that is not on this line."""
        return f"station {station}"

    def receive_by_character(self) -> None:
        """Characters of an external node come: every node receives them one by one."""
        self._hand_over_all()
