"""What the serial port of a device model needs and allows, each a named field."""

from dataclasses import dataclass, replace
from fractions import Fraction

from bussim.engines.modbus.adu import Mode
from bussim.engines.modbus.framing import Framing
from bussim.engines.modbus.gaps import STANDARD_GAPS, GapRule
from bussim.line.characters import BAUDS, CharFormat, LineTiming


@dataclass(frozen=True, slots=True)
class DevicePort:
    """One device model's port. Times in ticks.

    ===========  =======================================================  =========================
    field        meaning                                                  source
    ===========  =======================================================  =========================
    ``modes``    RTU, ASCII                                               manuals
    ``bauds``    rates that it can be set to                              manuals
    ``formats``  character formats that it can be set to; empty: any      manuals
    ``gaps``     silences of RTU                                          standard; V80 its own
    ``delay``    least time from a request's end to its reply             stepper; else 0 (assumed)
    ===========  =======================================================  =========================
    """

    name: str
    modes: tuple[Mode, ...] = (Mode.RTU, Mode.ASCII)
    bauds: tuple[int, ...] = BAUDS
    formats: tuple[CharFormat, ...] = ()
    gaps: GapRule = STANDARD_GAPS
    delay: int = 0

    def framing(self, mode: Mode, timing: LineTiming, silence: float | None = None) -> Framing:
        """How it frames; ``silence``, in ticks or as a float in characters, ends a frame of RTU instead.

        Raises ValueError for a mode that it lacks, or RTU without 8 data bits.
        """
        if mode not in self.modes:
            allowed = " or ".join(mode.value for mode in self.modes)
            raise ValueError(f"{self.name} does not speak Modbus {mode.value}, only {allowed}")
        if mode is Mode.ASCII:
            return Framing.ascii()
        framing = Framing.rtu(timing, self.gaps)
        if silence is None:
            return framing
        quiet = timing.characters(Fraction(silence)) if isinstance(silence, float) else silence
        return replace(framing, quiet=quiet, inner=min(framing.inner, quiet))
