"""A scenario's N:N links as :class:`~bussim.exact.link.LinkModel` values.

What lasts for the whole run becomes part of the link: a station that is switched off throughout is
a dead station, a slow one has a longer turnaround. What begins or ends during the run, and what the
closed form cannot describe, becomes a reason why the distribution does not hold. On request the former is
left out instead, since the distribution between such events is well defined; then a note says so.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import assert_never

from bussim.engines.nn.frames import PARAMETERS_CHARS, POLL_CHARS, data_chars, encode_poll
from bussim.exact.link import MASTER, TIMEOUT_UNIT, LineNoise, LinkModel, NoiseSource, Station, frame_ticks
from bussim.exact.scan.turnaround_sums import spread_of
from bussim.line.characters import NN_LINE, LineTiming
from bussim.line.uart import Uart
from bussim.line.wave import Wave, low_intervals
from bussim.plc.link_registers import (
    D_MODE,
    D_RETRIES,
    D_SLAVES,
    D_STATION,
    D_TIMEOUT,
    bad_parameters,
    mode_refusal,
    refusal,
    setting_values,
)
from bussim.plc.profiles import attempts_per_poll
from bussim.scenario.fault_kinds import (
    BoardError,
    CableCut,
    ClockPpm,
    Direction,
    DropReply,
    FaultKind,
    FlipBits,
    InsertChar,
    Jabber,
    LateRelease,
    LoseChar,
    Pause,
    PowerOff,
    Slow,
    Stop,
    WrongFormat,
)
from bussim.scenario.model import BitErrors, Burst, Fault, Impulse, Noise, Plc, ReplyLoss, Scenario, Window
from bussim.scenario.provenance import link_inputs
from bussim.units import milliseconds
from bussim.words.language import say

#: States of the channel grow as 2 to the number of bursts.
MAX_BURSTS = 3
#: Clock errors up to this many ppm move no sample out of its bit (4.7 % would, over 10.5 bits).
MAX_PPM = 20_000


def from_scenario(
    scenario: Scenario, *, ignore_faults: bool = False, bound_end: bool = False
) -> dict[str, LinkModel]:
    """The N:N links of a scenario by the names of their buses.

    With ``ignore_faults``, faults and noise that act only for a part of the run are left out (and
    named in :attr:`~bussim.exact.link.LinkModel.notes`), so that the distribution is that of the undisturbed
    time; without it they make the link's distribution invalid. With ``bound_end``, a reply that waits
    for END waits for the longest PLC scan each time: times are then upper bounds, which is what a sizing
    needs; without it such a link has no distribution.
    """
    return {
        bus: _LinkReader(scenario, bus, ignore_faults=ignore_faults, bound_end=bound_end).read()
        for bus in scenario.links
    }


@dataclass(slots=True)
class _Member:
    """A PLC on the link and what lasts for the whole run about it."""

    plc: Plc
    settings: dict[int, int]
    refused: bool
    silent: bool = False  # never sends
    receives: bool = True
    extra: int = 0
    loss: float = 0.0
    ppm: Fraction = Fraction(0)

    @property
    def number(self) -> int:
        return self.settings[D_STATION]

    @property
    def scan(self) -> int:
        """Longest PLC scan under N:N, in ticks."""
        return self.plc.longest_scan

    def ticks(self, characters: int) -> int:
        """Ticks of a frame that it sends."""
        return frame_ticks(characters, replace(NN_LINE, ppm=self.ppm))


def _reads(timing: LineTiming, station: int) -> bool:
    """Whether a receiver with its own rate and format has one of a station's polls as it is sent."""
    uart = Uart(timing)
    for counter in range(16):
        chars, read, ready = encode_poll(station, counter).chars, [], 0
        wave = Wave([low_intervals(chars, NN_LINE, 0)])
        while (char := uart.next_character(wave, ready)) is not None:
            read.append(char.value if char.parity_ok and char.stop_ok else None)
            ready = char.ready
        if read[-len(chars) :] == [*chars]:
            return True
    return False


