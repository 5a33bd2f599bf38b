"""Profiles: everything about a PLC family that is a number or a choice, each a named field.

Sources: "PW10" is the user guide of the PW10-2RS485-BD board, sections 5 to 8; "FX" the FX series
communication manual JY992D69901 rev. E, chapters 2.2.1, 4 and 12.2, whose N:N network the PW10
copies; "FX programming" the FX series programming manual JY992D88101, chapter 4; "std" Modbus over serial
line V1.02, section 2; "fit" was derived from the link times published by FX; "assumed" is ours, because no
public source says so, and is therefore a field that a scenario can change.
"""

from dataclasses import dataclass, replace
from enum import StrEnum
from fractions import Fraction
from typing import Annotated, NamedTuple, assert_never

from bussim.engines.modbus.adu import FIRST_STATION, LAST_STATION
from bussim.engines.modbus.gaps import STANDARD_GAPS, GapRule
from bussim.plc.link_devices import LINK_DEVICES, LinkDevices
from bussim.plc.memory import DeviceRange, Family, device_ranges
from bussim.plc.program.instruction_times import DEFAULT_TIMES, InstructionTimes
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND


class Attempts(StrEnum):
    """How D8179 counts (assumed; the manuals' wording allows both)."""

    RETRIES_PLUS_1 = "retries+1"
    RETRIES = "retries"  # exactly D8179, at least one


class AbsentStation(StrEnum):
    """What a master spends on a station whose error flag is on (assumed)."""

    FULL = "full"  # every scan spends all attempts on it
    PROBE = "probe"  # one attempt a scan

    @property
    def probes(self) -> bool:
        """Whether one attempt is made at it, not all."""
        match self:
            case AbsentStation.FULL:
                return False
            case AbsentStation.PROBE:
                return True
            case _:
                assert_never(self)


class ErrorCount(StrEnum):
    """When D8204+ counts a station that stays silent (assumed)."""

    PER_SCAN = "per_scan"
    ON_EDGE = "on_edge"

    @property
    def on_edge(self) -> bool:
        """Whether it counts when its flag goes on only, not in each link scan."""
        match self:
            case ErrorCount.PER_SCAN:
                return False
            case ErrorCount.ON_EDGE:
                return True
            case _:
                assert_never(self)


class Reply(StrEnum):
    """When a slave's reply starts (assumed)."""

    INTERRUPT = "interrupt"  # the board replies on its own, after its turnaround
    END = "end"  # at the first END at or after the poll's end plus the turnaround

    @property
    def at_end(self) -> bool:
        """Whether it waits for an END."""
        match self:
            case Reply.INTERRUPT:
                return False
            case Reply.END:
                return True
            case _:
                assert_never(self)


class ErrorCodes(StrEnum):
    """How a family numbers its serial errors (FX: from memory, assumed)."""

    PW10 = "7xyy"  # M8063 and D8063; x is the port, yy the PW10's code
    FX = "63xx"  # M8063 and D8063
    FX3U = "63xx and 38xx"  # COM4, the second channel, has M8438 and D8438


@dataclass(frozen=True, slots=True)
class Turnaround:
    """A slave's time from the end of its poll to its reply's first edge, in ticks.

    Either uniform over ``mean`` ± ``jitter``, or, where ``values`` is not empty, one of ``values``
    with the probabilities ``weights`` (same length, each > 0, normalised by their sum).
    """

    mean: int
    jitter: int
    values: tuple[int, ...] = ()
    weights: tuple[float, ...] = ()

    @property
    def longest(self) -> int:
        """The longest turnaround that can occur, in ticks."""
        return max(self.values) if self.values else self.mean + self.jitter

    @property
    def average(self) -> Fraction:
        """The mean turnaround, in ticks, exact up to the weights' own rounding."""
        if not self.values:
            return Fraction(self.mean)
        weights = [Fraction(weight) for weight in self.weights]
        return sum((v * w for v, w in zip(self.values, weights, strict=True)), Fraction(0)) / sum(weights)


#: FX programming, for the FX2N.
_FX2N_LATCHED = device_ranges("M500-3071 S500-999 T246-255 C100-199 C220-255 D200-7999")
#: As the FX2N, and M to M7679, S to S4095, and R (FX3U: from memory, assumed).
_FX3U_LATCHED = (*_FX2N_LATCHED, *device_ranges("M3072-7679 S1000-4095 R0-32767"))
#: FX programming.
_FX1S_LATCHED = device_ranges("M384-511 S0-127 C16-31 C235-255 D128-255")


