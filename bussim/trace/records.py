"""What is recorded of a run while it goes on (records, by tick) and when it has ended (totals).

The simulation and the serial-port driver write these; results, exports and reports read them.
All times are ticks of 1/72 MHz.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

from bussim.line.contention import Contention
from bussim.line.protocols import BusProtocol
from bussim.line.wave import Pause


class ScanRecord(NamedTuple):
    """One finished link scan: from one master data frame's start to the next one's."""

    bus: str
    number: int  # counts from 0; `index` in the tables
    start: int
    duration: int
    attempts: int  # polls sent in it, repeats included
    failed: int  # attempts that failed
    stations_in_error: int  # flags on at its end
    cause: str  # what made it longer than a plain one; "" if nothing did


class AttemptRecord(NamedTuple):
    """One attempt at one station, successful or not (only for a traced run)."""

    bus: str
    start: int  # first edge of the poll
    end: int  # when the attempt was decided
    station: int
    number: int  # 1 = first attempt of its exchange
    outcome: str  # "ok", "no reply", "wrong station", "wrong counter", "damaged"
    code: int  # 0, or the error code 0x01…0x04
    turnaround: int | None  # end of the poll to the reply's first edge; None without a reply


class FrameRecord(NamedTuple):
    """One frame that was on a bus (only for a traced run)."""

    bus: str
    start: int
    end: int  # when the sender's driver finished or was cut off
    sender: str
    kind: str  # "data", "poll", "parameters", "jabber"
    station: int | None
    counter: int | None
    chars: bytes  # the characters that were sent
    damaged_bits: tuple[int, ...]  # bits inverted on the wire, counted from the first start bit
    damaged_at: dict[str, tuple[int, ...]]  # bits inverted in one receiver only, by station name
    collided: bool
    cut: bool
    protocol: str = "nn"  # one of FRAME_PROTOCOLS
    baud: int = 38400  # the sender's rate, format and clock error
    format: str = "7E1"
    ppm: float = 0.0
    released: int | None = None  # when the sender's driver went off, if later than ``end``
    pauses: tuple[Pause, ...] = ()  # inside the frame: after which character (from 0), and for how long

    @property
    def driven_until(self) -> int:
        """When the sender's driver went off."""
        return self.end if self.released is None else self.released


class TransactionRecord(NamedTuple):
    """One attempt of a Modbus master: a request and what became of it."""

    bus: str
    master: str  # node: "press1.COM3", or a device's name
    poll: str  # name of the poll; "" where a program drove it
    attempt: int  # 1 = first of its turn
    station: int
    function: int
    address: int
    quantity: int
    sent: int | None  # first edge of the request; None: never sent
    asked: int | None  # last stop bit of the request
    answer_start: int | None  # first edge of what decided it, if something was received
    answer_end: int | None  # last stop bit of that
    end: int  # when the port decided it
    taken: int  # when the master took it over: at a PLC's END
    outcome: str  # "ok", "exception", or the port error ("no response in time", "CRC or LRC", …)
    error: int | None  # yy of D8063 = 7xyy; None where it is ok
    exception: int  # exception code, 0 for none
    served: int | None  # when the slave read its values, where the response belongs to this request
    mismatched: bool  # it took the response to another request (RTU carries no transaction number)
    chars: int  # characters of the request and the response


class PollRecord(NamedTuple):
    """One turn of a poll, all its attempts included."""

    bus: str
    master: str
    poll: str
    start: int  # when its first attempt was driven
    end: int  # when its last attempt was taken over
    attempts: int
    error: int | None  # of the last attempt
    late: int  # ticks from the moment it was due to ``start``


class CycleRecord(NamedTuple):
    """A cycle of a poll list is over: every poll had its turn."""

    bus: str
    master: str
    number: int  # counts from 0
    start: int
    duration: int


class FreeRecord(NamedTuple):
    """Bytes of the free protocol that a port has sent or received."""

    bus: str
    node: str
    poll: str  # name of the instruction in ``polls:``; "" for a device or a program
    direction: str  # "sent" or "received"
    start: int | None  # first edge; None where nothing came
    end: int
    data: bytes
    ended: str  # of a reception: "all bytes are there", "end character" or "timeout"; "" where sent
    damaged: int  # characters with parity or framing errors


