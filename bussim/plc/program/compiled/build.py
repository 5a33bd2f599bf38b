"""Binds a program's rungs to a machine: one closure a rung, specialised for its condition and outputs."""

from __future__ import annotations

from collections.abc import Callable

from bussim.plc.program.compiled.conditions import Conditions, Part, as_step, as_test
from bussim.plc.program.compiled.outputs import Act, Bind, Coil, Drive, Level, Output, Take
from bussim.plc.program.compiled.shapes import Step, Test, ToAct, ToCoil
from bussim.plc.program.instructions import arithmetic, coils, moves, serial, shifts
from bussim.plc.program.machine import Machine, OperationError
from bussim.plc.program.text.catalog import Instruction
from bussim.plc.program.text.ladder import Control, Rung
from bussim.plc.program.times import InstructionTimes

_BASIC: dict[str, Callable[[Machine, Instruction], Output]] = {
    "OUT": coils.bind_out,
    "SET": coils.bind_set,
    "RST": coils.bind_reset,
    "PLS": coils.bind_pulse,
    "PLF": coils.bind_pulse,
}
_APPLIED: dict[str, Bind] = {
    "MOV": moves.move,
    "CML": moves.move,
    "XCH": moves.exchange,
    "BMOV": moves.move_block,
    "FMOV": moves.fill,
    "BCD": moves.to_bcd,
    "BIN": moves.from_bcd,
    "WAND": moves.logic,
    "WOR": moves.logic,
    "WXOR": moves.logic,
    "MEAN": moves.mean,
    "ADD": arithmetic.add,
    "SUB": arithmetic.add,
    "MUL": arithmetic.multiply,
    "DIV": arithmetic.divide,
    "INC": arithmetic.step,
    "DEC": arithmetic.step,
    "NEG": arithmetic.negate,
    "CMP": arithmetic.compare,
    "ZCP": arithmetic.compare_zone,
    "ROR": shifts.rotate,
    "ROL": shifts.rotate,
    "SFTR": shifts.shift,
    "SFTL": shifts.shift,
    "ALT": shifts.alternate,
    "ZRST": shifts.reset_zone,
    "RS2": serial.drive,
    "CPAVL": serial.set_up,
}


def standing_time(times: InstructionTimes, at: Instruction) -> int:
    """Nanoseconds that an instruction takes whatever its condition."""
    if _is_applied(at):
        return times.of(f"{at.spec.name} off", "idle", wide=False)
    return times.of(at.spec.name, _group(at), wide=at.form.wide)


def time_when_on(times: InstructionTimes, at: Instruction) -> int:
    """Nanoseconds that an instruction takes when it is carried out, without those for each device."""
    return times.of(at.spec.name, _group(at), wide=at.form.wide)


def _is_applied(at: Instruction) -> bool:
    return at.spec.name in _APPLIED


def _group(at: Instruction) -> str:
    timed = at.spec.name in ("OUT", "RST") and at.operands[0].kind in ("T", "C")
    return "timer" if timed else at.spec.group


class Builder:
    """Makes the closures of one program for one machine."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self.conditions = Conditions(machine)

    def step(self, item: Rung | Control) -> Step | None:
        """What carries a rung (or MC) out; None where there is nothing to do (MCR, an unused condition)."""
        if isinstance(item, Control):
            return self._master(item) if item.instruction.spec.name == "MC" else None
        outputs: list[Output] = []
        place = self.conditions.place_of(item)
        if place is not None:
            outputs.append(Coil(self._machine.saved, place))
        outputs += [self._output(at) for at in item.outputs]
        if not outputs:
            # No output uses the value, but its edges have to be followed.
            test = as_test(self.conditions.build(item.condition, item.level))

            def ask() -> None:
                test()

            return ask
        return _rung(self.conditions.build(item.condition, item.level), outputs, self._machine)

    def test(self, control: Control) -> Callable[[], int]:
        """The condition of a jump."""
        test = as_test(self.conditions.build(control.driven_by, control.level))
        if not control.instruction.form.pulse:
            return test
        earlier, number = self._machine.earlier, control.instruction.number

        def rises() -> int:
            on, before = test(), earlier[number]
            earlier[number] = on
            return on > before

        return rises

    def _master(self, control: Control) -> Step:
        level, coil = control.instruction.operands
        condition = self.conditions.build(control.driven_by, control.level)
        outputs: list[Output] = [
            Coil(self._machine.levels, level.address),
            Coil(self._machine.bits[coil.letter], coil.address),
        ]
        return _rung(condition, outputs, self._machine)

    def _output(self, at: Instruction) -> Output:
        basic = _BASIC.get(at.spec.name)
        if basic is not None:
            return basic(self._machine, at)
        act = _APPLIED[at.spec.name](self._machine, at)
        if at.spec.fallible or any(operand.index is not None for operand in at.operands):
            act = self._guarded(act, at.step)
        times = self._machine.times
        extra = times.of(at.spec.name, at.spec.group, wide=at.form.wide) - standing_time(times, at)
        level = Level(act, extra)
        return coils.once(self._machine, at, level) if at.form.pulse else level

    def _guarded(self, act: Act, step: int) -> Act:
        machine = self._machine

        def guarded() -> None:
            try:
                act()
            except OperationError as error:
                machine.fail(error.code, step)

        return guarded


def _rung(condition: Part, outputs: list[Output], machine: Machine) -> Step:
    levels = [output for output in outputs if isinstance(output, Level)]
    if len(levels) == len(outputs):
        act, extra = _sequence([level.act for level in levels]), sum(level.extra for level in levels)
        return as_step(condition, ToAct(act, machine.spent, extra))
    first = outputs[0]
    if len(outputs) == 1:
        if isinstance(first, Coil):
            return as_step(condition, ToCoil(first.bits, first.at))
        if isinstance(first, Drive):
            take, test = first.take, as_test(condition)
            return lambda: take(test())
    second = outputs[1]
    if len(outputs) == 2 and isinstance(first, Coil) and isinstance(second, Coil):
        return _two_coils(as_test(condition), first, second)
    return _mixed(as_test(condition), [_take(output, machine) for output in outputs])


def _two_coils(test: Test, one: Coil, other: Coil) -> Step:
    a, i, b, j = one.bits, one.at, other.bits, other.at

    def step() -> None:
        a[i] = b[j] = test()

    return step


def _sequence(acts: list[Act]) -> Act:
    if len(acts) == 1:
        return acts[0]
    if len(acts) == 2:
        first, second = acts

        def two() -> None:
            first()
            second()

        return two
    following = tuple(acts)

    def several() -> None:
        for act in following:
            act()

    return several


def _mixed(test: Callable[[], int], takes: list[Take]) -> Step:
    following = tuple(takes)
    if len(takes) == 2:
        first, second = takes

        def two() -> None:
            on = test()
            first(on)
            second(on)

        return two

    def step() -> None:
        on = test()
        for take in following:
            take(on)

    return step


def _take(output: Output, machine: Machine) -> Take:
    match output:
        case Coil(bits, at):

            def set_coil(on: int) -> None:
                bits[at] = on

            return set_coil
        case Level(act, extra):
            spent = machine.spent

            def carry_out(on: int) -> None:
                if on:
                    spent[0] += extra
                    act()

            return carry_out
        case Drive(take):
            return take
