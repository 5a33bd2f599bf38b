"""PLCs with ports on one wire, their ENDs carried out as a simulation would, and no simulation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from bussim.devices.lx.map import LxMap
from bussim.engines.contract import OPEN, RxChar
from bussim.line.characters import CharFormat, LineTiming
from bussim.line.random_streams import Streams
from bussim.plc.plc import Plc
from bussim.plc.ports.cpavl import FORMAT, PROTOCOL, PROTOCOL_CODES, STATION, default_devices, format_word
from bussim.plc.ports.events import PortErrorRaised, PortEvent, TransactionTaken
from bussim.plc.ports.port_instructions import ProgramPorts
from bussim.plc.ports.spec import FreeSpec, PollSpec, PortSpec
from bussim.plc.profiles import PROFILES, Profile
from bussim.plc.sources import Source
from bussim.units import TICKS_PER_MS
from tests.engines.modbus.wire import RECEPTION, TIMERS, Wire

MS = TICKS_PER_MS
SCAN, PHASE = 10 * MS, 10 * MS
LINE = LineTiming(9600, CharFormat(8, "N", 1))
ASCII_LINE = LineTiming(9600, CharFormat(7, "E", 1))
#: Scans of 10 ms whatever happens on the ports.
FREE_OF_CHARGE = replace(PROFILES["pw10"], transaction_time=0)
END_RANK = TIMERS + 0.5

Program = Callable[["Bench", int], None]


def words(port: str, protocol: str, line: LineTiming = LINE, **offsets: int) -> dict[str, int]:
    """Registers that set a port up; ``w9=3`` is word +9."""
    first = default_devices(port)[0].address
    values = {FORMAT: format_word(line, eight_bit=False), PROTOCOL: PROTOCOL_CODES[protocol]}
    values |= {int(name[1:]): value for name, value in offsets.items()}
    if protocol.endswith("slave") and port != "COM2":
        values.setdefault(STATION, 1)
    return {f"D{first + offset}": value for offset, value in values.items()}


class Tap(Wire):
    """A wire that hands what a PLC's port reports to its board, and schedules ENDs."""

    def __init__(self, timing: LineTiming, bench: Bench, *, whole: bool) -> None:
        super().__init__(timing, whole=whole)
        self._bench = bench

    def handle(self, engine: Any, hints: int) -> None:
        known = len(self.events)
        super().handle(engine, hints)
        port_registers = self._bench.port_registers
        if engine is port_registers.engine:
            for _, item in self.events[known:]:
                port_registers.event(item, self.now)
        self._bench.schedule()

    def after_end(self, engine: Any, hints: int) -> None:
        """What an END asks for; what is half heard stays open."""
        self.handle(engine, hints | OPEN if self._open[engine] else hints)

    def receive(self, chars: bytes | Sequence[RxChar], at: int) -> None:
        """Characters back to back for the port, from somewhere else, the first edge at a tick."""
        engine = self._bench.port_registers.engine
        ends = [at + self.timing.characters(number) for number in range(len(chars) + 1)]
        for number, value in enumerate(chars):
            char = value if isinstance(value, RxChar) else RxChar(value)

            def receive(char: RxChar = char, number: int = number) -> None:
                self._last_heard[engine] = self.now
                self.handle(engine, engine.receive(char, ends[number], self.now))

            self.at(ends[number + 1], RECEPTION, receive)


class Bench:
    """A PLC with one port (``port``), in RUN from tick 0 with scans of 10 ms, the first END at 10 ms."""

    def __init__(
        self,
        port: str,
        protocol: str,
        polls: Sequence[PollSpec | FreeSpec] = (),
        *,
        line: LineTiming = LINE,
        profile: Profile = FREE_OF_CHARGE,
        registers: dict[str, int] | None = None,
        sources: dict[str, Source] | None = None,
        program: Program | None = None,
        whole: bool = False,
        linked: bool = False,
        scan: int = SCAN,
        jitter: int = 0,
        **offsets: int,
    ) -> None:
        self.plc = Plc(
            "press",
            profile,
            scan_mean=scan,
            scan_jitter=jitter,
            phase=PHASE,
            registers=words(port, protocol, line, **offsets) | (registers or {}),
            sources=sources or {},
            linked=linked,
            streams=Streams(1),
            ports=[PortSpec(port, "bus", *default_devices(port))],
            polls=polls,
            maps=LxMap,
        )
        self.port = port
        self.port_registers = self.plc.port_registers[port]
        self.wire = Tap(line, self, whole=whole)
        self.reported: list[PortEvent] = []
        self.ends: list[int] = []  # those that were carried out
        self._program = program
        self._scheduled = -1
        self.plc.power_on()
        self.run_plc()

    @property
    def program_ports(self) -> ProgramPorts:
        """RS2 and CPAVL of a program of this PLC."""
        return ProgramPorts(self.plc.port_registers, self.plc.memory, self.plc.profile.rs_port)

    def run_plc(self) -> None:
        now = self.wire.now
        self.plc.run(now, traced=False)
        self._scheduled = -1
        if self.port_registers.engine is not None:
            self.wire.add(self.port_registers.engine)
            self.wire.handle(self.port_registers.engine, self.port_registers.engine.start(now))
        self.collect()
        self.schedule()

    def stop_plc(self) -> None:
        engine = self.port_registers.engine
        self.plc.stop(self.wire.now)
        if engine is not None:
            self.wire.handle(engine, engine.stop(self.wire.now))
            self.wire._engines.remove(engine)
        self.collect()

    def add(self, engine: Any) -> None:
        """Another engine on the wire."""
        self.wire.add(engine)
        self.wire.handle(engine, engine.start(self.wire.now))

    def schedule(self) -> None:
        now = self.wire.now
        wanted = self.plc.wanted_end(now)
        if self._program is not None and self.plc.state.value == "run":
            wanted = self.plc.cycle.next_end(max(now, self.plc._done + 1), now)  # a program sees every END
        if wanted is not None and (self._scheduled < now or wanted < self._scheduled):
            self._scheduled = wanted
            self.wire.at(wanted, END_RANK, lambda: self._end(wanted))

    def _end(self, at: int) -> None:
        if at != self._scheduled:
            return
        self._scheduled = -1
        self.ends.append(at)
        if self._program is not None:
            self._program(self, at)
        hints = self.plc.end(at)
        if self.port_registers.engine is not None:
            self.wire.after_end(self.port_registers.engine, hints[self.port])
        self.collect()
        self.schedule()

    def collect(self) -> None:
        while (item := self.port_registers.poll()) is not None:
            self.reported.append(item)

    def run(self, until: int) -> None:
        self.wire.run(until)

    # -- what is to be seen ------------------------------------------------------------------------

    def requests(self) -> list[tuple[int, bytes]]:
        """(first edge, characters) of what the port has sent."""
        return [(at, chars) for at, engine, chars in self.wire.sent if engine is self.port_registers.engine]

    def of(self, kind: type[PortEvent]) -> list[Any]:
        return [item for item in self.reported if isinstance(item, kind)]

    def errors(self) -> list[int]:
        """D8063 as it was raised, time after time."""
        return [item.code for item in self.of(PortErrorRaised)]

    def outcomes(self) -> list[Any]:
        return [item.ended.error for item in self.of(TransactionTaken)]

    def bit(self, offset: int) -> int:
        return self.plc.memory.get(
            default_devices(self.port)[1]._replace(address=default_devices(self.port)[1].address + offset)
        )

    def word(self, offset: int) -> int:
        return self.plc.memory.word("D", default_devices(self.port)[0].address + offset)
