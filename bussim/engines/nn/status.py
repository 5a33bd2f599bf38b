"""What a station knows of the link: the counts, codes and flags behind its special registers.

D8201–D8218 and M8183–M8191: PW10 board manual, section 7.5.
"""

from bussim.engines.nn.codes import COUNT_LIMIT

STATIONS = 8


class LinkStatus:
    """One station's view. Lists have one entry a station number, 0 (the master) to 7.

    ``counts`` are D8203+k (0…32767), ``codes`` D8211+k, ``flags`` M8183+k, ``running`` M8191;
    ``current`` and ``longest`` are the link scan time and its maximum in ticks (D8201, D8202; None
    before the first) and ``longest_at`` the tick at which the longest one ended.
    """

    __slots__ = ("codes", "counts", "current", "flags", "longest", "longest_at", "running")

    def __init__(self) -> None:
        self.counts = [0] * STATIONS
        self.codes = [0] * STATIONS
        self.flags = [False] * STATIONS
        self.running = False
        self.current: int | None = None
        self.longest: int | None = None
        self.longest_at = 0

    def lost(self, station: int, code: int, *, count: bool = True) -> bool:
        """Store a code and set the flag, counting if asked to; returns whether the flag is new."""
        self.codes[station] = code
        if count and self.counts[station] < COUNT_LIMIT:
            self.counts[station] += 1
        new = not self.flags[station]
        self.flags[station] = True
        return new

    def measured_each(self, measured: tuple[int, int, int] | None) -> None:
        """Several link scans were measured (None: none): the longest, when it ended, and the latest."""
        if measured is not None:
            self.measured(*measured[:2])
            self.current = measured[2]

    def measured(self, duration: int, end: int) -> None:
        """A link scan took ``duration`` ticks and ended at ``end``."""
        self.current = duration
        if self.longest is None or duration > self.longest:
            self.longest = duration
            self.longest_at = end
