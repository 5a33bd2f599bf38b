"""The time between refreshes of one station's block in another station, which retries do not cover.

A gap runs from reception to reception. In a scan in which the receiver has not heard the source's
block its copy grows one scan older; the master may have heard the same frame, so no flag shows it. The
distribution of a gap is a chain: the rest of the exchange after a reception, the other stations' exchanges,
whole scans without a reception, and the exchange up to the next one. Flags and the line's state go
with it, and what the receiver remembers of the link's frames (:mod:`bussim.exact.bursts.listening`).

Simplified: a reply in which the master read no header and which the receiver took is followed by the rest
of the timeout, which is taken at its longest where turnarounds are not symmetric.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

from bussim.exact.bursts.channel import Matrix
from bussim.exact.bursts.exchange import course_at, poll_path
from bussim.exact.bursts.listening import NOTHING, memory_of
from bussim.exact.bursts.scan_chain import ScanChain
from bussim.exact.bursts.state_mixture import Part, StateMixture, Transitions, failures
from bussim.exact.link import MASTER, LinkModel, Station
from bussim.exact.scan.mixture import Distribution
from bussim.exact.scan.turnaround_sums import MOST, spread_of
from bussim.exact.solve import Solved

#: Components lighter than this are dropped. A chain ends when so little of it is left, or after so many
#: scans.
FLOOR = 1e-17
ENOUGH = 1e-15
LONGEST_CHAIN = 60
#: So many scans show how much of a chain each one leaves; so many that it is above a tenth.
_SETTLED, _MOSTLY = 4, 2


@dataclass(frozen=True, slots=True, eq=False)
class GapDistribution:
    """The distribution of the time between refreshes of one (source, receiver) pair.

    ``distribution`` in ticks; its ``lost`` weight is the chance of a gap longer than the chain that was
    worked out. ``per_scan`` is the expected number of receptions a link scan.
    """

    source: int
    receiver: int
    distribution: Distribution
    per_scan: float


def pairs(model: LinkModel) -> list[tuple[int, int]]:
    """The (source, receiver) pairs that are refreshed at all, by station numbers."""
    sources = [MASTER, *(station.number for station in model.alive)]
    hearing = [s.number for s in (*model.stations, *model.listeners) if s.hears]
    return [(s, r) for s in sources for r in (MASTER, *hearing) if s != r]


def gap_distributions(
    solved: Solved,
    floor: float = FLOOR,
    *,
    by_position: bool = True,
    resolved: float = 5e-4,
    progress: Callable[[str, int, int], None] | None = None,
) -> dict[tuple[int, int], GapDistribution]:
    """The distributions of all pairs; components lighter than ``floor`` are dropped.

    Pairs that do not differ share one distribution. Equal stations at different positions in the scan
    differ only by where a parameter frame falls (4 ms at the chance of an error); without ``by_position``
    and bursts they share the first one's distribution as well. A chain that would leave more than
    ``resolved`` of the gaps is given up.
    """
    model = solved.model
    known: dict[tuple[object, ...], GapDistribution] = {}
    found, every = {}, pairs(model)
    for number, (source, receiver) in enumerate(every):
        if progress is not None:
            progress("refresh gaps", number, len(every))
        key = _alike(model, source, receiver, by_position=by_position)
        if key not in known:
            known[key] = gap_distribution(solved, source, receiver, floor, resolved)
        found[source, receiver] = replace(known[key], source=source, receiver=receiver)
    return found


def _alike(model: LinkModel, source: int, receiver: int, *, by_position: bool) -> tuple[object, ...]:
    noise = model.noise
    receiving = ("master",) if receiver == MASTER else noise.in_receiver(receiver)
    if source == MASTER:
        return (MASTER, receiving, noise.on_wire(MASTER))
    station = model.station(source)
    return (
        source if by_position or not noise.memoryless else 0,
        replace(station, number=0, name="", scan=0),
        receiving,
        noise.on_wire(source),
        noise.in_receiver(source),
        # What a listener remembers depends on the places of both.
        (source, receiver) if memory_of(model, receiver) is not NOTHING else None,
    )


def gap_distribution(
    solved: Solved, source: int, receiver: int, floor: float = FLOOR, resolved: float = 5e-4
) -> GapDistribution:
    """The distribution of the time between refreshes of a source's block in a receiver (station numbers)."""
    if source == MASTER:
        return _Gaps(solved.chain, floor, resolved).of_master(receiver)
    gaps = _Gaps(solved.chain_of(receiver), floor, resolved)
    return gaps.of_slave(solved.model.station(source), receiver)


#: What a scan takes of components that wait for a reception, and what is left of them.
_Scan = tuple[list[StateMixture], StateMixture]


