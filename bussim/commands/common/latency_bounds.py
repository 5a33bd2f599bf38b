"""What latencies are at worst, in a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

    from bussim.exact.latency.bounds import LatencyBound


def show_bounds(console: Console, bounds: Mapping[str, LatencyBound]) -> None:
    """Print a table: one row a latency, its parts and its cases in ms."""
    from rich.text import Text

    from bussim.commands.common.console import plain_table
    from bussim.exact.text import ms_cell

    parts = ["scan", "turn", "wire", "destination", "output"]
    if any(bound.program for bound in bounds.values()):
        parts.append("program")
    table = plain_table(
        ["from, to"],
        [*parts, "no error", "1 lost reply", "every retry"],
        title="latency at worst (ms), and what it is made of without error",
    )
    for name, bound in bounds.items():
        if bound.valid:
            lost = [bound.lost(1), bound.every_retry] if bound.link_scan else []
            label = f"{name} (age)" if bound.word else name
            table.add_row(
                Text(label), *map(ms_cell, (*(getattr(bound, part) for part in parts), bound.no_error, *lost))
            )
    if table.row_count:
        console.print(table)
    for name, bound in bounds.items():
        for sentence in [f"no bound: {bound.reason}"] if bound.reason else bound.caveats:
            console.print(Text(f"  {name}: {sentence}"))
    linked = [bound for bound in bounds.values() if bound.valid and bound.link_scan]
    if linked:
        flag = ms_cell(max(bound.parameters for bound in linked))
        longest = ms_cell(max(bound.missed for bound in linked))
        console.print(
            Text(
                "  no error: nor is a station's error flag still on at the change, which would cost "
                f"{flag} ms. every retry: the source is in error "
                "for one link scan and replies to the last attempt of the next, any reply of all others may "
                f"be lost. A frame that only the target misses adds up to {longest} ms. None holds "
                "for a change before the link has formed."
            )
        )
