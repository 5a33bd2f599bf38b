"""Lines of the simulation that lead out of it: what their nodes send leaves by a :class:`Way`."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence

from bussim.engines.nn.frames import DATA, ENQ, KIND_NAMES, PARAMETERS, POLL, SOH, STX, Frame
from bussim.line.characters import LineTiming
from bussim.serve.bridge import Way
from bussim.serve.partly_external_line import OpenLine
from bussim.sim.kernel import Kernel
from bussim.sim.nn.bus import LinkBus
from bussim.sim.nn.port import LinkPort
from bussim.sim.nn.reporter import Reporter
from bussim.sim.serial.bus import SerialBus
from bussim.sim.wire.line import Witness
from bussim.sim.wire.node import Node
from bussim.sim.wire.transmission import Transmission, WireFrame
from bussim.trace.records import Sink

_LINK_KINDS = {ENQ: KIND_NAMES[POLL], STX: KIND_NAMES[DATA], SOH: KIND_NAMES[PARAMETERS]}
_STRANGERS_LUCK = "outside"


class LeadsOut(OpenLine):
    """What every line with a way out does otherwise.

    Nobody knows what was really sent outside: a frame from there is never taken for an undetected error.
    """

    way: Way

    # -- what its nodes send ------------------------------------------------------------------------

    def begin(self, port: Node, frame: WireFrame, now: int) -> Transmission:
        """See the line."""
        tx = super().begin(port, frame, now)
        self.way.leave(tx)
        return tx

    def begin_jabber(self, port: Node, chars: bytes, now: int, *, first: bool) -> Transmission:
        """See the line."""
        tx = super().begin_jabber(port, chars, now, first=first)
        self.way.leave(tx)
        return tx

    def finish(self, port: Node, tx: Transmission, now: int) -> None:
        """See the line."""
        super().finish(port, tx, now)
        self.way.left(now)

    def cut_transmission(self, tx: Transmission, now: int) -> None:
        """See the line."""
        super().cut_transmission(tx, now)
        self.way.cut()

    # -- what comes from outside ---------------------------------------------------------------------

    def connected(self, one: Node, other: Node) -> bool:
        """See the line; the way out is never cut."""
        outside = self.way.stranger
        return one is outside or other is outside or super().connected(one, other)

    def luck_key(self, tx: Transmission) -> Hashable:
        """See the line."""
        return _STRANGERS_LUCK if tx.sender is self.way.stranger else super().luck_key(tx)

    def luck_name(self, tx: Transmission) -> str:
        """See the line."""
        return _STRANGERS_LUCK if tx.sender is self.way.stranger else super().luck_name(tx)

    def kind_name(self, tx: Transmission) -> str:
        """See the line."""
        if tx.sender is self.way.stranger:
            return self.kind_of_strange(tx.chars)
        return super().kind_name(tx)

    def kind_of_strange(self, chars: bytes) -> str:
        """What kind of frame characters from outside may be."""
        raise NotImplementedError

    def accepted(
        self,
        port: Node,
        frame: WireFrame,
        start: int,
        now: int,
        sender: Node | None,
        blamed: Transmission | None,
        *,
        stored: bool,
    ) -> None:
        """See the line."""
        del blamed
        super().accepted(port, frame, start, now, sender, None, stored=stored)


class OutsideSerialBus(LeadsOut, SerialBus):
    """A bus beside the link with a way out."""

    def __init__(
        self, name: str, timing: LineTiming, kernel: Kernel, sink: Sink, witness: Witness, way: Way
    ) -> None:
        super().__init__(name, timing, sink, witness)
        self.way = way
        way.attach(self, kernel)

    def kind_of_strange(self, chars: bytes) -> str:
        """Requests where somebody here answers."""
        del chars
        return "request" if any(node.kind == "response" for node in self.ports) else "response"


class OutsideLinkBus(LeadsOut, LinkBus):
    """An N:N line with a way out; ``strangers`` are the PLCs by station that are to be found there."""

    def __init__(
        self,
        name: str,
        timing: LineTiming,
        kernel: Kernel,
        sink: Sink,
        reporter: Reporter,
        way: Way,
        strangers: Mapping[int, str],
    ) -> None:
        super().__init__(name, timing, kernel, sink, reporter)
        # The short ways for what nearly always happens do not lead outside.
        self.together = False
        self.way = way
        self._strangers = dict(strangers)
        self._outsiders = list(strangers.values())
        way.attach(self, kernel)

    def connect(self, ports: Sequence[LinkPort], horizon: int) -> None:
        """See the bus."""
        super().connect(ports, horizon)
        self._others = -1  # that all heard a block can never be told: there are others outside

    @property
    def seats(self) -> tuple[str, ...]:
        """See the bus; whoever was heard from outside follows."""
        return (*super().seats, *self._outsiders)

    def outsider(self, station: int) -> str:
        """See the base class; by a name that the class was given."""
        name = self._strangers.get(station)
        if name is None:
            name = self._strangers[station] = f"station {station} outside"
            self._outsiders.append(name)
        return name

    def kind_of_strange(self, chars: bytes) -> str:
        """By the header."""
        return _LINK_KINDS.get(chars[0], "")

    def accepted(
        self,
        port: Node,
        frame: WireFrame,
        start: int,
        now: int,
        sender: Node | None,
        blamed: Transmission | None,
        *,
        stored: bool,
    ) -> None:
        """See the line; a block from outside is a refresh, too."""
        super().accepted(port, frame, start, now, sender, blamed, stored=stored)
        if stored and sender is None and isinstance(frame, Frame):
            source = len(self.ports) + self._outsiders.index(self.outsider(frame.station))
            self.sink.refreshed(self.name, source, now, [port.seat])
