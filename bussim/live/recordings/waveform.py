"""The level of a line over time: its bit, its idle level, and its characters.

Times are samples, integers; a waveform is the samples at which the level changes (its edges).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from bussim.engines.contract import RxChar
from bussim.line.characters import CharFormat, LineTiming
from bussim.live.arrival import GOOD, Timed
from bussim.units import TICKS_PER_SECOND

if TYPE_CHECKING:
    import numpy as np

#: Rates that lines have: those of serial ports, MIDI's, and one between.
STANDARD = (
    *(300, 600, 1200, 2400, 4800, 7200, 9600, 14400, 19200, 28800, 31250, 38400, 57600, 76800, 115200),
    *(230400, 460800, 921600),
)
#: A measured rate so close to a standard one is that one.
_CLOSE = 0.025
#: Distances of edges are used up to so many bits: those of one character.
_INSIDE = 11
#: A share of them must be whole bits within so much of a bit, and so many of one bit.
_WHOLE, _WITHIN, _SINGLE = 0.95, 0.25, 0.02
#: A pulse shorter than so much of a bit is no bit; at most this share of edges may belong to such.
SPIKE, _MOST_SPIKES = 0.4, 0.05
#: A level that lasts longer than so many bits is a pause.
_PAUSE = 12
_LEAST = 10


class Measured(NamedTuple):
    """What the edges of a channel show: bits a second (``standard``: by its name) and the level of pauses.

    ``fits``: the distances of edges are whole numbers of bits; else the rate is the likeliest of none.
    ``inverted`` is None where there is no pause, or most pauses have one level, most of their time the other.
    """

    baud: int
    standard: bool
    inverted: bool | None
    fits: bool


def measure(edges: np.ndarray, rate: int, samples: int) -> Measured | None:
    """The line that a channel's edges are of; None of too few edges, or of less than a bit a second.

    Before the first edge the level is high. ``rate`` is in samples a second, ``samples`` their number.
    """
    import numpy as np

    if len(edges) < _LEAST:
        return None
    apart = np.diff(edges)
    guesses = [rate / baud for baud in STANDARD]
    guesses += [float(guess) for guess in np.percentile(apart, (1, 3, 6, 10, 20, 30))]
    bits = sorted(filter(None, (_fitted(edges, guess) for guess in guesses)), reverse=True)
    fits = bool(bits)
    bits = bits or [max(1.0, float(np.percentile(apart, 3)))]
    measured = rate / bits[0]
    if measured < 1:
        return None
    near = min(STANDARD, key=lambda baud: abs(baud / measured - 1))
    standard = abs(near / measured - 1) <= _CLOSE
    levels = (1 + np.arange(len(edges) + 1)) & 1  # before the first edge, …, behind the last
    lasted = np.diff(edges, prepend=0, append=samples)
    pauses = lasted > _PAUSE * bits[0]
    high = pauses & (levels == 1)
    votes = {bool(2 * high.sum() < pauses.sum()), bool(2 * lasted[high].sum() < lasted[pauses].sum())}
    inverted = votes.pop() if pauses.any() and len(votes) == 1 else None
    return Measured(near if standard else round(measured), standard, inverted, fits)


def _fitted(edges: np.ndarray, bit: float) -> float | None:
    """The bit (samples) close to a guess that most distances of edges are whole numbers of."""
    import numpy as np

    for _ in range(3):
        if int((np.diff(edges) < SPIKE * bit).sum()) > _MOST_SPIKES * len(edges):
            return None  # at least so many edges would be left out
        kept, spikes = without_spikes(edges, SPIKE * bit)
        if spikes > _MOST_SPIKES * len(edges):
            return None
        apart = np.diff(kept)
        apart = apart[apart < _INSIDE * bit]
        if len(apart) < _LEAST:
            return None
        bits = np.maximum(np.rint(apart / bit), 1)
        whole = np.abs(apart - bits * bit) <= _WITHIN * bit + 1e-9
        if whole.mean() < _WHOLE or (bits == 1).mean() < _SINGLE:
            return None
        bit = float((apart * bits).sum() / (bits * bits).sum())
    return bit


def without_spikes(edges: np.ndarray, shortest: float) -> tuple[np.ndarray, int]:
    """Edges without the pairs that are closer than ``shortest`` samples, and how many were left out."""
    import numpy as np

    if not len(edges) or int(np.diff(edges).min(initial=1 << 40)) >= shortest:
        return edges, 0
    kept: list[int] = []
    for edge in edges.tolist():
        if kept and edge - kept[-1] < shortest:
            kept.pop()
        else:
            kept.append(edge)
    return np.array(kept, dtype=np.int64), len(edges) - len(kept)


class Receiver:
    """A UART at a rate and format, fed with edges: characters with verdicts, in ticks.

    It starts on a falling edge, samples at bit centres, and is ready again at the middle of the (first) stop
    bit. A start bit that is high at its centre was a glitch. With two stop bits both are sampled.
    ``rate`` is in samples a second; ``inverted``: the line idles low. The level before the first edge is
    high.
    """

    def __init__(self, timing: LineTiming, rate: int, *, inverted: bool) -> None:
        import numpy as np

        form = timing.format
        self._rate, self._bit = rate, rate / timing.baud
        self._middle = (form.bits - form.stop_bits + 0.5) * self._bit  # of the first stop bit
        self._centres = (np.arange(form.bits) + 0.5) * self._bit
        self._weights = 1 << np.arange(form.bits - 1)
        self._ticks = timing.characters(1)
        self._table = _table(form)
        # Edges to the level of a start bit have even indices.
        self._edges = np.zeros(int(inverted), dtype=np.int64)
        self._ready = 0.0

    def feed(self, edges: np.ndarray, until: float) -> list[Timed]:
        """The characters that are whole before a sample, up to which all ``edges`` are known."""
        import numpy as np

        kept = np.concatenate((self._edges, edges))
        starts = kept[::2]
        starts = starts[: np.searchsorted(starts, until - self._centres[-1])]
        # Of every start: whether it is a glitch, and which start comes next if a character begins there.
        low = np.searchsorted(kept, starts + self._centres[0]) % 2 == 1
        ready = starts + np.where(low, self._middle, self._bit / 2)
        following = np.searchsorted(starts, ready).tolist()
        begun, at = [], int(np.searchsorted(starts, self._ready))
        last = len(starts)
        while at < last:
            begun.append(at)
            at = following[at]
        if begun:
            self._ready = float(ready[begun[-1]])
        first = np.array(begun, dtype=np.int64)[low[begun]]
        levels = 1 - np.searchsorted(kept, starts[first, None] + self._centres[1:]) % 2
        seconds, samples = np.divmod(starts[first], self._rate)
        ticks = seconds * TICKS_PER_SECOND + (2 * samples * TICKS_PER_SECOND + self._rate) // (2 * self._rate)
        chars = map(self._table.__getitem__, (levels @ self._weights).tolist())
        found = list(zip(chars, ticks.tolist(), (ticks + self._ticks).tolist(), strict=True))
        # An edge whose partner is still to come stays: edges to a start bit's level have even indices.
        self._edges = kept[min(2 * last, len(kept) & ~1) :]
        return found


def _table(form: CharFormat) -> list[RxChar]:
    """Characters by the levels behind the start bit, the first one lowest."""
    found = []
    for word in range(1 << (form.bits - 1)):
        value = word & ((1 << form.data_bits) - 1)
        rest = word >> form.data_bits
        parity_ok = form.parity == "N" or rest & 1 == form.parity_bit(value)
        stops = rest >> (form.parity != "N")
        stop_ok = stops == (1 << form.stop_bits) - 1
        found.append(GOOD[value] if parity_ok and stop_ok else RxChar(value, parity_ok, stop_ok))
    return found
