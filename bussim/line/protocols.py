"""What runs on an RS485 bus as a whole."""

from __future__ import annotations

from enum import StrEnum
from typing import assert_never


class BusProtocol(StrEnum):
    """How the nodes of a bus share it."""

    NN = "nn"  # the N:N link of one master and up to seven slaves, which takes the bus for itself
    SERIAL = "serial"  # what its ports are set up for: Modbus RTU, Modbus ASCII or a free protocol

    @property
    def divisible(self) -> bool:
        """Whether some nodes of a bus can be external while it goes on without them."""
        match self:
            case BusProtocol.NN:
                return False
            case BusProtocol.SERIAL:
                return True
            case _:
                assert_never(self)
