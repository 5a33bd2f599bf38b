"""What disturbs the frames of one bus: noise, lost replies, and faults that damage single frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from bussim.line.noise import BitNoise
from bussim.line.wave import edge_of
from bussim.sim.wire.contract import Cable, Transmission


@dataclass(slots=True)
class PlacedNoise:
    """A noise process with its target: ``position`` None for the whole bus, ``receiver`` its direction."""

    process: BitNoise
    position: int | None = None
    receiver: bool = False


@dataclass(slots=True)
class Loss:
    """Replies of a position (None: of every node) vanish with a probability while it lasts."""

    position: int | None
    probability: float
    since: int
    until: int | None
    draws: dict[int, Iterator[float]]


@dataclass(slots=True)
class Drop:
    """The next ``left`` replies of a position vanish (None: all)."""

    position: int
    left: int | None


@dataclass(slots=True)
class FrameFault:
    """Damages the next ``left`` frames (None: all) sent by a position, or received there (``receiver``).

    ``action`` is "flip", "lose", "insert" or "pause"; ``value`` is the character that is inserted, or the
    pause in ticks; ``frame`` restricts it to one kind of frame.
    """

    action: str
    position: int
    receiver: bool
    left: int | None
    draws: Iterator[float]
    bits: tuple[int, ...] = ()
    index: int | None = None
    value: int | None = None
    frame: str | None = None


class Disturber:
    """All that disturbs one bus now. ``active`` is False while nothing can touch a frame."""

    def __init__(self, line: Cable) -> None:
        self._line = line
        self._noises: list[PlacedNoise] = []
        self._losses: list[Loss] = []
        self._drops: list[Drop] = []
        self._frame_faults: list[FrameFault] = []
        self.active = False
        #: Whether a reply may vanish before it is sent.
        self.replies_at_risk = False

    def add(self, item: PlacedNoise | Loss | Drop | FrameFault) -> None:
        """Begin a disturbance (noise and losses know their own window)."""
        self._list_for(item).append(item)
        self._refresh()

    def remove(self, item: Drop | FrameFault) -> None:
        """End a fault."""
        items = self._list_for(item)
        if item in items:
            items.remove(item)
        self._refresh()

    def _list_for(self, item: PlacedNoise | Loss | Drop | FrameFault) -> list[object]:
        lists: dict[type, list[object]] = {
            PlacedNoise: self._noises,  # type: ignore[dict-item] # each list holds the type of its key
            Loss: self._losses,  # type: ignore[dict-item] # the same
            Drop: self._drops,  # type: ignore[dict-item] # the same
            FrameFault: self._frame_faults,  # type: ignore[dict-item] # the same
        }
        return lists[type(item)]

    def _refresh(self) -> None:
        self.active = bool(self._noises or self._frame_faults)
        self.replies_at_risk = bool(self._losses or self._drops)
        self._line.listeners_changed()

    # -- replies -----------------------------------------------------------------------------------

    def reply_vanishes(self, position: int, now: int) -> bool:
        """Whether a reply of a position that is to begin now is never sent; asked once for each reply."""
        vanishes = False
        for loss in self._losses:
            if loss.position not in (None, position) or now < loss.since:
                continue
            if loss.until is not None and now >= loss.until:
                continue
            vanishes |= next(loss.draws[position]) < loss.probability
        for drop in list(self._drops):
            if drop.position == position and not vanishes:
                vanishes = True
                self._used(drop)
        return vanishes

    def _used(self, fault: Drop | FrameFault) -> None:
        if fault.left is not None:
            fault.left -= 1
            if fault.left <= 0:
                self.remove(fault)

    # -- frames ------------------------------------------------------------------------------------

    def disturb(self, tx: Transmission) -> None:
        """Damage a frame that begins now."""
        for fault in list(self._frame_faults):
            self._apply(fault, tx)
        if not self._noises:
            return
        sender = tx.sender
        name = self._line.stream_name(tx)
        width, bit = tx.timing.format.bits, tx.timing.bit
        bits = len(tx.chars) * width
        indices = range(len(tx.chars) if tx.pauses else 0)
        pieces = [(edge_of(index, tx.timing, tx.start, tx.pauses), width) for index in indices]
        for noise in self._noises:
            if noise.position is not None and (noise.position == sender.position) is noise.receiver:
                continue  # tx noise: not the sender; rx noise: the receiver is itself the sender
            hit = noise.process.inverted(tx.start, bits, bit, name, pieces)
            if hit:
                tx.invert(noise.position if noise.receiver else None, hit)

    def _apply(self, fault: FrameFault, tx: Transmission) -> None:
        sender = tx.sender.position
        if (fault.position == sender) is fault.receiver:
            return
        if fault.receiver:
            port = self._line.ports[fault.position]
            if port.engine is None or port.driving or not self._line.connected(port, tx.sender):
                return
        if fault.frame is not None and fault.frame != self._line.kind_name(tx):
            return
        if fault.action == "pause":
            last = len(tx.chars) - 1
            index = fault.index if fault.index is not None else int(next(fault.draws) * last)
            if index >= last or fault.value is None:
                return
            tx.pause(index, fault.value)
        elif fault.action == "flip":
            inside = tuple(bit for bit in fault.bits if bit < len(tx.chars) * tx.timing.format.bits)
            tx.invert(fault.position if fault.receiver else None, inside)
        else:
            self._recount(fault, tx)
        self._used(fault)

    @staticmethod
    def _recount(fault: FrameFault, tx: Transmission) -> None:
        """Remove a character from a transmission, or insert one."""
        length = len(tx.chars)
        index = fault.index if fault.index is not None else int(next(fault.draws) * length)
        index = min(index, length - 1)
        value: int | None = None
        if fault.action == "insert":
            values = 1 << tx.timing.format.data_bits
            value = fault.value if fault.value is not None else int(next(fault.draws) * values)
        if fault.receiver:
            tx.miscount(fault.position, index, value)
        elif value is None:
            tx.set_chars(tx.chars[:index] + tx.chars[index + 1 :])
        else:
            tx.set_chars(tx.chars[:index] + bytes((value,)) + tx.chars[index:])
