"""A validated scenario as frozen values: what the simulation and the exact solver read.

Times are ticks (1/72 MHz). Nothing here checks anything: :mod:`bussim.scenario.loader` makes these
values from a file and reports every mistake before one exists.
"""

from bussim.line.protocols import BusProtocol
from bussim.plc.scan import Scan
from bussim.scenario.model.faults import (
    BoardError,
    CableCut,
    ClockPpm,
    DropReply,
    Fault,
    FaultKind,
    FlipBits,
    InsertChar,
    Jabber,
    LateRelease,
    LoseChar,
    PowerOff,
    Slow,
    Stop,
    WrongFormat,
)
from bussim.scenario.model.noise import (
    BitErrors,
    Burst,
    Bus,
    Direction,
    Impulse,
    Noise,
    NoiseKind,
    ReplyLoss,
    Target,
    Window,
)
from bussim.scenario.model.plc import (
    LinkAttachment,
    Plc,
)
from bussim.scenario.model.scenario import (
    Edge,
    Latency,
    Scenario,
)

__all__ = [
    "BitErrors",
    "BoardError",
    "Burst",
    "Bus",
    "BusProtocol",
    "CableCut",
    "ClockPpm",
    "Direction",
    "DropReply",
    "Edge",
    "Fault",
    "FaultKind",
    "FlipBits",
    "Impulse",
    "InsertChar",
    "Jabber",
    "LateRelease",
    "Latency",
    "LinkAttachment",
    "LoseChar",
    "Noise",
    "NoiseKind",
    "Plc",
    "PowerOff",
    "ReplyLoss",
    "Scan",
    "Scenario",
    "Slow",
    "Stop",
    "Target",
    "Window",
    "WrongFormat",
]
