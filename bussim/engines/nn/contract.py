"""What the N:N engines offer beyond :mod:`bussim.engines.contract`: the blocks that stations share.

A station's block is its PLC's memory as of the latest END. The engine keeps none: the driver supplies
the image when a frame needs one, and stores what other stations sent.
"""

from typing import Protocol, TypeVar

from bussim.engines.contract import OPEN, OWN_HINTS, Engine
from bussim.engines.nn.frames import Frame, FrameReader

#: Hint: the frame's block was accepted as its station's newest image.
STORED = OWN_HINTS


EventT = TypeVar("EventT")


class NnEngine(Engine[Frame, EventT], Protocol[EventT]):
    """A master or slave of the link."""

    #: Whether the frame that begin_transmit will return carries the station's own block.
    wants_image: bool = False
    #: That block at the latest END, to be set by the driver before begin_transmit where it is wanted.
    image: bytes = b""
    _reader: FrameReader

    def follow(self, reader: FrameReader) -> int:
        """Receive what a reader has taken, ahead of its time, if nothing is unfinished; returns OPEN or 0."""
        self._reader.follow(reader)
        return OPEN

    @property
    def unfinished(self) -> bool:
        """Whether a frame is."""
        return self._reader.open
