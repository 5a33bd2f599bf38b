"""A whole scenario, as frozen values. Times are ticks (1/72 MHz)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import TYPE_CHECKING

from bussim.scenario.model.faults import Fault
from bussim.scenario.model.noise import Bus, Noise
from bussim.scenario.model.plc import Plc

if TYPE_CHECKING:  # what only a scenario with devices pays
    from bussim.devices.contract import BusDevice


class Edge(StrEnum):
    """Which changes of a bit a latency counts."""

    RISING = "rising"
    FALLING = "falling"
    BOTH = "both"


@dataclass(frozen=True, slots=True)
class Latency:
    """How long a change takes from one device to another: an entry of ``latency:``.

    Bits: from the change of ``source`` (an input's wire, or an END that left it changed) to the END
    at which ``target`` follows; ``inverted``: it follows with the other level. Words: the age of what
    ``target`` holds whenever its PLC's program reads it.
    """

    name: str
    source_plc: str
    source: str
    target_plc: str
    target: str
    edge: Edge = Edge.BOTH
    inverted: bool = False


@dataclass(frozen=True, slots=True)
class Scenario:
    """Everything a run needs. ``warnings`` are what the loader found odd but possible.

    ``source`` is the scenario as plain data with every default filled in, in the file's own form
    (times as text with units), so that a run can leave it behind as YAML.
    """

    name: str
    duration: int
    seed: int
    buses: tuple[Bus, ...]
    plcs: tuple[Plc, ...]
    noise: tuple[Noise, ...] = ()
    faults: tuple[Fault, ...] = ()
    warnings: tuple[str, ...] = ()
    devices: tuple[BusDevice, ...] = ()
    latency: tuple[Latency, ...] = ()
    source: dict[str, object] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        """Devices draw from the seed: also a replaced one changes their noise."""
        devices = tuple(
            replace(device, settings=device.settings.seeded(self.seed, device.name))
            for device in self.devices
        )
        object.__setattr__(self, "devices", devices)

    def nodes_on(self, bus: str) -> tuple[str, ...]:
        """What sits on a bus, in the order of its cable: PLCs' ports as in ``plcs``, then devices."""
        names: list[str] = []
        for plc in self.plcs:
            ports = [spec.name for spec in plc.ports if spec.bus == bus]
            if plc.link is not None and plc.link.bus == bus:
                ports.append(plc.link.port)
            names += [plc.port_node(port) for port in sorted(ports)]
        return (*names, *(device.name for device in self.devices if device.bus == bus))
