"""What a Modbus master asks for, and how often: its polls, and requests that it repeats unasked."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from operator import sub
from statistics import mean, median_low
from typing import NamedTuple

#: A request is periodic if nine tenths of its turns begin within so much of a period of their grid.
_LATE, _MOST = 0.25, 0.9
#: What is due by a clock comes within so much of a period and the turns' own spread.
_EXACT = 0.01
#: From fewer distances no grid is concluded.
_LEAST = 5
#: A request that comes twice in a row in fewer of its turns comes so by exception.
_SELDOM = 0.25

#: Outcomes behind which a master repeats.
_FAILED = frozenset(("no_answer", "damaged", "wrong_answer"))

#: Station, function, address and quantity.
Request = tuple[int, int, int, int]


@dataclass(frozen=True, slots=True)
class PollEstimate:
    """A request that recurs. ``every`` is the median distance of its turns in ticks.

    Where that is 0 by the recording's clock it is the mean; a request seen once has the recording's length.
    ``low`` and ``high`` hold nine tenths of the distances; ``periodic``: its turns keep to a grid.
    ``retries`` are the master's, of all its requests.
    Times are None where none are known.
    """

    station: int
    function: int
    address: int
    quantity: int
    turns: int
    first: int
    every: int | None
    low: int | None
    high: int | None
    periodic: bool
    retries: int

    @property
    def request(self) -> Request:
        """What is asked for."""
        return self.station, self.function, self.address, self.quantity

    @property
    def name(self) -> str:
        """What a reader calls it."""
        return f"{self.station}: {self.function:02X} at {self.address} × {self.quantity}"

    @property
    def irregular(self) -> bool:
        """Whether the distances of its turns say little of when the next one comes."""
        if self.periodic or self.every is None or self.low is None or self.high is None:
            return False
        return max(self.every - self.low, self.high - self.every) > _LATE * self.every


class Turn(NamedTuple):
    """A request of a master in order: when it began and ended, when its sound reply ended (None: none)."""

    request: Request
    attempt: int
    sent: int
    asked: int
    replied: int | None
    reply_bits: int
    outcome: str


def numbered(turns: list[Turn]) -> list[Turn]:
    """The turns with the attempts that they are.

    Where a request comes again behind failures when its next turn is due, its master repeats nothing.
    """
    usual = {request: _usual(starts) for request, starts in _polls(turns, frozenset()).items()}
    latest: dict[Request, Turn] = {}
    again, due = Counter[Request](), Counter[Request]()
    for turn in turns:
        (every, off), before = usual[turn.request], latest.get(turn.request)
        if turn.attempt > 1 and before is not None and every is not None:
            again[turn.request] += 1
            due[turn.request] += abs(turn.sent - before.sent - every) <= off
        latest[turn.request] = turn
    single = {request for request, count in again.items() if due[request] >= _MOST * count}
    return [turn._replace(attempt=1) if turn.request in single else turn for turn in turns]


def repeats_of(turns: list[Turn]) -> list[int] | None:
    """Numbers of the turns that repeat a request behind its sound reply, before the next turn was due.

    That is so if the request came before half of its usual distance had passed since a turn that was on time;
    of one that keeps to no grid and hardly ever comes twice in a row, before three quarters. None: a master
    that asks for one thing, at no regular times, shows nothing of it.
    """
    polls = _polls(turns, frozenset())
    again = Counter(after.request for before, after in pairwise(turns) if after.request == before.request)
    limits: dict[Request, tuple[int, float]] = {}  # the usual distance, and the least
    for request, starts in polls.items():
        every = _every(starts)
        if every is not None and _grid(starts):
            limits[request] = every, every * 0.5
        elif every is not None and len(polls) > 1 and again[request] <= _SELDOM * len(starts):
            limits[request] = every, every * 0.75
    if not limits:
        return None
    found = []
    latest: dict[
        Request, tuple[int, bool]
    ] = {}  # by request its latest turn that is none, and if it was on time
    before: Turn | None = None
    for number, turn in enumerate(turns):
        request = turn.request
        if turn.attempt == 1 and request in limits:
            every, limit = limits[request]
            begun, on_time = latest.get(request, (turn.sent, False))
            same = before is not None and before.request == request and before.replied is not None
            if same and on_time and turn.sent - begun < limit:
                found.append(number)
            else:
                on_time = request not in latest or abs(turn.sent - begun - every) <= _LATE * every
                latest[request] = turn.sent, on_time
        before = turn
    return found


def polls_of(
    turns: list[Turn], repeats: frozenset[int], span: int, *, timed: bool = True
) -> tuple[PollEstimate, ...]:
    """The polls in a recording of ``span`` ticks; ``repeats`` are numbers of turns that are none.

    Without ``timed`` the recording has no times, and nothing is said of how often they come.
    """
    polls, attempts = _polls(turns, repeats), _attempts(turns)
    found = [_estimate(request, starts, span, attempts) for request, starts in polls.items()]
    return tuple(
        each if timed else replace(each, every=None, low=None, high=None, periodic=False) for each in found
    )


def _polls(turns: list[Turn], repeats: frozenset[int]) -> Mapping[Request, array[int]]:
    """The starts of each request's turns."""
    polls: dict[Request, array[int]] = {}
    for number, turn in enumerate(turns):
        starts = polls.setdefault(turn.request, array("q"))
        if turn.attempt == 1 and number not in repeats:
            starts.append(turn.sent)
    return polls


