"""The cable of a line: its nodes, the breaks between them, and which nodes receive what."""

from __future__ import annotations

from collections.abc import Sequence

from bussim.sim.wire.contract import LineNode, ReceiveFrame

#: Nodes that receive whole frames; those that receive characters; how many the shared listener stands for.
Listeners = tuple[tuple[tuple[LineNode, ReceiveFrame], ...], tuple[LineNode, ...], int]


class Cable:
    """Nodes in cable order, in segments that a break separates.

    Which nodes receive a sender's frames whole is worked out once for each sender and kept until
    :meth:`listeners_changed`: it changes with faults, STOP and RUN, not with frames.
    """

    def __init__(self) -> None:
        self.ports: Sequence[LineNode] = []
        self._segments: list[int] = []
        #: Nodes that receive through a shared listener (see :meth:`hand_over`).
        self._represented: tuple[LineNode, ...] = ()
        self._listeners_by_position: dict[int, Listeners] = {}
        self._open_receivers = 0

    def set_nodes(self, nodes: Sequence[LineNode]) -> None:
        """Put the nodes on the cable, in cable order."""
        self.ports = nodes
        self._segments = [0] * len(nodes)

    def connected(self, one: LineNode, other: LineNode) -> bool:
        """Whether the cable between two nodes is whole."""
        return self._segments[one.position] == self._segments[other.position]

    def listeners_changed(self) -> None:
        """Forget which nodes receive what: some node receives otherwise than before."""
        self._listeners_by_position.clear()

    def hand_over(self, port: LineNode) -> None:
        """A node receives for itself from now on: hand over what the line has done on its behalf."""

    def _hand_over_all(self) -> None:
        """Every node receives for itself from now on, also what is on the wire."""

    def receiver_opened(self) -> None:
        """A node begins to receive character by character."""
        self._open_receivers += 1
        self.listeners_changed()

    def receiver_closed(self) -> None:
        """A node receives whole frames again."""
        self._open_receivers -= 1
        self.listeners_changed()

    def listeners_of(self, sender: LineNode) -> Listeners:
        """The nodes that receive a frame while no other driver is on: whole, or character by character."""
        found = self._listeners_by_position.get(sender.position)
        if found is None:
            whole: list[tuple[LineNode, ReceiveFrame]] = []
            single: list[LineNode] = []
            members = self._represented
            for port in self._receivers_of(sender):
                if port in members:
                    continue
                if port.nominal and sender.nominal and not port.receiver.is_open and port.understands(sender):
                    whole.append((port, port.engine.receive_frame))
                else:
                    single.append(port)
            shared = len(members) - (sender in members)
            found = self._listeners_by_position[sender.position] = (tuple(whole), tuple(single), shared)
        return found

    def _receivers_of(self, sender: LineNode) -> list[LineNode]:
        """The nodes whose receivers a sender's signal reaches: in operation, connected, driver off."""
        return [
            port
            for port in self.ports
            if port is not sender
            and port.engine is not None
            and not port.driving
            and self.connected(port, sender)
        ]
