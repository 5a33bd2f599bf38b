"""What a slave notes about the link: replies that other stations owe, and the master's frames.

A slave receives every frame. For each poll it notes whether the reply came, and when the master moves on
without one, it stores a code and sets the station's flag. How it decides (when the master has moved on,
which station a damaged frame belongs to, the watchdog's length) is assumed; the codes and registers are
those of the PW10 board manual, section 7.5, and the FX communication manual JY992D69901, chapter 12.2.
"""

from dataclasses import dataclass
from typing import NamedTuple

from bussim.engines.contract import DEADLINE, EVENTS
from bussim.engines.nn import codes
from bussim.engines.nn.contract import STORED, NnEngine
from bussim.engines.nn.events import MasterWatchdog, SlaveEvent, StationBack, StationLost
from bussim.engines.nn.frames import ENQ, SOH, STX, Damage, Frame, LinkSettings, data_chars
from bussim.engines.nn.status import LinkStatus

#: No poll is without a reply, and none had one since the parameters arrived.
NONE_PENDING = -1
#: Timeouts of silence that a slave grants the master, beyond the slowest reply (assumed).
_WATCHDOG_TIMEOUTS = 2
_REPLIED = 0  # no code: an earlier attempt of the same exchange had a reply
_MASTERS_DIGIT = ord("0")


@dataclass(frozen=True, slots=True)
class SlaveConfig:
    """A slave's settings. Times in ticks.

    ``timeout_unit`` is the tick length of D8180's unit (10 ms); ``worst_turnaround`` the longest
    time from a poll to a reply's first edge that this family needs (without faults, END included
    where replies wait for it) and ``character`` one character time: from both follows the watchdog.
    """

    station: int
    modes: tuple[int, ...]
    timeout_unit: int
    worst_turnaround: int
    character: int
    count_on_edge: bool = False


class ReceptionState(NamedTuple):
    """What a slave remembers of the frames so far, besides its status.

    ``pending``/``pending_counter``: the poll without a reply yet (below zero: none, and then its
    complement is the station that replied last, 0 for none) and ``outcome`` the code of its attempt so
    far; ``counter``: of the latest master frame; ``heard_master``: when a valid one ended;
    ``data_start``/``data_counter``: of the master's latest data frame.
    """

    pending: int
    pending_counter: int
    outcome: int
    counter: int
    heard_master: int
    data_start: int | None
    data_counter: int


_NOTHING_RECEIVED = ReceptionState(NONE_PENDING, 0, codes.NOT_IN_NETWORK, -1, 0, None, 0)


class Reception:
    """The state of reception of a slave."""

    @property
    def reception(self) -> ReceptionState:
        """The state as one value."""
        return ReceptionState(
            self.pending,
            self._pending_counter,
            self._outcome,
            self._counter,
            self._heard_master,
            self._data_start,
            self._data_counter,
        )

    def resume(self, state: ReceptionState) -> None:
        """Go on as if it had itself received the frames that led to this state."""
        (
            self.pending,
            self._pending_counter,
            self._outcome,
            self._counter,
            self._heard_master,
            self._data_start,
            self._data_counter,
        ) = state


