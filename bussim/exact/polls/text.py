"""Poll lists in words that a technician follows."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from bussim.exact.polls.master_timing import Span
from bussim.exact.polls.poll_list import PollListModel, PollModel
from bussim.exact.text import at_least, at_most, ms
from bussim.units import TICKS_PER_SECOND
from bussim.wording import about, names


def when_off(devices: Sequence[str], polls: Sequence[PollModel], timeout: int, lost: int, cycle: Span) -> str:
    """Attempts multiplied out: ``3 retries = 4 attempts × 100 ms on 4 polls (…): 1.6 s when b is dead``."""
    groups: dict[int, list[str]] = {}
    for poll in polls:
        groups.setdefault(poll.retries, []).append(poll.name)
    parts = []
    for retries, group in groups.items():
        attempts = f"{_count(retries, 'retry', 'retries')} = {_count(retries + 1, 'attempt', 'attempts')}"
        on = f"{_count(len(group), 'poll', 'polls')} ({names(group)})"
        parts.append(f"{attempts} × {ms(timeout)} ms on {on}")
    who = f"{names(devices)} {'is' if len(devices) == 1 else 'are'} dead"
    return (
        f"{' + '.join(parts)}: {duration(lost)} when {who}; "
        f"with the rest of the cycle {_to(cycle)}{duration(cycle.most)}"
    )


def _to(span: Span) -> str:
    return "" if span.fixed else f"{duration(span.least, at_least)} to "


def duration(ticks: int, rounded: Callable[[float, int], float] = at_most) -> str:
    """``1.6 s``, ``350 ms``: four digits at most, above a second in seconds."""
    if ticks >= TICKS_PER_SECOND:
        return f"{rounded(ticks / TICKS_PER_SECOND, 4):.4g} s"
    return f"{rounded(ticks * 1000 / TICKS_PER_SECOND, 4):.4g} ms"


def _count(number: int, one: str, more: str) -> str:
    return f"{number or 'no'} {one if number == 1 else more}"


def remarks(model: PollListModel, *, fits: bool, continuous: bool) -> tuple[str, ...]:
    """What must be known beside the figures."""
    said = []
    paced = [poll for poll in model.cyclic if poll.every]
    endless = [poll.name for poll in model.cyclic if not poll.every]
    if paced and continuous:
        longest = max(paced, key=lambda poll: poll.every)
        said.append(
            f"one turn of each poll takes longer than {longest.name} may wait ({ms(longest.every)} ms): the "
            "list goes round without a pause"
        )
    elif endless and paced:
        said.append(
            f"{names(endless)} {'has' if len(endless) == 1 else 'have'} no period and so fill the time "
            "between the others: the cycle's bounds are wide, and no mean is known"
        )
    elif not (fits or continuous):
        shortest = min(paced, key=lambda poll: poll.every)
        said.append(
            f"one turn of each poll can take longer than {shortest.name} may wait ({ms(shortest.every)} ms): "
            "then a turn is left out"
        )
    if model.commands:
        said.append(f"turns of {names(poll.name for poll in model.commands)} come on top of the cycle")
    if model.off:
        said.append(
            f"{names(model.off)} dead for the whole run: the figures without errors are those with it alive"
        )
    return tuple(said)


def percent(load: tuple[float, float]) -> str:
    """A bus load, or its bounds."""
    least, most = (f"{about(100 * part)}" for part in load)
    return f"{least} %" if least == most else f"{least} to {most} %"
