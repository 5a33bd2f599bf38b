"""What ``bussim size`` prints: the recommendation and its cost first, then what it was chosen from."""

import math
from collections.abc import Sequence
from functools import partial

from rich.console import Console

from bussim.commands.common.console import plain_table, print_line
from bussim.commands.size.verify import Verification
from bussim.exact.scan.outages import longest_scan
from bussim.exact.sizing.choice import Choice
from bussim.exact.sizing.noise_levels import LEVELS, NoiseLevels
from bussim.exact.sizing.size import Sizing
from bussim.exact.sizing.unmet_goals import no_help
from bussim.exact.text import a_year, ms, ms_at_least, ms_at_most
from bussim.units import TICKS_PER_MS
from bussim.words.language import say
from bussim.words.origins import in_words

#: What only an answer to a goal has.
_FIGURES = {"onsets": "show_onsets", "scan": "show_scan_over", "heartbeat": "show_heartbeat"}
#: Settings of the Pareto front that are printed.
_MOST = 12


def show_sizing(console: Console, bus: str, sizing: Sizing, verifications: Sequence[Verification]) -> None:
    """Print the sizing of one link."""
    line = partial(print_line, console)
    model = sizing.model
    line(say("show_size_link", bus=bus, stations=len(model.stations) + 1, mode=model.mode), 0, "bold")
    for note in (*sizing.model.not_replying, *sizing.model.notes):
        line(note)
    if not sizing.valid:
        for reason in sizing.reasons:
            line(say("show_cannot", reason=reason))
        return
    for goal in sizing.goals.texts().values():
        line(say("show_goal", goal=goal))
    if sizing.decided:
        line(sizing.decided)
    best = sizing.recommended
    if best is None:
        for unmet in sizing.unmet:
            line(say("show_unmet", text=unmet.text), style="bold")
        for help_ in sizing.unmet[0].helps if sizing.unmet else ():
            line(say("show_help", text=help_), 4)
        if sizing.unmet and not sizing.unmet[0].helps:
            line(no_help(), 4)
    else:
        counts = {"retries": best.retries, "attempts": best.attempts, "units": best.d8180}
        line(say("show_recommended", **counts, timeout=ms(best.timeout)), style="bold green")
        for cost in _costs(best, sizing):
            line(cost, 4)
        line(say("exact_not_covered"), 4)
        if sizing.model.noisy:
            line(say("show_worse"), 4)
        for mov in sizing.mov_lines():
            line(mov, 4)
    line(say("show_least", time=ms(sizing.floor)))
    if sizing.noise_levels is not None:
        _show_noise_levels(console, sizing.noise_levels, sizing.goals.errors)
    for margin in sizing.margins:
        line(margin.in_words(sizing.goals.errors))
    for text in (sizing.apart(), *sizing.robust_unmet) if best else ():
        if text:
            line(text)
    if best:
        _show_front(console, sizing, best)
    for verdict in verifications:
        line(verdict.in_words())
    line(say("show_rests_on"))
    for text in in_words(sizing.classes()):
        line(text, 4)
    line(say("show_assumptions"))
    for text in (*(assumption.in_words() for assumption in sizing.assumptions), *sizing.otherwise):
        line(text, 4)


def _costs(best: Choice, sizing: Sizing) -> list[str]:
    bound = longest_scan(sizing.model.with_setting(best.attempts, best.timeout))
    detect = {"mean": best.detect, "longest": best.detect_longest, "bound": bound}
    errors = a_year(best.errors, sizing.goals.errors)
    said = [
        say("show_scan", mean=_ms(best.mean), dead=ms_at_most(best.dead)),
        say("show_detect", **{name: ms_at_most(time) for name, time in detect.items()}),
        say("show_errors", errors=errors, level=sizing.level),
        say("show_ride", time=ms_at_least(best.ride)),
    ]
    return said + [say(_FIGURES[name], figure=figure) for name, figure in sizing.figures.items()]


def _show_noise_levels(console: Console, noise_levels: NoiseLevels, goal: float) -> None:
    levels = ", ".join(f"{name} {ber:g}" for name, ber in LEVELS.items())
    print_line(console, say("show_no_noise", levels=levels))
    shown_as = [say(f"show_column_{name}") for name in ("attempts", "dead", "outage", "outages")]
    table = plain_table(
        (),
        ("D8179", shown_as[0], *LEVELS, *shown_as[1:]),
        title=say("show_levels", timeout=ms(noise_levels.timeout)),
    )
    for rung in noise_levels.rungs:
        table.add_row(
            str(rung.retries),
            str(rung.attempts),
            *(a_year(rung.errors[name], goal) for name in LEVELS),
            ms_at_most(rung.dead),
            ms_at_least(rung.ride),
            ", ".join(ms(outage) for outage in rung.survived) or "–",
        )
    console.print(table)


def _show_front(console: Console, sizing: Sizing, best: Choice) -> None:
    front, goal = sizing.front, sizing.goals.errors
    table = plain_table(
        (),
        (
            "D8179",
            "D8180",
            *(say(f"show_column_{name}") for name in ("attempts", "errors", "dead", "detect")),
        ),
        title=say("show_front"),
    )
    shown = [choice for place, choice in enumerate(front) if place < _MOST or choice == best]
    for choice in shown:
        table.add_row(
            str(choice.retries),
            str(choice.d8180),
            str(choice.attempts),
            a_year(choice.errors, goal),
            ms_at_most(choice.dead),
            ms_at_most(choice.detect),
        )
    console.print(table)
    if len(front) > len(shown):
        print_line(console, say("show_more", number=len(front) - len(shown)))
    if sizing.front_longer:
        print_line(console, say("show_more_long", number=sizing.front_longer))


def _ms(ticks: float) -> str:
    """A time in tenths of a ms, rounded up."""
    return f"{math.ceil(10 * ticks / TICKS_PER_MS) / 10:,.1f} ms"
