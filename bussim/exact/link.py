"""One N:N link as plain numbers: what the exact solver works on.

Frame lengths and the meaning of every time are those of the engines; nothing here is probabilistic
yet. A link knows by itself where the closed form ends: :attr:`LinkModel.reasons`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache

from bussim.engines.nn.frames import PARAMETERS_CHARS, POLL_CHARS, QUIET_CHARS, data_chars
from bussim.exact.scan.turnaround_sums import MAX_KINDS, count_kinds, spread_of
from bussim.line.characters import NN_LINE, LineTiming
from bussim.plc.profiles import AbsentStation, Attempts, ErrorCount, Turnaround
from bussim.units import TICKS_PER_MS, milliseconds
from bussim.words.language import say

#: Ticks of D8180's unit (PW10 board manual, section 7.4).
TIMEOUT_UNIT = 10 * TICKS_PER_MS

#: Bits of a character on the N:N line, its start, parity and stop bits included.
CHAR_BITS = NN_LINE.format.bits

#: The master's station number.
MASTER = 0


@lru_cache(maxsize=256)
def frame_ticks(characters: int, timing: LineTiming = NN_LINE) -> int:
    """Ticks of a frame of so many characters, rounded once."""
    return timing.characters(characters)


@dataclass(frozen=True, slots=True)
class NoiseSource:
    """Bit errors in one part of a link.

    ``part`` is ``bus`` (one draw for all receivers), ``tx`` (on what ``station`` sends, for all receivers)
    or ``rx`` (in the receiver of ``station`` only). With ``chain`` None every bit is inverted with
    probability ``good``; else with ``good`` or ``bad`` by the state of that chain of the noise.
    """

    part: str
    station: int | None
    good: float
    bad: float = 0.0
    chain: int | None = None


@dataclass(frozen=True, slots=True)
class LineNoise:
    """All bit errors of a link.

    ``chains`` are the Gilbert–Elliott processes: mean sojourns (good, bad) in ticks, exponential,
    in continuous time.
    """

    sources: tuple[NoiseSource, ...] = ()
    chains: tuple[tuple[float, float], ...] = ()

    @property
    def memoryless(self) -> bool:
        """Whether every bit is independent of every other."""
        return not self.chains

    def on_wire(self, sender: int) -> tuple[NoiseSource, ...]:
        """The sources that damage what a station sends for all receivers."""
        return tuple(s for s in self.sources if s.part == "bus" or (s.part == "tx" and s.station == sender))

    def in_receiver(self, receiver: int) -> tuple[NoiseSource, ...]:
        """The sources that damage what one station hears, for it alone."""
        return tuple(s for s in self.sources if s.part == "rx" and s.station == receiver)


@dataclass(frozen=True, slots=True)
class Station:
    """A slave of the link. Times in ticks.

    ``alive``: it replies to its polls. ``hears``: it takes over what other stations send. The rest is as it
    is or would be: ``reply`` its data frame, ``extra`` what a slow station adds to its turnaround, ``loss``
    the probability that a reply is never sent, ``scan`` its PLC's longest scan.
    """

    number: int
    name: str
    turnaround: Turnaround
    reply: int
    alive: bool = True
    hears: bool = True
    extra: int = 0
    loss: float = 0.0
    scan: int = 0

    @property
    def label(self) -> str:
        """How messages name it."""
        return f"station {self.number} ({self.name})" if self.name else f"station {self.number}"

    @property
    def quickest(self) -> int:
        """The shortest turnaround, in ticks."""
        return spread_of(self.turnaround)[0] + self.extra

    @property
    def slowest(self) -> int:
        """The longest turnaround, in ticks."""
        return self.turnaround.longest + self.extra

    @property
    def average(self) -> float:
        """The mean turnaround, in ticks."""
        return float(self.turnaround.average) + self.extra


@dataclass(frozen=True, slots=True)
class LinkModel:
    """One N:N link with one setting. Times in ticks (1/72 MHz).

    ``stations`` are the slaves 1…D8177 in order, those that do not exist as well (not alive);
    ``listeners`` stations that are never polled but hear. ``attempts`` is what D8179 = ``retries``
    means by the master profile's ``reading``. ``zeros``: the blocks are of zeros, else random (assumed).
    ``obstacles`` are the reasons, known from the scenario, why the closed form does not hold; ``notes`` what
    was left out of it on request; ``not_replying`` which stations refuse, do not exist or never reply;
    ``inputs`` what its figures are made of, with where each comes from.
    """

    bus: str
    master: str
    stations: tuple[Station, ...]
    mode: int
    retries: int
    attempts: int
    timeout: int
    gap: int
    overhead: int
    data: int
    poll: int = frame_ticks(POLL_CHARS)
    parameters: int = frame_ticks(PARAMETERS_CHARS)
    quiet: int = frame_ticks(QUIET_CHARS)
    reading: Attempts = Attempts.RETRIES_PLUS_1
    absent: AbsentStation = AbsentStation.FULL
    error_count: ErrorCount = ErrorCount.PER_SCAN
    unit: int = TICKS_PER_MS
    noise: LineNoise = LineNoise()
    zeros: bool = True
    scan: int = 0
    timeout_range: tuple[int, int] = (5, 225)
    set_under: str = "M8002"
    listeners: tuple[Station, ...] = ()
    obstacles: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    not_replying: tuple[str, ...] = ()
    inputs: Mapping[str, str] = field(default_factory=dict, compare=False)

    # -- lengths -----------------------------------------------------------------------------------

    @property
    def character(self) -> int:
        """Ticks of one character."""
        return frame_ticks(1)

    @property
    def data_bits(self) -> int:
        """Bits of a data frame."""
        return CHAR_BITS * data_chars(self.mode)

    @property
    def poll_bits(self) -> int:
        """Bits of a poll."""
        return CHAR_BITS * POLL_CHARS

    @property
    def silent_cost(self) -> int:
        """Ticks of an attempt that runs to its deadline."""
        return self.gap + self.poll + self.timeout

    @property
    def parameters_cost(self) -> int:
        """Ticks that a parameter frame adds to a scan."""
        return self.gap + self.parameters

    @property
    def base(self) -> int:
        """Ticks of a scan without its exchanges: the master's data frame and the overhead."""
        return self.gap + self.data + self.overhead

    def replied(self, station: Station) -> int:
        """Ticks of an attempt with a reply at a station, its turnaround left out."""
        return self.gap + self.poll + station.extra + station.reply

    # -- stations ------------------------------------------------------------------------------

    @property
    def alive(self) -> tuple[Station, ...]:
        """The slaves that reply."""
        return tuple(station for station in self.stations if station.alive)

    @property
    def dead(self) -> tuple[Station, ...]:
        """The slaves that are polled and never reply."""
        return tuple(station for station in self.stations if not station.alive)

    def station(self, number: int) -> Station:
        """The slave or listener with a number (1…)."""
        for station in (*self.stations, *self.listeners):
            if station.number == number:
                return station
        raise KeyError(number)

    def name(self, number: int) -> str:
        """The PLC behind a station number, the master's included."""
        return self.master if number == MASTER else self.station(number).name

    def scans_between(self, source: int, receiver: int) -> int:
        """The longest PLC scans of two stations together, in ticks.

        A program writes its block up to one scan before it is sent, and sees another's up to one scan
        after it arrived.
        """
        return sum(
            self.scan if number == MASTER else self.station(number).scan for number in (source, receiver)
        )

    def attempts_at(self, *, flagged: bool) -> int:
        """Attempts at a station whose flag is on or off when its exchange begins."""
        return 1 if flagged and self.absent.probes else self.attempts

    # -- variants ----------------------------------------------------------------------------------

    def with_setting(self, attempts: int, timeout: int, retries: int | None = None) -> LinkModel:
        """The same link with other attempts and another timeout (ticks)."""
        return replace(
            self, attempts=attempts, timeout=timeout, retries=self.retries if retries is None else retries
        )

    def with_dead(self, *numbers: int) -> LinkModel:
        """The same link with some stations switched off."""
        return replace(
            self,
            stations=tuple(
                replace(s, alive=False, hears=False) if s.number in numbers else s for s in self.stations
            ),
        )

    @property
    def complete(self) -> LinkModel:
        """The same link with all stations replying that are polled."""
        stations = tuple(replace(station, alive=True, hears=True) for station in self.stations)
        return replace(self, stations=stations, not_replying=())

    @property
    def lines(self) -> tuple[LinkModel, ...]:
        """The link as it is, unless no slave replies, and complete, where some do not reply."""
        return (*([self] if self.alive else []), *([self.complete] if self.dead else []))

    # -- where the closed form ends ----------------------------------------------------------------

    @property
    def noisy(self) -> bool:
        """Whether anything is ever damaged or lost."""
        return bool(self.noise.sources) or any(station.loss > 0 for station in self.alive)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the closed form does not hold with this setting; empty where it does."""
        kinds = count_kinds(station.turnaround for station in self.alive)
        too_many = [say("link_kinds", number=kinds, most=MAX_KINDS)] if kinds > MAX_KINDS else []
        return (*self.obstacles, *too_many, *self.timeout_reasons())

    @property
    def valid(self) -> bool:
        """Whether the closed form holds."""
        return not self.reasons

    def least_timeout(self) -> int:
        """The least timeout, in ticks, at which the closed form holds.

        A whole reply must fit; with bit errors also the two quiet characters after a damaged one, whose
        last character may end up to nine bits later, which else would end at its deadline instead.
        """
        quiet = self.quiet + self.character if self.noise.sources else 0
        return max((s.slowest + s.reply + quiet for s in self.alive), default=0)

    def timeout_reasons(self) -> list[str]:
        """Stations whose replies may come too late for the timeout."""
        found = []
        for station in self.alive:
            reply = station.slowest + station.reply
            tight = self.noise.sources and reply + self.quiet + self.character > self.timeout
            if reply > self.timeout or tight:
                key = "link_late_replies" if reply > self.timeout else "link_tight"
                times = {"reply": milliseconds(reply), "timeout": milliseconds(self.timeout)}
                found.append(say(key, station=station.label, **times))
        return found