class Ticks(NamedTuple):
    """The times that a scenario may give a field, in ticks, both ends included."""

    low: int
    high: int


class Number(NamedTuple):
    """The numbers that a scenario may give a field, or each value of it; both ends included."""

    low: int
    high: int


class Composed:
    """Marks a field that a scenario gives in a form of its own."""


@dataclass(frozen=True, slots=True)
class Profile:
    """One PLC family. Times in ticks (1/72 MHz); a scenario writes them with units.

    A scenario can change every field that says how a family behaves: those whose type is a choice or a
    flag, and those with bounds (``Ticks``, ``Number``) or the mark ``Composed``. The form of a scenario's
    profile is made of these rows. What a family is (the other fields) cannot be changed.

    ========================  =============================================================  ========
    field                     meaning                                                        source
    ========================  =============================================================  ========
    ``master_gap``            quiet time before every frame of the master                    fit
    ``turnaround``            slave's time from poll to reply                                fit
    ``scan_overhead``         master's time after the last slave of a link scan              fit
    ``attempts``              meaning of D8179                                               assumed
    ``absent_station``        what a flagged station costs                                   assumed
    ``error_count``           when error counts rise                                         assumed
    ``reply``                 reply from the board's interrupt or at END                     assumed
    ``link_scan_unit``        unit of D8201/D8202                                            assumed
    ``scan_factor``           PLC scan time under N:N, as a factor on mean and jitter        FX
    ``default_timeout``       D8180 at power-on, in 10 ms                                    PW10, FX
    ``timeout_range``         D8180 that the PLC accepts, in 10 ms, both ends included       PW10, FX
    ``modes``                 refresh modes D8178 that the PLC accepts                       PW10, FX
    ``documented_modes``      those of them that the settings table lists                    PW10, FX
    ``word_spacing``          distance of the stations' D blocks                             PW10, FX
    ``firmware``              D8001 and D8101 (FX: assumed)                                  PW10
    ``rs_port``               the port that RS drives (PW10: COM2; FX: assumed)              PW10
    ``board_ports``           the ports that it has beside the programming port              PW10, FX
    ``error_codes``           numbers of serial errors (FX: assumed)                         PW10
    ``link_at_step_0``        M8038 must be the contact of a program's first step (else      PW10, FX
                              its settings of the link are without effect: assumed)
    ``latched``               what stays over a power loss and RUN→STOP (PW10: assumed)      FX programming
    ``latched_pulse_again``   PLS and PLF of latched M begin anew at RUN, as others do         assumed
    ``transaction_time``      what each active transaction of a port adds to a PLC scan      assumed
    ``broadcast_turnaround``  a Modbus master's pause after a broadcast (100 to 200 ms)      std
    ``rtu_gaps``              the silences of Modbus RTU on the ports                        std
    ``ascii_gap``             longest pause between two characters of a Modbus ASCII frame   std
    ``begun_holds``           a response that has begun by the timeout is awaited            assumed
    ``slave_backlog``         requests that wait while a Modbus slave port serves another    assumed
    ``slave_errors``          a slave port raises the codes 1, 2, 3, 4 and 7 as well         assumed
    ``com2_station``          D8121, the station number of COM2 as a slave, at power-on      assumed
    ``free_awaits_first``     +9 also limits the wait for a reception's first character      assumed
    ``free_keeps_frame``      start and end character count as received data                 assumed
    ``instruction_times``     what a program's instructions take                             assumed
    ========================  =============================================================  ========
    """

    name: str
    master_gap: Annotated[int, Ticks(0, TICKS_PER_SECOND)] = 30_060  # 0.4175 ms
    turnaround: Annotated[Turnaround, Composed] = Turnaround(30_060, 7_200)  # 0.4175 ms ± 0.1 ms
    scan_overhead: Annotated[int, Ticks(0, 10 * TICKS_PER_SECOND)] = 253_440  # 3.52 ms
    attempts: Attempts = Attempts.RETRIES_PLUS_1
    absent_station: AbsentStation = AbsentStation.FULL
    error_count: ErrorCount = ErrorCount.PER_SCAN
    reply: Reply = Reply.INTERRUPT
    link_scan_unit: Annotated[int, Ticks(72, TICKS_PER_SECOND)] = TICKS_PER_MS
    scan_factor: Annotated[Fraction, Number(1, 10)] = Fraction(11, 10)
    default_timeout: Annotated[int, Number(1, 255)] = 10
    timeout_range: Annotated[tuple[int, int], Number(1, 255)] = (5, 225)
    modes: Annotated[tuple[int, ...], Number(0, 4)] = (0, 1, 2, 3, 4)
    documented_modes: tuple[int, ...] = (0, 1, 2)
    word_spacing: Annotated[int, Number(4, 1000)] = 32
    firmware: Annotated[tuple[int, int], Number(0, 32767)] = (25010, 16003)
    rs_port: str = "COM2"
    board_ports: tuple[str, ...] = ("COM2", "COM3", "COM4", "COM5", "COM6")
    error_codes: ErrorCodes = ErrorCodes.PW10
    link_at_step_0: bool = False
    latched: Annotated[tuple[DeviceRange, ...], Composed] = _FX2N_LATCHED
    latched_pulse_again: bool = False
    transaction_time: Annotated[int, Ticks(0, TICKS_PER_SECOND)] = TICKS_PER_MS // 5
    broadcast_turnaround: Annotated[int, Ticks(0, 60 * TICKS_PER_SECOND)] = 100 * TICKS_PER_MS
    rtu_gaps: Annotated[GapRule, Composed] = STANDARD_GAPS
    ascii_gap: Annotated[int, Ticks(TICKS_PER_MS, 60 * TICKS_PER_SECOND)] = TICKS_PER_SECOND
    begun_holds: bool = False
    slave_backlog: Annotated[int, Number(0, 100)] = 0
    slave_errors: bool = True
    com2_station: Annotated[int, Number(FIRST_STATION, LAST_STATION)] = 1
    free_awaits_first: bool = False
    free_keeps_frame: bool = False
    instruction_times: Annotated[InstructionTimes, Composed] = DEFAULT_TIMES

    @property
    def family(self) -> Family:
        """Whose devices it has."""
        return {"fx1s": Family.FX1S, "fx3u": Family.FX3U}.get(self.name, Family.FX2N)

    @property
    def set_under(self) -> str:
        """The contact under which a program sets the link."""
        return "M8038" if self.link_at_step_0 else "M8002"

    @property
    def devices(self) -> LinkDevices:
        """Where it keeps the special devices of the link."""
        return LINK_DEVICES[self.family]


