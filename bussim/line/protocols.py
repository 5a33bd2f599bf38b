"""What runs on an RS485 bus as a whole."""

from enum import StrEnum


class BusProtocol(StrEnum):
    """How the nodes of a bus share it."""

    NN = "nn"  # the N:N link of one master and up to seven slaves, which takes the bus for itself
    SERIAL = "serial"  # what its ports are set up for: Modbus RTU, Modbus ASCII or a free protocol


#: What a frame on a bus can be a frame of, by the names in a trace.
FRAME_PROTOCOLS = ("nn", "modbus-rtu", "modbus-ascii", "free")
