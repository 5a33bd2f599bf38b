"""Whether errors come in bursts, and the two states of a line on which they do.

Wald and Wolfowitz' runs test (Annals of Mathematical Statistics 11, 1940) with its exact law, and the
likelihood of frames on a line that changes between two states in continuous time (Gilbert and Elliott's
channel). With states' rates of change Q and error rates diag(e), what a sound frame of length t leaves of
the states' probabilities is expm((Q - diag(e)) t), and a damaged one expm(Q t) less that; silence of length
t is expm(Q t).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import exp, inf, lgamma, log, log1p, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bussim.live.fit.statistics import FALL, Estimate

Matrices = NDArray[np.float64]

#: Bursts are seen if independent errors would look like it less often than this.
_SEEN = 0.001
#: From fewer failures nothing is concluded, and from fewer bursts no times are estimated.
LEAST_FAILURES, LEAST_BURSTS = 10, 5
#: Windows of the dispersion index, in mean distances of what is counted.
_WINDOW = 10
#: So many frames at most are evaluated for the two states.
MOST_FRAMES = 20_000
#: Lengths of bursts, in mean distances of frames, with which the search begins.
_STARTS = (1.0, 5.0, 25.0)
#: Gaps are the same if their logarithms are within so much; the step by which slopes are taken.
_GRAIN, _STEP = 0.01, 1e-5
#: Logarithms of an interval's ends: the first step from the estimate, and how exactly they are found.
_FIRST_STEP, _EXACT = 0.3, 0.05
#: Points are as likely as each other if their log likelihoods differ by less.
_ALIKE = 0.1
#: The least error rates that are looked for, as errors in the whole recording: less is none.
_LEAST_GOOD, _LEAST_BAD = 1e-3, 1.0


class Attempt(NamedTuple):
    """An attempt at an exchange: when it began (ticks), of which kind, whether it failed.

    Attempts of one ``kind`` (one station, one request) fail equally often where errors are independent.
    """

    start: int
    kind: object
    failed: bool


@dataclass(frozen=True, slots=True)
class TwoStates:
    """A line with a good and a bad state: mean times in ticks, bit error rates."""

    good: Estimate
    bad: Estimate
    ber_good: Estimate
    ber_bad: Estimate


@dataclass(frozen=True, slots=True)
class Bursts:
    """Whether failures come in groups; ``seen`` is None where there are too few to tell.

    ``runs_p`` is the probability of as few runs by chance, ``dispersion`` the variance of the number of
    failures in a window over its mean (1: independent). ``states`` are the two states of the line, None
    where they were not seen or cannot be estimated.
    """

    seen: bool | None
    failures: int
    attempts: int
    p_fail: float | None
    p_fail_after_fail: float | None
    runs_p: float | None
    dispersion: float | None
    states: TwoStates | None = None


def bursts_of(attempts: Sequence[Attempt]) -> Bursts:
    """Whether attempts, in order of their starts, fail in groups. ``states`` is not set.

    A damaged request, whose kind None is not known, is taken for one of the kind that follows it.
    """
    named, kind = [], attempts[-1].kind if attempts else None
    for attempt in reversed(attempts):
        if attempt.kind is None:
            attempt = attempt._replace(kind=kind)  # noqa: PLW2901 - the same attempt, named
        kind = attempt.kind
        named.append(attempt)
    attempts = named[::-1]
    count = len(attempts)
    fails = [attempt.failed for attempt in attempts]
    failures = sum(fails)
    if not 0 < failures < count:
        share = failures / count if count else None
        return Bursts(None, failures, count, share, None, None, None)
    followed = [after for before, after in pairwise(attempts) if before.failed]
    after_fail = sum(attempt.failed for attempt in followed) / len(followed) if followed else None
    runs = 1 + sum(one is not other for one, other in pairwise(fails))
    p = _as_few_runs(runs, failures, count - failures)
    seen = None
    if failures >= LEAST_FAILURES:
        seen = p < _SEEN and _after_failures(attempts, followed) < _SEEN
    return Bursts(seen, failures, count, failures / count, after_fail, p, _dispersion(attempts))


def _after_failures(attempts: Sequence[Attempt], followed: Sequence[Attempt]) -> float:
    """The probability of as many failures right behind failures, if each kind fails independently.

    A station that fails often is asked again at once: alone that is no burst. By the law of rare events,
    which for frequent ones has the longer tail.
    """
    from scipy.stats import poisson

    kinds: dict[object, list[bool]] = {}
    for attempt in attempts:
        kinds.setdefault(attempt.kind, []).append(attempt.failed)
    share = {kind: sum(fails) / len(fails) for kind, fails in kinds.items()}
    expected = sum(share[attempt.kind] for attempt in followed)
    return float(poisson.sf(sum(attempt.failed for attempt in followed) - 1, expected))


def _as_few_runs(runs: int, one: int, other: int) -> float:
    """The probability of at most so many runs where every order of two kinds of values is as likely."""

    def ways(number: int, parts: int) -> float:
        """The logarithm of the number of ways to divide values into parts."""
        if not 0 < parts <= number:
            return -inf
        return lgamma(number) - lgamma(parts) - lgamma(number - parts + 1)

    whole = lgamma(one + other + 1) - lgamma(one + 1) - lgamma(other + 1)
    total = 0.0
    for number in range(2, runs + 1):
        half, more = number // 2, number - number // 2
        total += exp(ways(one, half) + ways(other, more) - whole)
        total += exp(ways(one, more) + ways(other, half) - whole)
    return min(1.0, total)


def _dispersion(attempts: Sequence[Attempt]) -> float | None:
    times = [attempt.start for attempt in attempts if attempt.failed]
    begin, span = attempts[0].start, attempts[-1].start - attempts[0].start
    windows = len(times) // _WINDOW
    if windows < 2 or not span:
        return None
    counts = [0] * windows
    for time in times:
        counts[min(windows - 1, (time - begin) * windows // span)] += 1
    middle = len(times) / windows
    return sum((count - middle) ** 2 for count in counts) / (windows - 1) / middle


class SeenFrame(NamedTuple):
    """A frame of a line: first edge and end in ticks, bits, whether it was damaged."""

    start: int
    end: int
    bits: int
    damaged: bool


def two_states(frames: Sequence[SeenFrame]) -> TwoStates | None:
    """The two states of the line that frames, in order of their starts, were most likely seen on.

    None where no two states explain them better, or with fewer than five bursts. An end of an interval is
    None where the recording does not limit it.
    """
    from scipy.optimize import minimize

    frames = frames[:MOST_FRAMES]
    damaged = sum(frame.damaged for frame in frames)
    span = frames[-1].end - frames[0].start if frames else 0
    if not damaged or damaged == len(frames):
        return None
    likelihood = _likelihood(frames)
    bits = sum(frame.bits for frame in frames)
    apart, bit = span / len(frames), span / bits
    # Logarithms of good, bad (ticks), ber_good, ber_bad.
    times, most = (log(bit), log(100 * span)), log(0.4)
    bounds = [times, times, (log(_LEAST_GOOD / bits), most), (log(_LEAST_BAD / bits), most)]
    middle = log(damaged / bits)

    def search(start: Sequence[float], fixed: int | None = None) -> tuple[Sequence[float], float]:
        """The likeliest point from a start on, with less its log likelihood; one parameter may be fixed."""
        free = [number for number in range(4) if number != fixed]
        points = np.tile(np.array(start, float), (len(free) + 1, 1))

        def value_and_slope(values: Matrices) -> tuple[float, Matrices]:
            points[:, free] = values
            points[range(1, len(points)), free] += _STEP
            found = -likelihood(points)
            return float(found[0]), (found[1:] - found[0]) / _STEP

        # The good state is that with fewer errors, else each could take the other's part.
        good = (bounds[2][0], start[3] if fixed == 3 else middle + 0.5)
        bad = (start[2] if fixed == 2 else middle - 0.5, most)
        limits = [(times, times, good, bad)[number] for number in free]
        found = minimize(value_and_slope, points[0, free], jac=True, method="L-BFGS-B", bounds=limits)
        points[0, free] = found.x
        return points[0].tolist(), float(found.fun)

    share, rate = damaged / len(frames), damaged / bits
    starts = [
        [
            log(length * apart * (1 / share - 1)),
            log(length * apart),
            log(rate / 100),
            log(min(0.3, 2 * rate / share)),
        ]
        for length in _STARTS
    ]
    best, least = min(map(search, starts), key=lambda found: found[1])
    one_state = [times[1], times[0], log(-log1p(-share) * len(frames) / bits), best[3]]
    alone = -float(likelihood(np.array([one_state]))[0])
    inside = all(times[0] + 1e-3 < value < times[1] - 1e-3 for value in best[:2])
    bursts = span / (exp(best[0]) + exp(best[1]))
    if not inside or alone - least < 2 * FALL or bursts < LEAST_BURSTS or best[2] >= best[3]:
        return None
    estimates = []
    for number, value in enumerate(best):
        ends = _profile(search, best, least, number, bounds[number])
        low, high = (None if end is None else exp(end) for end in ends)
        estimates.append(Estimate(exp(value), low, high, len(frames)))
    if estimates[2].low is None:  # nothing speaks against a good state without errors
        without = search([*best[:2], bounds[2][0], best[3]], 2)[1]
        value = 0.0 if without - least < _ALIKE else estimates[2].value
        estimates[2] = replace(estimates[2], value=value, low=0.0)
    return TwoStates(*estimates)


def _profile(
    search: Callable[[Sequence[float], int], tuple[Sequence[float], float]],
    best: Sequence[float],
    least: float,
    number: int,
    bounds: tuple[float, float],
) -> Iterator[float | None]:
    """The logarithms at which the profile likelihood has fallen by half of chi-square's 95 % point.

    Below and above the best one, rounded outwards; None where it does not fall so far.
    """
    for sign, bound in zip((-1, 1), bounds, strict=True):
        inner, fall_inner, step, point = best[number], 0.0, _FIRST_STEP, best
        outer = fall = None
        while abs(bound - inner) > _EXACT and (outer is None or abs(outer - inner) > _EXACT):
            if outer is None or fall is None:
                tried, step = max(bounds[0], min(bounds[1], inner + sign * step)), 2 * step
            else:  # the root of the fall is nearly a line where it is small
                share = (1 - sqrt(fall_inner / FALL)) / (min(2, sqrt(fall / FALL)) - sqrt(fall_inner / FALL))
                tried = inner + (outer - inner) * min(0.9, max(0.1, share))
            point, value = search([*point[:number], tried, *point[number + 1 :]], number)
            if value - least > FALL:
                outer, fall = tried, value - least
            else:
                inner, fall_inner = tried, max(0.0, value - least)
        yield outer


def _likelihood(frames: Sequence[SeenFrame]) -> Callable[[Matrices], Matrices]:
    """The log likelihood, as a function of points: rows of the logarithms of good, bad, ber_good, ber_bad.

    Frames and the gaps behind them that are alike are evaluated once, and so are pairs of them, pairs of
    pairs and so on.
    """
    ends = [*(frame.start for frame in frames[1:]), frames[-1].end]
    kinds: dict[tuple[int, int, bool, int], int] = {}
    order = [
        kinds.setdefault(
            (
                frame.end - frame.start,
                frame.bits,
                frame.damaged,
                round(log(max(1, end - frame.end)) / _GRAIN),
            ),
            len(kinds),
        )
        for frame, end in zip(frames, ends, strict=True)
    ]
    nothing = len(kinds)  # what stands where frames are missing to a power of two
    lengths, bits, damaged, gaps = (np.array(column, float) for column in zip(*kinds, strict=True))
    gaps = np.exp(gaps * _GRAIN)
    at = np.full(1 << (len(order) - 1).bit_length(), nothing)
    at[: len(order)] = order
    levels = []
    while len(at) > 1:
        pairs, at = np.unique(at[::2] * (nothing + 1) + at[1::2], return_inverse=True)
        levels.append(divmod(pairs, nothing + 1))
        nothing = len(pairs) - 1
    return lambda points: _evaluate(points, lengths, bits, damaged > 0, gaps, levels)


def _evaluate(
    points: Matrices,
    lengths: Matrices,
    bits: Matrices,
    damaged: NDArray[np.bool_],
    gaps: Matrices,
    levels: Sequence[tuple[NDArray[np.int_], NDArray[np.int_]]],
) -> Matrices:
    """See :func:`_likelihood`. Matrices are arrays (2, 2, points, frames)."""
    good, bad, *rates = np.exp(points.T)[:, :, None]
    away, back = 1 / good, 1 / bad
    errors = [-np.log1p(-rate) * bits / lengths for rate in rates]
    sound = _leaves(away, back, errors[0], errors[1], lengths)
    whole = _leaves(away, back, 0.0, 0.0, lengths)
    each = _times(np.where(damaged, whole - sound, sound), _leaves(away, back, 0.0, 0.0, gaps))
    identity = np.broadcast_to(np.eye(2)[:, :, None, None], (2, 2, len(points), 1))
    each = np.concatenate((each, identity), axis=3)
    scale = np.zeros(each.shape[2:])
    for left, right in levels:
        each = _times(each[..., left], each[..., right])
        most = np.maximum(each.max(axis=(0, 1)), 1e-300)
        each = each / most
        scale = scale[:, left] + scale[:, right] + np.log(most)
    of_good, of_bad = each[..., 0].sum(axis=1)
    begins_bad = (away / (away + back))[:, 0]
    total = (1 - begins_bad) * of_good + begins_bad * of_bad
    found: Matrices = scale[:, 0] + np.log(np.maximum(total, 1e-300))
    return found


def _leaves(
    away: Matrices, back: Matrices, first: Matrices | float, second: Matrices | float, t: Matrices
) -> Matrices:
    """The exponentials of ((-away - first, away), (back, -back - second)) times t, as an array (2, 2, …)."""
    a, d = -away - first, -back - second
    half, middle = (a - d) / 2, (a + d) / 2
    root = np.sqrt(half * half + away * back)
    grown, shrunk = np.exp((middle + root) * t), np.exp((middle - root) * t)
    even, odd = (grown + shrunk) / 2, (grown - shrunk) / 2 / root
    return np.array([[even + odd * half, odd * away], [odd * back, even - odd * half]])


def _times(one: Matrices, other: Matrices) -> Matrices:
    """Products of matrices whose rows and columns are the first two axes."""
    (a, b), (c, d) = one
    (e, f), (g, h) = other
    return np.array([[a * e + b * g, a * f + b * h], [c * e + d * g, c * f + d * h]])
