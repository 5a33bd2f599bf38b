"""What latencies are at worst, in a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from bussim.words.language import said_text, say

if TYPE_CHECKING:
    from rich.console import Console

    from bussim.exact.latency.bounds import LatencyBound


def show_bounds(console: Console, bounds: Mapping[str, LatencyBound]) -> None:
    """Print a table: one row a latency, its parts and its cases in ms."""
    from rich.text import Text

    from bussim.commands.common.console import plain_table, print_line
    from bussim.exact.text import ms_cell

    parts = ["scan", "turn", "wire", "destination", "output"]
    if any(bound.program for bound in bounds.values()):
        parts.append("program")
    table = plain_table(
        [say("exact_ends")],
        [say(f"exact_{name}") for name in (*map("part_{}".format, parts), "no_error", "lost", "retry")],
        title=say("exact_latency"),
    )
    for name, bound in bounds.items():
        if bound.valid:
            lost = [bound.lost(1), bound.every_retry] if bound.link_scan else []
            label = said_text("exact_age", name=name) if bound.word else name
            table.add_row(
                Text(label), *map(ms_cell, (*(getattr(bound, part) for part in parts), bound.no_error, *lost))
            )
    if table.row_count:
        console.print(table)
    for name, bound in bounds.items():
        for sentence in [say("bound_none", reason=bound.reason)] if bound.reason else bound.caveats:
            print_line(console, say("exact_of", name=name, sentence=sentence))
    linked = [bound for bound in bounds.values() if bound.valid and bound.link_scan]
    if linked:
        flag = ms_cell(max(bound.parameters for bound in linked))
        longest = ms_cell(max(bound.missed for bound in linked))
        print_line(console, say("exact_cases", flag=flag, longest=longest))
