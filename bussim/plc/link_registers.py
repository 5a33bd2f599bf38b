"""The N:N part of a PLC: special registers in, an engine out; the engine's status back into them.

Devices and their meaning: PW10 board manual, sections 7.4 and 7.5; the mirrors D8173–D8175: FX
communication manual, chapter 12.2.
"""

from array import array
from collections.abc import Container, Iterable, Mapping

from bussim.engines.nn.frames import MODES, LinkSettings
from bussim.engines.nn.master import Master, MasterConfig
from bussim.engines.nn.monitor import SlaveConfig
from bussim.engines.nn.slave import Slave
from bussim.engines.nn.status import STATIONS, LinkStatus
from bussim.line.characters import NN_LINE
from bussim.plc.errors import SERIAL_ERROR as SERIAL_ERROR  # named with the link's other registers
from bussim.plc.errors import SerialErrors, serial_error, shown_at
from bussim.plc.link_devices import LINK_STATUS
from bussim.plc.memory import BlockRange, Device, Memory, block_range
from bussim.plc.ports.cpavl import COM2_STATION
from bussim.plc.profiles import MAX_RETRIES, MAX_SLAVES, Profile, attempts_per_poll
from bussim.plc.system_devices import WATCHDOG
from bussim.units import TICKS_PER_MS
from bussim.words.language import say

#: D8180 counts in 10 ms.
TIMEOUT_UNIT = 10 * TICKS_PER_MS

#: Settings: port, station number, slaves, mode, retries, timeout; and their mirrors.
M_PORT = 8179
_PORT = Device("M", M_PORT)
D_STATION, D_SLAVES, D_MODE, D_RETRIES, D_TIMEOUT = range(8176, 8181)
D_MIRROR_STATION, D_MIRROR_SLAVES, D_MIRROR_MODE = range(8173, 8176)
#: yy of 7xyy for bad N:N parameters (PW10, section 8).
BAD_PARAMETERS = 48

#: Devices that make a PLC take part in N:N when a scenario or program sets one.
TAKE_PART = ("M8179", "D8176", "D8177", "D8178", "D8179", "D8180")

#: D8201 and D8202 stand before the counts (one a station), these before the codes.
_COUNTS, _CODES = 2, 2 + STATIONS

#: The link's cause among the PLC's serial errors.
_REFUSAL = "link"

LinkEngine = Master | Slave


def setting_defaults(profile: Profile) -> dict[int, int]:
    """D8176–D8180 at power-on."""
    return {D_STATION: 0, D_SLAVES: 7, D_MODE: 0, D_RETRIES: 3, D_TIMEOUT: profile.default_timeout}


def memory_at_power_on(
    profile: Profile, registers: Mapping[Device, int], old: Memory | None = None
) -> Memory:
    """The memory of a PLC when its supply comes; ``registers`` are what the scenario sets.

    ``old`` is its memory when the supply went: what the profile's family keeps stays as it was there.
    """
    memory = Memory()
    for address, value in setting_defaults(profile).items():
        memory.set_word("D", address, value)
    memory.set(COM2_STATION, profile.com2_station)
    # Beside firmware and watchdog: STX and ETX, with which RS frames data, and its timeout in 10 ms (FX).
    defaults = (WATCHDOG, *profile.firmware, 2, 3, 10)
    for address, value in zip((8000, 8001, 8101, 8124, 8125, 8129), defaults, strict=True):
        memory.set_word("D", address, value)
    for device, value in registers.items():
        memory.set(device, value)
    if old is not None:
        memory.keep(old, profile.latched)
        memory.earlier = old.earlier
    return memory


def selected_port(memory: Memory) -> str:
    """The port that M8179 selects."""
    return "COM4" if memory.get(_PORT) else "COM3"


def bad_parameters(profile: Profile, values: dict[int, int]) -> list[str]:
    """What the PLC refuses in D8176–D8180 (addresses as keys), in words; empty if nothing."""
    station = values[D_STATION]
    if station > MAX_SLAVES:
        return [say("link_register", register="D8176", value=station, allowed=f"0..{MAX_SLAVES}")]
    if station:
        return []
    low, high = profile.timeout_range
    allowed: dict[int, tuple[Container[int], str]] = {
        D_SLAVES: (range(1, MAX_SLAVES + 1), f"1..{MAX_SLAVES}"),
        D_MODE: (profile.modes, mode_numbers(profile.modes)),
        D_RETRIES: (range(MAX_RETRIES + 1), f"0..{MAX_RETRIES}"),
        D_TIMEOUT: (range(low, high + 1), f"{low}..{high}"),
    }
    return [
        say("link_register", register=f"D{address}", value=values[address], allowed=text)
        for address, (good, text) in allowed.items()
        if values[address] not in good
    ]