def _attempts(turns: list[Turn]) -> int:
    """The attempts of a master: of as many failures most were its last; if that never was so, the most seen.

    Not every one, since a repeat that was damaged is not seen.
    """
    given_up = Counter(
        before.attempt for before, turn in pairwise(turns) if before.outcome in _FAILED and turn.attempt == 1
    )
    seen = Counter(turn.attempt for turn in turns)
    last = (number for number in sorted(given_up) if given_up[number] >= seen[number + 1])
    return next(last, max(seen))


def _usual(starts: array[int]) -> tuple[int | None, float]:
    """The median distance of turns, and by how much others differ that come when they are due."""
    every, apart = _every(starts), sorted(map(sub, starts[1:], starts))
    if every is None:
        return None, 0.0
    fifth = len(apart) // 5
    spread = max(every - apart[fifth], apart[-1 - fifth] - every)
    return every, min(_LATE * every, 2 * spread + _EXACT * every)


def _every(starts: array[int]) -> int | None:
    apart = [after - before for before, after in pairwise(starts)]
    return median_low(apart) if apart else None


def _grid(starts: array[int]) -> int | None:
    """The period of the grid that the turns keep to: they may be late, but lateness does not add up."""
    every = _every(starts)
    if len(starts) <= _LEAST or not every:
        return None
    # The median is off where distances alternate; where turns are repeated, their mean is.
    usual = [apart for apart in map(sub, starts[1:], starts) if every < 2 * apart < 3 * every]
    for guess in (every, mean(usual)):
        grid = (starts[-1] - starts[0]) / max(1, round((starts[-1] - starts[0]) / guess))
        late = sorted((start - starts[0] + grid / 2) % grid for start in starts)
        middle = late[len(late) // 2]
        if sum(abs(each - middle) <= _LATE * grid for each in late) >= _MOST * len(late):
            return round(grid)
    return None


def _estimate(request: Request, starts: array[int], span: int, attempts: int) -> PollEstimate:
    grid = _grid(starts)
    apart = sorted(after - before for before, after in pairwise(starts))
    every = max(1, grid or _every(starts) or (round(mean(apart)) if apart else span))
    low = min(every, apart[len(apart) // 20]) if apart else None
    high = max(every, apart[-1 - len(apart) // 20]) if apart else None
    return PollEstimate(
        *request, len(starts), starts[0] if starts else 0, every, low, high, grid is not None, attempts - 1
    )
