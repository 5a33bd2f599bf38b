"""What ``bussim fit`` warns of, by code, and what of it a scenario carries on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bussim.commands.fit.scenario import left_out
from bussim.units import milliseconds
from bussim.wording import counted

if TYPE_CHECKING:
    from bussim.commands.fit.recording import Fitted
    from bussim.live.fit.comparison import Comparison

#: So many polls are named in one warning.
_NAMED = 5


def warnings_of(fitted: Fitted) -> dict[str, str]:
    """The warnings about estimates."""
    found: dict[str, str] = {}
    noise = fitted.noise
    if noise.bursts.seen and noise.bursts.states is None:
        found["bursts"] = (
            "errors come in bursts whose lengths the recording does not tell: they are entered as "
            "independent errors, and all figures of errors are lower bounds"
        )
    elif noise.bursts.seen:
        found["bursts"] = (
            "errors come in bursts: entered as noise with two states, whose intervals say what is known"
        )
    if noise.master_receiver.unheard is not None and noise.master_receiver.unheard.value:
        found["master_receiver"] = (
            "the master heard nothing of replies that were sound on the line: entered as replies that are "
            "not sent"
        )
    if fitted.link is not None and fitted.link.scan_overhead is None:
        found["scan_overhead"] = "nothing shows the master's scan overhead: that of the scenario is assumed"
    if fitted.ports is not None:
        polls = fitted.ports.polls
        left = left_out(polls)
        if left:
            share = 100 * sum(poll.turns for poll in left) / sum(poll.turns for poll in polls)
            reasons = _some([f"{poll.name}: {reason}" for poll, reason in left.items()])
            found["left_out"] = (
                f"{counted(len(left), 'poll')}, {share:.2g}% of turns, left out of the scenario: {reasons}"
            )
        irregular = [
            f"{poll.name}: {_span(poll.low)} to {_span(poll.high)} ms" for poll in polls if poll.irregular
        ]
        if irregular:
            found["irregular_poll"] = f"turns come at no regular times: {_some(irregular)}"
        between = fitted.ports.timeout_between
        if between is not None:
            found["timeout"] = (
                "the next request comes when it is due whether a reply is missing or not: the timeout is "
                f"between {_span(between[0])} and {_span(between[1])} ms, and the middle is taken"
            )
        wrong = [f"station {each.station}: {each.wrong:,}" for each in fitted.ports.slaves if each.wrong]
        if wrong:
            found["wrong_answers"] = f"wrong replies, which are the devices' and no noise: {_some(wrong)}"
    return found


def carried(fitted: Fitted, found: dict[str, str]) -> dict[str, str]:
    """The warnings that a scenario has to repeat: not what its noise says itself."""
    estimated = fitted.noise.bursts.states is not None
    return {code: text for code, text in found.items() if code != "bursts" or not estimated}


def difference(comparison: Comparison) -> dict[str, str]:
    """The warning that a simulation of the estimates does not behave like the recording."""
    if not comparison.differs:
        return {}
    figures = "; ".join(
        f"{each.name} {each.measured:.4g} measured, {each.simulated:.4g} simulated (p {each.p:.2g})"
        for each in comparison.differs
    )
    return {"differs": f"a simulation of the estimates differs from the recording: {figures}"}


def _some(texts: list[str]) -> str:
    more = len(texts) - _NAMED
    return "; ".join(texts[:_NAMED]) + (f"; and {more} more" if more > 0 else "")


def _span(ticks: int | None) -> str:
    return "–" if ticks is None else f"{milliseconds(ticks):g}"
