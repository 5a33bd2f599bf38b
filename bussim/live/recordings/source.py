"""What every kind of recording offers: characters of a line, once it is known how to read it."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from bussim.line.characters import LineTiming
from bussim.live.arrival import Timed
from bussim.live.layout.value import ASSUMED, Layout

#: Shows what is done, how much of it, and of how much.
Progress = Callable[[str, int, int], None]
#: Rows or packets between two calls of what shows the progress.
PROGRESS_EVERY = 4096


class Chunk(NamedTuple):
    """Characters of one wire of the line, in order. ``lost``: before them is what cannot be read."""

    chars: list[Timed]
    wire: int = 0
    lost: bool = False


class LineSetup(NamedTuple):
    """How a recording is read: rate and format of its line, and where in it the line is.

    ``inverted``: the line idles low (None: the recording has no levels). ``channels`` are the names of its
    wires, () where a recording has no names. ``decimal_comma``: times of a text have one. ``layout`` is
    that of N:N frames.
    """

    timing: LineTiming
    inverted: bool | None = None
    channels: tuple[str, ...] = ()
    decimal_comma: bool = False
    layout: Layout = ASSUMED


@dataclass(slots=True)
class Facts:
    """What a recording has besides characters, complete when it was read to its end."""

    unreadable: list[str] = field(default_factory=list)  # the first ones, each with its reason
    unreadable_lines: int = 0
    time_steps: int = 0
    spikes: int = 0
    warnings: dict[str, str] = field(default_factory=dict)  # by code

    def cannot_read(self, where: str) -> None:
        """Count a line that cannot be read."""
        self.unreadable_lines += 1
        if len(self.unreadable) < 3:
            self.unreadable.append(where)


class Source(ABC):
    """A recording.

    ``exact``: its times are those of the line. ``tolerant``: a frame may come in parts, so that the distance
    between characters proves little. ``times``: "exact", "system" or "none". ``begin`` is the tick at which
    it begins, None: with its first character. ``resolution`` is that of its times, in ticks. ``wires`` are
    the wires of the line, one a direction where it gives directions. ``progress`` is called now and then.
    """

    exact: bool
    tolerant: bool
    times: str
    resolution: int
    begin: int | None = None
    wires: int = 1
    facts: Facts
    progress: Progress = staticmethod(lambda *_: None)

    @abstractmethod
    def chunks(self, setup: LineSetup) -> Iterator[Chunk]:
        """Its characters. Raises RecordingError where it is damaged."""

    def end(self) -> int | None:
        """The tick at which it ends, None: with its last character; after it was read."""
        return None
