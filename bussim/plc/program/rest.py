"""What a program's scans depend on, so that those that would change nothing need not be carried out.

What a scan does depends on the devices that its program names, on what its machine remembers of the scans
before, and on the time where a timer counts or a clock of the PLC is named. A scan that has left all of it as
it was is followed by others that do the same, until an input, a received block, a clock or a timer changes.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from bussim.plc.inputs import NEVER
from bussim.plc.link_devices import LINK_STATUS
from bussim.plc.memory import FIRST_SPECIAL, BlockRange, device_ranges
from bussim.plc.program.instructions.coils import unit_of
from bussim.plc.program.machine import Machine
from bussim.plc.program.program import Program
from bussim.plc.program.text.operand_checks import Extent, extents, slots_of
from bussim.units import TICKS_PER_MS

#: Half the periods of clocks that a program may name, by M's address; M8011's is shorter than a scan.
_CLOCKS = {8012: 50 * TICKS_PER_MS, 8013: 500 * TICKS_PER_MS, 8014: 30_000 * TICKS_PER_MS}
#: Special devices that from the second scan on change by the program alone.
_STEADY = device_ranges("M8000-8003 M8020-8022 M8024 M8038 M8179 D8176-8180")


@dataclass(frozen=True)
class Dependence:
    """What a program's scans depend on: devices, half periods of clocks in ticks, timers with their units."""

    devices: tuple[Extent, ...] = ()
    clocks: tuple[int, ...] = ()
    timers: tuple[tuple[int, int], ...] = ()

    def touches(self, blocks: Sequence[BlockRange], *, writes: bool = False) -> bool:
        """Whether the program names a device of some blocks, or writes one."""
        places = [place for of in blocks for place in (("M", of.bit, of.bits), ("D", of.word, of.words))]
        return any(
            at.letter == letter and at.first < first + count and at.last >= first and at.writes >= writes
            for at in self.devices
            for letter, first, count in places
        )


@lru_cache(maxsize=64)
def dependence(program: Program) -> Dependence | None:
    """What a program's scans depend on; None where that is not known before it runs, or always changes."""
    devices: list[Extent] = []
    clocks: set[int] = set()
    timers: dict[int, int] = {}
    status = LINK_STATUS[program.family].values()
    for at in program.instructions:
        slots = slots_of(at.form, at.operands)
        counts = {slot.by for slot in slots if slot.by}
        unknown = any(
            slot.name in counts and operand.constant is None
            for slot, operand in zip(slots, at.operands, strict=True)
        )
        if unknown or at.spec.group == "serial" or any(operand.index is not None for operand in at.operands):
            return None
        found = extents(at, backwards=True)
        devices += found
        for extent in found:
            if extent.letter in "MD" and extent.last >= FIRST_SPECIAL:
                if extent.letter == "M" and extent.first == extent.last in _CLOCKS:
                    clocks.add(_CLOCKS[extent.first])
                elif not any(
                    each.letter == extent.letter and each.first <= extent.first and extent.last <= each.last
                    for each in _STEADY
                ):
                    return None
            elif any(extent.holds(device.letter, device.address, word=device.is_word) for device in status):
                return None
        if at.name == "OUT" and at.operands[0].kind == "T":
            timers[at.operands[0].address] = unit_of(at.operands[0].address, at.operands[0].family)
    return Dependence(tuple(devices), tuple(clocks), tuple(timers.items()))


def state_of(found: Dependence, machine: Machine, loops: list[int]) -> Callable[[], tuple[bytes, list[int]]]:
    """A function that copies all that a scan may change and the next one may depend on."""
    letters = {"M", *(extent.letter for extent in found.devices)}
    shelves: tuple[dict[str, Any], ...] = (machine.bits, machine.words, machine.held)
    arrays = [of[letter] for of in shelves for letter in letters if letter in of]
    views = [memoryview(each) for each in (*arrays, machine.earlier, machine.levels, machine.counter_input)]
    return lambda: (b"".join(views), loops[:])


def rests_until(found: Dependence, machine: Machine) -> int:
    """Until which tick scans go on doing what the latest did, which has left everything as it was."""
    if machine.going:
        return -1
    now, scan, contacts = machine.now[0], machine.scan[0], machine.bits["T"]
    units = [
        unit for number, unit in found.timers if machine.timer_scan[number] == scan and not contacts[number]
    ]
    return min(((now // unit + 1) * unit + machine.origin for unit in (*units, *found.clocks)), default=NEVER)
