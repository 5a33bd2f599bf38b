"""A validated scenario as frozen values: what the simulation and the exact solver read.

Times are ticks (1/72 MHz). Nothing here checks anything: :mod:`bussim.scenario.loader` makes these
values from a file and reports every mistake before one exists.
"""

from bussim.line.protocols import BusProtocol
from bussim.scenario.model.devices import (
    BusDevice,
    DeviceSettings,
    FreeSettings,
    HmiSettings,
    LxSettings,
    MapSettings,
    StepperSettings,
    V80Settings,
)
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
    Scan,
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
    "BusDevice",
    "BusProtocol",
    "CableCut",
    "ClockPpm",
    "DeviceSettings",
    "Direction",
    "DropReply",
    "Edge",
    "Fault",
    "FaultKind",
    "FlipBits",
    "FreeSettings",
    "HmiSettings",
    "Impulse",
    "InsertChar",
    "Jabber",
    "LateRelease",
    "Latency",
    "LinkAttachment",
    "LoseChar",
    "LxSettings",
    "MapSettings",
    "Noise",
    "NoiseKind",
    "Plc",
    "PowerOff",
    "ReplyLoss",
    "Scan",
    "Scenario",
    "Slow",
    "StepperSettings",
    "Stop",
    "Target",
    "V80Settings",
    "Window",
    "WrongFormat",
]
