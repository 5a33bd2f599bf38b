"""What the device models' serial ports need and allow, each number a named field."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

from bussim.engines.modbus.adu import Mode
from bussim.engines.modbus.framing import Framing
from bussim.engines.modbus.gaps import STANDARD_GAPS, GapRule
from bussim.engines.modbus.slave import SlaveConfig
from bussim.line.characters import BAUDS, CharFormat, LineTiming
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND

_8N1 = CharFormat(8, "N", 1)
#: The usual format of Modbus ASCII: 7 data bits, even parity.
ASCII_FORMAT = CharFormat(7, "E", 1)


@dataclass(frozen=True, slots=True)
class DeviceProfile:
    """One device model's port. Times in ticks.

    ==============  =====================================================  =========================
    field           meaning                                                source
    ==============  =====================================================  =========================
    ``modes``       RTU, ASCII                                             manuals
    ``bauds``       rates that it can be set to                            manuals
    ``baud``        the one that it is delivered with                      manuals; 9600 assumed
    ``format``      character format in RTU                                manuals; 8N1 assumed
    ``gaps``        silences of RTU                                        standard; V80 its own
    ``ascii_gap``   longest time between two characters of an ASCII frame  standard
    ``delay``       least time from a request's end to its reply           stepper; else 0 (assumed)
    ``backlog``     requests that wait while one is being answered         assumed
    ==============  =====================================================  =========================
    """

    name: str
    modes: tuple[Mode, ...] = (Mode.RTU, Mode.ASCII)
    bauds: tuple[int, ...] = BAUDS
    baud: int = 9600
    format: CharFormat = _8N1
    gaps: GapRule = STANDARD_GAPS
    ascii_gap: int = TICKS_PER_SECOND
    delay: int = 0
    backlog: int = 0

    def framing(self, mode: Mode, timing: LineTiming) -> Framing:
        """How it frames. Raises ValueError for a mode that it lacks, or RTU without 8 data bits."""
        if mode not in self.modes:
            allowed = " or ".join(mode.value for mode in self.modes)
            raise ValueError(f"{self.name} does not speak Modbus {mode.value}, only {allowed}")
        return Framing.rtu(timing, self.gaps) if mode is Mode.RTU else Framing.ascii(self.ascii_gap)

    def slave_config(self, mode: Mode, timing: LineTiming, *, driven: bool = False) -> SlaveConfig:
        """The settings of its slave engine; ``driven``: a PLC, which serves requests at END."""
        return SlaveConfig(self.framing(mode, timing), self.delay, driven, self.backlog)


#: The built-in models by name; ``map`` is the one whose registers a scenario defines.
DEVICE_PROFILES: dict[str, DeviceProfile] = {
    "lx": DeviceProfile("lx"),
    # "more than four and a half characters" (V80 manual, section 1.2), at every rate.
    "v80": DeviceProfile("v80", gaps=GapRule(end=Fraction(9, 2), fast_character=None)),
    # Rates, 8N1 and 35 ms: stepper manual, sections 2 and 3.
    "stepper": DeviceProfile(
        "stepper", modes=(Mode.RTU,), bauds=(4800, 9600, 19200, 38400, 115200), delay=35 * TICKS_PER_MS
    ),
    "map": DeviceProfile("map"),
}
