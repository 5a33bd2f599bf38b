"""The order in which a project's steps run: its segment loop and its repetitions."""

from __future__ import annotations

from typing import NamedTuple


class Plan(NamedTuple):
    """The registers that give the order: 40026, 40037–40039, 40050.

    Steps ``loop_first`` … ``loop_last`` run ``loop_count`` times, if that is over 1 and they are steps of
    the project in order. The whole runs ``repeats`` times, 0 without end.
    """

    total: int
    loop_first: int = 0
    loop_last: int = 0
    loop_count: int = 0
    repeats: int = 1

    @property
    def loops(self) -> bool:
        """Whether there is a segment loop."""
        return 1 <= self.loop_first <= self.loop_last <= self.total and self.loop_count > 1


class Cursor(NamedTuple):
    """Where a project is: its step (from 1), and how often segment and whole were completed."""

    step: int = 1
    segment: int = 0
    passes: int = 0


def following(plan: Plan, cursor: Cursor) -> Cursor | None:
    """What comes after a step; None when the project is over."""
    step, segment, passes = cursor
    if plan.loops and step == plan.loop_last:
        if segment + 1 < plan.loop_count:
            return Cursor(plan.loop_first, segment + 1, passes)
        segment = 0
    if step < plan.total:
        return Cursor(step + 1, segment, passes)
    passes += 1
    return None if plan.repeats and passes >= plan.repeats else Cursor(1, 0, passes)
