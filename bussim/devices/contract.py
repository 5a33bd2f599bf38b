"""What a device on a bus is to the rest of the program, whatever its model.

A model belongs to one of three kinds: a Modbus slave, a Modbus master without a PLC's scan, or a device
with a protocol of its own. Its frozen settings say what follows from them; its behaviour runs on a bus.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple, Self

from bussim.devices.areas import AreaMap
from bussim.devices.serial_settings import DevicePort
from bussim.engines.modbus.adu import Mode
from bussim.engines.modbus.framing import Framing
from bussim.engines.modbus.gaps import GapRule
from bussim.engines.modbus.server import RegisterMap
from bussim.engines.modbus.slave import Slave, SlaveConfig
from bussim.line.characters import LineTiming
from bussim.line.random_streams import Streams
from bussim.plc.ports.spec import PollSpec
from bussim.plc.scan import Scan


class DeviceEvent(NamedTuple):
    """Something that a device itself reports: ``kind`` and ``text`` for the trace, a warning for the user."""

    tick: int
    kind: str
    text: str
    warning: str = ""


#: Makes an engine when the supply comes at a tick: it is not started yet. Beside it its rate and format.
PowerOn = Callable[[int], tuple[Any, LineTiming]]


class Behaviour:
    """A device in a run: with a new engine at every power-on, and nothing to report."""

    def __init__(self, power_on: PowerOn) -> None:
        self.power_on = power_on

    def power_off(self, now: int) -> None:
        """The supply goes."""

    def state(self, now: int) -> dict[str, int]:
        """Its state for the summary, by name."""
        return {}

    def events(self) -> Iterator[DeviceEvent]:
        """What it has to report since it was asked last."""
        return iter(())


class DeviceSettings(ABC):
    """What is peculiar to a device of one model."""

    __slots__ = ()

    #: The port of the model.
    port: ClassVar[DevicePort]

    @abstractmethod
    def behaviour(self, device: BusDevice, streams: Streams) -> Behaviour:
        """The device in a run."""

    def seeded(self, seed: int, device: str) -> Self:
        """The settings in a scenario of this seed, of a device of this name."""
        return self


class SlaveSettings(DeviceSettings):
    """A Modbus slave."""

    __slots__ = ()

    #: The address of the register that holds the station number; None where it cannot be written.
    station_register: ClassVar[int | None] = None

    @abstractmethod
    def register_map(self) -> AreaMap:
        """A new map with its addresses, functions, limits and values at power-on."""

    def plc_scan(self) -> Scan | None:
        """The scan of a PLC, which responds at END; None for what responds by itself."""
        return None

    def behaviour(self, device: BusDevice, streams: Streams) -> Behaviour:
        """A slave whose map is made anew at power-on."""
        return Behaviour(lambda _: (self.engine(device, self.register_map()), device.timing))

    def engine(self, device: BusDevice, registers: RegisterMap) -> Slave:
        """The slave engine over a map."""
        driven = self.plc_scan() is not None
        return Slave(SlaveConfig(device.framing(), device.delay, driven), {device.station or 0: registers})


@dataclass(frozen=True, slots=True)
class MasterSettings(DeviceSettings):
    """A Modbus master without a PLC's scan. Times in ticks."""

    polls: tuple[PollSpec, ...]
    timeout: int
    interval: int
    turnaround: int  # after a broadcast
    silence: float | None = None  # that ends a reply of RTU, as a float in characters; None: the port's


class FreeProtocolSettings(DeviceSettings):
    """A device with a protocol of its own, which sends when it likes."""

    __slots__ = ()


#: The settings of a device, by the kind of its model.
AnySettings = SlaveSettings | MasterSettings | FreeProtocolSettings


@dataclass(frozen=True, slots=True)
class BusDevice:
    """One entry of ``devices:``: something on a bus that is no PLC of the scenario. Times in ticks.

    ``model`` is its model's name in the registry. ``station`` is None for what is no slave. ``delay`` is
    the least time from a request's end to its reply's first edge, ``jitter`` what is added to it at most,
    uniform. ``timing`` are its own rate and format, normally the bus's. ``power_on`` is when it is
    switched on. ``gaps`` are a slave's own silences of RTU, None for its model's.
    """

    name: str
    model: str
    bus: str
    station: int | None
    mode: Mode
    timing: LineTiming
    delay: int
    jitter: int
    settings: AnySettings
    power_on: int = 0
    gaps: GapRule | None = None

    def framing(self) -> Framing:
        """How it frames Modbus. Raises ValueError for a mode that is impossible on its line."""
        settings = self.settings
        silence = settings.silence if isinstance(settings, MasterSettings) else None
        port = settings.port if self.gaps is None else replace(settings.port, gaps=self.gaps)
        return port.framing(self.mode, self.timing, silence)