class LinkMonitor(Reception, NnEngine[SlaveEvent]):
    """The notes of one slave. Methods return hints, see :mod:`bussim.engines.contract`."""

    def __init__(self, config: SlaveConfig) -> None:
        super().__init__()
        self.config = config
        self.status = LinkStatus()

    def _reset_notes(self) -> None:
        self._watching = False
        # The master is in error or was not received yet: its next frame changes that.
        self._alert = True
        #: Ticks without a valid master frame after which code 11 is due, 0 while unknown.
        self.watchdog = 0
        self._master_damaged = False
        self.resume(_NOTHING_RECEIVED)

    # -- frames ------------------------------------------------------------------------------------

    def _master_data(self, frame: Frame, start: int, end: int) -> int:
        hints = self._master_heard(end) if self._alert else 0
        self._heard_master = end
        if self.pending >= 0:
            hints |= self._no_reply(end)
            self.pending = NONE_PENDING
        counter = frame.counter
        if self._data_start is not None and counter == (self._data_counter + 1) & 15:
            self.status.measured(start - self._data_start, start)
        self._data_start = start
        self._data_counter = self._counter = counter
        return hints | STORED

    def _other_data(self, frame: Frame, end: int) -> int:
        """A slave's data frame that is not the reply to the pending poll."""
        station = frame.station
        if station == self.config.station:
            return 0
        if self.pending >= 0:
            # A reply to a poll of another station, or to an older one.
            wrong = station != self.pending
            return self._failed(codes.HEARD_WRONG_STATION if wrong else codes.HEARD_WRONG_COUNTER)
        if frame.counter != self._counter:
            return 0
        # This slave missed the poll: the data are good, and no outcome is to be noted.
        self.pending, self._pending_counter = ~station, frame.counter
        return STORED | (self._back(station, end) if self.status.flags[station] else 0)

    def _damaged(self, damage: Damage, now: int) -> int:
        header = damage.header
        masters = header in (ENQ, SOH) or (header == STX and damage.first == _MASTERS_DIGIT)
        if masters or self.pending < 0:
            if self._master_damaged:
                return 0
            self._master_damaged = True
            return self._master_lost(now, codes.MASTER_DAMAGED)
        return self._failed(codes.DAMAGED)

    # -- slaves ------------------------------------------------------------------------------------

    def _poll_noted(self, station: int, counter: int, end: int) -> int:
        """A poll of the master: the one before it has failed unless this is a new attempt of it."""
        pending, same = self.pending, counter == self._pending_counter
        hints = 0
        if pending >= 0 and not (same and station == pending):
            hints = self._no_reply(end)
        if same and (station == ~pending or (station == pending and self._outcome == _REPLIED)):
            self._outcome = _REPLIED  # the master missed a reply that was received here
        else:
            self._outcome = codes.NOT_IN_NETWORK
        self._counter = self._pending_counter = counter
        self.pending = station
        return hints

    def _back(self, station: int, now: int) -> int:
        self.status.flags[station] = False
        self._events.append(StationBack(now, station))
        return EVENTS

    def _failed(self, code: int) -> int:
        """Note the outcome of the pending poll's attempt, as received here."""
        if self._outcome != _REPLIED:
            self._outcome = code
        return 0

    def _no_reply(self, now: int) -> int:
        """The master has moved past the polled station, whose reply was never received here."""
        station = self.pending
        if station == self.config.station or self._outcome == _REPLIED:
            return 0
        status = self.status
        count = not (status.flags[station] and self.config.count_on_edge)
        new = status.lost(station, self._outcome, count=count)
        self._events.append(StationLost(now, station, self._outcome, new))
        return EVENTS

    # -- the master --------------------------------------------------------------------------------

    def _set_watchdog(self, settings: LinkSettings) -> None:
        config = self.config
        self.watchdog = (
            _WATCHDOG_TIMEOUTS * settings.timeout * config.timeout_unit
            + config.worst_turnaround
            + data_chars(settings.mode) * config.character
        )

    def _master_heard(self, now: int) -> int:
        """A valid frame of the master: the watchdog runs again and its flag goes off."""
        self._heard_master = now
        self._master_damaged = False
        self._alert = False
        hints = 0
        if self.status.flags[0]:
            hints = self._back(0, now)
        if not self._watching:
            self._watching = True
            hints |= DEADLINE
        return hints

    def _master_lost(self, now: int, code: int) -> int:
        self._alert = True
        new = self.status.lost(0, code)
        self._events.append(StationLost(now, 0, code, new))
        return EVENTS

    def deadline(self) -> int | None:
        """When the watchdog on the master's frames expires; None while it does not run."""
        return self._heard_master + self.watchdog if self._watching else None

    def on_deadline(self, now: int) -> int:
        """The master's frames stopped: code 11, once, and the next interval is not measured."""
        self._watching = False
        self.status.running = False
        self._data_start = None
        self._events.append(MasterWatchdog(now, self._heard_master))
        return DEADLINE | self._master_lost(now, codes.MASTER_SILENT)
