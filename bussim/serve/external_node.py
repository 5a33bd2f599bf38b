"""The node on the other side of a wire, as far as faults and noise of a line need it."""

from __future__ import annotations

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
