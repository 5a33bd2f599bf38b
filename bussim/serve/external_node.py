"""What is on the other side of a wire, as a line of the simulation and its bridge see it."""

from typing import Any

from bussim.line.characters import LineTiming
from bussim.sim.kernel import Kernel
from bussim.sim.wire.contract import LineNode
from bussim.sim.wire.line import Line
from bussim.sim.wire.node import Node

#: No position of any line.
NOWHERE = -1


class ExternalNode(Node):
    """The sender of what comes from the wire. It has no engine: it receives nothing and does nothing."""

    def __init__(self, line: Line, kernel: Kernel) -> None:
        super().__init__("outside", line, NOWHERE, kernel)

    def quiet(self, timing: LineTiming) -> int:
        """Two characters; it receives nothing."""
        return timing.characters(2)

    def understands(self, sender: LineNode) -> bool:
        """Never."""
        return False

    def report(self, item: Any, now: int) -> None:
        """Do nothing: there is no engine."""

    @property
    def powered(self) -> bool:
        """Always, as far as is known."""
        return True

    def _on_start(self, now: int) -> None:
        del now


class PartlyExternalLine(Line):
    """A line with nodes that are not simulated."""

    def external_name(self, station: int) -> str:
        """The name of a station that is not on this line."""
        return f"station {station}"

    def receive_by_character(self) -> None:
        """Characters of an external node come: every node receives them one by one."""
        self._hand_over_all()