class DeviceValueRecord(NamedTuple):
    """A watched device of a PLC has a new value (only devices that the scenario observes); 0 at first."""

    tick: int  # the END at which it changed, or the change of supply or mode
    plc: str
    device: str
    value: int


class InputRecord(NamedTuple):
    """An input's wire has changed (only of inputs that the scenario drives)."""

    tick: int
    plc: str
    device: str
    level: int  # from then on
    sampled: int  # the beginning of the scan that sampled it next
    seen: bool  # whether it was still so then
    end: int  # the END of that scan: when what the program made of it can leave the PLC


#: Kinds of notes: a PLC goes to RUN, or a device gets its supply; and the end of that. ``where`` names it.
#: A PLC in STOP whose supply goes or comes back has the second again.
IN_RUN, LEFT_RUN = "in_run", "left_run"
#: Texts of the second one.
WITHOUT_SUPPLY, IN_STOP = "without supply", "in STOP"


class NoteRecord(NamedTuple):
    """Any other event: a fault, a flag, a PLC's state, a late reply."""

    tick: int
    kind: str  # such as "fault", "fault_over", "station_error", "recovered", "watchdog", "undetected"
    where: str  # name of the bus or PLC
    text: str
    detail: dict[str, int | str]


class EndsRecord(NamedTuple):
    """ENDs of a PLC in order, as :meth:`bussim.trace.sink.Sink.ends` reported them, in a trace."""

    plc: str
    ticks: tuple[int, ...]


#: Everything that a line of a trace can be.
Record = (
    FrameRecord
    | ScanRecord
    | AttemptRecord
    | TransactionRecord
    | PollRecord
    | CycleRecord
    | FreeRecord
    | DeviceValueRecord
    | InputRecord
    | EndsRecord
    | NoteRecord
)


class TraceBus(NamedTuple):
    """A bus as the first line of a trace describes it."""

    name: str
    protocol: BusProtocol
    baud: int
    format: str  # "7E1"
    nodes: tuple[str, ...]  # in cable order
    stations: dict[str, int]  # station number by node, as far as it is known from the start
    contention: Contention = Contention.ZERO_WINS  # that of earlier versions

    @property
    def plcs(self) -> frozenset[str]:
        """PLCs that have a port on the bus (and devices, which are their own node)."""
        return frozenset(node.partition(".")[0] for node in self.nodes)


class TraceHeader(NamedTuple):
    """What a trace is of; of a recording of a real wire less is known than of a simulation."""

    buses: tuple[TraceBus, ...] = ()
    scenario: str = ""
    seed: int | None = None
    duration: int | None = None  # ticks that the run was to last; None: not known beforehand
    exact: bool = True  # False: the times are those of an operating system

    def bus(self, name: str) -> TraceBus | None:
        """The bus of that name, None if there is none."""
        return next((bus for bus in self.buses if bus.name == name), None)


class OrdinaryTurns(NamedTuple):
    """Turns of one poll in order, each with one good transaction as ``first`` was; ticks, one entry a turn.

    ``peer`` is the node that responds; ``begun`` are the first edges of the responses, ``driven`` and
    ``late`` are those of :class:`PollRecord`.
    """

    first: TransactionRecord
    peer: str
    sent: list[int]
    begun: list[int]
    taken: list[int]
    driven: list[int]
    late: list[int]


class Outcome(StrEnum):
    """What became of a free protocol's message at a node, or of a Modbus request.

    ``AWAY``: the receiver had no supply, was in STOP or sent jabber. ``DEAF``: it was at work, nothing came.
    """

    GOOD = "good"
    AWAY = "away"
    DEAF = "deaf"
    # Of messages: characters with errors, or a reception ended by timeout; believed, with other characters;
    # the port was not ready to receive.
    DAMAGED = "damaged"
    WRONG = "wrong"
    NOT_READY = "not_ready"
    # Of requests: no such station; received damaged, or undamaged as a part of another frame; received, and
    # no reply; a reply that did not arrive, or arrived damaged; failed in a way that does not tell.
    MISSING = "missing"
    GARBLED = "garbled"
    JOINED = "joined"
    SILENT = "silent"
    REPLY_LOST = "reply_lost"
    REPLY_DAMAGED = "reply_damaged"
    UNKNOWN = "unknown"


