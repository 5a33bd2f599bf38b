"""What the stepper controller's manual leaves open: our choices, each a named field."""

from dataclasses import dataclass
from enum import StrEnum
from fractions import Fraction

from bussim.devices.serial_settings import DevicePort
from bussim.engines.modbus.adu import Mode
from bussim.line.characters import CharFormat
from bussim.units import TICKS_PER_MS

#: Rates, 8N1 and 35 ms: manual, sections 2 and 3.
STEPPER_PORT = DevicePort(
    "stepper",
    modes=(Mode.RTU,),
    bauds=(4800, 9600, 19200, 38400, 115200),
    formats=(CharFormat(8, "N", 1),),
    delay=35 * TICKS_PER_MS,
)


class StepOutput(StrEnum):
    """When the output of a program step (40034) is on."""

    DELAY = "delay"  # from the end of its motion to the end of its delay
    STEP = "step"  # from the beginning of its motion to the end of its delay


@dataclass(frozen=True, slots=True)
class StepperProfile:
    """Choices that the manual allows both ways (all assumed).

    =====================  ==============================================================================
    field                  meaning
    =====================  ==============================================================================
    ``save_coil``          number of the coil that saves, whose name the manual's table has lost
    ``acceleration_unit``  Hz per second that one unit of 40004 and 40029 stands for
    ``homing_zeroes``      the coordinate becomes 0 where homing finds the mechanical zero
    ``refused_command``    exception code for a command that cannot be carried out now; 0: it is echoed,
                           without effect
    ``step_output``        when a step's output is on
    ``zero_is_endless``    40050 = 0 repeats a project without end, instead of running it once
    =====================  ==============================================================================
    """

    save_coil: int = 1
    acceleration_unit: Fraction = Fraction(1)
    homing_zeroes: bool = False
    refused_command: int = 4
    step_output: StepOutput = StepOutput.DELAY
    zero_is_endless: bool = True


STEPPER_PROFILE = StepperProfile()