_PW10 = Profile("pw10")
_FX2N = replace(
    _PW10,
    name="fx2n",
    default_timeout=5,
    timeout_range=(5, 255),
    modes=(0, 1, 2),
    word_spacing=10,
    firmware=(24300, 0),
    rs_port="COM3",
    board_ports=("COM3",),
    error_codes=ErrorCodes.FX,
    link_at_step_0=True,
)

#: The built-in profiles by name.
PROFILES: dict[str, Profile] = {
    "pw10": _PW10,
    "fx2n": _FX2N,
    "fx3u": replace(
        _FX2N,
        name="fx3u",
        firmware=(24300, 16300),
        board_ports=("COM3", "COM4"),
        latched=_FX3U_LATCHED,
        error_codes=ErrorCodes.FX3U,
    ),
    "fx1s": replace(
        _FX2N, name="fx1s", modes=(0,), documented_modes=(0,), firmware=(22300, 0), latched=_FX1S_LATCHED
    ),
}

#: The fields that a link's figures and error counts depend on and no public source gives.
ASSUMED_OF_LINKS = ("attempts", "absent_station", "error_count", "reply")

#: Largest number of slaves and of retries (PW10, section 7.4: D8177 1–7, D8179 0–10).
MAX_SLAVES = 7
MAX_RETRIES = 10


def attempts_per_poll(reading: Attempts, retries: int) -> int:
    """Attempts that a master makes before it flags a station: D8179 as its profile reads it."""
    match reading:
        case Attempts.RETRIES_PLUS_1:
            return retries + 1
        case Attempts.RETRIES:
            return max(1, retries)
        case _:
            assert_never(reading)
