"""A link played out attempt by attempt, bit errors drawn one by one: knows nothing of distributions."""

from __future__ import annotations

import math
import random
from bisect import bisect_right
from dataclasses import dataclass, field

from bussim.exact.link import LinkModel, NoiseSource, Station

BIT = 1875


class Chain:
    """States of one burst over time."""

    def __init__(self, means: tuple[float, float], rng: random.Random) -> None:
        self.means, self.rng = means, rng
        self.first = 1 if rng.random() * sum(means) < means[1] else 0
        self.ends: list[float] = []
        self._more()

    def _more(self) -> None:
        state = (self.first + len(self.ends)) & 1
        self.ends.append((self.ends[-1] if self.ends else 0.0) + self.rng.expovariate(1 / self.means[state]))

    def at(self, tick: float) -> tuple[int, float]:
        """The state at a tick and when it ends."""
        while self.ends[-1] <= tick:
            self._more()
        index = bisect_right(self.ends, tick)
        return (self.first + index) & 1, self.ends[index]


@dataclass
class Played:
    """What was seen. Ticks."""

    scans: list[float] = field(default_factory=list)
    errors: dict[int, int] = field(default_factory=dict)
    onsets: dict[int, int] = field(default_factory=dict)
    gaps: dict[tuple[int, int], list[float]] = field(default_factory=dict)


class Player:
    """Plays link scans of a model with its own random numbers."""

    def __init__(self, model: LinkModel, seed: int) -> None:
        self.model = model
        self.rng = random.Random(seed)
        self.chains = [Chain(means, self.rng) for means in model.noise.chains]
        self.now = 0.0
        self.flags = {station.number: not station.alive for station in model.stations}
        self.seen = Played()
        self.last: dict[tuple[int, int], float] = {}
        self.receivers = [0, *(s.number for s in model.stations if s.hears)]

    # -- bits --------------------------------------------------------------------------------------

    def _first_hit(self, sources: tuple[NoiseSource, ...], start: float, bits: int) -> int:
        """The first inverted bit of a frame, ``bits`` if there is none."""
        first = bits
        for source in sources:
            at = 0
            while at < first:
                if source.chain is None:
                    rate, until = source.good, math.inf
                else:
                    state, until = self.chains[source.chain].at(start + BIT * (at + 0.5))
                    rate = source.bad if state else source.good
                stay = max(1, math.ceil((until - start) / BIT - 0.5 - at)) if until < math.inf else first - at
                if rate > 0:
                    skip = 0 if rate >= 1 else int(math.log(1 - self.rng.random()) / math.log1p(-rate))
                    if skip < stay:
                        first = min(first, at + skip)
                        break
                at += stay
        return first

    def _wire(self, sender: int) -> tuple[NoiseSource, ...]:
        return tuple(
            s for s in self.model.noise.sources if s.part == "bus" or (s.part == "tx" and s.station == sender)
        )

    def _receiver(self, receiver: int) -> tuple[NoiseSource, ...]:
        return tuple(s for s in self.model.noise.sources if s.part == "rx" and s.station == receiver)

    def _turnaround(self, station: Station) -> float:
        distribution = station.turnaround
        if distribution.values:
            return self.rng.choices(distribution.values, distribution.weights)[0] + station.extra
        return distribution.mean + distribution.jitter * (2 * self.rng.random() - 1) + station.extra

    # -- frames ------------------------------------------------------------------------------------

    def _refresh(self, source: int, receiver: int, tick: float) -> None:
        key = (source, receiver)
        if key in self.last:
            self.seen.gaps.setdefault(key, []).append(tick - self.last[key])
        self.last[key] = tick

    def _attempt(self, station: Station) -> bool:
        model = self.model
        self.now += model.gap
        start = self.now
        self.now += model.poll
        deadline = self.now + model.timeout
        bits = model.poll_bits
        polled = self._first_hit(self._wire(0) + self._receiver(station.number), start, bits) == bits
        if not station.alive or not polled or self.rng.random() < station.loss:
            self.now = deadline
            return False
        start = self.now + self._turnaround(station)
        end = start + station.reply
        bits = model.data_bits
        wire = self._first_hit(self._wire(station.number), start, bits)
        for receiver in self.receivers:
            if receiver not in (0, station.number):
                own = self._first_hit(self._receiver(receiver), start, bits)
                if min(wire, own) == bits:
                    self._refresh(station.number, receiver, end)
        hit = min(wire, self._first_hit(self._receiver(0), start, bits))
        if hit == bits:
            self._refresh(station.number, 0, end)
            self.now = end
            return True
        self.now = deadline if hit < 10 else end + model.quiet
        return False

    def scan(self) -> None:
        """One link scan, from the start of the master's data frame."""
        model, start = self.model, self.now
        wire = self._first_hit(self._wire(0), start, model.data_bits)
        self.now += model.data
        for receiver in self.receivers:
            if (
                receiver
                and min(wire, self._first_hit(self._receiver(receiver), start, model.data_bits))
                == model.data_bits
            ):
                self._refresh(0, receiver, self.now)
        for station in model.stations:
            number = station.number
            attempts = model.attempts_at(flagged=self.flags[number])
            good = any(self._attempt(station) for _ in range(attempts))
            if not good:
                self.seen.errors[number] = self.seen.errors.get(number, 0) + 1
                if not self.flags[number]:
                    self.seen.onsets[number] = self.seen.onsets.get(number, 0) + 1
            self.flags[number] = not good
        self.now += model.overhead
        if any(self.flags.values()):
            self.now += model.gap + model.parameters
        self.now += model.gap
        self.seen.scans.append(self.now - start)


def play(model: LinkModel, scans: int, seed: int) -> Played:
    """So many scans, a few more before them to forget the beginning."""
    player = Player(model, seed)
    for _ in range(20):
        player.scan()
    player.seen = Played()
    player.last.clear()
    for _ in range(scans):
        player.scan()
    return player.seen
