"""What became of the messages or requests between two nodes beside the links."""

from collections import Counter
from dataclasses import dataclass, field

from bussim.results.meters.failures import Times
from bussim.trace.records import Outcome


@dataclass(slots=True)
class Exchange:
    """How many had each outcome; ``failed``: times from the first such one to the next good one (ticks).

    ``requests``: those that failed up to the next good one have the outcome that most of them had; of those
    that had another one it is not known why.
    """

    requests: bool = False
    counts: Counter[Outcome] = field(default_factory=Counter)
    failed: dict[Outcome, Times] = field(default_factory=dict)
    _open: dict[Outcome, tuple[int, int]] = field(default_factory=dict)  # since when, how many

    def add(self, start: int, outcome: Outcome) -> None:
        """Count what began at ``start``."""
        self.counts[outcome] += 1
        if outcome is Outcome.GOOD:
            self.close(start)
        elif outcome is not Outcome.UNKNOWN:
            since, number = self._open.get(outcome, (start, 0))
            self._open[outcome] = since, number + 1

    def close(self, tick: int) -> None:
        """A good one begins, or the run ends."""
        if self.requests and self._open:
            most = max(self._open, key=lambda outcome: self._open[outcome][1])
            for outcome in self._open.keys() - {most}:
                self.counts[outcome] -= self._open[outcome][1]
                self.counts[Outcome.UNKNOWN] += self._open[outcome][1]
            self._open = {most: min(self._open.values())}
        for outcome, (since, _) in self._open.items():
            self.failed.setdefault(outcome, Times()).add(since, tick)
        self._open.clear()