#: What a driver does that is on while another node's frame begins: it sends a frame, it was not released
#: after one, or it sends what is no frame.
IN_FRAME, AFTER_FRAME, WITHOUT_FRAME = "frame", "after a frame", "no frame"
#: What shows on a bus without another node: characters that are no frame go on, a reply of the link begins
#: that ends after its timeout, a frame has a pause of two characters or more inside it, or another rate,
#: format or clock than its bus.
JABBER, LATE_REPLY, UNEVEN, OFF_RATE = "jabber", "late reply", "pause", "rate"
#: A Modbus master has given up a request whose response ends after that.
LATE_RESPONSE = "late response"
IRREGULAR = (IN_FRAME, AFTER_FRAME, WITHOUT_FRAME, JABBER, LATE_REPLY, UNEVEN, OFF_RATE, LATE_RESPONSE)


@dataclass(frozen=True, slots=True)
class LinkTotals:
    """Counts of one N:N link at the end of a run, as its (first) master saw them.

    Where the link has no working master, ``slaves`` and ``mode`` are None and the counts are 0.
    """

    bus: str
    plc_names: tuple[str, ...]  # names of the PLCs on the link, in cable order
    station_names: dict[int, str]  # first PLC with each station number
    master: str | None  # the PLC whose view this is: the first working master along the cable
    slaves: int | None  # D8177 of the master
    mode: int | None
    retries: int | None
    attempts: int | None
    timeout: int | None  # ticks
    polls: int  # first attempts
    failed_attempts: dict[int, dict[int, int]]  # station → code → attempts
    station_errors: dict[int, int]  # station → scans in which it exhausted its attempts
    busy: int  # ticks during which some driver was on
    frames: int
    collisions: int
    undetected: int
    healthy_at: int | None  # first instant at which every slave had replied and no flag was on


@dataclass(frozen=True, slots=True)
class BusTotals:
    """A bus that is no N:N link, at the end of a run."""

    bus: str
    baud: int
    format: str
    nodes: tuple[str, ...]
    busy: int  # ticks during which some driver was on
    frames: int
    collisions: int
    undetected: int


@dataclass(frozen=True, slots=True)
class PortTotals:
    """A PLC's port beside its link, at the end of a run."""

    node: str  # "press1.COM3"
    plc: str
    port: str
    bus: str
    protocol: str | None = None  # as in a scenario; None where its parameters name none
    station: int | None = None  # own number, of a slave
    errors: dict[int, int] = field(default_factory=dict)  # yy of D8063 → how often
    requests: int = 0  # slave: requests for it, well-formed or not
    answered: int = 0
    exceptions: dict[int, int] = field(default_factory=dict)  # slave: exception code → responses with it
    rejected: dict[str, int] = field(default_factory=dict)  # slave: reason → frames ignored
    timeout: int | None = None  # ticks, of a Modbus master
    #: By poll: responses that ended after the master had given their request up.
    late: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class DeviceTotals:
    """A device at the end of a run. ``requests``…``rejected`` as of :class:`PortTotals`."""

    name: str
    model: str
    bus: str
    station: int | None
    requests: int
    answered: int
    broadcasts: int
    exceptions: dict[int, int]
    rejected: dict[str, int]
    state: dict[str, int]  # of the model itself, such as the stepper's position
    timeout: int | None = None  # ticks, of a Modbus master
    late: dict[str, int] = field(default_factory=dict)  # as of :class:`PortTotals`


@dataclass(frozen=True, slots=True)
class PlcTotals:
    """One PLC at the end of a run."""

    name: str
    registers: dict[str, int]
    scans: int
    scan_mean: float | None  # ticks
    scan_max: int | None  # ticks
    own_names: dict[str, str] = field(default_factory=dict)  # where a family has its own
    set_under: str = "M8002"  # the contact under which its program sets the link
    state: str = "run"  # "off", "stop" or "run"


@dataclass(frozen=True, slots=True)
class RunTotals:
    """The counts of a run."""

    duration: int  # simulated ticks
    links: tuple[LinkTotals, ...]
    plcs: tuple[PlcTotals, ...]
    warnings: tuple[str, ...] = field(default=())
    buses: tuple[BusTotals, ...] = ()
    ports: tuple[PortTotals, ...] = ()
    devices: tuple[DeviceTotals, ...] = ()
