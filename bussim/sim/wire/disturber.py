"""What disturbs the frames of one bus: noise, lost replies, and faults that damage single frames."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, NamedTuple

from bussim.line.noise import BitNoise
from bussim.line.random_streams import Uniforms
from bussim.line.wave import edge_of
from bussim.sim.kernel import NEVER
from bussim.sim.wire.contract import Cable, Transmission

if TYPE_CHECKING:
    import numpy as np


@dataclass(slots=True)
class PlacedNoise:
    """A noise process with its target: ``position`` None for the whole bus, ``receiver`` its direction."""

    process: BitNoise
    position: int | None = None
    receiver: bool = False

    def touches(self, sender: int) -> bool:
        """Whether it acts on what a position sends: sent by its own, or received there from another."""
        return self.position is None or (self.position == sender) is not self.receiver


class FramesAhead(NamedTuple):
    """Frames of one kind that a position will send; ``key`` is the name of the stream of their noise."""

    sender: int
    key: str
    starts: np.ndarray
    bits: int
    bit: Fraction


@dataclass(slots=True)
class Loss:
    """Replies of a position (None: of every node) vanish with a probability while it lasts."""

    position: int | None
    probability: float
    since: int
    until: int | None
    draws: dict[int, Uniforms]

    def acts_on(self, position: int, now: int) -> bool:
        """Whether a reply of a position that begins now may vanish."""
        return (
            self.position in (None, position)
            and now >= self.since
            and (self.until is None or now < self.until)
        )


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

    # -- frames that nothing touches ---------------------------------------------------------------

    def calm_until(self, now: int) -> int:
        """Until when only chance decides what is disturbed: the next begin or end of a window."""
        if self._drops or self._frame_faults:
            return now
        losses = (at for loss in self._losses for at in (loss.since, loss.until))
        edges = (*losses, *(noise.process.edge(now) for noise in self._noises))
        return min((at for at in edges if at is not None and at > now), default=NEVER)

    def replies_kept(self, position: int, now: int, most: int) -> int:
        """How many of a position's next replies are sent: at most ``most``, before :meth:`calm_until`."""
        for loss in self._losses:
            if loss.acts_on(position, now):
                most = loss.draws[position].before(loss.probability, most)
        return most

    def frames_kept(self, frames: FramesAhead, *, varying: bool) -> int:
        """How many of a node's next frames of a kind are surely undamaged, as far as such noise goes."""
        kept = len(frames.starts)
        for noise in self._noises:
            if noise.process.varies is varying and noise.touches(frames.sender):
                kept = noise.process.calm(frames.key, frames.starts[:kept], frames.bits, frames.bit)
        return kept

    def pass_replies(self, position: int, now: int, count: int) -> None:
        """So many replies of a position were sent."""
        for loss in self._losses:
            if loss.acts_on(position, now):
                loss.draws[position].skip(count)

    def pass_frames(self, frames: FramesAhead, count: int, now: int) -> None:
        """So many of a node's frames of a kind were undamaged."""
        for noise in self._noises:
            if noise.touches(frames.sender):
                noise.process.skip(frames.key, count, now)

    # -- replies -----------------------------------------------------------------------------------

    def reply_vanishes(self, position: int, now: int) -> bool:
        """Whether a reply of a position that is to begin now is never sent; asked once for each reply."""
        vanishes = False
        for loss in self._losses:
            if loss.acts_on(position, now):
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
            if not noise.touches(sender.position):
                continue
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
