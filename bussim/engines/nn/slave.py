"""The N:N slave: answers its polls and judges what it overhears of all others.

Registers and codes: PW10 board manual, section 7.5; FX communication manual JY992D69901, chapters 4
and 12.2. How a listener judges (when it moves on, whose damage it is, the watchdog's length, that a
slave without the master's mode reports 7348/7448 and stays silent until STOP) is assumed.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

from bussim.engines.contract import DEADLINE, EVENTS, OPEN, STORED, TRANSMIT, RxChar, Transmit
from bussim.engines.nn import codes
from bussim.engines.nn.events import (
    MasterWatchdog,
    ParametersRefused,
    ParametersTaken,
    PolledWithoutParameters,
    SlaveEvent,
    StationBack,
    StationLost,
)
from bussim.engines.nn.frames import (
    DATA,
    ENQ,
    MODES,
    POLL,
    SOH,
    STX,
    Damage,
    Frame,
    FrameReader,
    LinkSettings,
    data_chars,
    encode_data,
)
from bussim.engines.nn.states import SLAVE, SlaveInput, SlaveState
from bussim.engines.nn.status import LinkStatus

# What a listener writes down for a poll that got no good answer, by what came last.
_SILENCE = codes.NOT_IN_NETWORK
#: Timeouts of silence that a listener grants the master, the worst reply added (assumed).
_WATCHDOG_TIMEOUTS = 2
_ANSWERED = 0  # nothing: an earlier attempt of the same exchange was answered
#: No poll is without an answer, and none was answered since the parameters arrived.
NOBODY = -1


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


class Listening(NamedTuple):
    """What a slave has in mind of the link besides its status: the state of its listening.

    ``pending``/``pending_counter``: the poll without an answer yet (below zero: none, and then its
    complement is the station that answered last, 0 for nobody) and ``outcome`` what its attempt came
    to; ``counter``: of the latest master frame; ``heard_master``: when a valid one ended;
    ``data_start``/``data_counter``: of the master's latest data frame.
    """

    pending: int
    pending_counter: int
    outcome: int
    counter: int
    heard_master: int
    data_start: int | None
    data_counter: int


class Slave:
    """A station 1–7 of a link. See :mod:`bussim.engines.contract` for the methods.

    Until the master's parameter frame arrives it ignores everything, except that a poll makes it
    note code 31 about itself.
    """

    __slots__ = (
        "_alert",
        "_counter",
        "_data_counter",
        "_data_start",
        "_encoded",
        "_encoded_image",
        "_events",
        "_heard_master",
        "_master_damaged",
        "_outcome",
        "_pending",
        "_pending_counter",
        "_reader",
        "_sent_counter",
        "_watching",
        "block_size",
        "config",
        "due",
        "due_counter",
        "heard",
        "heard_start",
        "settings",
        "state",
        "status",
        "wants_image",
        "watchdog",
    )

    def __init__(self, config: SlaveConfig) -> None:
        self.config = config
        self.state = SlaveState.STOPPED
        self.status = LinkStatus()
        #: The master's settings, None before they arrived.
        self.settings: LinkSettings | None = None
        #: When a reply's turnaround began (the end of its poll) and the counter it must carry.
        self.due = -1
        self.due_counter = 0
        #: The latest valid frame that :meth:`receive` completed, and its first edge.
        self.heard: Frame | None = None
        self.heard_start = 0
        self.wants_image = True
        self._events: deque[SlaveEvent] = deque()
        self._encoded: dict[int, Frame] = {}
        self._encoded_image: bytes | None = None
        self._reader = FrameReader()
        self._reset()

    def _reset(self) -> None:
        self._reader.reset()
        self._reader.data_size = None
        self.settings = None
        self.due = -1
        #: Bytes of a block in the link's mode, -1 while it is unknown.
        self.block_size = -1
        self._counter = -1  # of the latest master frame
        self._pending = NOBODY  # station whose poll has no answer yet
        self._pending_counter = 0
        self._sent_counter = 0  # of the reply sent latest
        self._outcome = _SILENCE
        self._watching = False
        # Something is wrong with the master (or it was not heard yet): its next frame is news.
        self._alert = True
        #: Ticks without a valid master frame after which code 11 is due, 0 while unknown.
        self.watchdog = 0
        self._heard_master = 0
        self._master_damaged = False
        self._data_start: int | None = None  # of the master's latest data frame
        self._data_counter = 0

    # -- listening together: a driver may let one listener stand for several ------------------------

    @property
    def calm(self) -> bool:
        """Linked, nothing wrong with the master and nothing half heard."""
        return self.state is SlaveState.LINKED and not self._alert and not self._reader.open

    @property
    def listening(self) -> Listening:
        """The state of its listening."""
        return Listening(
            self._pending,
            self._pending_counter,
            self._outcome,
            self._counter,
            self._heard_master,
            self._data_start,
            self._data_counter,
        )

    def listen_on(self, state: Listening) -> None:
        """Go on as if it had itself heard what led to this state."""
        (
            self._pending,
            self._pending_counter,
            self._outcome,
            self._counter,
            self._heard_master,
            self._data_start,
            self._data_counter,
        ) = state

    # -- what the PLC does ---------------------------------------------------------------------

    def start(self, now: int) -> int:
        """RUN; returns hints. Clears the status as STOP→RUN does."""
        del now
        self._reset()
        self.status = LinkStatus()
        self.state = SLAVE[self.state, SlaveInput.START]
        return DEADLINE

    def stop(self, now: int) -> int:
        """STOP or power-off: silent, deaf, and the parameters are lost; returns hints."""
        del now
        self._reset()
        self.status.running = False
        self.state = SLAVE[self.state, SlaveInput.STOP]
        return DEADLINE

    # -- listening -----------------------------------------------------------------------------

    def receive(self, char: RxChar, start: int, end: int) -> int:
        """One character; see the contract."""
        reader = self._reader
        heard = reader.character(char, start)
        if heard is None:
            return OPEN
        if type(heard) is Frame:
            self.heard, self.heard_start = heard, reader.start
            return self.receive_frame(heard, reader.start, end)
        assert type(heard) is Damage  # noqa: S101 - narrows the type; the reader returns nothing else
        return OPEN | self._damaged(heard, end)

    def receive_frame(self, frame: Frame, start: int, end: int) -> int:
        """A whole undamaged frame; the same as its characters one by one."""
        if self.state is not SlaveState.LINKED:
            return self._without_parameters(frame, end)
        kind = frame.kind
        if kind == POLL:
            hints = self._master_heard(end) if self._alert else 0
            self._heard_master = end
            station, counter = frame.station, frame.counter
            pending, same = self._pending, counter == self._pending_counter
            if pending >= 0 and not (same and station == pending):
                hints |= self._judge(end)
            if not (same and (station == ~pending or (station == pending and self._outcome == _ANSWERED))):
                self._outcome = _SILENCE
            else:
                self._outcome = _ANSWERED  # the master missed an answer that was heard here
            self._counter = self._pending_counter = counter
            self._pending = station
            if station == self.config.station:
                self.due = end
                self.due_counter = counter
                return hints | TRANSMIT
            return hints
        if kind == DATA:
            if len(frame.data) != self.block_size:
                self._reader.spoil(frame, start)
                return OPEN
            station = frame.station
            if station == self._pending and frame.counter == self._pending_counter:
                if station == self.config.station:
                    return 0
                self._pending = ~station
                if self.status.flags[station]:
                    return STORED | self._back(station, end)
                return STORED
            if station == 0:
                return self._master_data(frame, start, end)
            return self._other_data(frame, end)
        return self._parameters(frame, end)

    def _without_parameters(self, frame: Frame, end: int) -> int:
        if self.state is not SlaveState.WAITING:
            return 0
        if frame.settings is not None:
            return self._parameters(frame, end)
        if frame.kind == POLL and frame.station == self.config.station:
            self.status.codes[self.config.station] = codes.NO_PARAMETERS
            self._events.append(PolledWithoutParameters(end))
            return EVENTS
        return 0

    def _parameters(self, frame: Frame, end: int) -> int:
        settings = frame.settings
        assert settings is not None  # noqa: S101 - narrows the type; only parameter frames come here
        if settings.mode not in self.config.modes:
            self._reset()
            self.status.running = False
            self.state = SLAVE[self.state, SlaveInput.FOREIGN_MODE]
            self._events.append(ParametersRefused(end, settings))
            return EVENTS | DEADLINE
        hints = 0
        if settings != self.settings:
            self._events.append(ParametersTaken(end, settings))
            hints = EVENTS | DEADLINE  # another timeout may bring the watchdog forward
        self.settings = settings
        self.block_size = self._reader.data_size = MODES[settings.mode].size
        config = self.config
        self.watchdog = (
            _WATCHDOG_TIMEOUTS * settings.timeout * config.timeout_unit
            + config.worst_turnaround
            + data_chars(settings.mode) * config.character
        )
        self.state = SLAVE[self.state, SlaveInput.PARAMETERS]
        self._counter = frame.counter
        if self._pending < 0:
            self._pending = NOBODY  # a master that starts again counts from 0 again
        return hints | self._master_heard(end)

    def _master_data(self, frame: Frame, start: int, end: int) -> int:
        hints = self._master_heard(end) if self._alert else 0
        self._heard_master = end
        if self._pending >= 0:
            hints |= self._judge(end)
            self._pending = NOBODY
        counter = frame.counter
        if self._data_start is not None and counter == (self._data_counter + 1) & 15:
            self.status.measured(start - self._data_start, start)
        self._data_start = start
        self._data_counter = self._counter = counter
        return hints | STORED

    def _other_data(self, frame: Frame, end: int) -> int:
        station = frame.station
        if station == self.config.station:
            return 0
        if self._pending >= 0:
            # Somebody answers a poll that was not his, or an older one.
            wrong = station != self._pending
            return self._failed(codes.HEARD_WRONG_STATION if wrong else codes.HEARD_WRONG_COUNTER)
        if frame.counter != self._counter:
            return 0
        # It missed the poll: the data are good, and nothing is to be judged.
        self._pending, self._pending_counter = ~station, frame.counter
        return STORED | (self._back(station, end) if self.status.flags[station] else 0)

    def _back(self, station: int, now: int) -> int:
        self.status.flags[station] = False
        self._events.append(StationBack(now, station))
        return EVENTS

    def _failed(self, code: int) -> int:
        """What the pending poll's attempt has come to, as heard here."""
        if self._outcome != _ANSWERED:
            self._outcome = code
        return 0

    def _judge(self, now: int) -> int:
        """The master has moved past the polled station, whose answer was never heard here."""
        station = self._pending
        if station == self.config.station or self._outcome == _ANSWERED:
            return 0
        status = self.status
        count = not (status.flags[station] and self.config.count_on_edge)
        new = status.lost(station, self._outcome, count=count)
        self._events.append(StationLost(now, station, self._outcome, new))
        return EVENTS

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

    def _damaged(self, damage: Damage, now: int) -> int:
        if self.state is not SlaveState.LINKED:
            return 0
        header = damage.header
        masters = header in (ENQ, SOH) or (header == STX and damage.first == _MASTERS_DIGIT)
        if masters or self._pending < 0:
            if self._master_damaged:
                return 0
            self._master_damaged = True
            return self._master_lost(now, codes.MASTER_DAMAGED)
        return self._failed(codes.DAMAGED)

    def line_idle(self, now: int) -> int:
        """Two quiet character times: what was unfinished is damage."""
        damage = self._reader.quiet()
        return 0 if damage is None else self._damaged(damage, now)

    def deadline(self) -> int | None:
        """The watchdog on the master's frames."""
        return self._heard_master + self.watchdog if self._watching else None

    def on_deadline(self, now: int) -> int:
        """The master's frames stopped: code 11, once, and the next interval is not measured."""
        self._watching = False
        self.status.running = False
        self._data_start = None
        self._events.append(MasterWatchdog(now))
        return DEADLINE | self._master_lost(now, codes.MASTER_SILENT)

    # -- sending -------------------------------------------------------------------------------

    def begin_transmit(self, now: int, image: bytes, counter: int = 0) -> Frame:
        """The reply to the poll with this counter; ``image`` is the block at the latest END."""
        del now
        self._sent_counter = counter
        if self._reader.length:
            self._reader.reset()
        if image is not self._encoded_image:
            if image != self._encoded_image:
                self._encoded.clear()
            self._encoded_image = image
        frame = self._encoded.get(counter)
        if frame is None:
            frame = self._encoded[counter] = encode_data(self.config.station, counter, image)
        return frame

    def transmit_done(self, now: int) -> int:
        """The reply has left: its poll is answered, as far as this station knows."""
        del now
        if self.state is SlaveState.LINKED:
            if self._pending == self.config.station and self._pending_counter == self._sent_counter:
                self._pending = ~self._pending
            self.status.running = True
        return 0

    def poll(self) -> Transmit | SlaveEvent | None:
        """The next event, then the reply that is due (its turnaround is the driver's)."""
        if self._events:
            return self._events.popleft()
        if self.due >= 0:
            at, self.due = self.due, -1
            return Transmit(at, reply=True, counter=self.due_counter)
        return None


_MASTERS_DIGIT = ord("0")
