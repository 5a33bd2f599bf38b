"""A line of the simulation on which there are others, too, as the way to them sees it."""

from __future__ import annotations

from bussim.sim.wire.line import Line


class PartlyExternalLine(Line):
    """A line that somebody is on who is not simulated."""

    def external_name(self, station: int) -> str:
        """The name of a station that is not on this line."""
        return f"station {station}"

    def listen_to_all(self) -> None:
        """Something comes that is no node's: whoever waits for silence hears it as it comes."""
        self._all_listen_alone()
