"""What the decoders of both kinds of lines count."""

from abc import ABC, abstractmethod
from collections import Counter
from typing import NamedTuple

from bussim.live.arrival import PARITY, STOP
from bussim.live.sniff.heard import Heard, Verdict
from bussim.trace.sink import Sink


class Line(NamedTuple):
    """What a decoder knows of the line before it hears anything. Times are ticks.

    ``silence`` is shorter than the wait for a reply, ``closest`` (3.5 characters) than that of any station.
    ``slack``: so far off times may be, 0 where they are those of the line, so that distances prove something.
    ``wires`` is the number of wires, one a direction where there are two. ``echo``: each request is heard
    twice; None: to be found out. ``counters`` is the number of link scans after which the counter of N:N
    frames begins again, 1 where they have none.
    """

    bus: str
    baud: int
    format: str
    silence: int
    closest: int
    slack: int = 0
    wires: int = 1
    echo: bool | None = None
    counters: int = 16


class Decoder(ABC):
    """Counts what is heard and records frames. Strays, echoes and what was torn are no frames."""

    def __init__(self, line: Line, sink: Sink) -> None:
        self._line, self._sink = line, sink
        self.frames = 0
        self.damaged = 0
        self.busy = 0
        self.unasked = 0  # sound frames that belong to no exchange
        self.strays = 0
        self.stray_characters = 0
        self.echoes = 0
        self.parity_errors = 0
        self.stop_errors = 0
        self.sound_characters = 0
        #: Attempts by outcome, and requests that are none: "broadcast", "undecided".
        self.outcomes: Counter[str] = Counter()
        #: Damage that was the recorder's alone: what followed shows that the line's own receivers had none.
        self.recorder_damage = 0

    @abstractmethod
    def heard(self, heard: Heard) -> None:
        """Take in what was heard next."""

    def lost(self) -> None:  # noqa: B027 - for decoders to which it matters
        """Something was on the line here that the recording does not show."""

    def close(self) -> None:  # noqa: B027 - for decoders to which it matters
        """Nothing more will be heard."""

    def _count(self, heard: Heard, kind: str, sender: str) -> None:
        """Count what was heard, and record it with its kind and the name of its sender."""
        if heard.flags:
            self.parity_errors += sum(bool(flag & PARITY) for flag in heard.flags)
            self.stop_errors += sum(bool(flag & STOP) for flag in heard.flags)
        verdict = heard.verdict
        if verdict is Verdict.STRAY:
            self.strays += 1
            self.stray_characters += len(heard.chars)
        elif verdict is not Verdict.TORN:
            self.frames += 1
            self.busy += heard.end - heard.start
            if verdict is Verdict.DAMAGED:
                self.damaged += 1
            else:
                self.sound_characters += len(heard.chars)
        if self._sink.traced:
            line = self._line
            self._sink.take(heard.record(line.bus, kind, sender, line.baud, line.format))
