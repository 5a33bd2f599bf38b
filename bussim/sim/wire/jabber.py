"""The jabber fault: a node that sends random characters without end."""

from __future__ import annotations

from collections.abc import Iterator

from bussim.sim.kernel import HEARING, Kernel
from bussim.sim.wire.contract import Transmission
from bussim.sim.wire.node import Node

_CHUNK = 32


class JabberSender:
    """Random characters back to back from one node, until :meth:`end`."""

    def __init__(self, port: Node, kernel: Kernel, draws: Iterator[float]) -> None:
        self._port = port
        self._draws = draws
        self._timer = kernel.timer(self._go_on, HEARING)
        self._tx: Transmission | None = None
        self._nested = False

    def begin(self, now: int) -> None:
        """Switch the node's driver on; what its engine sends is lost from here on."""
        port = self._port
        self._nested = port.jabbering  # it jabbers already for another fault
        if self._nested:
            return
        port.line.cut(port, now)
        port.release(now)
        port.jabbering = True
        port.line.listeners_changed()
        self._send(now, first=True)

    def _send(self, now: int, *, first: bool) -> None:
        values = 1 << self._port.timing.format.data_bits
        chars = bytes(int(next(self._draws) * values) for _ in range(_CHUNK))
        tx = self._port.line.begin_jabber(self._port, chars, now, first=first)
        self._tx = tx
        self._timer.set(tx.end)

    def _go_on(self, now: int) -> None:
        tx = self._tx
        if tx is not None:
            self._port.line.finish_jabber(tx, now)
            self._send(now, first=False)

    def end(self, now: int) -> None:
        """Switch the node's driver off: the fault is over."""
        tx, port = self._tx, self._port
        if self._nested or tx is None:
            return
        self._timer.cancel()
        self._tx = None
        port.jabbering = False
        port.line.listeners_changed()
        port.line.cut_transmission(tx, now)
        port.line.join_midway(port, now)
