"""Poll lists in words that a technician follows."""

from collections.abc import Callable, Sequence

from bussim.exact.polls.master_timing import Span
from bussim.exact.polls.poll_list import PollListModel, PollModel
from bussim.exact.text import at_least, at_most, ms
from bussim.units import TICKS_PER_SECOND
from bussim.wording import about, names
from bussim.words.language import say


def when_off(devices: Sequence[str], polls: Sequence[PollModel], timeout: int, lost: int, cycle: Span) -> str:
    """Attempts multiplied out: ``3 retries = 4 attempts × 100 ms on 4 polls (…): 1.6 s when b is dead``."""
    groups: dict[int, list[str]] = {}
    for poll in polls:
        groups.setdefault(poll.retries, []).append(poll.name)
    parts = []
    for retries, group in groups.items():
        counts = {"retries": retries, "attempts": retries + 1, "polls": len(group)}
        parts.append(say("poll_attempts", **counts, timeout=ms(timeout), names=names(group)))
    key = "poll_off" if len(devices) == 1 else "poll_off_several"
    times = {"lost": duration(lost), "cycle": _between(cycle)}
    return say(key, parts=say("plus_list", texts=parts), names=names(devices), **times)


def _between(span: Span) -> str:
    most = duration(span.most)
    return most if span.fixed else say("poll_span", least=duration(span.least, at_least), most=most)


def duration(ticks: int, rounded: Callable[[float, int], float] = at_most) -> str:
    """``1.6 s``, ``350 ms``: four digits at most, above a second in seconds."""
    if ticks >= TICKS_PER_SECOND:
        return f"{rounded(ticks / TICKS_PER_SECOND, 4):.4g} s"
    return f"{rounded(ticks * 1000 / TICKS_PER_SECOND, 4):.4g} ms"


def remarks(model: PollListModel, *, fits: bool, continuous: bool) -> tuple[str, ...]:
    """What must be known beside the figures."""
    said = []
    paced = [poll for poll in model.cyclic if poll.every]
    endless = [poll.name for poll in model.cyclic if not poll.every]
    if paced and continuous:
        longest = max(paced, key=lambda poll: poll.every)
        said.append(say("poll_continuous", poll=longest.name, every=ms(longest.every)))
    elif endless and paced:
        key = "poll_endless" if len(endless) == 1 else "poll_endless_several"
        said.append(say(key, names=names(endless)))
    elif not (fits or continuous):
        shortest = min(paced, key=lambda poll: poll.every)
        said.append(say("poll_left_turn", poll=shortest.name, every=ms(shortest.every)))
    if model.commands:
        said.append(say("poll_on_top", names=names(poll.name for poll in model.commands)))
    if model.off:
        said.append(say("poll_dead_all", names=names(model.off)))
    return tuple(said)


def percent(load: tuple[float, float]) -> str:
    """A bus load, or its bounds."""
    least, most = (f"{about(100 * part)}" for part in load)
    return say("poll_span", least=least, most=f"{most} %") if least != most else f"{least} %"
