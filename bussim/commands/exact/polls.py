"""The tables of ``bussim exact`` for Modbus poll lists."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bussim.exact.polls.master_timing import Span
from bussim.exact.polls.metrics import PollFigures
from bussim.exact.polls.text import percent
from bussim.exact.text import a_year, ms, ms_cell
from bussim.words.language import said_text, say, shown

if TYPE_CHECKING:
    from rich.console import Console


def show(console: Console, figures: PollFigures) -> None:
    """One poll list: the figures of the cycle, then a line for each poll."""
    from bussim.commands.common.console import named_values, print_line

    model = figures.model
    protocol = say("port_protocol", name=model.protocol) if model.protocol else say("port_no_protocol")
    heading = say("port_line", name=model.node, what=protocol, bus=model.bus)
    if model.line:
        heading = say("exact_of_line", heading=heading, line=model.line)
    if model.valid:
        times = {"timeout": ms(model.timeout), "interval": ms(model.master_timing.interval)}
        heading = say("exact_polls", heading=heading, polls=len(model.polls), **times)
    print_line(console, heading, 0, "bold")
    for sentence in (*figures.in_words(), *model.notes, *figures.remarks):
        print_line(console, sentence)
    if not model.valid:
        return
    console.print(named_values(_rows(figures)))
    _show_polls(console, figures)


def _rows(figures: PollFigures) -> list[tuple[str, str]]:
    rows: list[tuple[str, str]] = []
    if figures.cycle is not None:
        cycle = say("exact_cycle", span=_span(figures.cycle))
        if figures.mean is not None:
            cycle = say("exact_cycle_mean", cycle=cycle, mean=ms_cell(figures.mean))
        rows.append((say("port_cycle"), cycle))
        if (figures.first or 0) > figures.cycle.most:
            rows.append((say("exact_first"), say("exact_up_to", time=ms_cell(figures.first))))
    if figures.worst is not None:
        text = say("exact_spent", time=ms_cell(figures.worst))
        if figures.disturbed != figures.worst:
            times = {"time": ms_cell(figures.worst), "more": ms_cell(figures.disturbed)}
            text = say("exact_spent_more", **times)
        rows.append((say("exact_at_worst"), text))
    if figures.command is not None and figures.worst_command is not None:
        times = {"time": ms_cell(figures.command), "worst": ms_cell(figures.worst_command)}
        rows.append((say("exact_commands"), say("exact_commands_more", **times)))
    if figures.failed_a_year is not None:
        rows.append((say("exact_failed"), say("exact_failed_a_year", number=a_year(figures.failed_a_year))))
    if figures.load is not None:
        rows.append((say("exact_load"), say("exact_load_of", load=percent(figures.load))))
    return rows


def _show_polls(console: Console, figures: PollFigures) -> None:
    from rich.text import Text

    from bussim.commands.common.console import plain_table

    table = plain_table(
        [say(f"exact_poll_{name}") for name in ("name", "asks", "function", "every")],
        [say(f"exact_poll_{name}") for name in ("response", "taken", "arriving", "replaced")],
        title=say("exact_poll_table"),
    )
    for one in figures.polls:
        poll = one.poll
        every = f"{ms(poll.every)} ms" if poll.every else said_text("exact_always")
        if poll.times is not None:
            every = said_text("exact_in_all", times=poll.times)
        cells = (
            poll.name,
            poll.device or said_text("exact_all"),
            f"{poll.function:02X} × {poll.count}",
            every,
            shown(_span(one.response)),
            shown(_span(one.transaction)),
            ms_cell(one.on_arrival),
            ms_cell(one.before_refresh),
        )
        table.add_row(*map(Text, cells))
    console.print(table)


def _span(span: Span) -> str:
    least, most = ms_cell(span.least), ms_cell(span.most)
    return least if span.fixed else say("poll_span", least=least, most=most)
