"""The time between refreshes of one station's block in another station, which retries do not cover.

A gap runs from reception to reception. In a scan in which the receiver has not heard the source's
block its copy grows one scan older; the master may have heard the same frame, so no flag shows it. The
distribution of a gap is a chain: the rest of the exchange after a reception, the other stations' exchanges,
whole scans without a reception, and the exchange up to the next one. Flags and the line's state go
with it.

Simplified: a reply that the master lost to its first character and the receiver took is followed by
the rest of the timeout, which is taken at its longest where turnarounds are not symmetric. After a
dead station's poll a listener must hear the source's own poll to take its reply; with bursts that
chance is taken as independent of the reply's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from bussim.exact.bursts.channel import Matrix
from bussim.exact.bursts.exchange import poll_path
from bussim.exact.bursts.state_mixture import StateMixture, Transitions, failures
from bussim.exact.link import MASTER, LinkModel, Station
from bussim.exact.scan.mixture import Distribution
from bussim.exact.scan.turnaround_sums import spread_of
from bussim.exact.solve import Solved

#: Components lighter than this are dropped. A chain ends when so little of it is left, or after so many
#: scans.
FLOOR = 1e-17
ENOUGH = 1e-15
LONGEST_CHAIN = 60


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


class _Heard(NamedTuple):
    """Attempts at the source by what the receiver and the master had of the reply.

    ``first``: heard, up to the reception; split by what follows: the exchange is over, or so many
    more ticks and then the next attempt. ``missed``: the master alone got it. The rest fails unheard.
    """

    clean: Transitions
    torn: Transitions
    headless: Transitions
    after_torn: Transitions
    after_headless: Transitions
    missed: Transitions
    fails: tuple[tuple[float, int, Matrix], tuple[float, int, Matrix]]


def pairs(model: LinkModel) -> list[tuple[int, int]]:
    """The (source, receiver) pairs that are refreshed at all, by station numbers."""
    sources = [MASTER, *(station.number for station in model.alive)]
    hearing = [s.number for s in (*model.stations, *model.listeners) if s.hears]
    return [(s, r) for s in sources for r in (MASTER, *hearing) if s != r]


def gap_distributions(
    solved: Solved, floor: float = FLOOR, *, by_position: bool = True
) -> dict[tuple[int, int], GapDistribution]:
    """The distributions of all pairs; components lighter than ``floor`` are dropped.

    Pairs that do not differ share one distribution. Equal stations at different positions in the scan
    differ only by where a parameter frame falls (4 ms at the chance of an error); without ``by_position``
    and bursts they share the first one's distribution as well.
    """
    model = solved.model
    known: dict[tuple[object, ...], GapDistribution] = {}
    found = {}
    for source, receiver in pairs(model):
        key = _alike(model, source, receiver, by_position=by_position)
        if key not in known:
            known[key] = gap_distribution(solved, source, receiver, floor)
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
        receiver != MASTER and _needs_poll(model, source),
    )


def _needs_poll(model: LinkModel, source: int) -> bool:
    """Whether a listener must hear the poll as well: the one before is open if its station is dead."""
    return source > 1 and not model.station(source - 1).alive


def gap_distribution(solved: Solved, source: int, receiver: int, floor: float = FLOOR) -> GapDistribution:
    """The distribution of the time between refreshes of a source's block in a receiver (station numbers)."""
    chain = _Chain(solved, floor)
    if source == MASTER:
        return chain.of_master(receiver)
    return chain.of_slave(solved.model.station(source), receiver)


