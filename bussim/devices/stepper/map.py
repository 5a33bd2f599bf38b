"""The stepper motor controller as Modbus slave (stepper controller manual, sections 3 to 7)."""

from collections.abc import Callable, Sequence
from functools import partial

from bussim.devices.areas import Area, AreaMap, Part
from bussim.devices.stepper.axis import Switch
from bussim.devices.stepper.controller import FORWARD, REVERSE, Controller
from bussim.devices.stepper.parameters import Parameters, with_words
from bussim.devices.stepper.profile import STEPPER_PORT, STEPPER_PROFILE, StepperProfile
from bussim.devices.stepper.registers import BY_NAME, COILS, OUTPUTS, REGISTERS, Group
from bussim.engines.modbus.codes import ExceptionCode
from bussim.engines.modbus.server import Space

#: 03 05 06 10 (manual, section 4: 01, 02 and 0F are not supported).
STEPPER_FUNCTIONS = frozenset((0x03, 0x05, 0x06, 0x10))


class Stepper(AreaMap):
    """The controller: registers 40001–40080, coils 00001–00037, and the motor behind them.

    Station and rate are those that were saved when power came (``station``, ``baud``): a driver
    gives its slave engine the station, and asks again after :meth:`power_on`. A command that cannot
    be carried out now (motor running, disabled, limit reached, no speed) is refused as the profile
    says, a value outside its range with exception 03 (assumed). Coils cannot be read; OFF does
    something only for the two jogs. Each half of a two-register value can be written alone.
    """

    def __init__(
        self,
        station: int = 1,
        baud: int = 9600,
        switches: Sequence[Switch] = (),
        profile: StepperProfile = STEPPER_PROFILE,
    ) -> None:
        """Power is on, at tick 0, with a saved station and rate. Raises ValueError for impossible ones."""
        if not BY_NAME["station"].low <= station <= BY_NAME["station"].high:
            raise ValueError(f"station (={station}) must be in [1...247]")
        if baud not in STEPPER_PORT.bauds:
            raise ValueError(f"baud (={baud}) must be one of {', '.join(map(str, STEPPER_PORT.bauds))}")
        areas: list[Area] = [Area(Space.HOLDING, r.address, r.words, r.name, r.writable) for r in REGISTERS]
        coils = {number - 1: name for number, name in COILS.items() if name != "save"}
        if coils.setdefault(profile.save_coil - 1, "save") != "save":
            raise ValueError(f"save_coil (={profile.save_coil}) is {coils[profile.save_coil - 1]}")
        areas += [Area(Space.COILS, address, 1, name) for address, name in coils.items()]
        super().__init__(areas, STEPPER_FUNCTIONS)
        self.parameters = Parameters()
        self.parameters["station"] = station
        self.parameters["baud"] = baud
        self.parameters.save()
        self.profile = profile
        self.controller = Controller(self.parameters, profile, switches)
        self.station = station
        self.baud = baud
        self.powered = True
        self.controller.power_on(0)
        self._commands = self._command_table()

    def _command_table(self) -> dict[str, Callable[[int], bool]]:
        """What each coil does when it is written ON."""
        control, parameters = self.controller, self.parameters
        table: dict[str, Callable[[int], bool]] = {
            "save": lambda _: self._save(),
            "read_project": lambda _: self._while_idle(parameters.read_project),
            "clear_project": lambda _: self._while_idle(parameters.clear_project),
            "stop": control.stop,
            "jog_forward": lambda now: control.jog(FORWARD, now),
            "jog_reverse": lambda now: control.jog(REVERSE, now),
            "to_zero": control.to_zero,
            "run_once": control.run_once,
            "start_project": control.start_project,
            "home": control.home,
            "clear_position": control.clear_position,
            "previous_step": lambda _: control.move_step_number(-1),
            "next_step": lambda _: control.move_step_number(1),
            "reset_basic": lambda _: self._while_idle(parameters.reset_basic),
        }
        for number in range(1, OUTPUTS + 1):
            table[f"output_{number}_on"] = partial(control.set_output, number, on=True)
            table[f"output_{number}_off"] = partial(control.set_output, number, on=False)
        return table

    def _save(self) -> bool:
        self.parameters.save()
        return True

    def _while_idle(self, action: Callable[[], None]) -> bool:
        if self.controller.busy:
            return False
        action()
        return True

    # -- time, power and wires -------------------------------------------------------------------

    def advance(self, now: int) -> None:
        """Let everything happen that is to happen by ``now``. Reading and writing do so themselves."""
        if self.powered:
            self.controller.advance(now)

    def poll(self) -> tuple[int, str] | None:
        """What it did next, as a phrase with its tick; None when there is no more."""
        events = self.controller.events
        return events.popleft() if events else None

    def power_off(self, now: int) -> None:
        """Everything stands where it is; what was not saved is lost. Nothing if it is off."""
        if self.powered:
            self.advance(now)
            self.controller.power_off(now)
            self.powered = False

    def power_on(self, now: int) -> None:
        """It comes up as it was saved: ``station`` and ``baud`` are valid from now on.

        The coordinate is 0 where the axis stands (assumed). A saved rate that does not exist leaves
        the old one (assumed). Nothing if it is on.
        """
        if self.powered:
            return
        self.powered = True
        self.parameters.power_on()
        self.controller.power_on(now)
        self.station = self.parameters["station"]
        if self.parameters["baud"] in STEPPER_PORT.bauds:
            self.baud = self.parameters["baud"]
        self.controller.events.append((now, f"is on as station {self.station} at {self.baud} bps"))

    # -- registers ---------------------------------------------------------------------------------

    def read(self, space: Space, address: int, count: int, now: int) -> Sequence[int] | ExceptionCode:
        """See the protocol."""
        self.advance(now)
        return super().read(space, address, count, now)

    def write(self, space: Space, address: int, values: Sequence[int], now: int) -> ExceptionCode | None:
        """See the protocol."""
        self.advance(now)
        if space is not Space.COILS:
            return super().write(space, address, values, now)
        parts = self.parts(space, address, len(values))
        if parts is None:
            return ExceptionCode.ILLEGAL_ADDRESS
        done = all(self._coil(part.area.name, value, now) for part, value in zip(parts, values, strict=True))
        refused = self.profile.refused_command
        return None if done or not refused else ExceptionCode(refused)

    def _coil(self, name: str, value: int, now: int) -> bool:
        if value:
            return self._commands[name](now)
        if name == "jog_forward":
            return self.controller.release_jog(FORWARD, now)
        if name == "jog_reverse":
            return self.controller.release_jog(REVERSE, now)
        return True

    def alike_until(self, now: int) -> int:
        """See the base class: until something happens on its own."""
        change = self.controller.next_change()
        return super().alike_until(now) if change is None else change

    def value(self, name: str, now: int) -> int:
        """A register by its name, two words as one number of 32 bits (not sign-extended)."""
        self.advance(now)
        register, control = BY_NAME[name], self.controller
        if register.group is not Group.STATUS:
            return self.parameters[name]
        if name == "position":
            return control.axis.position(now) & 0xFFFF_FFFF
        if name == "running_step":
            return control.running_step
        kind, _, number = name.partition("_")
        if kind == "input":
            return int(control.inputs.level(int(number)))
        if kind == "output":
            return int(control.outputs[int(number)])
        return int(control.arrived if name == "arrived" else control.moving)

    def _fetch(self, part: Part, now: int) -> Sequence[int]:
        value = self.value(part.area.name, now)
        return [value >> 16 * word & 0xFFFF for word in range(part.offset, part.offset + part.size)]

    def _written(self, part: Part, values: Sequence[int]) -> int:
        name = part.area.name
        return with_words(BY_NAME[name], self.parameters[name], part.offset, tuple(values))

    def _refuse(self, part: Part, values: Sequence[int], now: int) -> ExceptionCode | None:
        register = BY_NAME[part.area.name]
        if register.low <= self._written(part, values) <= register.high:
            return None
        return ExceptionCode.ILLEGAL_VALUE

    def _store(self, part: Part, values: Sequence[int], now: int) -> None:
        name = part.area.name
        self.parameters[name] = self._written(part, values)
        if name == "disabled" and self.parameters[name]:
            self.controller.disable(now)
        # Which input means what, and where switches lie, may be new.
        self.controller.axis.replan(now)
        self.controller.inputs_changed(now)
