"""What the stations of a readout say of each other, as the rules of a diagnosis ask for it."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from bussim.engines.nn import codes
from bussim.site.link import SiteLink, SteadyNoise
from bussim.site.readout import START, Readout, Station


@dataclass(frozen=True)
class Witness:
    """The counts, codes and flags of a readout by who tells and whom it is about.

    ``bursts`` is what the ladder says of them: "seen", "not seen" or "cannot tell".
    """

    readout: Readout
    link: SiteLink
    bursts: str = "cannot tell"

    @cached_property
    def numbers(self) -> range:
        """The slaves that the master polls."""
        return range(1, self.readout.settings.slaves + 1)

    @cached_property
    def master(self) -> Station | None:
        """The master, where its registers were read."""
        master = self.readout.at(0)
        return master if master is not None and master.read else None

    @cached_property
    def heard(self) -> tuple[Station, ...]:
        """The slaves whose registers were read, or of which something was seen to climb."""
        return tuple(station for station in self.readout.slaves if station.supposed > 0 and station.read)

    @cached_property
    def listeners(self) -> tuple[Station, ...]:
        """The slaves that take part: they can judge others."""
        return tuple(station for station in self.heard if not self.deaf(station) and not station.halted)

    @cached_property
    def tellers(self) -> tuple[Station, ...]:
        """The slaves that take part, and the master where it was read."""
        return (*self.listeners, *((self.master,) if self.master else ()))

    @cached_property
    def missed_master(self) -> tuple[Station, ...]:
        """The slaves that take part and once heard nothing of the master (code 11)."""
        return tuple(s for s in self.listeners if s.code(0) == codes.MASTER_SILENT)

    @property
    def all_missed(self) -> bool:
        """Whether each slave that takes part missed the master."""
        return bool(self.listeners) and len(self.missed_master) == len(self.listeners)

    @cached_property
    def stopped(self) -> bool:
        """Whether the master does not work now."""
        master = self.readout.at(0)
        return master is not None and (master.halted or master.value("M8191") == 0)

    def missing(self, k: int) -> bool:
        """Whether a slave was away, or is: what others count of it then is no noise."""
        gone = self.master is not None and self.master.flag(k) and self.readout.at(k) not in self.listeners
        return bool(gone or self.absent(k))

    def listed(self, told: Mapping[int, int], about: int = 0) -> str:
        """Counts about a station by who tells them; what has no number is said to climb."""
        climbs = {s.supposed for s in self.heard if s.climbs(about)}
        return ", ".join(f"{j}: {'climbs' if j in climbs else count}" for j, count in told.items())

    @staticmethod
    def seen(station: Station, about: int) -> int | None:
        """Errors counted about a station; what climbs is more than a start leaves."""
        return START + 1 if station.climbs(about) else station.count(about)

    def deaf(self, station: Station) -> str:
        """Why a station that should run hears nothing of the link, "" where it hears."""
        if station.halted:
            return ""
        if station.flag(0) and station.code(0) == codes.MASTER_SILENT:
            return "M8183 is on with code 11"
        if station.value("D8174") == 0:
            return "D8174 = 0, no parameters arrived"
        if station.value("M8191") == 0:
            return "M8191 is off"
        return "its RD lamp is dark" if station.rd == "dark" else ""

    @property
    def flagged(self) -> bool:
        """Whether the master has a flag on."""
        return self.master is not None and any(self.master.flag(k) for k in self.numbers)

    def by_master(self, about: int) -> int:
        """The master's count about a slave, 0 where it was not read."""
        return (self.seen(self.master, about) or 0) if self.master is not None else 0

    def by_slaves(self, about: int) -> dict[int, int]:
        """What listening slaves count about a slave, by their number."""
        return {
            station.supposed: count
            for station in self.listeners
            if station.supposed != about and (count := self.seen(station, about)) is not None
        }

    def common(self, about: int) -> int:
        """The least count about a slave, the master's included: what happened after all had joined."""
        told = list(self.by_slaves(about).values())
        if self.master is not None:
            told.append(self.by_master(about))
        return min(told, default=0)

    @cached_property
    def about_master(self) -> dict[int, int]:
        """D8203 of the listening slaves by number, without one count of code 11."""
        return {
            station.supposed: max(0, count - (station.code(0) == codes.MASTER_SILENT))
            for station in self.listeners
            if (count := self.seen(station, 0)) is not None
        }

    def own_misses(self, station: Station) -> int:
        """Replies that a slave missed and the master did not."""
        return sum(
            max(0, (self.seen(station, about) or 0) - self.by_master(about) - START)
            for about in self.numbers
            if about != station.supposed
        )

    @cached_property
    def master_misses(self) -> int:
        """Replies that are damaged at the master alone: no slave counts them, and code 04 outweighs 01."""
        if self.master is None or not self.listeners:
            return 0
        more = {k: self.by_master(k) - max(self.by_slaves(k).values(), default=0) for k in self.numbers}
        found = {k: count for k, count in more.items() if count > START}
        damaged = sum(self.master.code(k) in (codes.DAMAGED, None) for k in found)
        return sum(found.values()) if 2 * damaged > len(found) else 0

    def absent(self, about: int) -> str:
        """Why a slave that is there now was switched off or not yet on for a while, "" if nothing says so.

        It is counted as silent, and its own D8202 saw none of the long scans that this made.
        """
        named = self.readout.at(about)
        told = {0: self.by_master(about), **self.by_slaves(about)}
        most = self.by_master(about) if self.master is not None else max(told.values())
        if most <= START or named is None or (self.master is not None and self.master.flag(about)):
            return ""
        tellers = [s for j in told if told[j] and (s := self.readout.at(j)) is not None]
        silent = [s for s in tellers if s.code(about) in (codes.NO_REPLY, codes.NOT_IN_NETWORK, None)]
        own, heard = named.value("D8202"), self.about_master
        rest = [count for j, count in heard.items() if j != about]
        if heard.get(about, 0) > START + 2 * min(rest, default=0):
            return ""  # a receiver that misses frames measures no scan with them
        others = [s.value("D8202") or 0 for s in tellers if (s.count(about) or 0) > START]
        if own is None or not others or own >= min(others) or 2 * len(silent) <= len(tellers):
            return ""
        return (
            f"{most} counts about station {about}, its flag is off, and its own D8202 = {own} is below "
            f"that of those that counted ({min(others)} at least)"
        )

    @cached_property
    def errors(self) -> dict[int, int]:
        """Station errors since the last station joined, by slave; of one that was away none can be told.

        There are none where the least D8202 is below a scan with one.
        """
        link, longest = self.link, self.least_longest
        least = link.healthy + link.n * (link.slot + link.model.quiet) - link.slot
        if longest is not None and (longest + 1) * link.model.unit < least:
            return dict.fromkeys(self.numbers, 0)
        return {k: 0 if self.missing(k) else self.common(k) for k in self.numbers}

    @cached_property
    def looks(self) -> list[int]:
        """All looks at D8201 of the stations that take part."""
        return [look for station in self.tellers for look in station.after.looks if look]

    @property
    def always_long(self) -> bool:
        """Whether every look at D8201 is longer than a healthy scan."""
        return bool(self.looks) and min(self.looks) > self.link.normal

    @cached_property
    def staggered(self) -> bool:
        """Whether all counts follow from the stations having been switched on one after the other.

        A slave that came after so many scans counts about each later one what the master counts less those.
        """
        return all(
            abs(count - max(0, self.by_master(about) - self.by_master(teller))) <= START
            for about in self.numbers
            for teller, count in self.by_slaves(about).items()
        )

    @cached_property
    def least_longest(self) -> int | None:
        """The least D8202 of the stations that take part: what was seen after all had joined."""
        told = (station.value("D8202") for station in self.tellers)
        return min((longest for longest in told if longest), default=None)

    def scans(self, ber: float, ticks: int | None = None) -> float:
        """Link scans while it was watched, or in a time, with steady noise on the wire."""
        return (ticks or self.readout.watched) / self.link.mean_scan(SteadyNoise(ber))
