"""The longest wait for a station's data, by trying out which replies are lost: an independent reckoning."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache


@dataclass(frozen=True)
class Line:
    """One link in plain numbers: what a scan is made of. ``replied`` is of each slave, 1 first."""

    bare: int  # the master's data frame and the overhead
    parameters: int
    silent: int
    replied: tuple[int, ...]
    attempts: int
    probe: bool = False

    @property
    def scan(self) -> int:
        """A scan in which every station replies at once."""
        return self.bare + sum(self.replied)


def longest_wait(line: Line, source: int, losses: int | None, spent: int | None = None) -> int:
    """From just after any moment to the end of the source's next data (0: the master's), at most.

    ``losses`` is how many replies may be lost in it (None: any number), ``spent`` how many attempts
    of the source may be spent in exchanges without a reply. Flags may be on at the beginning, and attempts of the exchange that is under
    way may have failed before it.
    """
    slaves = range(1, len(line.replied) + 1)

    @cache
    def on(station: int, flags: frozenset[int], left: int | None, vain: int | None, failed: int) -> int:
        """From before the exchange of a station (one beyond the last: the scan's end) on."""
        if station > len(line.replied):
            between = line.bare + (line.parameters if flags else 0)
            return between if source == 0 else between + on(1, flags, left, vain, 0)
        allowed = 1 if line.probe and station in flags else line.attempts
        best = 0
        for lost in range(allowed - failed + 1):
            if left is not None and lost > left:
                break
            after = None if left is None else left - lost
            time = lost * line.silent
            if failed + lost < allowed:
                time += line.replied[station - 1]
                if station != source:
                    time += on(station + 1, flags - {station}, after, vain, 0)
            elif station == source and vain is not None and vain < allowed:
                break
            else:
                fewer = vain - allowed if station == source and vain is not None else vain
                time += on(station + 1, flags | {station}, after, fewer, 0)
            best = max(best, time)
        return best

    subsets = [frozenset(s for s in slaves if bits >> s & 1) for bits in range(0, 2 ** (len(slaves) + 1), 2)]
    found = 0
    for flags in subsets:
        # Just after the source's data or failed exchange, or within an exchange that has failed so far.
        found = max(found, on(source + 1, flags, losses, spent, 0))
        for station in slaves:
            allowed = 1 if line.probe and station in flags else line.attempts
            for failed in range(allowed):
                found = max(found, on(station, flags, losses, spent, failed))
    return found
