"""What ``bussim size`` prints of a Modbus poll list."""

import math
from collections.abc import Sequence
from functools import partial

from rich.console import Console

from bussim.commands.common.console import plain_table, print_line
from bussim.commands.size.verify_ports import PortVerification
from bussim.exact.sizing.noise_levels import BAD, LEVELS
from bussim.exact.sizing.ports.setting import PortSetting
from bussim.exact.sizing.ports.size import PortSizing
from bussim.exact.text import a_year, ms, ms_at_most
from bussim.words.language import say

#: The columns of the table of settings.
_COLUMNS = ("timeout", "retries", "failed", "cycle", "one_dead", "two_dead", "oldest")


def show_port_sizing(
    console: Console, node: str, sizing: PortSizing, verifications: Sequence[PortVerification]
) -> None:
    """Print the sizing of one poll list."""
    line = partial(print_line, console)
    model = sizing.model
    what = say("show_on", protocol=model.protocol, bus=model.bus) if model.protocol else model.bus
    heading = say("show_port", node=node, what=what)
    if model.polls:
        heading = say("show_port_polls", heading=heading, polls=len(model.polls))
    line(heading, 0, "bold")
    for reason in sizing.reasons:
        line(say("show_cannot", reason=reason))
    if not sizing.valid:
        return
    for goal in sizing.goals.port_texts().values():
        line(say("show_goal", goal=goal))
    best = sizing.recommended
    if best is None:
        for unmet in sizing.unmet:
            line(say("show_unmet", text=unmet.text), style="bold")
    else:
        interval, own = (ms(time) for time in (best.interval, model.master_timing.interval))
        counts = {"retries": best.retries, "attempts": best.attempts, "timeout": ms(best.timeout)}
        said = say("show_port_recommended", **counts, interval=interval)
        if interval != own:
            said = say("show_port_instead", said=said, own=own)
        line(said, style="bold green")
        for text in (*_costs(best), *best.figures.in_words(), sizing.margin()):
            if text:
                line(text, 4)
        for mov in sizing.mov_lines():
            line(mov, 4)
        if sizing.mov_lines():
            line(say("show_rs2"), 4)
        line(say("show_pymodbus", code=sizing.pymodbus()), 4)
    for remedy in sizing.remedies:
        line(say("show_less" if best else "show_help", text=remedy.in_words()))
    line(say("show_port_least", time=ms(sizing.least)))
    _show_table(console, sizing)
    for verdict in verifications:
        line(verdict.in_words())


def _costs(best: PortSetting) -> list[str]:
    said = [] if best.cycle is None else [say("show_cycle", time=ms_at_most(best.cycle))]
    if best.age is not None:
        said.append(say("show_age", time=ms_at_most(best.age)))
    return [*said, say("show_failed", number=a_year(best.errors), level=LEVELS[BAD])]


def _show_table(console: Console, sizing: PortSizing) -> None:
    interval = ms(sizing.table[0].interval)
    table = plain_table(
        (), [say(f"show_port_{name}") for name in _COLUMNS], title=say("show_port_table", interval=interval)
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
        print_line(console, say("show_dash", reason=reason))
