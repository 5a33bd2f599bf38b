"""One attempt at a station, and all the attempts of one exchange, as matrices over the line's state.

How an attempt ends (the engines' rules): *replied*, one character after the other undamaged; *torn*,
the reply's first character undamaged and a later one hit, which fails it two quiet characters after
the reply's end; else *silent*: the poll was hit, the reply lost, or its first character hit, and the
attempt runs to its deadline. What is neglected:

* Frames that are damaged and yet valid. That takes at least four inverted bits, two in each of two
  characters, so that parity and sum are both kept: less than 4e-4 × (bits × BER)^4 / 24 a frame.
* A receiver that lost its place in a torn reply finds its last character up to nine bits after the
  reply's end, or one before it. Of single hits 2 % do that; the attempt then ends up to a character
  (0.26 ms) later or earlier, 2 µs on average over all torn replies. No probability changes.
* Headers where there were none. A receiver that lost its place in the first character finds a clean
  STX later in 1 % of the cases (one reply in 10 / BER); the attempt then ends with the reply instead of
  at the deadline, so that the distribution is on the long side.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bussim.exact.bursts.channel import Line, Matrix
from bussim.exact.link import CHAR_BITS, MASTER, LinkModel, NoiseSource, Station, frame_ticks


class Attempt(NamedTuple):
    """The three ends of an attempt, from its start (the gap before the poll) to its end."""

    replied: Matrix
    silent: Matrix
    torn: Matrix

    @property
    def failed(self) -> Matrix:
        """Silent or torn."""
        return self.silent + self.torn


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


def attempt_at(line: Line, model: LinkModel, station: Station) -> Attempt:
    """The ends of one attempt at a station."""
    every = attempts_at(line, model, station, np.full(1, float(model.timeout)))
    return Attempt(*(part[0] for part in every))


def attempts_at(line: Line, model: LinkModel, station: Station, timeouts: Matrix) -> Attempt:
    """The ends of one attempt at a station for many timeouts (ticks): each (timeout, state, state)."""
    stack = (timeouts.size, line.states, line.states)
    if not station.alive:
        nothing = np.zeros(stack)
        return Attempt(nothing, line.after_each(model.gap + model.poll + timeouts), nothing)
    poll = line.outcome(poll_path(model, station.number), model.poll_bits)
    path = reply_path(model, station, MASTER)
    head = line.outcome(path, CHAR_BITS)
    rest = line.outcome(path, model.data_bits - CHAR_BITS)
    gap = line.after(model.gap)
    polled = gap @ poll.clean
    replied = (1 - station.loss) * (polled @ line.turnaround(station))
    left = np.maximum(timeouts - station.average - frame_ticks(1), 0.0)
    silent = (gap @ poll.hit + station.loss * polled) @ line.after_each(timeouts)
    silent = silent + (replied @ head.hit) @ line.after_each(left)
    whole = replied @ head.clean
    torn = whole @ rest.hit @ line.after(model.quiet)
    return Attempt(np.broadcast_to(whole @ rest.clean, stack), silent, np.broadcast_to(torn, stack))


def exchange_at(line: Line, attempt: Attempt, attempts: int) -> Exchange:
    """The ends of an exchange of so many attempts, each at once after the one before."""
    failed = np.eye(line.states)
    replied = np.zeros_like(failed)
    step = attempt.failed
    for _ in range(attempts):
        replied = replied + failed @ attempt.replied
        failed = failed @ step
    return Exchange(replied, failed)