class _Chain:
    def __init__(self, solved: Solved, floor: float) -> None:
        self.model = solved.model
        self.chain = solved.chain
        self.line = solved.chain.line
        self.sums = solved.chain.sums
        self.floor = floor

    # -- the master's data frame -------------------------------------------------------------------

    def of_master(self, receiver: int) -> GapDistribution:
        model = self.model
        outcome = self.line.outcome(poll_path(model, receiver), model.data_bits)
        missed, taken = (
            Transitions.single(model.data, outcome.hit),
            Transitions.single(model.data, outcome.clean),
        )
        heard = self.chain.begun().times(outcome.clean)
        scale = heard.total
        found: list[StateMixture] = []
        components = self._rest(heard, None)
        for _ in range(LONGEST_CHAIN):
            found.append(components.then(taken, self.floor))
            components = self._rest(components.then(missed, self.floor), None)
            if components.total <= ENOUGH:
                break
        distribution = found[0].mixed(*found[1:]).distribution(self.sums, scale)
        return GapDistribution(MASTER, receiver, distribution, scale)

    # -- a slave's reply ---------------------------------------------------------------------------

    def of_slave(self, station: Station, receiver: int) -> GapDistribution:
        heard = self._heard(station, receiver)
        mark = self.chain.mark(station)
        found: list[StateMixture] = []
        after: list[StateMixture] = []  # at the end of an exchange that the gap began in
        scale = 0.0
        for components, attempts in self._by_attempts(self.chain.begun_exchange(station), station):
            before = components
            for left in range(attempts - 1, -1, -1):
                over = before.times(heard.clean.matrix[0])
                scale += over.total
                after.append(over)
                for parts, wait in ((heard.torn, heard.after_torn), (heard.headless, heard.after_headless)):
                    again = before.times(parts.matrix[0])
                    if again.total == 0:
                        continue
                    scale += again.total
                    again = again.then(wait, self.floor)
                    if left:
                        found.append(again.then(self._taken(heard, left), self.floor))
                    after.append(again.then(self._unheard(heard, left, mark), self.floor))
                before = before.times(self._failed(heard))
        components = self._rest(after[0].mixed(*after[1:]), station)
        for _ in range(LONGEST_CHAIN):
            unheard = []
            for part, attempts in self._by_attempts(components, station):
                found.append(part.then(self._taken(heard, attempts), self.floor))
                unheard.append(part.then(self._unheard(heard, attempts, mark), self.floor))
            components = self._rest(unheard[0].mixed(*unheard[1:]), station)
            if components.total <= ENOUGH:
                break
        distribution = found[0].mixed(*found[1:]).distribution(self.sums, scale)
        return GapDistribution(station.number, receiver, distribution, scale)

    def _by_attempts(self, components: StateMixture, station: Station) -> list[tuple[StateMixture, int]]:
        """Components by the number of attempts that the station's flag allows (the flag then taken off)."""
        model = self.model
        if not model.absent.probes:
            return [(components, model.attempts)]
        off, on = components.parted(self.chain.mark(station))
        return [(off, model.attempts)] + ([(on, 1)] if on.shift.size else [])

    def _rest(self, components: StateMixture, source: Station | None) -> StateMixture:
        """From the end of the source's exchange (None: the master's data frame) to its next one's start."""
        model, chain = self.model, self.chain
        index = -1 if source is None else model.stations.index(source)
        for station in model.stations[index + 1 :]:
            components = chain.followed(components, station, self.floor).thinned(self.sums)
        components = chain.turned(components)
        if source is not None:
            components = components.times(self.line.after(model.data), model.data)
        for station in model.stations[: max(index, 0)]:
            components = chain.followed(components, station, self.floor).thinned(self.sums)
        return components

    # -- one attempt at the source -----------------------------------------------------------------

    def _heard(self, station: Station, receiver: int) -> _Heard:
        """One attempt at the source as master and receiver have it."""
        model, line = self.model, self.line
        noise = model.noise
        gap = line.after(model.gap)
        poll = line.outcome(poll_path(model, station.number), model.poll_bits)
        polled = gap @ poll.clean
        replied = (1 - station.loss) * (polled @ line.turnaround(station))
        receiving = () if receiver == MASTER else noise.in_receiver(receiver)
        outcome = line.reply(
            noise.on_wire(station.number), noise.in_receiver(MASTER), receiving, model.data_bits
        )
        nothing = np.zeros_like(gap)
        if receiver == MASTER:
            clean = (outcome.clean[0] + outcome.clean[1], nothing)
            torn, headless = (nothing, sum(outcome.torn)), (nothing, sum(outcome.headless))
        else:
            # A listener whose open poll was not closed takes the reply only if it heard this poll.
            p = 1.0
            if _needs_poll(model, station.number):
                clean_bits = line.outcome(receiving, model.poll_bits).clean.sum(axis=1)
                p = float(line.stationary @ clean_bits)
            clean, torn, headless = (
                (p * heard, missed + (1 - p) * heard)
                for heard, missed in (outcome.clean, outcome.torn, outcome.headless)
            )
        unit = self.sums.unit(station.turnaround)
        least, width = spread_of(station.turnaround)
        whole = float(model.replied(station) + least)
        left = max(0.0, model.timeout - station.average - station.reply)
        wait = line.after(left)
        silent = (gap @ poll.hit + station.loss * polled) @ line.after(model.timeout)
        silent = silent + replied @ headless[1] @ wait
        torn_missed = replied @ torn[1] @ line.after(model.quiet)
        rest = float(model.silent_cost) - whole
        mirrored = not station.turnaround.values and unit != 0
        return _Heard(
            clean=Transitions.single(whole, replied @ clean[0], unit),
            torn=Transitions.single(whole, replied @ torn[0], unit),
            headless=Transitions.single(whole, replied @ headless[0], unit),
            after_torn=Transitions.single(model.quiet, line.after(model.quiet)),
            after_headless=Transitions.single(
                rest - width if mirrored else rest, wait, unit if mirrored else 0
            ),
            missed=Transitions.single(whole, replied @ clean[1], unit),
            fails=((float(model.silent_cost), 0, silent), (whole + model.quiet, unit, torn_missed)),
        )

    def _failed(self, heard: _Heard) -> Matrix:
        """A failed attempt, heard or not, without its time."""
        ended = heard.torn.matrix[0] @ heard.after_torn.matrix[0]
        ended = ended + heard.headless.matrix[0] @ heard.after_headless.matrix[0]
        return np.asarray(ended + heard.fails[0][2] + heard.fails[1][2], dtype=np.float64)

    def _unheard(self, heard: _Heard, attempts: int, mark: int) -> Transitions:
        """An exchange of which the receiver hears nothing: with a reply, or in error, which sets ``mark``."""
        levels = failures(*heard.fails, attempts)
        shift, code, matrix = float(heard.missed.shift[0]), int(heard.missed.code[0]), heard.missed.matrix[0]
        parts = [(s + shift, c + code, m @ matrix) for level in levels[:-1] for s, c, m in level]
        return Transitions.of(parts + [(s, c | mark, m) for s, c, m in levels[-1]])

    def _taken(self, heard: _Heard, attempts: int) -> Transitions:
        """An exchange up to the first reception."""
        levels = failures(*heard.fails, max(attempts - 1, 0))
        takes = heard.clean.matrix[0] + heard.torn.matrix[0] + heard.headless.matrix[0]
        shift, code = float(heard.clean.shift[0]), int(heard.clean.code[0])
        return Transitions.of([(s + shift, c + code, m @ takes) for level in levels for s, c, m in level])
