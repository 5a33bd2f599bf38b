"""Entries of ``devices`` as the file has them: what every model has, and the kinds of models."""

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field

from bussim.devices.contract import AnySettings, BusDevice, SlaveSettings
from bussim.devices.serial_settings import DevicePort
from bussim.engines.modbus.adu import FIRST_STATION, LAST_STATION, Mode
from bussim.forms.fields import Baud, Format, Name, characters_or_time, choice, time, whole
from bussim.forms.form import Model
from bussim.forms.mistakes import EntryView, Reporter
from bussim.forms.rtu_gaps import RtuGapsIn
from bussim.line.characters import LineTiming
from bussim.plc.ports.spec import PollSpec
from bussim.units import TICKS_PER_SECOND, format_time
from bussim.words.language import say

#: Finds a function of the user by ``module:function``. Raises ValueError with a message for the user.
Find = Callable[[str], Callable[[int], int]]

LONG = (-(1 << 31), (1 << 32) - 1)
Long = Annotated[int, whole(*LONG)]
Word = Annotated[int, whole(-32768, 0xFFFF)]
Delay = Annotated[int, time(0, 60 * TICKS_PER_SECOND)]
ModbusMode = Annotated[str, choice(*(mode.value for mode in Mode))]


class DeviceIn(Model):
    """What every device has. Its fields are the keys of its entry; a model adds its own."""

    #: Of a model: an entry with all of its keys, none at its default; a slave is station 9.
    example = "{name: feeder1, model: stepper, bus: feeder, station: 1}"
    #: Whether it is of a model that is known.
    known: ClassVar[bool] = True
    #: What it is on its bus.
    role: ClassVar[Literal["slave", "master", "free protocol"]] = "free protocol"
    #: The port of its model.
    port: ClassVar[DevicePort]

    name: Name
    model: str
    bus: Name
    baud: Baud | None = None
    format: Format | None = None

    def check(self, entry: EntryView, find: Find, report: Reporter) -> None:
        """Report what does not fit together or is odd in an entry whose values are right one by one."""

    @abstractmethod
    def settings(self, polls: tuple[PollSpec, ...], find: Find) -> AnySettings:
        """The frozen settings of an entry without mistakes; ``polls`` are those of a master."""

    def fill(self, written: dict[str, Any]) -> None:
        """Put into the entry as written what it leaves open: its defaults, other forms of a value."""

    def address(self) -> tuple[Mode | None, int | None]:
        """Its mode of Modbus and its station; None for what has none."""
        return None, None

    def timing(self, line: LineTiming) -> LineTiming:
        """Its own rate and format, on a bus with these."""
        return LineTiming(self.baud or line.baud, self.format or line.format)

    def device(self, line: LineTiming, power_on: int, polls: tuple[PollSpec, ...], find: Find) -> BusDevice:
        """The frozen device on a bus with this rate and format, switched on at a tick."""
        mode, station = self.address()
        return BusDevice(
            name=self.name,
            model=self.model,
            bus=self.bus,
            station=station,
            mode=mode or Mode.RTU,
            timing=self.timing(line),
            delay=0,
            jitter=0,
            settings=self.settings(polls, find),
            power_on=power_on,
        )


class SlaveIn(DeviceIn):
    """A Modbus slave."""

    role = "slave"

    station: Annotated[int, whole(FIRST_STATION, LAST_STATION)] = 1
    mode: ModbusMode = Mode.RTU.value
    delay: Delay | None = None
    jitter: Delay = 0
    rtu_gaps: RtuGapsIn | None = None

    @property
    def own_port(self) -> DevicePort:
        """The port of its model, with its own silences."""
        return self.port if self.rtu_gaps is None else replace(self.port, gaps=self.rtu_gaps.rule())

    @property
    def least_delay(self) -> int:
        """The least time from a request's end to its reply, as given or as the model has it."""
        return self.port.delay if self.delay is None else self.delay

    def address(self) -> tuple[Mode | None, int | None]:
        """Its mode and station."""
        return Mode(self.mode), self.station

    @abstractmethod
    def settings(self, polls: tuple[PollSpec, ...], find: Find) -> SlaveSettings:
        """Its settings."""

    def device(self, line: LineTiming, power_on: int, polls: tuple[PollSpec, ...], find: Find) -> BusDevice:
        """The frozen device with its delay."""
        return replace(
            super().device(line, power_on, polls, find),
            delay=self.least_delay,
            jitter=self.jitter,
            gaps=self.rtu_gaps.rule() if self.rtu_gaps is not None else None,
        )

    def check(self, entry: EntryView, find: Find, report: Reporter) -> None:
        """Compare mode and delay with what the model has."""
        port = self.port
        if Mode(self.mode) not in port.modes:
            allowed = ", ".join(mode.value for mode in port.modes)
            report.error(
                (*entry.path, "mode"),
                say("rule_not_among_port", baud=self.mode, allowed=allowed, port=port.name),
            )
        if self.least_delay < port.delay:
            least = format_time(self.least_delay)
            report.error(
                (*entry.path, "delay"),
                say("model_no_sooner", found=least, port=port.name, delay=format_time(port.delay)),
            )
        if self.rtu_gaps is not None and Mode(self.mode) is Mode.ASCII:
            report.warn((*entry.path, "rtu_gaps"), say("model_ascii_gaps", name=self.name))

    def fill(self, written: dict[str, Any]) -> None:
        """The model's delay."""
        written["delay"] = format_time(self.least_delay)


class MasterIn(DeviceIn):
    """A Modbus master without a scan, whose ``polls`` are read entry by entry."""

    role = "master"

    mode: ModbusMode = Mode.RTU.value
    timeout: Annotated[int, time(1, 3600 * TICKS_PER_SECOND)] = TICKS_PER_SECOND
    interval: Delay | None = None
    turnaround: Delay = TICKS_PER_SECOND // 10
    silence: Annotated[int | float, characters_or_time(0.1, 1000)] | None = None
    polls: list[Any] = Field([])

    @property
    def least_interval(self) -> int:
        """The interval as given; without it 5 ms, or none where the silence says when it goes on."""
        if self.interval is not None:
            return self.interval
        return TICKS_PER_SECOND // 200 if self.silence is None else 0

    def address(self) -> tuple[Mode | None, int | None]:
        """Its mode."""
        return Mode(self.mode), None

    def fill(self, written: dict[str, Any]) -> None:
        """The interval."""
        written["interval"] = format_time(self.least_interval)

    def check(self, entry: EntryView, find: Find, report: Reporter) -> None:
        """Warn where it has nothing to send, or a silence that means nothing."""
        if self.silence is not None and Mode(self.mode) is Mode.ASCII:
            text = say("model_ascii_silence", name=self.name)
            report.warn((*entry.path, "silence"), text)
        if not self.polls and not entry.lost("polls"):
            report.warn(entry.path, say("model_no_polls", name=self.name))
