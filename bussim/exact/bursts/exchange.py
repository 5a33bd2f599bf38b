"""One attempt at a station, and all the attempts of one exchange, as matrices over the line's state.

How an attempt ends (the engines' rules): replied, one character after the other undamaged; *torn*,
the reply damaged, but a clean header was read, which fails it two quiet characters after the last
character that is read; else *silent*: the poll was hit, the reply lost, or no header read, and the attempt
runs to its deadline. What a damaged reply is read as: :mod:`bussim.exact.bursts.reading`.

Neglected are frames that are damaged and yet valid. That takes at least four inverted bits, two in each of
two characters, so that parity and sum are both kept: less than 4e-4 × (bits × BER)^4 / 24 a frame. How far a
torn reply's end is shifted (by nine bits at most) is taken as independent of the line's state; whether it
is shifted is not.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from bussim.exact.bursts.channel import Line, Matrix, ReplyOutcome
from bussim.exact.bursts.listening import NOTHING, Memory
from bussim.exact.bursts.reading import ENDS
from bussim.exact.link import CHAR_BITS, MASTER, LinkModel, NoiseSource, Station, frame_ticks
from bussim.exact.scan.turnaround_sums import TurnaroundSums
from bussim.plc.profiles import Turnaround

#: With bursts, the part of the torn replies whose end must be shifted for these to be kinds of their own.
_OFTEN = 0.1


#: Matrices of a reply that a receiver takes, and of one that it does not.
Pair = tuple[Matrix, Matrix]


class Course(NamedTuple):
    """What one attempt comes to, from its start (the gap before the poll).

    ``unsent``: no reply, up to the poll's end; else by what the master reads, up to the reply's end.
    ``torn`` ones by ticks from there to the attempt's end and the code of what is spread of these.
    """

    unsent: Matrix
    clean: Pair
    headless: Pair
    torn: tuple[tuple[int, int, Pair], ...]


class Attempt(NamedTuple):
    """The ends of an attempt, from its start to its end; ``torn`` as in :class:`Course`.

    ``over`` is what the end of an exchange changes; attempts with a reply have it in them.
    """

    replied: Matrix
    silent: Matrix
    torn: tuple[tuple[int, int, Matrix], ...]
    over: Matrix

    @property
    def failed(self) -> Matrix:
        """Silent or torn."""
        return np.asarray(self.silent + sum(matrix for _, _, matrix in self.torn), dtype=np.float64)


class Exchange(NamedTuple):
    """The ends of an exchange: a reply to some attempt, or the station in error."""

    replied: Matrix
    error: Matrix


def line_of(model: LinkModel) -> Line:
    """The matrices of a link's noise."""
    return Line(model.noise, frame_ticks(1) / CHAR_BITS)


def reply_path(model: LinkModel, station: Station, receiver: int) -> tuple[NoiseSource, ...]:
    """What damages a station's reply on its way to one receiver."""
    return model.noise.on_wire(station.number) + model.noise.in_receiver(receiver)


def poll_path(model: LinkModel, receiver: int) -> tuple[NoiseSource, ...]:
    """What damages the master's frames on their way to one receiver."""
    return model.noise.on_wire(MASTER) + model.noise.in_receiver(receiver)


def alike(model: LinkModel, station: Station) -> object:
    """What stations have in common whose attempts do not differ."""
    if not station.alive:
        return None
    paths = poll_path(model, station.number), reply_path(model, station, MASTER)
    return station.loss, station.extra, station.reply, station.turnaround, paths


def different(model: LinkModel) -> dict[object, Station]:
    """The living stations whose exchanges differ, by what they share with others; with bursts all."""
    memoryless = model.noise.memoryless
    return {alike(model, s) if memoryless else s.number: s for s in reversed(model.alive)}


def attempt_at(
    line: Line, model: LinkModel, station: Station, receiver: int = MASTER, memory: Memory = NOTHING
) -> Attempt:
    """The ends of one attempt at a station."""
    timeouts = np.full(1, float(model.timeout))
    replied, silent, torn, over = attempts_at(line, model, station, timeouts, receiver, memory)
    return Attempt(replied[0], silent[0], tuple((*end, matrix[0]) for *end, matrix in torn), over)


