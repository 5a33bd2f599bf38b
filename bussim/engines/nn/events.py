"""Everything that the N:N engines report. Frozen values; times are ticks."""

from dataclasses import dataclass

from bussim.engines.nn.frames import LinkSettings


@dataclass(frozen=True, slots=True)
class ScanEnded:
    """Master: a link scan is over, from its data frame's start to the next one's."""

    index: int
    start: int
    duration: int
    attempts: int
    failures: tuple[tuple[int, int], ...]  # (station, code) of each failed attempt, in order
    in_error: tuple[int, ...]  # stations whose flag was on at its end
    parameters: bool  # the interval ended with a parameter frame
    slowest: tuple[int, int]  # (station, ticks from its poll's end to its reply) of the slowest reply


@dataclass(frozen=True, slots=True)
class AttemptEnded:
    """Master: an attempt was decided. Successes are reported only to a driver that traces."""

    start: int  # first edge of the poll
    polled: int  # end of the poll
    reply: int | None  # first edge of the reply, if there was one
    end: int
    station: int
    number: int
    code: int  # 0: a good reply


@dataclass(frozen=True, slots=True)
class StationLost:
    """An error flag went on (or, for the master, every attempt of a scan was spent again)."""

    tick: int
    station: int
    code: int
    new: bool  # the flag was off before


@dataclass(frozen=True, slots=True)
class StationBack:
    """An error flag went off."""

    tick: int
    station: int


@dataclass(frozen=True, slots=True)
class AllHealthy:
    """Master: every slave has replied and no flag is on, for the first time or again."""

    tick: int


@dataclass(frozen=True, slots=True)
class MasterWatchdog:
    """Slave: the master's frames stopped (code 11)."""

    tick: int
    heard: int  # when the last valid one ended


@dataclass(frozen=True, slots=True)
class PolledWithoutParameters:
    """Slave: polled before parameters arrived (code 31)."""

    tick: int


@dataclass(frozen=True, slots=True)
class ParametersTaken:
    """Slave: the master's settings arrived for the first time, or other ones than before."""

    tick: int
    settings: LinkSettings


@dataclass(frozen=True, slots=True)
class ParametersRefused:
    """Slave: the master asks for a refresh mode that this PLC family does not have."""

    tick: int
    settings: LinkSettings


MasterEvent = ScanEnded | AttemptEnded | StationLost | StationBack | AllHealthy
SlaveEvent = (
    StationLost | StationBack | MasterWatchdog | PolledWithoutParameters | ParametersTaken | ParametersRefused
)
NnEvent = MasterEvent | SlaveEvent
