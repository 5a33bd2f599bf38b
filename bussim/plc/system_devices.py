"""The special devices that live by themselves in every PLC, with a program or without.

FX programming manual, table of special devices: M8000 on and M8001 off in RUN, M8002 on and M8003 off in the
first scan; M8004 on while one of M8060–M8067 is, whose number D8004 has (of several the first: assumed);
M8011 M8012 M8013 M8014 clocks of 10 ms, 100 ms, 1 s and 1 min (half a period on, then half off; they run free
from power-on, with the on half first, and change at scans only: assumed); D8000 the watchdog's time in ms;
D8001 and D8101 the firmware; D8010 D8011 D8012 the time of the latest scan, the shortest and the longest
since RUN, in 0.1 ms (rounded down: assumed; 0 before a whole one); D8013–D8019 second, minute, hour, day,
month, year and day of the week (0: Sunday) of a clock that a battery keeps going.
"""

from array import array
from collections.abc import Sequence
from datetime import datetime, timedelta

from bussim.plc.errors import note_errors
from bussim.plc.memory import Memory
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND

#: D8000 at power-on, in ms.
WATCHDOG = 200
#: The clock: D8013–D8018, and D8019.
CLOCK = range(8013, 8020)
#: D8010, the first of the three, and their unit of 0.1 ms.
_SCAN_TIMES, _SCAN_UNIT = 8010, TICKS_PER_MS // 10
#: M8000–M8003 in STOP, in the first scan and in the later ones.
_STOPPED, _FIRST_SCAN, _LATER_SCAN = b"\0\1\0\1", b"\1\0\1\0", b"\1\0\0\1"


def clock_of(words: Sequence[int]) -> datetime:
    """The time that D8013–D8018 name, of 2000 on (without any its beginning: assumed). Raises ValueError."""
    second, minute, hour, day, month, year = words
    return datetime(2000 + year, month or 1, day or 1, hour, minute, second)


class SystemDevices:
    """Those of one PLC from a power-on at the tick ``power_on`` on. In STOP at first.

    What D8013–D8018 hold then is what its clock showed at tick 0.
    """

    def __init__(self, memory: Memory, power_on: int) -> None:
        self._m, self._d = memory.bits("M"), memory.words("D")
        self._power_on = power_on
        self._clock = clock_of(self._d[CLOCK.start : CLOCK.stop - 1])
        self._second = -1  # that the clock shows, since tick 0
        self.stop()

    def stop(self) -> None:
        """STOP."""
        self._m[8000:8004] = _STOPPED

    def scan(self, begin: int, times: tuple[int, int, int]) -> None:
        """Show what a scan that begins at a tick finds: in ``times`` D8010–D8012 in ticks, 0 in the first."""
        m, d = self._m, self._d
        # Written anew each time: an index register may have led a program to them.
        m[8000:8004] = _LATER_SCAN if times[0] else _FIRST_SCAN
        time = begin - self._power_on
        m[8011] = time % (10 * TICKS_PER_MS) < 5 * TICKS_PER_MS
        m[8012] = time % (100 * TICKS_PER_MS) < 50 * TICKS_PER_MS
        m[8013] = time % (1000 * TICKS_PER_MS) < 500 * TICKS_PER_MS
        m[8014] = time % (60_000 * TICKS_PER_MS) < 30_000 * TICKS_PER_MS
        for address, ticks in enumerate(times, _SCAN_TIMES):
            d[address] = min(ticks // _SCAN_UNIT, 0xFFFF)
        note_errors(m, d)
        second = begin // TICKS_PER_SECOND
        if second != self._second:
            self._second = second
            now = self._clock + timedelta(seconds=second)
            year, *others = now.timetuple()[:7]
            d[CLOCK.start : CLOCK.stop] = array("H", [*others[4::-1], year % 100, (others[5] + 1) % 7])
