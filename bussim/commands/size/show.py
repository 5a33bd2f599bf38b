"""What ``bussim size`` prints: the recommendation and its cost first, then what it was chosen from."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.text import Text

from bussim.commands.common.console import plain_table
from bussim.commands.size.verify import Verdict
from bussim.exact.sizing.noise_levels import LEVELS, NoiseLevels
from bussim.exact.sizing.size import Choice, Sizing
from bussim.exact.text import ms
from bussim.units import TICKS_PER_MS
from bussim.wording import about

#: Settings of the Pareto front that are printed.
_MOST = 12


def show_sizing(console: Console, bus: str, sizing: Sizing, verdicts: Sequence[Verdict]) -> None:
    """Print the answer for one link."""

    def line(text: str, indent: int = 2, style: str = "") -> None:
        console.print(Text(" " * indent + text, style))

    line(f"{bus}: {len(sizing.model.stations) + 1} stations, mode {sizing.model.mode}", 0, "bold")
    if not sizing.valid:
        for reason in sizing.reasons:
            line(f"cannot be sized: {reason}")
        return
    for note in sizing.model.notes:
        line(note)
    for goal in sizing.goals.texts().values():
        line(f"goal: {goal}")
    best = sizing.recommended
    if best is None:
        for unmet in sizing.unmet:
            line(f"not to be met: {unmet.text}", style="bold")
            for help_ in unmet.helps:
                line(f"would help: {help_}", 4)
    else:
        line(
            f"recommended: D8179 = {best.retries} ({best.attempts} attempts a poll), "
            f"D8180 = {best.d8180} ({ms(best.timeout)} ms)",
            style="bold green",
        )
        for cost in _costs(best):
            line(cost, 4)
        for mov in sizing.mov_lines():
            line(mov, 4)
    line(f"the timeout is at least {ms(sizing.floor)} ms: longest reply, PLC scan and one tick of 10 ms")
    if sizing.noise_levels is not None:
        _show_noise_levels(console, sizing.noise_levels)
    if best is None:
        return
    for text in (sizing.apart(), *sizing.robust_unmet):
        if text:
            line(text)
    _show_front(console, sizing.front)
    for verdict in verdicts:
        line(_simulated(verdict))


def _costs(best: Choice) -> list[str]:
    return [
        f"link scan: mean {_ms(best.mean)}; with a dead station {_ms(best.dead)}",
        f"a dead station is noticed after {_ms(best.detect)} on average, {_ms(best.detect_longest)} at worst",
        f"false station errors: {about(best.errors)} a year",
        f"silence of {_ms(best.ride)} passes without a station error",
    ]


def _simulated(verdict: Verdict) -> str:
    low, high = verdict.allowed
    sign = "agrees" if verdict.agrees else "DISAGREES"
    return (
        f"simulated {verdict.retries} retries, {ms(verdict.timeout)} ms: mean "
        f"{verdict.mean:.3f} ± {verdict.half:.3f} ms (exact {verdict.exact_mean:.3f}), "
        f"{verdict.errors} station errors (exact {about(verdict.expected_errors)}, "
        f"within {low} to {high}) in {verdict.scans:,} scans: {sign}"
    )


def _show_noise_levels(console: Console, noise_levels: NoiseLevels) -> None:
    levels = ", ".join(f"{name} {chance:g}" for name, chance in LEVELS.items())
    timeout = ms(noise_levels.timeout)
    console.print(Text(f"  no noise is given; assumed chance that an attempt fails: {levels}"))
    table = plain_table(
        (),
        ("D8179", "attempts", *LEVELS, "dead-station scan", "outage passed", "of 20, 100, 300 ms"),
        title=f"false station errors a year under each, with a timeout of {timeout} ms; outages are silence",
    )
    for rung in noise_levels.rungs:
        table.add_row(
            str(rung.retries),
            str(rung.attempts),
            *(about(rung.errors[name]) for name in LEVELS),
            _ms(rung.dead),
            _ms(rung.ride),
            ", ".join(ms(outage) for outage in rung.survived) or "–",
        )
    console.print(table)


def _show_front(console: Console, front: Sequence[Choice]) -> None:
    table = plain_table(
        (),
        ("D8179", "D8180", "attempts", "false errors a year", "dead-station scan", "noticed after"),
        title="settings that no other beats in all three (Pareto front)",
    )
    for choice in front[:_MOST]:
        table.add_row(
            str(choice.retries),
            str(choice.d8180),
            str(choice.attempts),
            about(choice.errors),
            _ms(choice.dead),
            _ms(choice.detect),
        )
    console.print(table)
    if len(front) > _MOST:
        console.print(Text(f"  … and {len(front) - _MOST} more (--json has all)"))


def _ms(ticks: float) -> str:
    return f"{ticks / TICKS_PER_MS:,.1f} ms"
