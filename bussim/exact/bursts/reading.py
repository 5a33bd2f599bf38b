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

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bussim.engines.nn.frames import DATA_OVERHEAD_CHARS, ETX, STX
from bussim.line.characters import NN_LINE

Array = NDArray[np.float64]

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
def _moves() -> tuple[Array, Array]:
    """For each level sent, from (right or inverted bit, damaged, header read, receiver) to the last three."""
    found = np.zeros((2, 2, 2, 2, _STATES, 2, 2, _STATES))
    for sent, inverted, damaged, headed, state in np.ndindex(2, 2, 2, 2, _STATES):
        after, header = _move(state, sent ^ inverted)
        found[sent, inverted, damaged, headed, state, damaged | inverted, headed | header, after] = 1
    zero, one = found.reshape(2, 2 * 4 * _STATES, 4 * _STATES)
    return zero, one


def read(right: Array, inverted: Array, characters: int, *, zeros: bool) -> Reading:
    """How a reply of so many characters is read.

    ``right`` and ``inverted``: what accompanies the bits (the line's state, what a listener has had so
    far) from one bit to the next, times the probability that this one is right, or inverted. ``zeros``: the
    block is of zeros, else random.
    """
    outer = right.shape[0]
    state = np.zeros((1, outer, outer, 4 * _STATES))
    state[0, range(outer), range(outer), _SINCE - 1] = 1.0  # the line idle
    data = [_HEX[:1] if zeros else _HEX] * (characters - DATA_OVERHEAD_CHARS)
    moves, step = _moves(), np.concatenate((right.T, inverted.T))
    for choice in ((STX,), _HEX, _HEX, *data, (ETX,), _HEX, _HEX):
        levels = np.array([_FORMAT.encode(character) for character in choice])
        state = np.repeat(state / len(choice), len(choice), axis=0)
        for bit in range(_BITS):
            # (choice, before, right or inverted and after, state) to (…, after, right or inverted and state)
            both = (step @ state).reshape(len(choice), outer, 2, outer, -1)
            both = both.swapaxes(2, 3).reshape(len(choice), outer, outer, -1)
            state = np.empty_like(state)
            for level in (0, 1):
                state[levels[:, bit] == level] = both[levels[:, bit] == level] @ moves[level]
        state = state.sum(axis=0, keepdims=True)
    # Rows add up to 1; rounding must not wear them down over a thousand bits.
    state = (state / state.sum(axis=(2, 3), keepdims=True)).reshape(outer, outer, 2, 2, _STATES)
    torn = state[:, :, 1, 1]
    waiting = torn[..., :_WAITING].reshape(outer, outer, 2, _SINCE).sum(axis=2)
    reading = torn[..., _WAITING:].reshape(outer, outer, _BITS - 1, 2).sum(axis=3)
    return Reading(
        clean=state[:, :, 0].sum(axis=(2, 3)),
        torn=waiting[..., 0],
        shifted=waiting[..., 1:].sum(axis=2) + reading.sum(axis=2),
        headless=state[:, :, 1, 0].sum(axis=2),
        ends=np.concatenate((waiting[..., ::-1], reading[..., ::-1]), axis=2).sum(axis=1),
    )
