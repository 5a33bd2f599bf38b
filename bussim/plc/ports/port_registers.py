"""The registers of one serial port of a PLC: parameters in, an engine out, and what happens at END."""

from collections import deque
from collections.abc import Callable, Hashable, Sequence

from bussim.engines.free.engine import FreeConfig, FreePort
from bussim.engines.modbus.framing import Framing
from bussim.engines.modbus.master import Master, MasterConfig
from bussim.engines.modbus.pdu import READS
from bussim.engines.modbus.server import RegisterMap
from bussim.engines.modbus.slave import Slave, SlaveConfig
from bussim.plc.errors import SerialErrors
from bussim.plc.memory import BIT_RANGES, Device, Memory
from bussim.plc.ports.cpavl import BITS, WORDS, BadSettings, PortSettings, read_settings
from bussim.plc.ports.device_layout import taken, words_fit
from bussim.plc.ports.events import PortEvent
from bussim.plc.ports.free import FreeSide
from bussim.plc.ports.free_list import listener_of
from bussim.plc.ports.master import MasterSide
from bussim.plc.ports.rs2 import Drive, Rs2
from bussim.plc.ports.side import EngineItem, Side
from bussim.plc.ports.slave import SlaveSide
from bussim.plc.ports.spec import FreeSpec, PollSpec, PortSpec
from bussim.plc.ports.status import PortStatus
from bussim.plc.profiles import Profile

PortEngine = Master | Slave | FreePort
#: A PLC's devices as its slave ports show them.
Maps = Callable[[Memory], RegisterMap]