def mode_numbers(modes: tuple[int, ...]) -> str:
    """Refresh modes in words: ``0..4``, ``0``, or ``0, 2`` where there are gaps."""
    ordered = sorted(modes)
    if len(ordered) > 1 and ordered == list(range(ordered[0], ordered[-1] + 1)):
        return f"{ordered[0]}..{ordered[-1]}"
    return ", ".join(map(str, ordered))


def refusal(profile: Profile, name: str, reasons: list[str], port: str) -> str:
    """What a PLC with bad N:N parameters does, as a sentence."""
    code = serial_error(profile.error_codes, port, BAD_PARAMETERS)
    device = shown_at(code)
    return say("link_refuses", name=name, reasons=reasons, device=device, code=code)


def mode_refusal(name: str, profile: Profile, mode: int) -> str:
    """What a slave does whose family lacks the master's refresh mode, as a sentence."""
    return say("link_mode", name=name, profile=profile.name, mode=mode)


def setting_values(profile: Profile, registers: Mapping[str, int]) -> dict[int, int]:
    """D8176–D8180 (addresses as keys) at power-on, with those that ``registers`` sets by name."""
    return {
        address: registers.get(f"D{address}", value) for address, value in setting_defaults(profile).items()
    }


def master_config(profile: Profile, values: Mapping[int, int]) -> MasterConfig:
    """A master's configuration from D8176–D8180, which the PLC must accept."""
    settings = LinkSettings(*(values[address] for address in range(D_SLAVES, D_TIMEOUT + 1)))
    return MasterConfig(
        settings=settings,
        attempts=attempts_per_poll(profile.attempts, settings.retries),
        timeout=settings.timeout * TIMEOUT_UNIT,
        gap=profile.master_gap,
        overhead=profile.scan_overhead,
        probe=profile.absent_station.probes,
        count_on_edge=profile.error_count.on_edge,
    )


def worst_turnaround(profile: Profile, longest_scan: int) -> int:
    """Longest time from a poll's end to the reply's first edge, END included where replies wait for it."""
    waiting = longest_scan if profile.reply.at_end else 0
    return profile.turnaround.longest + waiting


