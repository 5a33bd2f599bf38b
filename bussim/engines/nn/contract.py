"""What the N:N engines offer beyond :mod:`bussim.engines.contract`: the blocks that stations share.

A station's block is its PLC's memory as of the latest END. The engine keeps none: the driver supplies
the image when a frame needs one, and stores what other stations sent.
"""

from __future__ import annotations

from typing import Protocol

from bussim.engines.contract import OWN_HINTS, Engine
from bussim.engines.nn.events import NnEvent
from bussim.engines.nn.frames import Frame

#: Hint: the frame's block was accepted as its station's newest image.
STORED = OWN_HINTS


class NnEngine(Engine[Frame, NnEvent], Protocol):
    """A master or slave of the link."""

    #: Whether the frame that begin_transmit will return carries the station's own block.
    wants_image: bool
    #: That block at the latest END, to be set by the driver before begin_transmit where it is wanted.
    image: bytes
