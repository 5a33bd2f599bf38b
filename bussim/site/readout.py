"""A readout as values: what was seen at each station, and nothing that was not.

A register that was not read is absent; it is never taken as 0. Registers have their common names, whatever
the family calls them, and codes the values that the PLC stores (code 21 is 0x21).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from bussim.engines.nn.codes import MEANINGS, NO_PARAMETERS
from bussim.site.forms import LIMIT, Cut, Ladder, Settings, SlowPlc

#: The addresses of the master's count, code and flag; slave k's follow at + k.
COUNT, CODE, FLAG = 8203, 8211, 8183
#: Counts that a start leaves at most (PLCs are switched on at different times: more).
START = 2
#: Error codes by the digits that a programming tool shows.
STYLES = {
    "as hexadecimal digits": {int(f"{code:X}"): code for code in MEANINGS},
    "in decimal": {code: code for code in MEANINGS},
}


@dataclass(frozen=True, slots=True)
class SiteProfile:
    """The profile of a site: as a scenario writes it, and the fields that its calibration left open."""

    form: Mapping[str, object]
    open: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Reading:
    """The registers of one station at one moment; ``looks`` are all those at D8201."""

    values: Mapping[str, int]
    looks: tuple[int, ...] = ()


_UNREAD = Reading({})


@dataclass(frozen=True, slots=True)
class Station:
    """One cabinet. ``number`` is as read there, ``supposed`` also what follows from the others."""

    place: str
    number: int | None
    state: str = "unread"
    after: Reading = _UNREAD
    before: Reading | None = None
    supposed: int = -1
    sd: str | None = None
    rd: str | None = None
    plc_scan: int | None = None
    rising: frozenset[str] = frozenset()

    @property
    def read(self) -> bool:
        """Whether any of its registers was read."""
        return bool(self.after.values or self.rising)

    def value(self, name: str) -> int | None:
        """A register at the last reading, None if not read."""
        return self.after.values.get(name)

    def count(self, about: int) -> int | None:
        """Errors counted about a station: between the readings, or since RUN; None if not read.

        Of what was only seen to climb it is 1, which is the least.
        """
        name = f"D{COUNT + about}"
        now, then = self.value(name), self.before.values.get(name) if self.before else 0
        if now is None or then is None:
            return 1 if name in self.rising else None
        return now - then

    def climbs(self, about: int) -> bool:
        """Whether its count about a station has no number, and was only seen to climb."""
        return self.count(about) is not None and self.value(f"D{COUNT + about}") is None

    def exact(self, about: int) -> int | None:
        """Its count about a station where that is one; None where it is not read, a lower bound or climbs."""
        stopped = self.value(f"D{COUNT + about}") == LIMIT
        return None if stopped or self.climbs(about) else self.count(about)

    def code(self, about: int) -> int | None:
        """The last error code about a station, None if not read, 0 for none."""
        return self.value(f"D{CODE + about}")

    def flag(self, about: int) -> int | None:
        """The flag about a station, None if not read."""
        return self.value(f"M{FLAG + about}")

    @property
    def label(self) -> str:
        """How sentences name it."""
        return self.place if self.supposed < 0 else f"{self.place} (station {self.supposed})"

    @property
    def halted(self) -> bool:
        """Whether it is off or in STOP."""
        return self.state in ("off", "stop")


@dataclass(frozen=True, slots=True)
class Readout:
    """One sheet of paper. Times in ticks."""

    profile: SiteProfile
    settings: Settings
    order: tuple[str, ...]
    watched: int
    stations: tuple[Station, ...]
    started: int | None = None
    ladder: Ladder | None = None
    symptoms: frozenset[str] = frozenset()
    notes: tuple[str, ...] = ()

    @property
    def slaves(self) -> tuple[Station, ...]:
        """The stations without number 0, in the order of the paper."""
        return tuple(station for station in self.stations if station.supposed)

    @property
    def since(self) -> int | None:
        """How long D8202 has been kept, None where that is not known: it goes back beyond ``before``."""
        earlier = self.started if any(station.before for station in self.stations) else 0
        return None if earlier is None else self.watched + earlier

    def label(self, number: int | None) -> str:
        """How sentences name the station, or the stations, with a number."""
        if number is None:
            return "a station"
        named = [station.label for station in self.stations if station.supposed == number]
        return " or ".join(named) or f"station {number}"

    def at(self, number: int) -> Station | None:
        """The station that is supposed to have a number, None if it was not visited."""
        return next((station for station in self.stations if station.supposed == number), None)


@dataclass(frozen=True, slots=True)
class Experiment:
    """What was set and read at a machine at rest; ``timeout`` in ticks."""

    name: str
    retries: int
    timeout: int
    slaves: int
    reading: Reading
    cut: Cut | None = None
    slow_plc: SlowPlc | None = None
    at_slaves: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Calibration:
    """Experiments by name."""

    profile: SiteProfile
    slaves: int
    mode: int
    experiments: Mapping[str, Experiment]


def with_numbers(stations: Sequence[Station], slaves: int) -> list[Station]:
    """The stations with their numbers: those read, for the others what is left, in order.

    A station that counts about the number that is its turn has another one, if there is one that fits.
    """
    left = [number for number in range(slaves + 1) if number not in {each.number for each in stations}]
    unknown = [each for each in stations if each.number is None]
    found: dict[str, int] = {}
    if unknown and left:
        from scipy.optimize import linear_sum_assignment

        costs = [
            [min(1000, each.count(number) or 0) + abs(turn - place) / 100 for turn, number in enumerate(left)]
            for place, each in enumerate(unknown)
        ]
        for row, column in zip(*linear_sum_assignment(costs), strict=True):
            found[unknown[row].place] = left[column]
    return [
        replace(each, supposed=found.get(each.place, -1) if each.number is None else each.number)
        for each in stations
    ]


def own_entries(station: Station) -> list[str]:
    """Registers in which a station tells of its own number what no station can: not of code 31."""
    number = station.supposed
    found = [f"D{COUNT + number} = {count}"] if number >= 0 and (count := station.count(number)) else []
    if number >= 0 and (code := station.code(number)) not in (None, 0, NO_PARAMETERS):
        found.append(f"D{CODE + number} = {code:02X}")
    return found