class LinkRegisters:
    """The link's board of one PLC. ``engine`` is None in STOP and after bad parameters.

    ``errors`` is what the PLC's ports share of M8063 and D8063.
    """

    def __init__(self, profile: Profile, memory: Memory, errors: SerialErrors | None = None) -> None:
        self._profile = profile
        self._memory = memory
        self._errors = errors if errors is not None else SerialErrors(memory)
        self._registers = profile.devices
        self.engine: LinkEngine | None = None
        # The latest link scan times that were shown, in ticks and in the unit of D8201.
        self._times: tuple[int | None, int | None] = (None, None)
        self._shown = (0, 0)
        # The latest counts and codes that were shown, as words of memory too.
        self._counts: list[int] = []
        self._codes: list[int] = []
        self._count_words = self._code_words = array("H")
        self.block: BlockRange | None = None
        #: The refresh mode in force, None for a slave that does not know it.
        self.mode: int | None = None

    # -- settings in -----------------------------------------------------------------------------

    def take_over(
        self, longest_scan: int, *, traced: bool, values: dict[int, int] | None = None
    ) -> LinkEngine | None:
        """STOP→RUN: take D8176–D8180 over (or ``values`` in their place), clear the status, make the engine.

        Returns None, with the serial error of bad parameters, if the PLC refuses the settings.
        """
        memory, profile = self._memory, self._profile
        if values is None:
            values = {address: memory.word("D", address) for address in range(D_STATION, D_TIMEOUT + 1)}
        self.engine, self.block, self.mode = None, None, None
        self._publish_status(LinkStatus())
        station = values[D_STATION]
        if bad_parameters(profile, values):
            self.refuse()
            return None
        self._errors.over(_REFUSAL)
        memory.set_word("D", D_MIRROR_STATION, station)
        if station:
            self.engine = Slave(
                SlaveConfig(
                    station=station,
                    modes=profile.modes,
                    timeout_unit=TIMEOUT_UNIT,
                    worst_turnaround=worst_turnaround(profile, longest_scan),
                    character=NN_LINE.characters(1),
                    count_on_edge=profile.error_count.on_edge,
                )
            )
            self._mirror(None)
        else:
            config = master_config(profile, values)
            self.engine = Master(config, traced=traced)
            self._mirror(config.settings)
        return self.engine

    def refuse(self) -> None:
        """Bad parameters: a serial error (of a PW10 7348 on COM3, 7448 on COM4), no link."""
        self._errors.report(_REFUSAL, selected_port(self._memory), BAD_PARAMETERS)
        self.block, self.mode = None, None

    def parameters(self, settings: LinkSettings) -> None:
        """A slave has learnt the master's settings."""
        self._mirror(settings)

    def release(self) -> None:
        """STOP or power-off: the flags of the running link go off with the engine."""
        if self.engine is not None:
            self.publish()
            if isinstance(self.engine, Slave):
                self._mirror(None)
        self.engine, self.block, self.mode = None, None, None

    def _mirror(self, settings: LinkSettings | None) -> None:
        memory = self._memory
        memory.set_word("D", D_MIRROR_SLAVES, settings.slaves if settings else 0)
        memory.set_word("D", D_MIRROR_MODE, settings.mode if settings else 0)
        if settings is not None and self.engine is not None:
            self.mode = settings.mode
            self.block = self.range_of(self.station, settings.mode)

    @property
    def station(self) -> int:
        """The station number in force."""
        engine = self.engine
        return engine.config.station if isinstance(engine, Slave) else 0

    def range_of(self, station: int, mode: int) -> BlockRange:
        """Where this PLC keeps a station's block."""
        block = MODES[mode]
        return block_range(station, block.bits, block.words, self._profile.word_spacing)

    def blocks(self) -> dict[int, BlockRange]:
        """Where the blocks of all stations lie in the largest mode, by station; none without an engine."""
        mode = max(range(len(MODES)), key=lambda mode: MODES[mode].size)
        numbers = range(STATIONS) if self.engine is not None else ()
        return {number: self.range_of(number, mode) for number in numbers}

    def store_blocks(self, blocks: Iterable[tuple[int, bytes]]) -> None:
        """Write received blocks of other stations into the memory, those of the mode in force."""
        if (mode := self.mode) is None:
            return
        own = self.station
        for station, image in blocks:
            if station != own and len(image) == MODES[mode].size:
                self._memory.store_block(self.range_of(station, mode), image)

    # -- status out ------------------------------------------------------------------------------

    def publish(self) -> None:
        """Write the engine's counts, codes, flags and times into the special devices."""
        if self.engine is not None:
            self._publish_status(self.engine.status)

    def _publish_status(self, status: LinkStatus) -> None:
        words, bits = self._memory.words("D"), self._memory.bits("M")
        first, first_flag = self._registers.first_word, self._registers.first_flag
        times = (status.current, status.longest)
        if times != self._times:
            self._times = times
            self._shown = (self.in_units(status.current), self.in_units(status.longest))
        words[first], words[first + 1] = self._shown
        if status.counts != self._counts:
            self._counts = list(status.counts)
            self._count_words = array("H", self._counts)
        if status.codes != self._codes:
            self._codes = list(status.codes)
            self._code_words = array("H", self._codes)
        # Written anew each time: a program may have written there.
        words[first + _COUNTS : first + _COUNTS + STATIONS] = self._count_words
        words[first + _CODES : first + _CODES + STATIONS] = self._code_words
        bits[first_flag : first_flag + STATIONS] = bytes(status.flags)
        bits[self._registers.running] = status.running

    def in_units(self, ticks: int | None) -> int:
        """A link scan time in the unit of D8201, rounded half up; 0 for none; at most 32767."""
        if ticks is None:
            return 0
        unit = self._profile.link_scan_unit
        return min(32767, (2 * ticks + unit) // (2 * unit))

    def registers(self) -> dict[str, int]:
        """What every link-related special device holds, by the PW10's name for it."""
        devices = status_devices(self._profile, selected_port(self._memory))
        return {name: self._memory.get(device) for name, device in devices.items()}

    def own_names(self) -> dict[str, str]:
        """This family's own names of those of them that the PW10 calls otherwise, by the PW10's name."""
        devices = status_devices(self._profile, selected_port(self._memory))
        return {name: str(device) for name, device in devices.items() if name != str(device)}


def status_devices(profile: Profile, port: str) -> dict[str, Device]:
    """Every link-related special device of a family, by the PW10's name for it.

    An FX1S keeps some elsewhere (D201–D218, M503–M511), an FX3U's COM4 its errors (D8438, M8438); a result
    has the common names, so that families can be compared.
    """
    port_error = shown_at(serial_error(profile.error_codes, port, BAD_PARAMETERS))
    own = {Device("D", at): Device("D", at) for at in range(D_MIRROR_STATION, D_TIMEOUT + 1)}
    status = LINK_STATUS[profile.family]
    own |= {common: device for common, device in status.items() if common.is_word}
    own |= {Device(letter, SERIAL_ERROR): Device(letter, port_error) for letter in "DM"}
    own |= {_PORT: _PORT, **status}
    return {str(common): device for common, device in own.items()}
