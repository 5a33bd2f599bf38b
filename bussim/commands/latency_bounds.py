"""What latencies are at worst, in a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console

    from bussim.exact.latency import LatencyBound


def show_bounds(console: Console, bounds: Mapping[str, LatencyBound]) -> None:
    """Print a table: one row a latency, its parts and its cases in ms."""
    from rich.table import Table
    from rich.text import Text

    from bussim.units import TICKS_PER_MS

    def cell(ticks: int) -> str:
        return f"{ticks / TICKS_PER_MS:,.3f}"

    table = Table(
        title=Text("latency at worst (ms), and what it is made of without error"),
        title_justify="left",
        box=None,
        pad_edge=False,
        padding=(0, 2),
    )
    table.add_column("from, to")
    for name in ("scan", "turn", "wire", "destination", "output", "no error", "1 lost reply", "every retry"):
        table.add_column(Text(name), justify="right")
    for name, bound in bounds.items():
        if bound.valid:
            parts = [bound.scan, bound.turn, bound.wire, bound.destination, bound.output]
            lost = [bound.lost(1), bound.every_retry] if bound.link_scan else []
            label = f"{name} (age)" if bound.word else name
            table.add_row(Text(label), *map(cell, (*parts, bound.no_error, *lost)))
    if table.row_count:
        console.print(table)
    for name, bound in bounds.items():
        for reason in bound.reasons:
            console.print(Text(f"  {name}: no bound: {reason}"))
    longest = max((bound.link_scan for bound in bounds.values() if bound.valid), default=0)
    if longest:
        console.print(
            Text(
                "  A program that passes a signal on later than in the scan that reads it, and a frame that "
                f"only the target misses ({cell(longest)} ms), add to it."
            )
        )
