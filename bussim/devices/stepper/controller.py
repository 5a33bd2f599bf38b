"""What the stepper controller does: commands, inputs and outputs, and what follows from them in time.

Choices that the manual leaves open are fields of the profile, or marked here as assumed. Times are
ticks; every method takes the present one.
"""

from collections import deque
from collections.abc import Sequence

from bussim.devices.stepper.axis import Axis, Inputs, Switch, drive_for, pulses_of, pulses_per_unit
from bussim.devices.stepper.motion import Drive, Job, StopReason, run, travel
from bussim.devices.stepper.parameters import Parameters
from bussim.devices.stepper.profile import StepOutput, StepperProfile
from bussim.devices.stepper.project import Project, Waiting
from bussim.devices.stepper.registers import MAX_STEPS, OUTPUTS, signed

FORWARD = 1
REVERSE = -1
_LIMITS = {FORWARD: "forward_limit_input", REVERSE: "reverse_limit_input"}


class Controller:
    """The machine behind the registers."""

    def __init__(
        self, parameters: Parameters, profile: StepperProfile, switches: Sequence[Switch] = ()
    ) -> None:
        self.parameters = parameters
        self.profile = profile
        self.axis = Axis(parameters, switches)
        #: What it did, as phrases with their ticks; positions in units.
        self.events: deque[tuple[int, str]] = deque()
        #: 40013: the latest single run has arrived.
        self.arrived = False
        self.outputs = [False] * (OUTPUTS + 1)  # by number, 0 unused
        self.inputs = Inputs(parameters, self.axis)
        self._job = Job.JOG
        self._stop: StopReason | None = None  # why the motion in progress is being stopped
        self._signal = 0  # the input that a jog by signal follows
        self._legs: list[int] = []  # signed pulses still to go in a single run
        self._project: Project | None = None
        self._step_output = 0  # the output that the step's delay keeps on

    # -- time ----------------------------------------------------------------------------------

    def next_change(self) -> int | None:
        """The next tick at which something happens on its own, None for never."""
        until = self._project.until if self._project is not None else None
        return min((at for at in (self.axis.next_change(), until) if at is not None), default=None)

    def advance(self, now: int) -> None:
        """Let everything happen that is to happen by ``now``."""
        while (at := self.next_change()) is not None and at <= now:
            motion = self.axis.motion
            if motion is not None and motion.end is not None and motion.end <= at:
                self._motion_over(motion.end)
            elif self._project is not None and self._project.until == at:
                self._delay_over(at)
            else:
                self.axis.passed(at)
                self.inputs_changed(at)

    # -- state that registers show -------------------------------------------------------------

    @property
    def moving(self) -> bool:
        """40049: the motor runs."""
        return self.axis.motion is not None

    @property
    def running_step(self) -> int:
        """40042: the step that runs, 0 without a project."""
        return 0 if self._project is None else self._project.step

    # -- commands: each returns whether it was carried out ---------------------------------------

    def _refuse(self, now: int, command: str, why: str) -> bool:
        self.events.append((now, f"{command} refused: {why}"))
        return False

    def _blocked(self, direction: int | None) -> str | None:
        """Why the motor cannot start now, in words."""
        if self.moving or self._project is not None:
            return "the motor runs" if self.moving else "a project runs"
        if self.parameters["disabled"]:
            return "the motor is disabled"
        if direction is not None and self.inputs.on(_LIMITS[direction]):
            return "the limit switch is on"
        return None

    def run_once(self, now: int) -> bool:
        """Coil 00008: by 40010/40011 (relative), or to it (absolute), as often as 40058 says there and back.

        40058 = 0 is a single run; n goes there and back n times (assumed).
        """
        parameters = self.parameters
        if parameters["absolute"]:
            pulses = self.axis.pulses_to(signed(parameters["distance"]), now)
        else:
            pulses = pulses_of(parameters, parameters["distance"], reverse=parameters["direction"])
        started = self._start_travel(Job.RUN_ONCE, pulses, now, "run_once")
        if started:
            self.arrived = False
            legs = 2 * parameters["round_trips"] if pulses else 0
            self._legs = [pulses * (-1) ** leg for leg in range(legs - 1, 0, -1)]  # the last one first
        return started

    def to_zero(self, now: int) -> bool:
        """Coil 00007: back to coordinate zero."""
        return self._start_travel(Job.TO_ZERO, self.axis.pulses_to(0, now), now, "to_zero")

    def home(self, now: int) -> bool:
        """Coil 00010: reverse until the mechanical zero signal (40007)."""
        return self._start_run(Job.HOME, REVERSE, now, "home")

    def jog(self, direction: int, now: int) -> bool:
        """Coil 00005 or 00006 on: the motor runs until it goes off."""
        motion = self.axis.motion
        if motion is not None and self._job is Job.JOG and motion.direction == direction and not self._stop:
            return True
        return self._start_run(Job.JOG, direction, now, "jog")

    def release_jog(self, direction: int, now: int) -> bool:
        """Coil 00005 or 00006 off."""
        motion = self.axis.motion
        if motion is not None and self._job is Job.JOG and motion.direction == direction:
            self._halt(now, StopReason.RELEASED)
        return True

    def stop(self, now: int) -> bool:
        """Coil 00004: the motor stops as 40008 says, a project is over."""
        self._end_project(now, complete=False)
        self._legs = []
        self._halt(now, StopReason.COMMAND)
        return True

    def start_project(self, now: int) -> bool:
        """Coil 00009: the steps one after the other."""
        why = self._blocked(None)
        if why is not None:
            return self._refuse(now, "start_project", why)
        self._project = Project(self.parameters, self.profile)
        self._enter_step(now)
        return True

    def set_output(self, number: int, now: int, *, on: bool) -> bool:
        """Coils 00012–00017."""
        if self.outputs[number] != on:
            self.outputs[number] = on
            self.events.append((now, f"output {number} {'on' if on else 'off'}"))
        return True

    def move_step_number(self, by: int) -> bool:
        """Coils 00018 and 00019: 40040 one down or up, within 1–33."""
        number = self.parameters["step_number"] + by
        self.parameters["step_number"] = min(max(number, 1), MAX_STEPS)
        return True

    def disable(self, now: int) -> None:
        """40080 = 1: the motor stands at once."""
        self._end_project(now, complete=False)
        self._halt(now, StopReason.DISABLED)

    @property
    def busy(self) -> bool:
        """Whether the motor or a project runs."""
        return self.moving or self._project is not None

    def clear_position(self, now: int) -> bool:
        """Coil 00011: the coordinate is 0 here."""
        self.axis.set_origin(now)
        return True

    def power_on(self, now: int) -> None:
        """The coordinate is 0 where the axis stands (assumed); inputs that are on already start nothing."""
        self.arrived = False
        self.axis.set_origin(now)
        self.inputs.refresh(now)

    def power_off(self, now: int) -> None:
        """Everything stands; outputs are off."""
        self._end_project(now, complete=False)
        self._legs = []
        self._halt(now, StopReason.POWER)
        for number in range(1, OUTPUTS + 1):
            self.set_output(number, now, on=False)

    # -- inputs --------------------------------------------------------------------------------

    def inputs_changed(self, now: int) -> None:
        """Inputs, or what they mean, may have changed: what stops, starts or goes on?"""
        risen = self.inputs.refresh(now)
        self._check_motion(now)

        parameters = self.parameters
        if parameters["project_stop_input"] in risen:
            self.stop(now)
        elif parameters["project_start_input"] in risen:
            self.start_project(now)
        if parameters["forward_input"] in risen:
            self._signalled(FORWARD, parameters["forward_input"], now)
        elif parameters["reverse_input"] in risen:
            self._signalled(REVERSE, parameters["reverse_input"], now)
        project = self._project
        if project is not None and project.waiting is Waiting.START:
            self._try_step(now)

    def _check_motion(self, now: int) -> None:
        """Stop the motion in progress if an input says so."""
        motion = self.axis.motion
        if motion is None:
            return
        if self.inputs.on(_LIMITS[motion.direction]):
            self._end_project(now, complete=False)
            self._halt(now, StopReason.LIMIT)
        elif self._job is Job.HOME and self.inputs.on("home_input"):
            self._halt(now, StopReason.HOME)
        elif self._job is Job.SIGNAL_JOG and not self.inputs.level(self._signal):
            self._halt(now, StopReason.RELEASED)
        elif self._job is Job.STEP and self._step_stopped():
            self._halt(now, StopReason.STEP_SIGNAL)

    def _signalled(self, direction: int, number: int, now: int) -> None:
        """A forward or reverse start signal (40078, 40079) came; 40077 decides what it does."""
        mode = self.parameters["signal_mode"]
        if mode == 0:
            pulses = direction * abs(pulses_of(self.parameters, self.parameters["distance"], reverse=0))
            self._start_travel(Job.SIGNAL, pulses, now, "start signal")
        elif mode == 1:
            self._start_run(Job.SIGNAL, direction, now, "start signal")
        else:
            if not self.moving:
                self._signal = number
            self._start_run(Job.SIGNAL_JOG, direction, now, "start signal")

    # -- motion --------------------------------------------------------------------------------

    def _drive(self, start: int, speed: int, acceleration: int) -> Drive:
        unit = self.profile.acceleration_unit
        return drive_for(self.parameters, start, speed, acceleration * unit)

    def _own_drive(self) -> Drive:
        """The drive of everything but program steps."""
        parameters = self.parameters
        return self._drive(parameters["start_frequency"], parameters["speed"], parameters["acceleration"])

    def _start_travel(self, job: Job, pulses: int, now: int, command: str) -> bool:
        direction = REVERSE if pulses < 0 else FORWARD
        why = self._blocked(direction if pulses else None)
        drive = self._own_drive()
        if why is None and (not drive.can_move or pulses_per_unit(self.parameters) is None):
            why = "speed, step angle, microsteps or pitch is 0"
        if why is not None:
            return self._refuse(now, command, why)
        self._begin(job, drive, abs(pulses), direction, now)
        return True

    def _start_run(self, job: Job, direction: int, now: int, command: str) -> bool:
        drive = self._own_drive()
        why = self._blocked(direction)
        if why is None and not drive.can_move:
            why = "speed, step angle or microsteps is 0"
        if why is not None:
            return self._refuse(now, command, why)
        self._begin(job, drive, None, direction, now)
        self._check_motion(now)
        return True

    def _begin(self, job: Job, drive: Drive, pulses: int | None, direction: int, now: int) -> None:
        motion = run(drive, now, direction) if pulses is None else travel(drive, pulses, now, direction)
        self._job, self._stop = job, None
        self.axis.move(motion, now)
        target = self.axis.target()
        aim = "" if target is None else f" to {target / 100:.2f}"
        heading = "forward" if direction == FORWARD else "reverse"
        self.events.append((now, f"starts {heading}{aim} ({job.value})"))

    def _halt(self, now: int, reason: StopReason) -> None:
        """Stop the motion in progress: signals of the machine at once, the rest as 40008 says."""
        motion = self.axis.motion
        if motion is None:
            return
        by_signal = reason in (StopReason.LIMIT, StopReason.HOME, StopReason.DISABLED, StopReason.POWER)
        stopping = motion.cut(now) if by_signal or self.parameters["stop_mode"] else motion.slowed(now)
        if stopping is motion:
            return  # it is ramping down already, or comes to its end anyway
        self._stop = self._stop or reason
        self.axis.move(stopping, now)
        if stopping.end is not None and stopping.end <= now:
            self._motion_over(now)

    def _motion_over(self, now: int) -> None:
        motion = self.axis.motion
        self.axis.settle(now)
        job, reason = self._job, self._stop or StopReason.ARRIVED
        if reason is StopReason.HOME and self.profile.homing_zeroes:
            self.axis.set_origin(now)
        at = self.axis.position(now) / 100
        self.events.append((now, f"stands at {at:.2f} ({job.value}: {reason.value})"))
        if job is Job.RUN_ONCE and reason is StopReason.ARRIVED:
            if self._legs and motion is not None:
                pulses = self._legs.pop()  # with the speed of the first one
                self._begin(job, motion.drive, abs(pulses), REVERSE if pulses < 0 else FORWARD, now)
            else:
                self.arrived = True
        elif job is Job.STEP:
            self._step_moved(now)
        self.inputs_changed(now)

    # -- projects ------------------------------------------------------------------------------

    def _enter_step(self, now: int) -> None:
        project = self._project
        assert project is not None  # noqa: S101 - narrows the type; a project has just been set
        project.enter(now)
        self.events.append((now, f"step {project.step}"))
        self._try_step(now)

    def _try_step(self, now: int) -> None:
        """Begin the step's motion if its start signal (40027; 0: none) is there."""
        project = self._project
        if project is None:
            return
        values = project.values
        number = values["step_start_input"]
        if number and not self.inputs.level(number):
            return
        drive = self._drive(values["step_start_frequency"], values["step_speed"], values["step_acceleration"])
        pulses = pulses_of(self.parameters, values["step_distance"], reverse=values["step_direction"])
        direction = REVERSE if pulses < 0 else FORWARD
        if pulses == 0 or not drive.can_move or self._step_stopped():
            self._step_moved(now)
        elif self.inputs.on(_LIMITS[direction]):
            self._end_project(now, complete=False)
        else:
            project.waiting = Waiting.MOTION
            if self.profile.step_output is StepOutput.STEP:
                self._take_output(now)
            self._begin(Job.STEP, drive, abs(pulses), direction, now)

    def _step_stopped(self) -> bool:
        """Whether the stop signal of the running step (40051; 0: none) is on."""
        return self._project is not None and self.inputs.level(self._project.values["step_stop_input"])

    def _step_moved(self, now: int) -> None:
        """The step's motion is over, or there was none: its delay (40035/40036) begins."""
        if self._project is not None:
            self._project.delay(now)
            self._take_output(now)

    def _take_output(self, now: int) -> None:
        """The step's output (40034) goes on, until its delay is over; there is nothing behind 4–8."""
        output = 0 if self._project is None else self._project.values["step_output"]
        if 1 <= output <= OUTPUTS:
            self._step_output = output
            self.set_output(output, now, on=True)

    def _delay_over(self, now: int) -> None:
        project = self._project
        assert project is not None  # noqa: S101 - narrows the type; only a running project has a delay
        self._release_output(now)
        goes_on, passed = project.advance()
        if passed:
            self.parameters["work_count"] = (self.parameters["work_count"] + 1) & 0xFFFF_FFFF
        if goes_on:
            self._enter_step(now)
        else:
            self._end_project(now, complete=True)

    def _release_output(self, now: int) -> None:
        if self._step_output:
            self.set_output(self._step_output, now, on=False)
            self._step_output = 0

    def _end_project(self, now: int, *, complete: bool) -> None:
        if self._project is not None:
            self._project = None
            self._release_output(now)
            self.events.append((now, "project done" if complete else "project broken off"))
