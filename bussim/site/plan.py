"""How long to watch with which reading, until it tells a link's noise to a factor of two either way."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import prod
from statistics import median
from typing import Any

from bussim.site.noise.lenses import root
from bussim.site.noise.picture import Picture
from bussim.units import TICKS_PER_SECOND
from bussim.wording import about

#: Events to expect: then ten or more come with 93 %, and the interval's ends differ by a factor of 4 at most.
EVENTS = 15


@dataclass(frozen=True, slots=True)
class Watch:
    """One reading: events a second, and what it costs the machine."""

    reading: str
    events: float
    costs: str

    @property
    def seconds(self) -> float | None:
        """How long to watch, None for never."""
        return EVENTS / self.events if self.events > 0 else None

    def in_words(self) -> str:
        """One line."""
        seconds = self.seconds
        return f"{self.reading}: {'never' if seconds is None else _long(seconds)}; {self.costs}"

    def to_json(self) -> dict[str, Any]:
        """The reading as plain data."""
        return {"reading": self.reading, "watch_s": self.seconds, "costs": self.costs}


def expected_failures(picture: Picture) -> tuple[list[float], bool]:
    """The probabilities of a failed attempt where there are any; without any, the upper limits (True)."""
    values = [fails.value for fails in picture.fails.values() if fails.value > 0]
    return (values, False) if values else ([fails.high for fails in picture.fails.values()], True)


def plan(picture: Picture) -> list[Watch]:
    """The readings, that which disturbs the machine least first."""
    return list(_watches(picture, expected_failures(picture)[0]))


def _watches(picture: Picture, fails: list[float]) -> Iterator[Watch]:
    link, p = picture.link, median(fails)
    scans = TICKS_PER_SECOND / link.healthy
    ber = root(lambda b: link.damaged(b, link.model.poll_bits + link.data_bits), p, 1e-2)
    wire = "nothing; tells noise on the wire and in receivers only"
    yield Watch("D8203 of the slaves", scans * link.master_damaged(ber), wire)
    healthy = prod(1 - each for each in fails)
    ladder = "some instructions in the master; all stations together"
    yield Watch("the ladder", scans * healthy * (1 - healthy), ladder)
    for retries in reversed(range(4)):
        other = replace(link, settings=link.settings.model_copy(update={"retries": retries}))
        hourly = about(3600 * scans * sum(map(other.station_errors, fails)))
        costs = "as it is" if retries == link.settings.retries else "STOP and RUN of the master"
        reading = f"D8204 on of the master at D8179 = {retries}"
        yield Watch(reading, scans * other.station_errors(p), f"{costs}; {hourly} station errors an hour")


def _long(seconds: float) -> str:
    """A time to wait, in the unit that suits it."""
    if seconds > 100 * 365 * 86400:
        return "over 100 years"
    for unit, length in (("years", 365 * 86400), ("days", 86400), ("hours", 3600), ("minutes", 60)):
        if seconds >= 2 * length:
            return f"{about(seconds / length)} {unit}"
    return f"{about(seconds)} seconds"
