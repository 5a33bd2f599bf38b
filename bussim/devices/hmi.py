"""The device model ``hmi``: a master that works through its polls without a scan, an HMI or a PC."""

from dataclasses import dataclass

from bussim.devices.contract import Behaviour, BusDevice, MasterSettings
from bussim.devices.forms import Find, MasterIn
from bussim.devices.serial_settings import DevicePort
from bussim.engines.modbus.master import MasterConfig
from bussim.engines.modbus.polling import PollingMaster
from bussim.engines.modbus.polls import PollList
from bussim.line.random_streams import Streams
from bussim.plc.ports.requests import poll_of
from bussim.plc.ports.spec import PollSpec

HMI_PORT = DevicePort("hmi")


@dataclass(frozen=True, slots=True)
class HmiSettings(MasterSettings):
    """An HMI or a PC."""

    port = HMI_PORT

    def behaviour(self, device: BusDevice, streams: Streams) -> Behaviour:
        """A master whose poll list begins anew at power-on."""
        config = MasterConfig(device.framing(), self.timeout, self.interval, self.turnaround)
        polls = [poll_of(poll) for poll in self.polls]
        return Behaviour(lambda now: (PollingMaster(config, PollList(polls, now)), device.timing))


class HmiIn(MasterIn):
    """An entry of this model."""

    example = """
{name: panel, model: hmi, bus: feeder, mode: ascii, timeout: 500 ms, interval: 2 ms, turnaround: 50 ms,
  silence: 2.0, polls: [{station: 9, function: 3, address: 0, count: 2, every: 200 ms}]}
"""
    port = HMI_PORT

    def settings(self, polls: tuple[PollSpec, ...], find: Find) -> HmiSettings:
        """Its polls and times."""
        return HmiSettings(polls, self.timeout, self.least_interval, self.turnaround, self.silence)
