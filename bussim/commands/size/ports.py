"""What ``bussim size`` prints of a Modbus poll list."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.console import Console
from rich.text import Text

from bussim.commands.common.console import plain_table
from bussim.commands.size.verify_ports import PortVerification
from bussim.exact.sizing.noise_levels import BAD, LEVELS
from bussim.exact.sizing.ports.setting import PortSetting
from bussim.exact.sizing.ports.size import PortSizing
from bussim.exact.text import a_year, ms, ms_at_most
from bussim.wording import counted


def show_port_sizing(
    console: Console, node: str, sizing: PortSizing, verifications: Sequence[PortVerification]
) -> None:
    """Print the sizing of one poll list."""

    def line(text: str, indent: int = 2, style: str = "") -> None:
        console.print(Text(" " * indent + text, style))

    model = sizing.model
    what = f"{model.protocol} on {model.bus}" if model.protocol else model.bus
    polls = f", {counted(len(model.polls), 'poll')}" if model.polls else ""
    line(f"{node}: {what}{polls}", 0, "bold")
    for reason in sizing.reasons:
        line(f"cannot be sized: {reason}")
    if not sizing.valid:
        return
    for goal in sizing.goals.port_texts().values():
        line(f"goal: {goal}")
    best = sizing.recommended
    if best is None:
        for unmet in sizing.unmet:
            line(f"not to be met: {unmet.text}", style="bold")
    else:
        retries = f"{counted(best.retries, 'retry')} = {counted(best.attempts, 'attempt')} a turn"
        interval, own = (ms(time) for time in (best.interval, model.master_timing.interval))
        instead = "" if interval == own else f" instead of {own} ms"
        line(
            f"recommended: timeout {ms(best.timeout)} ms, {retries}, interval {interval} ms{instead}",
            style="bold green",
        )
        for text in (*_costs(best), *best.figures.in_words(), sizing.margin()):
            if text:
                line(text, 4)
        for mov in sizing.mov_lines():
            line(mov, 4)
        if sizing.mov_lines():
            line("retries: the program drives RS2 again after an error, that many times", 4)
        line(f"pymodbus (its retries are repeats): {sizing.pymodbus()}", 4)
    for remedy in sizing.remedies:
        line(f"would {'make it less' if best else 'help'}: {remedy.in_words()}")
    line(f"the timeout is at least {ms(sizing.least)} ms: the longest response, from the request's end on")
    _show_table(console, sizing)
    for verdict in verifications:
        line(verdict.in_words())


def _costs(best: PortSetting) -> list[str]:
    noise = f"with the noise as entered or at the assumed level bad ({LEVELS[BAD]:g}), whichever is more"
    said = [] if best.cycle is None else [f"cycle: at most {ms_at_most(best.cycle)} without errors"]
    if best.age is not None:
        said.append(f"oldest data: {ms_at_most(best.age)} without errors")
    return [*said, f"failed turns: at most {a_year(best.errors)} a year ({noise})"]


def _show_table(console: Console, sizing: PortSizing) -> None:
    interval = ms(sizing.table[0].interval)
    table = plain_table(
        (),
        ("timeout", "retries", "failed turns a year", "cycle", "one dead", "two dead", "oldest data"),
        title=f"settings with an interval of {interval} ms: times in ms, at most; "
        "– where it is not known, or there are not so many devices",
    )
    for each in sizing.table:
        times = (each.cycle, each.dead_longest, each.two_dead, each.age)
        table.add_row(
            ms(each.timeout),
            str(each.retries),
            "–" if math.isnan(each.errors) else a_year(each.errors, sizing.goals.errors),
            *("–" if time is None else ms_at_most(time).removesuffix(" ms") for time in times),
        )
    console.print(table)
    for reason in dict.fromkeys(each.reason for each in sizing.table if each.reason):
        console.print(Text(f"  –: {reason}"))