def attempts_at(
    line: Line,
    model: LinkModel,
    station: Station,
    timeouts: Matrix,
    receiver: int = MASTER,
    memory: Memory = NOTHING,
) -> Attempt:
    """The ends of one attempt at a station for many timeouts (ticks): each (timeout, state, state).

    States are those of what a receiver remembers and of the line.
    """
    course, same = course_at(line, model, station, receiver, memory), np.eye(len(memory.over))
    left = np.maximum(timeouts - station.average - station.reply, 0.0)
    waits = [np.kron(same[None], line.after_each(ticks)) for ticks in (timeouts, left)]
    silent = course.unsent @ waits[0] + sum(course.headless) @ waits[1]
    over = np.asarray(np.kron(memory.over, np.eye(line.states)), dtype=np.float64)
    quiet = np.kron(same, line.after(model.quiet))
    torn = tuple(
        (later, code, np.broadcast_to(sum(both) @ quiet, silent.shape)) for later, code, both in course.torn
    )
    return Attempt(np.broadcast_to(sum(course.clean) @ over, silent.shape), silent, torn, over)


def course_at(
    line: Line, model: LinkModel, station: Station, receiver: int = MASTER, memory: Memory = NOTHING
) -> Course:
    """What one attempt at a station comes to, and which of its replies a receiver takes."""
    noise, own = model.noise, receiver in (MASTER, station.number)
    gap, same = line.after(model.gap), np.eye(len(memory.over))
    nothing = np.zeros((line.states * len(same),) * 2)
    # By whether the station hears its poll, then the receiver.
    receivers = noise.in_receiver(station.number), noise.in_receiver(receiver)
    polls = line.shared(noise.on_wire(MASTER), *receivers, model.poll_bits)
    if own:
        poll = line.outcome(poll_path(model, station.number), model.poll_bits)
        polls = [[poll.clean, 0 * poll.clean], [0 * poll.hit, poll.hit]]
    heard, unheard = (np.kron(memory.polled, gap @ both[0]) + np.kron(same, gap @ both[1]) for both in polls)
    if not station.alive:
        return Course(heard + unheard, (nothing, nothing), (nothing, nothing), ())
    sent = (1 - station.loss) * heard @ np.kron(same, line.turnaround(station))

    def split(both: Pair) -> Pair:
        if own:
            return nothing, sent @ np.kron(memory.replies, both[0] + both[1])
        refused = np.kron(memory.refuses, both[0]) + np.kron(same, both[1])
        return sent @ np.kron(memory.takes, both[0]), sent @ refused

    read, sums = reply_of(line, model, station, None if own else receiver), sums_of(model)
    clean, later = split(read.clean), model.quiet + sums.earliest
    if receiver == MASTER:
        clean = clean[1], clean[0]
    if sums.shifted:
        torn = [(model.quiet, 0, read.torn), (later, sums.torn, read.shifted)]
    else:
        torn = [(later, sums.torn, (read.torn[0] + read.shifted[0], read.torn[1] + read.shifted[1]))]
    ends = tuple((ticks, code, split(both)) for ticks, code, both in torn)
    return Course(unheard + station.loss * heard, clean, split(read.headless), ends)


def reply_of(line: Line, model: LinkModel, station: Station, listener: int | None = None) -> ReplyOutcome:
    """What becomes of a station's reply in the master and, where one is given, in a listener."""
    noise = model.noise
    other = None if listener is None else noise.in_receiver(listener)
    wire, characters = noise.on_wire(station.number), model.data_bits // CHAR_BITS
    return line.reply(wire, noise.in_receiver(MASTER), other, characters, zeros=model.zeros)


@lru_cache(maxsize=256)
def sums_of(model: LinkModel) -> TurnaroundSums:
    """The sums of a link's turnarounds, and of the times at which torn replies end.

    These are averaged over the stations, as often as their replies are torn. Whether an end is shifted goes
    with the line's state: in strong bursts shifted ends are a kind of their own, and these times theirs.
    """
    line = line_of(model)
    read = [(1 - s.loss) * line.stationary @ reply_of(line, model, s).ends for s in model.alive]
    chances = np.asarray(sum(read), dtype=np.float64)
    found = {}
    if model.noise.sources and model.alive:
        found = {end: float(chance) for end, chance in zip(ENDS, chances, strict=True) if chance > 0}
    elsewhere = sum(chance for end, chance in found.items() if end != 0)
    shifted = not model.noise.memoryless and elsewhere > _OFTEN * sum(found.values())
    if shifted:
        found.pop(0, None)
    ends = None
    if found:
        ends = Turnaround(0, 0, tuple(round(end * line.bit) for end in found), tuple(found.values()))
    return TurnaroundSums((station.turnaround for station in model.alive), ends, shifted=shifted)


def exchange_at(attempt: Attempt, attempts: int) -> Exchange:
    """The ends of an exchange of so many attempts, each at once after the one before."""
    failed = np.eye(len(attempt.over))
    replied = np.zeros_like(failed)
    step = attempt.failed
    for _ in range(attempts):
        replied = replied + failed @ attempt.replied
        failed = failed @ step
    return Exchange(replied, failed @ attempt.over)