class PortRegisters:
    """One port of a PLC. All times are ticks.

    ``polls`` are its instructions where no program drives it: those that fit the protocol in its
    words are used. ``maps`` makes the register map of a slave. Raises ValueError for words or bits
    that do not lie in memory, or instructions that cannot share the port.

    The driver starts and stops the engine that :meth:`take_over` returns, runs it, hands its events
    to :meth:`event`, and calls :meth:`at_end` at the first END at or after :meth:`wanted_end`, which it
    asks again after each call of the engine.
    """

    def __init__(
        self, spec: PortSpec, polls: Sequence[PollSpec | FreeSpec], profile: Profile, maps: Maps | None = None
    ) -> None:
        self.spec = spec
        #: What the port's words said at the latest STOP→RUN; None before it and where it refused them.
        self.settings: PortSettings | None = None
        #: Its engine; None in STOP, after bad parameters, and without a protocol.
        self.engine: PortEngine | None = None
        #: Whether a transaction or reception was under way at the latest END: it costs execution time.
        self.active = False
        self._devices = (spec.words, spec.bits)
        self._check(spec.words, spec.bits)
        self._polls = [poll for poll in polls if isinstance(poll, PollSpec)]
        self._free = [poll for poll in polls if isinstance(poll, FreeSpec)]
        listener_of(self._free)
        self._profile = profile
        self._maps = maps
        self._side = Side()
        self._events: deque[PortEvent] = deque()

    def _check(self, words: Device, bits: Device) -> None:
        last = bits.address + BITS - 1
        ranges = BIT_RANGES[bits.letter] if bits.letter in "MSY" else ()
        if not words_fit(words, WORDS) or not any(
            low <= bits.address and last <= high for low, high in ranges
        ):
            raise ValueError(f"{self.spec.name}: {WORDS} words from {words}, {BITS} bits from {bits} on")

    def move(self, words: Device, bits: Device) -> None:
        """CPAVL is executed: the port's words and bits lie here from the next STOP→RUN on.

        Raises ValueError if they do not lie in memory.
        """
        self._check(words, bits)
        self._devices = (words, bits)

    # -- RUN and STOP ------------------------------------------------------------------------------

    def take_over(self, memory: Memory, errors: SerialErrors, now: int) -> PortEngine | None:
        """STOP→RUN: read the words; returns the engine, which is to be started at ``now``.

        None where the port has no protocol that is simulated, or refuses its words: then M8063 and
        D8063 say so, and it stays silent.
        """
        self.engine = self.settings = None
        self._side = Side()
        self.active = False
        status = PortStatus(self.spec.name, memory, self._devices, errors, self._events)
        status.good()
        settings = read_settings(self.spec.name, memory, self._devices[0])
        if isinstance(settings, BadSettings):
            status.failed(settings.error, now, settings.text)
            return None
        self.settings = settings
        self._side = self._make(settings, status, now)
        return self.engine

    def _make(self, settings: PortSettings, status: PortStatus, now: int) -> Side:
        protocol, profile = settings.protocol, self._profile
        if protocol is None or protocol == "hmi":
            return Side()
        if protocol == "free":
            free = self.engine = FreePort(
                FreeConfig(
                    timing=settings.timing,
                    timeout=settings.timeout,
                    start=settings.start,
                    end=settings.end,
                    awaits_first=profile.free_awaits_first,
                    keeps_frame=profile.free_keeps_frame,
                )
            )
            return FreeSide(free, status, self._free, eight_bit=settings.eight_bit, now=now)
        framing = (
            Framing.rtu(settings.timing, profile.rtu_gaps)
            if protocol.startswith("modbus-rtu")
            else Framing.ascii(profile.ascii_gap)
        )
        if protocol.endswith("-slave"):
            if self._maps is None:
                raise ValueError(f"{self.spec.name} is a Modbus slave without a register map")
            config = SlaveConfig(framing, driven=True, backlog=profile.slave_backlog)
            slave = self.engine = Slave(config, {settings.station: self._maps(status.memory)})
            return SlaveSide(slave, settings.timing, status if profile.slave_errors else None)
        master = self.engine = Master(
            MasterConfig(
                framing=framing,
                timeout=settings.timeout,
                interval=settings.interval,
                turnaround=profile.broadcast_turnaround,
                begun_holds=profile.begun_holds,
            )
        )
        return MasterSide(master, status, self._polls, now)

    def release(self, now: int) -> None:
        """STOP or power-off: what was under way is forgotten. The driver stops the engine itself."""
        self._side.release(now)
        self.engine, self._side = None, Side()
        self.active = False

    # -- END ---------------------------------------------------------------------------------------

    def wanted_end(self, now: int) -> int | None:
        """The earliest tick from which an END matters to this port; it may lie before ``now``.

        None: no END does before something happens on the wire or in a program.
        """
        side = self._side
        return now if side.busy != self.active else side.wanted_end(now)

    @property
    def reads_devices(self) -> bool:
        """Whether what it sends may come from the PLC's devices."""
        engine = self.engine
        return engine is not None and not (
            type(engine) is Master and all(poll.function in READS for poll in self._polls)
        )

    @property
    def writes(self) -> set[Device] | None:
        """The devices that it may write; None where that is not known, or where polls read over its bits."""
        if self.engine is None:
            return set()
        if self.reads_devices:
            return None
        letter, first = self._devices[1]
        bits = {Device(letter, first + number) for number in range(BITS)}
        read = [taken(poll.device, poll.function, poll.count) for poll in self._polls if poll.device]
        return bits.union(*read) if bits.isdisjoint(device for each in read for device in each) else None

    @property
    def polling(self) -> MasterSide | None:
        """What its poll list does, if it is a master whose polls only read."""
        return self._side if isinstance(self._side, MasterSide) and not self.reads_devices else None

    @property
    def shows_memory(self) -> bool:
        """Whether the next END serves a request for what is in memory: special devices must be current."""
        return type(self.engine) is Slave and self.engine.waiting

    def at_end(self, end: int) -> int:
        """Carry out what happens at this END; returns hints for the engine (see its contract)."""
        hints = self._side.at_end(end)
        self.active = self._side.busy
        return hints

    def event(self, item: EngineItem, now: int) -> None:
        """Take an event of the engine."""
        self._side.event(item, now)

    def poll(self) -> PortEvent | None:
        """The next event, None if there is none."""
        return self._events.popleft() if self._events else None

    # -- a program's instructions --------------------------------------------------------------------

    def drive(self, instruction: Hashable, operands: Rs2, now: int) -> Drive:
        """RS2 is executed with its contact on; ``instruction`` is its number in the program."""
        return self._side.drive(instruction, operands, now)

    def undrive(self, instruction: Hashable, now: int) -> None:
        """RS2 is executed with its contact off."""
        self._side.undrive(instruction, now)
