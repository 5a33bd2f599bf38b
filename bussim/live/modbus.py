"""Modbus masters and slaves on real ports."""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace

from bussim.engines.modbus.adu import LAST_RESERVED, Mode
from bussim.engines.modbus.events import FrameRejected, TransactionEnded
from bussim.engines.modbus.framing import Framing
from bussim.engines.modbus.gaps import STANDARD_GAPS, silences
from bussim.engines.modbus.master import MasterConfig
from bussim.engines.modbus.pdu import Request, encode_request, response_size
from bussim.engines.modbus.polls import Poll, PollList
from bussim.engines.modbus.resync import ResyncingMaster
from bussim.engines.modbus.server import RegisterMap
from bussim.engines.modbus.slave import Slave, SlaveConfig
from bussim.errors import UsageError
from bussim.line.characters import CharFormat, LineTiming
from bussim.live.runner import EngineRunner, Handling
from bussim.live.wire import Wire
from bussim.units import round_half_up

#: What the standard asks for: RTU 8E1, ASCII 7E1.
STANDARD_FORMATS = {Mode.RTU: CharFormat(8, "E", 1), Mode.ASCII: CharFormat(7, "E", 1)}

#: With which function is read what one writes whose response equals the request.
_READ_BACK = {5: 1, 6: 3}
#: Bytes of the PDU of such a write.
_WRITE_ONE_SIZE = 5


class ModbusHandling(Handling):
    """What happens to the transmissions and events of a Modbus engine."""

    def __init__(self) -> None:
        #: Frames that were ignored, by reason.
        self.rejected: Counter[str] = Counter()

    def count(self, event: FrameRejected) -> None:
        """Count a frame that was ignored."""
        self.rejected[event.reason] += 1


def live_framing(mode: Mode, wire: Wire) -> tuple[Framing, int]:
    """How a port frames in real time, and the protocol's own silence behind a frame.

    The framing is that of the engine's reader, its silences lengthened by the tolerance of the port. Raises
    UsageError where the format has not the bits for the mode.
    """
    if mode is Mode.ASCII:
        framing = Framing.ascii()
    else:
        try:
            framing = Framing.rtu(wire.timing, STANDARD_GAPS)
        except ValueError as error:
            raise UsageError(str(error)) from error
    tolerance = wire.options.tolerance
    longer = replace(framing, quiet=framing.quiet + tolerance, inner=framing.inner + tolerance)
    return longer, framing.quiet


def line_of(mode: Mode, baud: int, fmt: CharFormat | None = None) -> LineTiming:
    """The line of a mode: the standard's format where none is given."""
    return LineTiming(baud, fmt or STANDARD_FORMATS[mode])


def slave_runner(
    wire: Wire,
    mode: Mode,
    maps: Mapping[int, RegisterMap],
    *,
    delay: int = 0,
    handling: Handling | None = None,
    slave: Callable[[SlaveConfig, Mapping[int, RegisterMap]], Slave] = Slave,
) -> EngineRunner:
    """Devices by station number as slaves on a wire. ``delay``: ticks from a request's end to its reply.

    ``slave`` makes the engine.
    """
    framing, quiet = live_framing(mode, wire)
    engine = slave(SlaveConfig(framing, delay=delay), maps)
    return EngineRunner(engine, wire, quiet=quiet, mode=mode, handling=handling)


def master_runner(
    wire: Wire,
    mode: Mode,
    polls: PollList[Poll],
    *,
    timeout: int,
    interval: int = 0,
    turnaround: int | None = None,
    resync: bool = True,
    handling: Handling | None = None,
) -> EngineRunner:
    """A master that works through a poll list on a wire. Raises UsageError for what it cannot send.

    Times in ticks. ``interval`` is the pause from one transaction's end to the next request; an RTU
    master never makes it shorter than the silence that ends a frame. The timeout is the system's:
    a response that has begun by then is waited for; ``resync`` is what
    :class:`~bussim.engines.modbus.resync.ResyncingMaster` does about one that comes later. Reserved
    stations (248 to 255) are asked, too.
    """
    framing, quiet = live_framing(mode, wire)
    silent = quiet if mode is Mode.RTU else 0
    config = MasterConfig(
        framing, timeout, max(interval, silent), begun_holds=True, last_station=LAST_RESERVED
    )
    if turnaround is not None:
        config = replace(config, turnaround=turnaround)
    try:
        engine = ResyncingMaster(config, polls, resync=resync)
    except ValueError as error:
        raise UsageError(str(error)) from error
    return EngineRunner(engine, wire, quiet=quiet, mode=mode, handling=handling)


class PortCheck:
    """What responses say about a port: whether it returns what is sent, and whether its bytes take time."""

    def __init__(self, wire: Wire, mode: Mode, timeout: int) -> None:
        self._wire, self._timeout = wire, timeout
        self._framing, _ = live_framing(mode, wire)
        self._silence = round_half_up(silences(wire.timing, STANDARD_GAPS)[1])  # a slave waits for it
        #: Whether what is sent comes back; None where nothing made that likely.
        self.found: bool | None = None

    def no_time(self, ended: TransactionEnded) -> bool:
        """Whether a good response came sooner than its characters let it, so that its time is not known.

        The port has no pace then, and later times are reckoned so.
        """
        wire, sent, end = self._wire, ended.sent, ended.answer_end
        if wire.instant or sent is None or end is None or ended.error is not None:
            return False
        sizes = len(encode_request(ended.request)), response_size(ended.request)
        least = sum(wire.timing.characters(self._framing.chars(size)) for size in sizes)
        if end - sent >= least:
            return False
        wire.has_no_pace()
        return True

    def is_echo(self, written: TransactionEnded) -> bool:
        """Whether what a write took is an echo, since its response equals it.

        It is if it came before a station can have responded (and the port have held that back) and a read of
        what was written comes back, too: its response cannot equal it. Nothing else may be under way.
        """
        asked, end, wire = written.asked, written.answer_end, self._wire
        if written.error is not None or asked is None or end is None or wire.options.echo:
            return False
        function = _READ_BACK.get(written.request.function)
        chars = 0 if wire.instant else wire.timing.characters(self._framing.chars(_WRITE_ONE_SIZE))
        if function is None or end - asked >= self._silence + chars + wire.options.tolerance:
            return False
        if self.found is None:
            self.found = self._comes_back(written.station, Request(function, written.request.address, 1))
        return self.found

    def _comes_back(self, station: int, read: Request) -> bool:
        wire, clock = self._wire, self._wire.clock
        sent = self._framing.encode(station, encode_request(read)).chars
        begun = clock.now() + self._silence
        while clock.now() < begun:
            wire.read(begun)
        wire.write(sent)
        heard, until = b"", clock.now() + wire.timing.characters(len(sent)) + self._timeout
        while wire.connected and (now := clock.now()) < until:
            data = wire.read(until)
            heard += data
            if data:  # what follows at once belongs to it
                until = min(until, now + self._framing.quiet)
        return sent in bytes(wire.characters[value].value for value in heard)