@dataclass(slots=True)
class _LinkReader:
    scenario: Scenario
    bus: str
    ignore_faults: bool
    bound_end: bool
    members: list[_Member] = field(default_factory=list)
    obstacles: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    sources: list[NoiseSource] = field(default_factory=list)
    chains: list[tuple[float, float]] = field(default_factory=list)

    def read(self) -> LinkModel:
        """The link as it is for the whole run."""
        for plc in self.scenario.plcs:
            if plc.link is not None and plc.link.bus == self.bus:
                settings = setting_values(plc.profile, plc.registers)
                self.members.append(_Member(plc, settings, bool(bad_parameters(plc.profile, settings))))
        self._numbers()
        for fault in self.scenario.faults:
            self._fault(fault)
        for noise in self.scenario.noise:
            if noise.target.bus == self.bus:
                self._noise(noise)
        return self._model()

    # -- members --------------------------------------------------------------------------------

    def _named(self, name: str) -> _Member | None:
        return next((member for member in self.members if member.plc.name == name), None)

    def _working(self) -> list[_Member]:
        return [member for member in self.members if not member.refused]

    def _numbers(self) -> None:
        by_number: dict[int, list[str]] = {}
        for member in self._working():
            by_number.setdefault(member.number, []).append(member.plc.name)
        for number, names in sorted(by_number.items()):
            if len(names) > 1:
                key = "link_masters_collide" if number == MASTER else "link_numbers_collide"
                self.obstacles.append(say(key, names=names, number=number))
        if MASTER not in by_number:
            self.obstacles.append(say("link_no_master"))

    def _passing(self, what: str, window: Window) -> bool:
        """Whether something acts only for a part of the run, which then is noted."""
        until = window.until
        if window.at <= 0 and (until is None or until >= self.scenario.duration):
            return False
        if window.at >= self.scenario.duration:
            return True
        if self.ignore_faults:
            self.notes.append(say("link_left_out", what=what))
        else:
            self.obstacles.append(say("link_changes", what=what))
        return True

    # -- faults ------------------------------------------------------------------------------------

    def _fault(self, fault: Fault) -> None:
        kind = fault.kind
        if isinstance(kind, BoardError):
            return  # flags in a PLC; the link does not notice
        if isinstance(kind, CableCut):
            if kind.bus == self.bus and not self._passing(say("link_cut", name=fault.name), fault.window):
                self._cut(kind)
            return
        member = self._named(kind.node)
        if member is None or member.refused:
            return
        what = say("link_fault", name=fault.name, plc=member.plc.name)
        counted = getattr(kind, "count", None)
        if counted is not None:
            self._passing(what, Window(fault.window.at, 0))
        elif not self._passing(what, fault.window):
            self._lasting(member, kind, what)

    def _cut(self, kind: CableCut) -> None:
        names = [plc.name for plc in self.scenario.plcs]
        position = names.index(kind.after)
        master = next((m for m in self._working() if m.number == MASTER), None)
        if master is None:
            return
        near = names.index(master.plc.name) <= position
        for member in self.members:
            if (names.index(member.plc.name) <= position) != near:
                member.silent, member.receives = True, False

    def _lasting(self, member: _Member, kind: FaultKind, what: str) -> None:
        master = member.number == MASTER
        match kind:
            case PowerOff() | Stop():
                member.silent, member.receives = True, False
                if master:
                    self.obstacles.append(say("link_master_off", what=what))
            case DropReply():
                member.silent = member.silent or not master
            case Slow(_, extra):
                member.extra += 0 if master else extra
            case ClockPpm(_, ppm) if abs(ppm) <= MAX_PPM:
                member.ppm += ppm
            case ClockPpm():
                self.obstacles.append(say("link_clock", what=what))
            case LateRelease(_, by):
                if by >= self._quiet_after(member):  # else the driver is off before any other frame
                    self.obstacles.append(say("link_tail", what=what))
            case Jabber():
                self.obstacles.append(say("link_jabber", what=what))
            case WrongFormat(_, timing) if self.bound_end and not (master or _reads(timing, member.number)):
                member.silent, member.receives = True, False
                self.notes.append(say("link_deaf_dumb", what=what))
            case WrongFormat():
                self.obstacles.append(say("link_wrong_format", what=what))
            case Pause():
                self.obstacles.append(say("link_pauses", what=what))
            case LoseChar() | InsertChar() | FlipBits():
                self.obstacles.append(say("link_data", what=what))
            case BoardError() | CableCut():
                raise ValueError(f"{what} is not of a station's frames")
            case _:
                assert_never(kind)

    def _quiet_after(self, member: _Member) -> int:
        """The shortest time from the end of a member's frame to the next frame on the line."""
        masters = [m.plc.profile.master_gap for m in self._working() if m.number == MASTER]
        if member.number != MASTER:
            return min(masters, default=0)
        slaves = (m.plc for m in self._working() if m.number != MASTER)
        replies = [spread_of(plc.profile.turnaround)[0] for plc in slaves]
        return min((*masters, *replies), default=0)

    # -- noise -------------------------------------------------------------------------------------

    def _noise(self, noise: Noise) -> None:
        target = noise.target
        member = None
        if target.station is not None:
            member = self._named(target.station)
            if member is None or member.refused:
                return
        kind = noise.kind
        what = say("link_noise", name=noise.name)
        if noise.harmless or self._passing(what, noise.window):
            return
        part = "bus" if member is None else ("rx" if target.direction is Direction.RX else "tx")
        station = None if member is None else member.number
        match kind:
            case ReplyLoss(probability):
                for losing in self.members if member is None else [member]:
                    losing.loss += (1 - losing.loss) * probability
            case BitErrors(ber):
                self.sources.append(NoiseSource(part, station, ber))
            case Burst(_, _, good, bad) if good == bad:
                self.sources.append(NoiseSource(part, station, good))
            case Burst() if len(self.chains) == MAX_BURSTS:
                self.obstacles.append(say("link_bursts", what=what, most=MAX_BURSTS))
            case Burst(good, bad, ber_good, ber_bad):
                self.sources.append(NoiseSource(part, station, ber_good, ber_bad, chain=len(self.chains)))
                self.chains.append((float(good), float(bad)))
            case Impulse():
                self.obstacles.append(say("link_impulses", what=what))
            case _:  # a kind that is not worked out yet
                self.obstacles.append(say("link_noise_kind", what=what, kind=type(kind).__name__))

    # -- the result --------------------------------------------------------------------------------

    def _model(self) -> LinkModel:
        working = self._working()
        first: dict[int, _Member] = {}
        for member in working:
            first.setdefault(member.number, member)
        master = first.get(MASTER)
        if master is None:
            nothing = LinkModel(
                self.bus, "", (), mode=0, retries=0, attempts=1, timeout=0, gap=0, overhead=0, data=0
            )
            return self._told(nothing, first)
        settings, profile = master.settings, master.plc.profile
        mode = settings[D_MODE]
        numbers = range(1, settings[D_SLAVES] + 1)
        stations = tuple(self._station(number, first.get(number), master, mode) for number in numbers)
        listeners = tuple(
            self._station(member.number, member, master, mode)
            for member in working
            if member.number > settings[D_SLAVES] and first[member.number] is member
        )
        model = LinkModel(
            bus=self.bus,
            master=master.plc.name,
            stations=stations,
            mode=mode,
            retries=settings[D_RETRIES],
            attempts=attempts_per_poll(profile.attempts, settings[D_RETRIES]),
            reading=profile.attempts,
            timeout=settings[D_TIMEOUT] * TIMEOUT_UNIT,
            gap=profile.master_gap,
            overhead=profile.scan_overhead,
            data=master.ticks(data_chars(mode)),
            poll=master.ticks(POLL_CHARS),
            parameters=master.ticks(PARAMETERS_CHARS),
            absent=profile.absent_station,
            error_count=profile.error_count,
            unit=profile.link_scan_unit,
            noise=LineNoise(tuple(self.sources), tuple(self.chains)),
            scan=master.scan,
            timeout_range=profile.timeout_range,
            set_under=profile.set_under,
            listeners=listeners,
            inputs=link_inputs(self.scenario, self.bus),
        )
        self.obstacles += self._limits(model, working)
        return self._told(model, first)

    def _dead(self, model: LinkModel, first: dict[int, _Member]) -> Iterator[str]:
        """Why stations never reply, and what that makes of the figures."""
        for refusing in self.members:
            plc = refusing.plc
            if refusing.refused and plc.link is not None:
                reasons = bad_parameters(plc.profile, refusing.settings)
                yield refusal(plc.profile, plc.name, reasons, plc.link.port)
        for station in model.dead:
            member = first.get(station.number)
            if member is None:
                yield say("link_not_there", station=station.label, polled=len(model.stations))
            elif model.mode not in member.plc.profile.modes:
                why = mode_refusal(station.name, member.plc.profile, model.mode)
                yield say("link_stays_out", station=station.label, why=why)
            else:
                yield say("link_never_replies", station=station.label)
        if model.dead and model.alive:
            yield say("link_one_more")

    def _told(self, model: LinkModel, first: dict[int, _Member]) -> LinkModel:
        """The link with what was found out about it."""
        silent = tuple(self._dead(model, first))
        return replace(model, obstacles=tuple(self.obstacles), notes=tuple(self.notes), not_replying=silent)

    def _station(self, number: int, member: _Member | None, master: _Member, mode: int) -> Station:
        if member is None:
            # Were it there, it might be as slow as any.
            kind = max(
                (each.plc.profile.turnaround for each in self.members), key=lambda spread: spread.longest
            )
            scan = max(each.scan for each in self.members)
            return Station(
                number, "", kind, frame_ticks(data_chars(mode)), alive=False, hears=False, scan=scan
            )
        plc = member.plc
        at_end = plc.profile.reply.at_end
        stays_out = mode not in plc.profile.modes  # refuses the master's parameters
        if plc.power_on > master.plc.power_on and number <= master.settings[D_SLAVES]:
            self._passing(say("link_late_on", plc=plc.name), Window(master.plc.power_on, plc.power_on))
        return Station(
            number=number,
            name=plc.name,
            turnaround=plc.profile.turnaround,
            reply=member.ticks(data_chars(mode)),
            alive=not (member.silent or stays_out),
            hears=member.receives and not stays_out,
            extra=member.extra + (member.scan if at_end and self.bound_end else 0),
            loss=member.loss,
            scan=member.scan,
        )

    def _limits(self, model: LinkModel, working: Iterable[_Member]) -> list[str]:
        found = []
        by_number = {member.number: member for member in working}
        for station in model.alive:
            if not by_number[station.number].plc.profile.reply.at_end:
                continue
            if self.bound_end:
                self.notes.append(say("link_end_bound", station=station.label))
            else:
                found.append(say("link_end", station=station.label))
        if model.noise.sources and model.gap < model.character:
            found.append(say("link_gap", gap=milliseconds(model.gap)))
        return found
