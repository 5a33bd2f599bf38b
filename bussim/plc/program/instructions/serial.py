"""RS, RS2 and CPAVL (PW10 board manual, section 5): handed on to the PLC's ports."""

from bussim.plc.memory import Device
from bussim.plc.program.machine import Act, Machine, Ports
from bussim.plc.program.text.catalog import Instruction


def drive(machine: Machine, at: Instruction) -> Act:
    """RS S m D n; RS2 S m D n n1."""
    ports, now, number = _ports(machine), machine.now, at.number
    operands: tuple[Device | int, ...] = tuple(
        operand.address if operand.kind == "K" else operand.device for operand in at.operands
    )
    start = machine.origin
    return lambda: ports.drive(number, operands, now[0] + start)


def set_up(machine: Machine, at: Instruction) -> Act:
    """CPAVL S D M."""
    ports = _ports(machine)
    words, bits, port = at.operands

    def act() -> None:
        ports.cpavl(words.device, bits.device, port.address)

    return act


def _ports(machine: Machine) -> Ports:
    if machine.ports is None:
        raise ValueError("RS, RS2 and CPAVL need ports")
    return machine.ports
