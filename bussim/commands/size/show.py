"""What ``bussim size`` prints: the recommendation and its cost first, then what it was chosen from."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.console import Console
from rich.text import Text

from bussim.commands.common.console import plain_table
from bussim.commands.size.verify import Verification
from bussim.exact.scan.outages import longest_scan
from bussim.exact.sizing.choice import Choice
from bussim.exact.sizing.noise_levels import LEVELS, NoiseLevels
from bussim.exact.sizing.size import Sizing
from bussim.exact.sizing.unmet_goals import NO_HELP
from bussim.exact.text import NOT_COVERED, a_year, ms, ms_at_least, ms_at_most
from bussim.scenario.provenance import in_words
from bussim.units import TICKS_PER_MS
from bussim.wording import counted

#: Settings of the Pareto front that are printed.
_MOST = 12
#: What the figures of a line with noise are.
_WORSE = (
    "each figure is the worst of the noise as entered, of weaker bursts if there are bursts, and of the "
    "assumed level bad, where failed attempts take the whole timeout"
)
#: Figures that only an answer to a goal has.
_FIGURES = {
    "onsets": "false station errors begin",
    "scan": "scans over the deadline",
    "heartbeat": "a heartbeat is missed falsely",
}


def show_sizing(console: Console, bus: str, sizing: Sizing, verifications: Sequence[Verification]) -> None:
    """Print the sizing of one link."""

    def line(text: str, indent: int = 2, style: str = "") -> None:
        console.print(Text(" " * indent + text, style))

    line(f"{bus}: {counted(len(sizing.model.stations) + 1, 'station')}, mode {sizing.model.mode}", 0, "bold")
    for note in (*sizing.model.not_replying, *sizing.model.notes):
        line(note)
    if not sizing.valid:
        for reason in sizing.reasons:
            line(f"cannot be sized: {reason}")
        return
    for goal in sizing.goals.texts().values():
        line(f"goal: {goal}")
    if sizing.decided:
        line(sizing.decided)
    best = sizing.recommended
    if best is None:
        for unmet in sizing.unmet:
            line(f"not to be met: {unmet.text}", style="bold")
        for help_ in sizing.unmet[0].helps if sizing.unmet else ():
            line(f"would help: {help_}", 4)
        if sizing.unmet and not sizing.unmet[0].helps:
            line(NO_HELP, 4)
    else:
        line(
            f"recommended: D8179 = {best.retries} ({counted(best.attempts, 'attempt')} a poll), "
            f"D8180 = {best.d8180} ({ms(best.timeout)} ms)",
            style="bold green",
        )
        for cost in _costs(best, sizing):
            line(cost, 4)
        line(NOT_COVERED, 4)
        if sizing.model.noisy:
            line(_WORSE, 4)
        for mov in sizing.mov_lines():
            line(mov, 4)
    line(f"the timeout is at least {ms(sizing.floor)} ms: longest reply, PLC scan and one tick of 10 ms")
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
    line("what the figures rest on:")
    for text in in_words(sizing.classes()):
        line(text, 4)
    line("the assumptions that change the answer most:")
    for text in (*(assumption.in_words() for assumption in sizing.assumptions), *sizing.otherwise):
        line(text, 4)


def _costs(best: Choice, sizing: Sizing) -> list[str]:
    bound = longest_scan(sizing.model.with_setting(best.attempts, best.timeout))
    detect = f"{ms_at_most(best.detect)} on average, {ms_at_most(best.detect_longest)} at worst"
    said = [
        f"link scan: mean {_ms(best.mean)}; with a dead station {ms_at_most(best.dead)}",
        f"a dead station is noticed after {detect} while no other reply is lost, else {ms_at_most(bound)}",
        f"false station errors: {a_year(best.errors, sizing.goals.errors)} a year ({sizing.level})",
        f"an interruption of the line of {ms_at_least(best.ride)} passes without a station error",
    ]
    return said + [f"{_FIGURES[name]}: {figure}" for name, figure in sizing.figures.items()]


def _show_noise_levels(console: Console, noise_levels: NoiseLevels, goal: float) -> None:
    levels = ", ".join(f"{name} {ber:g}" for name, ber in LEVELS.items())
    timeout = ms(noise_levels.timeout)
    console.print(Text(f"  no noise is given; assumed bit error rates: {levels}"))
    table = plain_table(
        (),
        ("D8179", "attempts", *LEVELS, "scan, one dead", "outage passed", "of 20, 100, 300 ms"),
        title=f"false station errors a year at each, timeout {timeout} ms; outages are of the line",
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
        ("D8179", "D8180", "attempts", "false errors a year", "scan, one dead", "noticed after"),
        title="settings that no other beats in all three (Pareto front)",
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
        console.print(Text(f"  … and {len(front) - len(shown)} more (--json has all)"))
    if sizing.front_longer:
        console.print(Text(f"  … and {sizing.front_longer:,} more above 1 s, which are left out"))


def _ms(ticks: float) -> str:
    """A time in tenths of a ms, rounded up."""
    return f"{math.ceil(10 * ticks / TICKS_PER_MS) / 10:,.1f} ms"
