"""What a session of ``bussim poll`` is to do, from options or from a scenario."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bussim.engines.modbus.adu import Mode
    from bussim.engines.modbus.polls import Poll
    from bussim.line.characters import LineTiming
    from bussim.live.value_notation import Form


@dataclass(frozen=True, slots=True)
class Planned:
    """A poll as it is sent and shown."""

    poll: Poll
    name: str
    first: int  # number of its first item as the user counts
    form: Form | None  # None: coils
    big: bool = False


@dataclass(frozen=True, slots=True)
class Plan:
    """What is polled, and how. Times in ticks."""

    mode: Mode
    line: LineTiming
    polls: tuple[Planned, ...]
    timeout: int
    interval: int = 0  # between transactions
    pause: int = 0  # between turns
    turnaround: int | None = None  # after a broadcast; None: as usual
    resync: bool = True  # wait for late responses and throw them away
