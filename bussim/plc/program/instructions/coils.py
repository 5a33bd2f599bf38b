"""OUT and RST of timers and counters (FX programming manual, basic instructions).

Timers count the pulses of a clock that runs free from power-on: the first unit after they are driven
is cut short, so that a timer of K n units takes between n - 1 and n, and up to a scan more. They are
brought up to date where their OUT stands, as is their contact. One that a jump leaves out pauses. T192–T199
and T246–T249, once driven, go on, also without a further call of the subroutine where their OUT stands:
T192–T199 close at END as well, T246–T249 at their first OUT after the preset (FX programming manual, 4.9.4).
Counters count rising edges of their OUT's condition. A 16-bit counter stops at its preset; a 32-bit
one runs on (and round, at ±2³¹), its contact going on where it counts up to the preset and off where it
counts down from it; what is written beyond the preset does not close it.
RST of a timer or counter is a coil too: while its condition is on, and where a jump then leaves it out,
the timer or counter is held: it neither counts nor closes. The hold lasts until an RST of it is
carried out with its condition off (FX3 programming manual, 7.13 and 8.1.1), of what is not latched also no
longer than until STOP. ZRST holds nothing.
Where the manual is silent, assumed: a timer's contact, once on, stays until the timer is reset, and
the timer counts no further; a preset of 0 or less is reached at once; at RUN every condition counts as
having been off before; a held counter follows its input, so that one that has come on during the hold
is no edge after it.
"""

from bussim.plc.memory import FIRST_LONG_COUNTER, Family
from bussim.plc.program.compiled.access import value_reader, word_of
from bussim.plc.program.machine import Act, Machine, Take
from bussim.plc.program.text.catalog import Instruction
from bussim.plc.program.text.operands import Operand
from bussim.units import TICKS_PER_MS

#: The first timer of each kind and its unit in ms; T246–T255 keep their value (FX programming manual).
_UNITS = ((256, 1), (250, 100), (246, 1), (200, 10), (0, 100))
_FX1S_UNITS = ((63, 1), (0, 100))
RETENTIVE_TIMERS = range(246, 256)
#: Timers for subroutines, which close at END; those that go on while their OUT is left out.
SUBROUTINE_TIMERS = range(192, 200)
_GOING_ON = (*SUBROUTINE_TIMERS, *range(246, 250))
#: The special bit that makes counter C200 count down; C201's follows, and so on.
DOWN_FLAGS = 8200 - FIRST_LONG_COUNTER
_LONG = 1 << 32
_LONG_HALF = 1 << 31


def unit_of(timer: int, family: Family) -> int:
    """A timer's unit in ticks."""
    units = _FX1S_UNITS if family is Family.FX1S else _UNITS
    return next(unit for first, unit in units if timer >= first) * TICKS_PER_MS


def bind(machine: Machine, at: Instruction) -> Take:
    """OUT and RST of a timer or counter."""
    device = at.operands[0]
    if at.spec.name == "RST":
        return _reset_coil(machine, device.letter, device.address)
    if device.kind == "T":
        return _timer(machine, device, at.operands[1])
    count = _long_counter if device.address >= FIRST_LONG_COUNTER else _counter
    return count(machine, device.address, at.operands[1])


def _reset_coil(machine: Machine, letter: str, number: int) -> Take:
    clear, held = reset(machine, letter, number, number), machine.held[letter]

    def take(on: int) -> None:
        held[number] = on
        if on:
            clear()

    return take


def reset(machine: Machine, letter: str, first: int, last: int) -> Act:
    """Clears timers or counters: value and contact. A timer that stays driven begins anew."""
    contacts, values = machine.bits[letter], machine.words[letter]
    starts, going = machine.timer_scan, machine.going

    def act() -> None:
        for number in range(first, last + 1):
            contacts[number] = 0
            values[number] = 0
            if letter == "T":
                starts[number] = 0
                going.pop(number, None)

    return act


# -- timers and counters ---------------------------------------------------------------------------


def _timer(machine: Machine, device: Operand, preset: Operand) -> Take:
    number = device.address
    contacts, values = machine.bits["T"], machine.words["T"]
    driven, pulses, held = machine.timer_scan, machine.timer_pulse, machine.held["T"]
    now, scan, going = machine.now, machine.scan, machine.going
    presets, index = word_of(machine, preset)
    unit = unit_of(number, device.family)
    retentive = number in RETENTIVE_TIMERS
    goes_on = number in _GOING_ON

    def count(closes: int) -> None:
        pulse = now[0] // unit
        value = values[number] + pulse - pulses[number]
        pulses[number] = pulse
        limit = (presets[index] ^ 0x8000) - 0x8000
        if value >= limit:
            # What a program wrote beyond the preset stays; the clock stops at the preset.
            value = max(values[number], limit, 0)
            contacts[number] = closes
        values[number] = value

    def take(on: int) -> None:
        if not on or held[number]:
            driven[number] = 0
            going.pop(number, None)
            if not (on or retentive):
                contacts[number] = 0
                values[number] = 0
            return
        if contacts[number]:
            return  # until it is reset, which begins it anew
        last, driven[number] = driven[number], scan[0]
        if not last or (scan[0] - last > 1 and not goes_on):
            pulses[number] = now[0] // unit  # it begins, or has paused
        count(1)
        if goes_on:
            going[number] = count

    return take


def end(machine: Machine) -> None:
    """END of a scan: what goes on without its OUT is brought up to date."""
    contacts = machine.bits["T"]
    for number, count in machine.going.items():
        if not contacts[number]:
            count(int(number in SUBROUTINE_TIMERS))


def _counter(machine: Machine, number: int, preset: Operand) -> Take:
    contacts, values = machine.bits["C"], machine.words["C"]
    earlier, held = machine.counter_input, machine.held["C"]
    presets, index = word_of(machine, preset)

    def take(on: int) -> None:
        if on > earlier[number] and not contacts[number] and not held[number]:
            value = values[number]
            if value < 0x7FFF:
                value += 1
                values[number] = value
            if value >= (presets[index] ^ 0x8000) - 0x8000:
                contacts[number] = 1
        earlier[number] = on

    return take


def _long_counter(machine: Machine, number: int, preset: Operand) -> Take:
    contacts, values = machine.bits["C"], machine.words["C"]
    earlier, held = machine.counter_input, machine.held["C"]
    flags, down = machine.bits["M"], DOWN_FLAGS + number
    limit_of = value_reader(machine, preset, wide=True)

    def take(on: int) -> None:
        if on > earlier[number] and not held[number]:
            step = -1 if flags[down] else 1
            pattern = (values[number] + step) % _LONG
            values[number] = pattern
            value = (pattern ^ _LONG_HALF) - _LONG_HALF
            if value == limit_of() + (step - 1) // 2:  # the preset, or what is below it on the way down
                contacts[number] = step > 0
        earlier[number] = on

    return take
