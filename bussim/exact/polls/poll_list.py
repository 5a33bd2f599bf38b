"""A master and its polls as the closed form sees them. All times are ticks."""

from dataclasses import dataclass, field

from bussim.exact.polls.master_timing import Direct, MasterTiming, Span
from bussim.line.characters import LineTiming


@dataclass(frozen=True, slots=True)
class PollModel:
    """One poll and its response if nothing goes wrong.

    ``device`` is the slave, "" for a broadcast. ``served``, ``response_end`` and ``need`` are from the
    request's first edge: to the moment when the slave takes its values, to the last stop bit of the response
    (of a broadcast: to the end of the turnaround), and to the master's decision; ``after`` is the longest
    time from the first of them to the last. ``waits`` says that the slave responds at its END, so that
    nothing is uniform about them. ``awaited`` is when the timeout may not be over yet. ``request`` and
    ``response`` are how long the two frames last. ``hits`` are bits of both with their error rates, ``bits``
    all of them, ``loss`` is the chance that the reply vanishes. For ``every``, ``at``, ``times``, ``retries``
    and ``skip`` see :class:`~bussim.plc.ports.spec.PollSpec`.
    """

    name: str
    station: int
    device: str
    function: int
    count: int
    reads: bool
    request: int
    response: int
    served: Span
    response_end: Span
    need: Span
    after: int
    awaited: Span
    bits: int = 0
    hits: tuple[tuple[int, float], ...] = ()
    loss: float = 0.0
    waits: bool = False
    every: int = 0
    at: int = 0
    times: int | None = None
    retries: int = 0
    skip: int = 1

    @property
    def cyclic(self) -> bool:
        """Whether it recurs for ever: others are commands, and no part of the cycle."""
        return self.times is None

    @property
    def attempts(self) -> int:
        """The most attempts of one turn."""
        return self.retries + 1

    @property
    def frames(self) -> int:
        """Ticks on the wire of one good transaction."""
        return self.request + self.response


@dataclass(frozen=True, slots=True)
class PollListModel:
    """The polls of one master. ``obstacles`` say why there are no figures; ``polls`` is empty then.

    ``tail`` is how long after the timeout a failing attempt is decided at the latest: what has begun to
    arrive must be over. ``first_end`` is the least time from RUN to the first END. ``off`` are the slaves
    that are switched off for the whole run; the figures without errors are those with them.
    ``noise_reasons`` say why it is not known how often attempts fail. ``silence`` is the least gap that its
    slaves need before a request. ``words`` is where the words of a PLC's port begin (D), None for a device,
    ``timing`` is that of its line, ``joined`` are the names of polls that became one read.
    ``seen`` is the longest response that was measured, in ticks from the request's end, 0 where none was.
    """

    node: str
    bus: str
    protocol: str
    line: str = ""
    timeout: int = 0
    master_timing: MasterTiming = field(default_factory=lambda: Direct(0))
    tail: int = 0
    first_end: int = 0
    polls: tuple[PollModel, ...] = ()
    off: tuple[str, ...] = ()
    obstacles: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    noise_reasons: tuple[str, ...] = ()
    silence: int = 0
    words: int | None = None
    timing: LineTiming | None = None
    joined: tuple[tuple[str, ...], ...] = ()
    seen: int = 0

    @property
    def valid(self) -> bool:
        """Whether there are figures."""
        return not self.obstacles

    @property
    def cyclic(self) -> tuple[PollModel, ...]:
        """The polls that recur for ever."""
        return tuple(poll for poll in self.polls if poll.cyclic)

    @property
    def commands(self) -> tuple[PollModel, ...]:
        """The polls that have a number of turns."""
        return tuple(poll for poll in self.polls if not poll.cyclic)
