"""The device model ``lx``: a PLC as Modbus slave of which nothing else is simulated."""

from dataclasses import dataclass, field

from pydantic import Field

from bussim.devices.contract import SlaveSettings
from bussim.devices.forms import Find, SlaveIn, Word
from bussim.devices.lx.map import LX_PORT, LxMap
from bussim.forms.form import ScanIn
from bussim.forms.mistakes import EntryView, Reporter
from bussim.forms.registers import check_registers
from bussim.plc.link_registers import memory_at_power_on
from bussim.plc.memory import parse_device
from bussim.plc.ports.spec import PollSpec
from bussim.plc.profiles import PROFILES
from bussim.plc.scan import Scan
from bussim.plc.system_devices import SystemDevices


@dataclass(frozen=True, slots=True)
class LxSettings(SlaveSettings):
    """A PLC that responds at END. ``registers`` are its devices at power-on by name."""

    port = LX_PORT

    scan: Scan
    registers: dict[str, int] = field(default_factory=dict)

    def register_map(self) -> LxMap:
        """The PLC's memory. What lives by itself is as of the END that reads it, in scans of mean length."""
        registers = {parse_device(name): value for name, value in self.registers.items()}
        memory, times = memory_at_power_on(PROFILES["pw10"], registers), (self.scan.mean,) * 3
        system = SystemDevices(memory, 0)
        memory.refresh_specials = lambda end: system.scan(end, times)
        return LxMap(memory)

    def plc_scan(self) -> Scan:
        """Its scan."""
        return self.scan


class LxIn(SlaveIn):
    """An entry of this model."""

    example = """
{name: press9, model: lx, bus: feeder, station: 9, delay: 3 ms, jitter: 2 ms, mode: ascii,
  rtu_gaps: {end: 5, inner: 2, fast_character: 400 us},
  scan: {mean: 20 ms, jitter: 2 ms}, registers: {D0: -1, M3: 1}}
"""
    port = LX_PORT

    scan: ScanIn = ScanIn(mean="10 ms")  # type: ignore[arg-type] # read as from a file
    registers: dict[str, Word] = Field({})

    def check(self, entry: EntryView, find: Find, report: Reporter) -> None:
        """Check its devices and their values."""
        super().check(entry, find, report)
        check_registers((*entry.path, "registers"), self.registers, report, link=False)

    def settings(self, polls: tuple[PollSpec, ...], find: Find) -> LxSettings:
        """Its scan, and its devices by their proper names (D007 is D7)."""
        registers = {str(parse_device(name)): value for name, value in self.registers.items()}
        return LxSettings(Scan(self.scan.mean, self.scan.jitter), registers)
