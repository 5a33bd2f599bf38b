"""A link scan as a chain from scan to scan, with the channel's state and the flags that matter.

Used for the distribution on a line with bursts, and on any line for what spans several scans. Attempts
are correlated through the channel's state, which moves on in real time: a retry after a short timeout meets
the same burst again. A scan is a product of matrices; its start has the stationary distribution of the
chain of scan starts (not the distribution at a random instant: scans that meet a burst last longer, so
fewer of them begin in one). With the policy ``probe`` that chain also holds which flags are on.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bussim.engines.nn.frames import PARAMETERS_CHARS
from bussim.exact.bursts.channel import Matrix
from bussim.exact.bursts.exchange import (
    Attempt,
    Exchange,
    alike,
    attempt_at,
    exchange_at,
    line_of,
    poll_path,
    sums_of,
)
from bussim.exact.bursts.listening import memory_of
from bussim.exact.bursts.state_mixture import MARK, StateMixture, Transitions, exchange_transitions
from bussim.exact.link import CHAR_BITS, MASTER, LinkModel, NoiseSource, Station
from bussim.exact.scan.memoryless import Fails
from bussim.exact.scan.mixture import Distribution
from bussim.exact.scan.turnaround_sums import spread_of

#: Components lighter than this are dropped; with bursts there are many.
FLOOR = 1e-18

#: Bits of a parameter frame.
PARAMETERS_BITS = CHAR_BITS * PARAMETERS_CHARS


class _Passed(NamedTuple):
    """What one scan did.

    ``end``: weights at the next one's start; ``errors`` and ``onsets`` (only where flags are
    remembered): those of each station's being in error, and newly so; ``before``: weights at the
    start of each station's exchange, and ``marked`` those of them after an error in this scan (where
    flags are not remembered).
    """

    end: NDArray[np.float64]
    errors: tuple[float, ...]
    onsets: tuple[float, ...]
    before: tuple[NDArray[np.float64], ...]
    marked: tuple[NDArray[np.float64], ...]


class ScanChain:
    """A link scan with one setting; without bursts the line has one state.

    With a receiver, a state is that of the line and what that receiver remembers of the link's frames.
    """

    def __init__(self, model: LinkModel, receiver: int = MASTER) -> None:
        self.model = model
        self.line = line = line_of(model)
        self.sums = sums_of(model)
        self.memory = memory = memory_of(model, receiver)
        self.states = len(memory.over) * line.states
        # A listener has the replies of others in another way than its own.
        self._kinds = {s.number: (alike(model, s), s.number == receiver) for s in model.stations}
        self._attempts = {
            kind: attempt_at(line, model, station, receiver, memory)
            for kind, station in {self._kinds[s.number]: s for s in model.stations}.items()
        }
        path, same = poll_path(model, receiver), np.eye(len(memory.over))
        #: Over a data frame of the master, and from the last exchange to it, without and with parameters.
        self.data = self._frame(path, model.data, model.data_bits, memory.data)
        self.plain = np.kron(memory.turned, line.after(model.overhead + model.gap))
        parameters = self._frame(path, model.parameters, PARAMETERS_BITS, memory.parameters)
        self.long = self.plain @ parameters @ np.kron(same, line.after(model.gap))
        self._exchanges: dict[tuple[object, int], Exchange] = {}
        self._transitions: dict[tuple[object, int, int], Transitions] = {}
        # Indices of the flags that a scan's start depends on.
        remembered = model.alive if model.absent.probes else ()
        self._bits = {station.number: bit for bit, station in enumerate(remembered)}
        self.configurations = 1 << len(self._bits)

    def _frame(self, path: Sequence[NoiseSource], ticks: int, bits: int, heard: Matrix) -> Matrix:
        if len(heard) == 1:
            return self.line.after(ticks)
        clean, hit = self.line.outcome(path, bits)
        return np.asarray(np.kron(heard, clean) + np.kron(np.eye(len(heard)), hit), dtype=np.float64)

    def after(self, ticks: float) -> Matrix:
        """Over a time in which no frame is sent."""
        return np.asarray(np.kron(np.eye(len(self.memory.over)), self.line.after(ticks)), dtype=np.float64)

    def attempt(self, station: Station) -> Attempt:
        """The ends of one attempt."""
        return self._attempts[self._kinds[station.number]]

    def exchange(self, station: Station, *, flagged: bool) -> Exchange:
        """The ends of an exchange with a station whose flag is on or off."""
        attempts = self.model.attempts_at(flagged=flagged)
        key = (self._kinds[station.number], attempts)
        if key not in self._exchanges:
            self._exchanges[key] = exchange_at(self.attempt(station), attempts)
        return self._exchanges[key]

    # -- from scan to scan -------------------------------------------------------------------------

    def _pass(self, start: NDArray[np.float64], spared: int | None = None) -> _Passed:
        """Carry weights over (…, flags, state) through one scan.

        With ``spared`` only the scans without an error of that station go on.
        """
        model = self.model
        clean = start @ self.data
        marked = np.zeros_like(clean)
        errors, onsets, before, before_marked = [], [], [], []
        for station in model.stations:
            both = clean + marked
            before.append(both)
            before_marked.append(marked)
            if station.number in self._bits:
                off, on = self.exchange(station, flagged=False), self.exchange(station, flagged=True)
                split = self._split(both, station)
                new, again = split[..., 0, :, :] @ off.error, split[..., 1, :, :] @ on.error
                good = split[..., 0, :, :] @ off.replied + split[..., 1, :, :] @ on.replied
                bad = new + again if station.number != spared else np.zeros_like(new)
                clean, marked = np.stack((good, bad), axis=-3).reshape(both.shape), np.zeros_like(both)
                onsets.append(float(new.sum()))
                errors.append(float((new + again).sum()))
                continue
            exchange = self.exchange(station, flagged=not station.alive)
            bad = both @ exchange.error
            errors.append(float(bad.sum()))
            onsets.append(0.0)
            if station.number == spared:
                bad = np.zeros_like(bad)
            clean, marked = clean @ exchange.replied, marked @ exchange.replied + bad
        if self._bits:
            # The flags themselves show which scans end without one.
            both, without = clean + marked, 0 if model.dead else 1
            clean, marked = np.zeros_like(both), both.copy()
            clean[..., :without, :], marked[..., :without, :] = both[..., :without, :], 0.0
        end = clean @ self.plain + marked @ self.long
        return _Passed(end, tuple(errors), tuple(onsets), tuple(before), tuple(before_marked))

    def _split(self, weight: NDArray[np.float64], station: Station) -> NDArray[np.float64]:
        """Weights (…, flags, state) with an axis of its own, third from the end, for one station's flag."""
        bit = self._bits[station.number]
        shape = (*weight.shape[:-2], self.configurations >> (bit + 1), 2, 1 << bit, self.states)
        return weight.reshape(shape)

    @cached_property
    def start(self) -> NDArray[np.float64]:
        """The stationary weights (flags, state) at the start of a master's data frame."""
        size = self.configurations * self.states
        unit = np.eye(size).reshape(size, self.configurations, self.states)
        step = self._pass(unit).end.reshape(size, size)
        # One equation of (step^T - 1) w = 0 is replaced by: the weights add up to 1.
        system = step.T - np.eye(size)
        system[-1] = 1.0
        right = np.zeros(size)
        right[-1] = 1.0
        try:
            solution = np.linalg.solve(system, right)
        except np.linalg.LinAlgError:
            # A slave that hears nothing keeps what it remembers: mixtures of that are stationary, too.
            solution = np.linalg.lstsq(system, right)[0]
        solution = np.maximum(solution, 0.0)
        # Subtraction above leaves errors near 1e-16; a few steps of the chain wash them out of small weights.
        for _ in range(8):
            solution = solution @ step
        distribution = solution / solution.sum()
        return np.asarray(distribution.reshape(self.configurations, self.states), dtype=np.float64)

    def fails(self) -> tuple[Fails, ...]:
        """The chances of each station, in order; :attr:`Fails.flagged` is 0 here."""
        passed = self._pass(self.start)
        errors, onsets = passed.errors, passed.onsets
        found = []
        for index, station in enumerate(self.model.stations):
            if not station.alive:
                found.append(Fails(1.0, 0.0, 0.0))
            elif station.number in self._bits:
                found.append(Fails.of(errors[index], onsets[index]))
            else:
                without = self._pass(self.start, spared=station.number).end
                found.append(Fails.of(errors[index], self._pass(without).errors[index]))
        return tuple(found)

    # -- the distribution -----------------------------------------------------------------------------------

    def mark(self, station: Station) -> int:
        """The mark that a station's error sets: its own where flags are remembered, else one for all.

        A dead station needs none: its flag is always on.
        """
        return MARK << self._bits.get(station.number, 0) if station.alive else 0

    def transitions(self, station: Station, *, flagged: bool) -> Transitions:
        """The components of an exchange with a station whose flag is on or off."""
        attempts = self.model.attempts_at(flagged=flagged)
        key = (self._kinds[station.number], attempts, self.mark(station))
        if key not in self._transitions:
            model = self.model
            unit = self.sums.unit(station.turnaround) if station.alive else 0
            whole = float(model.replied(station) + spread_of(station.turnaround)[0])
            self._transitions[key] = exchange_transitions(
                self.attempt(station), model.silent_cost, whole, unit, attempts, self.mark(station)
            )
        return self._transitions[key]

    def followed(self, components: StateMixture, station: Station, floor: float) -> StateMixture:
        """Components followed by the exchange with a station, by its flag where that is remembered."""
        if station.number not in self._bits:
            return components.then(self.transitions(station, flagged=not station.alive), floor)
        off, on = components.parted(self.mark(station))
        parts = [
            part.then(self.transitions(station, flagged=flagged), floor)
            for part, flagged in ((off, False), (on, True))
            if part.shift.size
        ]
        return parts[0].mixed(*parts[1:]) if parts else components

    def turned(self, components: StateMixture) -> StateMixture:
        """Components of a scan's end at the next data frame's start, past a parameter frame if due."""
        model = self.model
        on = ((components.code >= MARK) | bool(model.dead))[:, None, None]
        weight = np.where(on, components.weight @ self.long, components.weight @ self.plain)
        plain = model.overhead + model.gap
        shift = components.shift + plain + np.where(on[:, 0, 0], model.parameters_cost, 0)
        return StateMixture(shift, components.code if self._bits else components.code & (MARK - 1), weight)

    def by_attempts(self, components: StateMixture, station: Station) -> list[tuple[StateMixture, int]]:
        """Components by the number of attempts that the station's flag allows (the flag then taken off)."""
        model = self.model
        if not model.absent.probes:
            return [(components, model.attempts)]
        off, on = components.parted(self.mark(station))
        return [(off, model.attempts)] + ([(on, 1)] if on.shift.size else [])

    def rest(self, components: StateMixture, source: Station | None, floor: float) -> StateMixture:
        """From the end of a station's exchange (None: the master's data frame) to its next one's start."""
        model = self.model
        index = -1 if source is None else model.stations.index(source)
        for station in model.stations[index + 1 :]:
            components = self.followed(components, station, floor).thinned(self.sums)
        components = self.turned(components)
        if source is not None:
            components = components.times(self.data, model.data)
        for station in model.stations[: max(index, 0)]:
            components = self.followed(components, station, floor).thinned(self.sums)
        return components

    def begun(self) -> StateMixture:
        """Stationary components, of no length, at a data frame's start, with the flags as marks."""
        flags = np.nonzero(self.start.sum(axis=1) >= FLOOR)[0]
        return StateMixture(np.zeros(flags.size), flags * MARK, self.start[flags][:, None, :])

    def begun_exchange(self, station: Station) -> StateMixture:
        """Stationary components, of no length, at the start of an exchange, marked as the scan left them."""
        passed = self._pass(self.start)
        index = self.model.stations.index(station)
        if self._bits:
            weight = passed.before[index]
            flags = np.nonzero(weight.sum(axis=1) >= FLOOR)[0]
            return StateMixture(np.zeros(flags.size), flags * MARK, weight[flags][:, None, :])
        weight = np.stack((passed.before[index] - passed.marked[index], passed.marked[index]))
        return StateMixture(np.zeros(2), np.array([0, MARK]), weight)

    def distribution(self) -> Distribution:
        """The distribution of a scan, from one master data frame's start to the next one's."""
        model = self.model
        components = self.begun().times(self.data, model.data)
        for station in model.stations:
            components = self.followed(components, station, FLOOR)
        return self.turned(components).distribution(self.sums)
