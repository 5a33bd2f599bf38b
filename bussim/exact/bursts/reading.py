"""What a UART reads of a reply that bit errors damage: a chain from bit to bit.

A receiver that has lost its place takes falling edges inside of characters for start bits. It may read a
clean header where there was none, so that the attempt ends with the reply instead of at its deadline,
and the last character that it reads may end up to nine bits after the reply, or before its end. Inverted
bits leave all edges at the borders of bits, so that the receiver moves on bit by bit (see
:mod:`bussim.line.uart`).

What it reads depends on the data. The blocks are taken as zeros, as they are until something writes them,
or else as random; of all data zeros are read as headers most often. Station, counter and sum are averaged
over the hexadecimal digits, as the counter moves on from scan to scan.
"""

from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bussim.engines.nn.frames import DATA_OVERHEAD_CHARS, ETX, STX
from bussim.line.characters import NN_LINE

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
#: The levels, bit by bit, of what is left of each of the characters that may come.
_Choice = tuple[tuple[int, ...], ...]

_FORMAT = NN_LINE.format
_BITS = _FORMAT.bits
_HEX = tuple(b"0123456789ABCDEF")
#: Bits since a character ended that a waiting receiver tells apart.
_SINCE = 10
# A receiver waits, the line high or low, or has read 1 to 9 bits of a character, which so far is a clean
# header or not.
_WAITING, _STATES = 2 * _SINCE, 2 * _SINCE + 2 * (_BITS - 1)


class Reading(NamedTuple):
    """How a reply is read: probabilities with the axes (before, after) of what accompanies the bits.

    ``clean``: undamaged; ``torn``: damaged, with a clean header, the last character that is read ending
    with the reply; ``shifted``: the same, that character ending earlier or later; ``headless``: damaged,
    without a clean header. ``ends`` has the axes (before, end): in which of :data:`ENDS` the last
    character of a torn or shifted one ends.
    """

    clean: Array
    torn: Array
    shifted: Array
    headless: Array
    ends: Array


#: The ends that are told apart, in bits after the reply's end.
ENDS = range(1 - _SINCE, _BITS)


def _move(state: int, level: int) -> tuple[int, bool]:
    """The receiver's state after one more bit, and whether that completed a clean header."""
    if state < _WAITING:
        low, since = divmod(state, _SINCE)
        if level == 0 and not low:
            return _WAITING + 1, False  # a falling edge: the first bit of a character, so far as a header's
        return (1 - level) * _SINCE + min(since + 1, _SINCE - 1), False
    read, header = divmod(state - _WAITING, 2)
    header &= level == _FORMAT.encode(STX)[read + 1]
    if read + 2 < _BITS:
        return _WAITING + 2 * (read + 1) + header, False
    return (1 - level) * _SINCE, bool(header)


@cache
def _moves() -> Indices:
    """The state (header read, receiver) after each one, by the level of a bit."""
    found = np.empty((2, 2, _STATES), dtype=np.int64)
    for level, headed, state in np.ndindex(found.shape):
        after, header = _move(state, level)
        found[level, headed, state] = (headed | header) * _STATES + after
    return found.reshape(2, -1)


def _branches(choice: _Choice) -> Iterator[tuple[int, float, _Choice]]:
    """The levels of the next bit of one of these characters: each with its share and what may follow."""
    for level in (0, 1):
        rest = tuple(sorted(levels[1:] for levels in choice if levels[:1] == (level,)))
        if rest:
            yield level, len(rest) / len(choice), rest


def read(right: Array, inverted: Array, characters: int, *, zeros: bool) -> Reading:
    """How a reply of so many characters is read.

    ``right`` and ``inverted``: what accompanies the bits (the line's state, what a listener has had so
    far) from one bit to the next, times the probability that this one is right, or inverted. ``zeros``: the
    block is of zeros, else random.
    """
    outer, moves = right.shape[0], _moves()
    size = moves.shape[1]

    @cache
    def damaged(choice: _Choice) -> Array:
        """Over what is left of a character, one of these, in a damaged reply: (before, state, after)."""
        if not choice[0]:
            return np.eye(outer * size).reshape(outer, size, -1)
        total = np.zeros((outer, size, outer * size))
        for level, share, rest in _branches(choice):
            after = damaged(rest)
            total += np.einsum("ij,jkl", share * right, after[:, moves[level]])
            total += np.einsum("ij,jkl", share * inverted, after[:, moves[1 - level]])
        return total

    @cache
    def hit(choice: _Choice, state: int) -> Array:
        """The same of an undamaged reply that is damaged in it; the receiver has one state then."""
        total = np.zeros((outer, outer * size))
        for level, share, rest in _branches(choice):
            total += share * inverted @ damaged(rest)[:, moves[1 - level, state]]
            total += share * right @ hit(rest, int(moves[level, state]))
        return total

    clean, state = np.eye(outer), np.zeros((outer, outer * size))
    place = _SINCE - 1  # the line idle
    data = [_HEX[:1] if zeros else _HEX] * (characters - DATA_OVERHEAD_CHARS)
    for codes in ((STX,), _HEX, _HEX, *data, (ETX,), _HEX, _HEX):
        choice = tuple(sorted(map(_FORMAT.encode, codes)))
        state = state @ damaged(choice).reshape(outer * size, -1) + clean @ hit(choice, place)
        for level in choice[0]:
            clean, place = clean @ right, int(moves[level, place])
    # Rows add up to 1; rounding must not wear them down over a thousand bits.
    every = clean.sum(axis=1) + state.sum(axis=1)
    clean, state = clean / every[:, None], state / every[:, None]
    headless, torn = np.moveaxis(state.reshape(outer, outer, 2, _STATES), 2, 0)
    waiting = torn[..., :_WAITING].reshape(outer, outer, 2, _SINCE).sum(axis=2)
    reading = torn[..., _WAITING:].reshape(outer, outer, _BITS - 1, 2).sum(axis=3)
    return Reading(
        clean=clean,
        torn=waiting[..., 0],
        shifted=waiting[..., 1:].sum(axis=2) + reading.sum(axis=2),
        headless=headless.sum(axis=2),
        ends=np.concatenate((waiting[..., ::-1], reading[..., ::-1]), axis=2).sum(axis=1),
    )
