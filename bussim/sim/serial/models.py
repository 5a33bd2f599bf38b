"""The device models behind their nodes: which engine a device runs, and what it has to say."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from bussim.devices.profiles import DEVICE_PROFILES
from bussim.devices.scripted import ScriptedDevice
from bussim.devices.stepper.events import in_words
from bussim.devices.user import UserMap
from bussim.engines.modbus.master import MasterConfig
from bussim.engines.modbus.polling import PollingMaster
from bussim.engines.modbus.polls import PollList
from bussim.engines.modbus.server import RegisterMap
from bussim.engines.modbus.slave import Slave, SlaveConfig
from bussim.line.characters import LineTiming
from bussim.line.random_streams import Streams
from bussim.plc.ports.requests import poll_of
from bussim.scenario import model
from bussim.scenario.resolve.register_maps import register_map, stepper
from bussim.sim.serial.reporter import SerialReporter


class Behaviour:
    """What is peculiar to a device. The node asks for its engine whenever the supply comes."""

    def __init__(self, spec: model.BusDevice, streams: Streams) -> None:
        del streams
        self.spec = spec

    def power_on(self, now: int) -> tuple[Any, LineTiming]:
        """The supply comes: the engine, not started, and the rate and format that it uses."""
        raise NotImplementedError

    def power_off(self, now: int) -> None:
        """The supply goes."""

    def state(self, now: int) -> dict[str, int]:
        """What is worth telling of it at the end."""
        del now
        return {}

    def tell(self, reporter: SerialReporter) -> None:
        """Report what the device itself has to say."""


class _SlaveDevice(Behaviour):
    """A register map without a life of its own, made anew at power-on."""

    def map(self) -> RegisterMap:
        """The map at power-on."""
        found = register_map(self.spec.settings)
        assert found is not None  # noqa: S101 - narrows the type; see _MODELS
        return found

    def power_on(self, now: int) -> tuple[Any, LineTiming]:
        """The engine over a fresh map."""
        del now
        return self.engine(self.map(), self.spec.station or 0, self.spec.timing), self.spec.timing

    def engine(self, registers: RegisterMap, station: int, timing: LineTiming) -> Slave:
        """The slave engine at a station and rate."""
        spec = self.spec
        profile = DEVICE_PROFILES[spec.model]
        config = SlaveConfig(
            profile.framing(spec.mode, timing),
            delay=spec.delay,
            driven=isinstance(spec.settings, model.LxSettings),
            backlog=profile.backlog,
        )
        return Slave(config, {station: registers})


class _Map(_SlaveDevice):
    """A register map that the scenario defines."""

    _map: UserMap | None = None

    def map(self) -> RegisterMap:
        found = super().map()
        assert isinstance(found, UserMap)  # noqa: S101 - narrows the type; see _MODELS
        self._map = found
        return found

    def tell(self, reporter: SerialReporter) -> None:
        name = self.spec.name
        while self._map is not None and (failure := self._map.poll()) is not None:
            reporter.note(failure.tick, "value_failed", name, f"{failure.name}: {failure.error}")
            reporter.warn(f"{name}: the function of {failure.name} failed: {failure.error}")


class _StepperDevice(_SlaveDevice):
    """The controller lives on without supply: what was saved stays, and the axis stands where it was."""

    def __init__(self, spec: model.BusDevice, streams: Streams) -> None:
        super().__init__(spec, streams)
        settings = spec.settings
        assert isinstance(settings, model.StepperSettings)  # noqa: S101 - narrows the type; see _MODELS
        self._stepper = stepper(settings, spec.station or 1, spec.timing.baud)
        if spec.power_on > 0:
            self._stepper.power_off(0)

    def power_on(self, now: int) -> tuple[Any, LineTiming]:
        drive, spec = self._stepper, self.spec
        drive.power_on(now)
        timing = LineTiming(drive.baud, spec.timing.format, spec.timing.ppm)
        return self.engine(drive, drive.station, timing), timing

    def power_off(self, now: int) -> None:
        self._stepper.power_off(now)

    def state(self, now: int) -> dict[str, int]:
        drive = self._stepper
        drive.advance(now)
        names = ("position", "running", "arrived", "running_step")
        found = {name: drive.value(name, now) for name in names}
        position = found["position"]
        found["position"] = position - (1 << 32) if position >> 31 else position
        return {**found, "station": drive.station, "baud": drive.baud}

    def tell(self, reporter: SerialReporter) -> None:
        while (event := self._stepper.poll()) is not None:
            reporter.note(event.tick, "device", self.spec.name, in_words(event))


class _Hmi(Behaviour):
    """A master that works through its polls without a scan."""

    def power_on(self, now: int) -> tuple[Any, LineTiming]:
        spec, settings = self.spec, self.spec.settings
        assert isinstance(settings, model.HmiSettings)  # noqa: S101 - narrows the type; see _MODELS
        framing = DEVICE_PROFILES["map"].framing(spec.mode, spec.timing)
        config = MasterConfig(framing, settings.timeout, settings.interval, settings.turnaround)
        polls = PollList([poll_of(poll) for poll in settings.polls], now)
        return PollingMaster(config, polls), spec.timing


class _Free(Behaviour):
    """A device with a protocol of its own."""

    def __init__(self, spec: model.BusDevice, streams: Streams) -> None:
        super().__init__(spec, streams)
        settings = spec.settings
        assert isinstance(settings, model.FreeSettings)  # noqa: S101 - narrows the type; see _MODELS
        self._messages = settings.messages
        self._draws: list[Iterator[float]] = [
            streams.uniforms("saying", spec.name, number) for number in range(len(settings.messages))
        ]

    def power_on(self, now: int) -> tuple[Any, LineTiming]:
        del now
        return ScriptedDevice(self._messages, self.spec.timing, self._draws), self.spec.timing


_MODELS: dict[str, type[Behaviour]] = {
    "lx": _SlaveDevice,
    "v80": _SlaveDevice,
    "map": _Map,
    "stepper": _StepperDevice,
    "hmi": _Hmi,
    "free": _Free,
}


def behaviour(spec: model.BusDevice, streams: Streams) -> Behaviour:
    """The model of a device."""
    return _MODELS[spec.model](spec, streams)
