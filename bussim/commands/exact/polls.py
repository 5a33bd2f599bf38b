"""The tables of ``bussim exact`` for Modbus poll lists."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bussim.exact.polls.master_timing import Span
from bussim.exact.polls.metrics import PollFigures
from bussim.exact.polls.text import percent
from bussim.exact.text import a_year, ms, ms_cell

if TYPE_CHECKING:
    from rich.console import Console


def show(console: Console, figures: PollFigures) -> None:
    """One poll list: the figures of the cycle, then a line for each poll."""
    from rich.text import Text

    from bussim.commands.common.console import named_values

    model = figures.model
    count = len(model.polls)
    about = f"{count} {'poll' if count == 1 else 'polls'}, timeout {ms(model.timeout)} ms, "
    about += f"interval {ms(model.master_timing.interval)} ms"
    line = f" ({model.line})" if model.line else ""
    heading = f"{model.node}: {model.protocol or 'no protocol'} on {model.bus}{line}"
    console.print(Text(f"{heading}, {about}" if model.valid else heading, style="bold"))
    for sentence in (*figures.in_words(), *model.notes, *figures.remarks):
        console.print(Text(f"  {sentence}"))
    if not model.valid:
        return
    console.print(named_values(_rows(figures)))
    _show_polls(console, figures)


def _rows(figures: PollFigures) -> list[tuple[str, str]]:
    rows: list[tuple[str, str]] = []
    if figures.cycle is not None:
        mean = f", mean {ms_cell(figures.mean)}" if figures.mean is not None else ""
        rows.append(("poll cycle", f"{_span(figures.cycle)} ms without errors{mean}"))
        if (figures.first or 0) > figures.cycle.most:
            rows.append(("  the first one", f"up to {ms_cell(figures.first)} ms"))
    if figures.worst is not None:
        more = "" if figures.disturbed == figures.worst else f", {ms_cell(figures.disturbed)} ms if "
        more += "something else arrives at the end of each timeout" if more else ""
        text = f"{ms_cell(figures.worst)} ms (every attempt of every poll spent without a response{more})"
        rows.append(("  at worst", text))
    if figures.command is not None and figures.worst_command is not None:
        text = f"up to {ms_cell(figures.command)} ms, at worst {ms_cell(figures.worst_command)} ms"
        rows.append(("  with all commands", f"{text} more"))
    if figures.failed_a_year is not None:
        rows.append(("failed turns", f"{a_year(figures.failed_a_year)} a year with the noise as entered"))
    if figures.load is not None:
        rows.append(("bus load", f"{percent(figures.load)} by these polls"))
    return rows


def _show_polls(console: Console, figures: PollFigures) -> None:
    from rich.text import Text

    from bussim.commands.common.console import plain_table

    table = plain_table(
        ["poll", "asks", "function", "every"],
        ["response", "taken over", "arriving", "replaced"],
        title="polls without errors (ms): response time; from the request to its taking over; "
        "oldest data when they arrive, and when they are replaced",
    )
    for one in figures.polls:
        poll = one.poll
        every = f"{ms(poll.every)} ms" if poll.every else "always"
        if poll.times is not None:
            every = f"{poll.times} × in all"
        cells = (
            poll.name,
            poll.device or "all",
            f"{poll.function:02X} × {poll.count}",
            every,
            _span(one.response),
            _span(one.transaction),
            ms_cell(one.on_arrival),
            ms_cell(one.before_refresh),
        )
        table.add_row(*map(Text, cells))
    console.print(table)


def _span(span: Span) -> str:
    return ms_cell(span.least) if span.fixed else f"{ms_cell(span.least)} to {ms_cell(span.most)}"
