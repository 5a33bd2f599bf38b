"""A link played out attempt by attempt, bit errors drawn one by one: knows nothing of distributions."""

from __future__ import annotations

import math
import random
from bisect import bisect_right
from dataclasses import dataclass, field

from bussim.engines.nn.frames import ETX, STX
from bussim.exact.link import LinkModel, NoiseSource, Station
from bussim.line.characters import NN_LINE
from bussim.line.uart import Uart
from bussim.line.wave import Wave, low_intervals

BIT = 1875
UART = Uart(NN_LINE)


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
    #: Station, begin, end, begin and end of a reply if there was one, whether it arrived.
    attempts: list[tuple[int, float, float, tuple[float, float] | None, bool]] = field(default_factory=list)


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
        self.damage: dict[int, set[int]] = {}
        # The scan's counter; of each receiver the poll without a reply, and the latest counter of the master.
        self.count = 0
        self.open: dict[int, tuple[int, int] | None] = dict.fromkeys(self.receivers)
        self.counter = dict.fromkeys(self.receivers, -1)

    # -- bits --------------------------------------------------------------------------------------

    def _hits(self, sources: tuple[NoiseSource, ...], start: float, bits: int) -> set[int]:
        """The inverted bits of a frame; one that is inverted twice is right again."""
        hits: set[int] = set()
        for source in sources:
            at = 0
            while at < bits:
                if source.chain is None:
                    rate, until = source.good, math.inf
                else:
                    state, until = self.chains[source.chain].at(start + BIT * (at + 0.5))
                    rate = source.bad if state else source.good
                stay = max(1, math.ceil((until - start) / BIT - 0.5 - at)) if until < math.inf else bits - at
                place = at
                while rate > 0:
                    skip = 0 if rate >= 1 else int(math.log(1 - self.rng.random()) / math.log1p(-rate))
                    place += skip
                    if place >= min(at + stay, bits):
                        break
                    hits ^= {place}
                    place += 1
                at += stay
        return hits

    def _read(self, hits: set[int]) -> tuple[bool, float]:
        """Whether a clean header is read of a damaged reply of zeros, and when its last character ends."""
        station, counter, high, low = self.rng.choices(b"0123456789ABCDEF", k=4)
        zeros = b"0" * (self.model.data_bits // 10 - 6)
        wave = Wave([low_intervals(bytes((STX, station, counter, *zeros, ETX, high, low)), NN_LINE, 0, hits)])
        header, ready, end = False, 0, 0
        while (char := UART.next_character(wave, ready)) is not None:
            header |= char.value == STX and char.parity_ok and char.stop_ok
            ready, end = char.ready, char.end
        return header, end

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

    def _sent(self, sender: int, start: float, bits: int) -> dict[int, bool]:
        """Which stations hear a frame undamaged."""
        wire = self._hits(self._wire(sender), start, bits)
        own = {number: self._hits(self._receiver(number), start, bits) for number in self.receivers}
        self.damage = {number: wire ^ own[number] for number in self.receivers if number != sender}
        return {number: not hits for number, hits in self.damage.items()}

    def _attempt(self, station: Station) -> bool:
        model, number, polled = self.model, station.number, self.now
        self.now += model.gap
        start = self.now
        self.now += model.poll
        deadline = self.now + model.timeout
        heard = self._sent(0, start, model.poll_bits)
        for receiver, whole in heard.items():
            if whole:
                self.open[receiver], self.counter[receiver] = (number, self.count), self.count
        if not station.alive or not heard.get(number) or self.rng.random() < station.loss:
            self.now = deadline
            self.seen.attempts.append((number, polled, deadline, None, False))
            return False
        start = self.now + self._turnaround(station)
        end = start + station.reply
        heard = self._sent(number, start, model.data_bits)
        for receiver, whole in heard.items():
            mine = self.open[receiver]
            # The reply to the open poll; without one, what carries the counter of the master's latest frame.
            if receiver and whole and (mine == (number, self.count) or self._idle(receiver)):
                self._refresh(number, receiver, end)
                self.open[receiver] = None
        self.open[number] = None
        if heard[0]:
            self._refresh(number, 0, end)
            self.now = end
        else:
            header, last = self._read(self.damage[0])
            self.now = start + last + model.quiet if header else deadline
        self.seen.attempts.append((number, polled, self.now, (start, end), heard[0]))
        return heard[0]

    def _idle(self, receiver: int) -> bool:
        return self.open[receiver] is None and self.counter[receiver] == self.count

    def scan(self) -> None:
        """One link scan, from the start of the master's data frame."""
        model, start = self.model, self.now
        for receiver, whole in self._sent(0, start, model.data_bits).items():
            if whole:
                self._refresh(0, receiver, start + model.data)
                self.open[receiver], self.counter[receiver] = None, self.count
        self.now += model.data
        for station in model.stations:
            number = station.number
            attempts = model.attempts_at(flagged=self.flags[number])
            good = any(self._attempt(station) for _ in range(attempts))
            if not good:
                self.seen.errors[number] = self.seen.errors.get(number, 0) + 1
                if not self.flags[number]:
                    self.seen.onsets[number] = self.seen.onsets.get(number, 0) + 1
            self.flags[number] = not good
        self.count = (self.count + 1) % 16
        self.now += model.overhead
        if any(self.flags.values()):
            for receiver, whole in self._sent(0, self.now + model.gap, 140).items():
                if whole:
                    self.counter[receiver] = self.count
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