class _Gaps:
    def __init__(self, chain: ScanChain, floor: float, resolved: float) -> None:
        self.chain, self.floor, self.resolved = chain, floor, resolved

    def of_master(self, receiver: int) -> GapDistribution:
        """The gaps of the master's data frames."""
        model = self.chain.model
        outcome = self.chain.line.outcome(poll_path(model, receiver), model.data_bits)
        missed, taken = (Transitions.single(model.data, end) for end in (outcome.hit, outcome.clean))

        def scan(components: StateMixture) -> _Scan:
            return [components.then(taken, self.floor)], components.then(missed, self.floor)

        heard = self.chain.begun().times(outcome.clean)
        distribution = self._distribution([], heard, None, heard.total, scan)
        return GapDistribution(MASTER, receiver, distribution, heard.total)

    def of_slave(self, station: Station, receiver: int) -> GapDistribution:
        """The gaps of a slave's replies."""
        chain, floor = self.chain, self.floor
        source = _Source(chain, station, receiver)
        found: list[StateMixture] = []
        after: list[StateMixture] = []  # at the end of an exchange that the gap began in
        scale = 0.0
        for components, attempts in chain.by_attempts(chain.begun_exchange(station), station):
            before = components
            for left in range(attempts - 1, -1, -1):
                over = before.times(source.course.clean[0] @ source.attempt.over)
                scale += over.total
                after.append(over)
                for matrix, wait in source.followed():
                    again = before.times(matrix)
                    if again.total == 0:
                        continue
                    scale += again.total
                    again = again.then(wait, floor)
                    if left:
                        found.append(again.then(source.taken(left), floor))
                    after.append(again.then(source.missed(left), floor))
                before = before.times(source.attempt.failed)

        def scan(components: StateMixture) -> _Scan:
            parts = chain.by_attempts(components, station)
            missed = [part.then(source.missed(attempts), floor) for part, attempts in parts]
            taken = [part.then(source.taken(attempts), floor) for part, attempts in parts]
            return taken, missed[0].mixed(*missed[1:])

        distribution = self._distribution(found, after[0].mixed(*after[1:]), station, scale, scan)
        return GapDistribution(station.number, receiver, distribution, scale)

    def _distribution(
        self,
        found: list[StateMixture],
        components: StateMixture,
        station: Station | None,
        scale: float,
        scan: Callable[[StateMixture], _Scan],
    ) -> Distribution:
        """The distribution of gaps that ended in the exchange they began in, and of those that did not."""
        chain, model = self.chain, self.chain.model
        components = chain.rest(components, station, self.floor)
        # The counts of a chain's spreads must fit a code.
        most = min(LONGEST_CHAIN, MOST // max(1, len(model.alive) * (model.attempts + 1)) - 1)
        for number in range(1, most + 1):
            taken, missed = scan(components)
            found += taken
            before, components = components.total, chain.rest(missed, station, self.floor)
            if components.total <= ENOUGH:
                break
            left = components.total * (components.total / before) ** (most - number)
            if left > self.resolved * scale and number >= (_MOSTLY if 10 * left > scale else _SETTLED):
                break
        return found[0].mixed(*found[1:]).distribution(chain.sums, scale or 1.0)


class _Source:
    """The exchange with a gap's source, as its receiver and the master have it."""

    def __init__(self, chain: ScanChain, station: Station, receiver: int) -> None:
        self.chain, self.model = chain, chain.model
        self.course = course_at(chain.line, self.model, station, receiver, chain.memory)
        self.attempt = chain.attempt(station)
        self._mark = chain.mark(station)
        least, self._width = spread_of(station.turnaround)
        # Up to a reply's end; from there to the deadline.
        self._whole, self._unit = (
            float(self.model.replied(station) + least),
            chain.sums.unit(station.turnaround),
        )
        self._left = chain.after(max(0.0, self.model.timeout - station.average - station.reply))
        self._values = bool(station.turnaround.values)

    def followed(self) -> list[tuple[Matrix, Transitions]]:
        """Replies that only the receiver took, and what follows up to the next attempt."""
        course, model = self.course, self.model
        quiet = self.chain.after(model.quiet)
        found = [(both[0], Transitions.single(later, quiet, code)) for later, code, both in course.torn]
        rest = float(model.silent_cost) - self._whole
        if self._unit and not self._values:
            return [
                *found,
                (course.headless[0], Transitions.single(rest - self._width, self._left, self._unit)),
            ]
        return [*found, (course.headless[0], Transitions.single(rest, self._left))]

    def taken(self, attempts: int) -> Transitions:
        """An exchange up to the first reception."""
        _, clean, headless, torn = self.course
        takes = clean[0] + headless[0] + sum(both[0] for _, _, both in torn)
        levels = self._failures(max(attempts - 1, 0))
        return Transitions.of(
            [(s + self._whole, c + self._unit, m @ takes) for level in levels for s, c, m in level]
        )

    def missed(self, attempts: int) -> Transitions:
        """An exchange of which the receiver takes nothing: replied, or in error, which sets the mark."""
        levels, over = self._failures(attempts), self.attempt.over
        clean = self.course.clean[1] @ over
        parts = [(s + self._whole, c + self._unit, m @ clean) for level in levels[:-1] for s, c, m in level]
        return Transitions.of(parts + [(s, c | self._mark, m @ over) for s, c, m in levels[-1]])

    def _failures(self, most: int) -> list[list[Part]]:
        """Components of failed attempts of whose replies the receiver takes none."""
        model, course = self.model, self.course
        silent = course.unsent @ self.chain.after(model.timeout) + course.headless[1] @ self._left
        quiet = self.chain.after(model.quiet)
        whole, unit = self._whole, self._unit
        torn = [(whole + later, unit + code, both[1] @ quiet) for later, code, both in course.torn]
        return failures([(float(model.silent_cost), 0, silent), *torn], most)
