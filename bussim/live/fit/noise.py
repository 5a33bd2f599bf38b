"""The noise of a line, from the frames that were heard: how often bits are wrong, where, and in groups."""

from array import array
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from math import expm1, log1p

from bussim.live.fit.clusters import MOST_FRAMES, Attempt, Bursts, SeenFrame, bursts_of, two_states
from bussim.live.fit.statistics import Estimate, bit_error_rate, proportion

#: Senders' rates differ if they would by chance less often than this, whatever their number.
_DIFFER = 0.01
#: The number of the master among senders; of a sender that is not known.
MASTER, UNKNOWN = 0, -1
#: A frame that was damaged at the recorder only.
_WITHDRAWN = 2


@dataclass(frozen=True, slots=True)
class MasterReceiver:
    """Replies that were sound on the line and that the master did not take: it asked again.

    ``loss`` is their share. At once it asked where it saw damage (``ber``), after its timeout where it saw
    nothing (``unheard``, a share). All are None where the master asks at no times that would tell a repeat
    from the next turn, all but ``repeats`` where it never repeats.
    """

    repeats: int | None = None
    loss: Estimate | None = None
    unheard: Estimate | None = None
    ber: Estimate | None = None


@dataclass(frozen=True, slots=True)
class NoiseEstimate:
    """The noise of a line. ``senders`` are bit error rates by sender (0: the master) where they differ."""

    ber: Estimate | None
    senders: dict[int, Estimate]
    bursts: Bursts
    master_receiver: MasterReceiver


class FrameLog:
    """Frames in the order in which they were heard; of a damaged one, what should have stood there."""

    def __init__(self, bits: int) -> None:
        self._bits = bits  # of a character
        self._starts, self._ends = array("q"), array("q")
        self._sizes, self._senders, self._kinds = array("l"), array("h"), array("l")
        self._states = bytearray()
        self._numbers: dict[object, int] = {}
        self._common: defaultdict[int, Counter[int]] = defaultdict(Counter)

    def add(self, start: int, end: int, size: int, sender: int, kind: object, *, damaged: bool) -> int:
        """A frame of ``size`` characters; returns its number.

        Frames of one ``kind`` are of one length: a damaged one is as long as the commonest sound one of its
        kind, without one as ``size``.
        """
        number = self._numbers.setdefault(kind, len(self._numbers))
        self._starts.append(start)
        self._ends.append(end)
        self._sizes.append(size)
        self._senders.append(sender)
        self._kinds.append(number)
        self._states.append(damaged)
        if not damaged:
            self._common[number][size] += 1
        return len(self._states) - 1

    def is_of(self, number: int, kind: object) -> None:
        """Say of which kind a damaged frame should have been."""
        self._kinds[number] = self._numbers.setdefault(kind, len(self._numbers))

    def withdraw(self, number: int) -> None:
        """A frame was damaged at the recorder only: it enters no rate."""
        self._states[number] = _WITHDRAWN

    def replies(self) -> Counter[int]:
        """How many sound replies there were, by their bits."""
        rows = zip(self._sizes, self._senders, self._states, strict=True)
        return Counter(size * self._bits for size, sender, state in rows if sender > MASTER and not state)

    def estimate(
        self, attempts: Sequence[Attempt], master_receiver: MasterReceiver, *, timed: bool = True
    ) -> NoiseEstimate:
        """The noise that frames and attempts (in any order) show; ``timed``: their times are known."""
        usual = {number: sizes.most_common(1)[0][0] for number, sizes in self._common.items()}
        rows = zip(self._sizes, self._kinds, self._states, strict=True)
        expected = array(
            "l", ((usual.get(kind, size) if state else size) * self._bits for size, kind, state in rows)
        )
        counts: defaultdict[int, dict[int, list[int]]] = defaultdict(dict)
        for bits, sender, state in zip(expected, self._senders, self._states, strict=True):
            if state != _WITHDRAWN:
                counts[sender].setdefault(bits, [0, 0])[state] += 1
        bursts = bursts_of(sorted(attempts, key=lambda attempt: attempt.start))
        if not timed:
            bursts = replace(bursts, dispersion=None)
        elif bursts.seen:
            frames = zip(self._starts, self._ends, expected, self._states, strict=True)
            seen = (SeenFrame(*row[:3], bool(row[3])) for row in frames if row[3] != _WITHDRAWN)
            bursts = replace(bursts, states=two_states(sorted(islice(seen, MOST_FRAMES))))
        senders = {} if bursts.seen else _senders(counts)
        return NoiseEstimate(_rate(*counts.values()), senders, bursts, master_receiver)


def received(
    sound: Mapping[int, int], damaged: Mapping[int, int], unheard: Mapping[int, int], header: int = 0
) -> MasterReceiver:
    """What the master's receiver makes of sound replies.

    All are numbers of replies by their bits: all of them, those that it saw damaged, and those of which it
    saw nothing. Where damage of the first ``header`` bits hides a frame, and explains the latter, they are
    damaged, too.
    """
    from scipy.stats import binomtest

    replies, number = sum(sound.values()), sum(unheard.values())
    repeats = sum(damaged.values()) + number
    if number and header:
        share = header * repeats / sum(bits * (damaged.get(bits, 0) + unheard.get(bits, 0)) for bits in sound)
        if binomtest(number, repeats, min(1.0, share), "greater").pvalue >= _DIFFER:
            damaged = {bits: damaged.get(bits, 0) + unheard.get(bits, 0) for bits in sound}
            number = 0
    if not replies:
        return MasterReceiver()
    ber = bit_error_rate(
        {bits: (count - damaged.get(bits, 0), damaged.get(bits, 0)) for bits, count in sound.items()}
    )
    return MasterReceiver(repeats, proportion(repeats, replies), proportion(number, replies), ber)


def _rate(*counts: dict[int, list[int]]) -> Estimate | None:
    """The bit error rate of all frames; each mapping has numbers of sound and damaged ones by their bits."""
    total: dict[int, tuple[int, int]] = {}
    for each in counts:
        for bits, (sound, damaged) in each.items():
            before = total.get(bits, (0, 0))
            total[bits] = before[0] + sound, before[1] + damaged
    return bit_error_rate(total)


def _senders(counts: dict[int, dict[int, list[int]]]) -> dict[int, Estimate]:
    """The bit error rate of each sender's frames; empty where they do not differ.

    Of all damage the share of one sender is binomial if all have one rate.
    """
    from scipy.stats import binomtest

    known = {sender: of for sender, of in counts.items() if sender != UNKNOWN}
    whole = _rate(*known.values())
    if len(known) < 2 or whole is None or not 0 < whole.value < 0.5:
        return {}
    damage = {sender: sum(bad for _, bad in of.values()) for sender, of in known.items()}
    likely = {
        sender: -sum((good + bad) * expm1(bits * log1p(-whole.value)) for bits, (good, bad) in of.items())
        for sender, of in known.items()
    }
    number, everything = sum(damage.values()), sum(likely.values())
    p = min(binomtest(damage[sender], number, likely[sender] / everything).pvalue for sender in known)
    if p * len(known) >= _DIFFER:
        return {}
    found = {sender: _rate(of) for sender, of in sorted(known.items())}
    return {sender: rate for sender, rate in found.items() if rate is not None}
