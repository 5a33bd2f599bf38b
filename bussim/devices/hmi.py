"""The device model ``hmi``: a master that works through its polls without a scan, an HMI or a PC."""

from __future__ import annotations

from dataclasses import dataclass

from bussim.devices.contract import Behaviour, BusDevice, MasterSettings
from bussim.devices.forms import Find, MasterIn
from bussim.devices.port import DevicePort
from bussim.engines.modbus.master import MasterConfig
from bussim.engines.modbus.polling import PollingMaster
from bussim.engines.modbus.polls import PollList
from bussim.line.characters import LineTiming
from bussim.line.random_streams import Streams
from bussim.plc.ports.requests import poll_of
from bussim.plc.ports.spec import PollSpec

HMI_PORT = DevicePort("hmi")


@dataclass(frozen=True, slots=True)
class HmiSettings(MasterSettings):
    """An HMI or a PC."""

    port = HMI_PORT

    def behaviour(self, device: BusDevice, streams: Streams) -> HmiBehaviour:
        """The master in a run."""
        del streams
        return HmiBehaviour(device, self)


class HmiBehaviour(Behaviour):
    """A master whose poll list begins anew at power-on."""

    def __init__(self, device: BusDevice, settings: HmiSettings) -> None:
        self._device = device
        self._settings = settings

    def power_on(self, now: int) -> tuple[PollingMaster, LineTiming]:
        """The engine over the poll list."""
        device, settings = self._device, self._settings
        config = MasterConfig(device.framing(), settings.timeout, settings.interval, settings.turnaround)
        polls = PollList([poll_of(poll) for poll in settings.polls], now)
        return PollingMaster(config, polls), device.timing


class HmiIn(MasterIn):
    """An entry of this model."""

    port = HMI_PORT

    def settings(self, polls: tuple[PollSpec, ...], find: Find) -> HmiSettings:
        """Its polls and times."""
        del find
        return HmiSettings(polls, self.timeout, self.interval, self.turnaround)
