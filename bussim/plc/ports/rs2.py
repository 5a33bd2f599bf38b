"""The instruction RS2 ``S m D n n1``: its operands, and what they ask a port to do.

==========  ==================================================  =============================
operand     Modbus master                                       free protocol
==========  ==================================================  =============================
S (D)       register: slave (high byte), function (low byte)    first register to send from
m (K H D)   first address                                       bytes to send, 0–256
D (D)       register: how many words or coils                   first register to receive into
n (K H D)   first device of the data                            bytes to receive, 0–256
n1 (K H D)  port, 2–6                                           port, 2–6
==========  ==================================================  =============================

(PW10 board manual, section 5. One of its examples puts the data elsewhere than n and its figure swaps
the bytes of S; the definition and the other example agree. It lists COM0 and COM1, which have none of
these protocols.) A constant n of a Modbus instruction is the number of a D register (assumed).
"""

from dataclasses import dataclass
from enum import Enum

from bussim.plc.memory import Device, Memory

#: A constant (K or H), or the D register that holds the number.
Operand = int | Device

#: Ports that n1 may name.
FIRST_PORT, LAST_PORT = 2, 6


class Drive(Enum):
    """What came of driving an RS2 instruction in this scan."""

    RUNNING = "it has the port"
    BUSY = "the port is another instruction's"
    OFF = "its contact is off"
    REFUSED = "the port does not exist, or has no protocol for it"


@dataclass(frozen=True, slots=True)
class Rs2:
    """The operands of one RS2 instruction; see the module for their meaning."""

    s: Device
    m: Operand
    d: Device
    n: Operand
    n1: Operand


@dataclass(frozen=True, slots=True)
class Call:
    """A Modbus transaction that an RS2 instruction asks for.

    ``device`` None: what is read has no place, and ``values`` are written.
    """

    station: int
    function: int
    address: int
    count: int
    device: Device | None
    values: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class FreeCall:
    """A free-protocol exchange that an RS2 instruction asks for.

    ``send`` or ``device`` None: those bytes have no registers. ``data``: what is sent without any.
    """

    send: Device | None
    send_count: int
    device: Device | None
    count: int
    data: bytes = b""


def value_of(operand: Operand, memory: Memory) -> int:
    """A constant, or what its D register holds: 0…65535."""
    return memory.get(operand) if isinstance(operand, Device) else operand & 0xFFFF


def port_of(operands: Rs2, memory: Memory) -> str | None:
    """The port that n1 names, None if it names none."""
    number = value_of(operands.n1, memory)
    return f"COM{number}" if FIRST_PORT <= number <= LAST_PORT else None


def modbus_call(operands: Rs2, memory: Memory) -> Call:
    """What the operands mean on a port that is a Modbus master."""
    head = memory.get(operands.s)
    n = operands.n if isinstance(operands.n, Device) else Device("D", operands.n & 0xFFFF)
    return Call(head >> 8, head & 0xFF, value_of(operands.m, memory), memory.get(operands.d), n)


def free_call(operands: Rs2, memory: Memory) -> FreeCall:
    """What the operands mean on a port with the free protocol."""
    return FreeCall(operands.s, value_of(operands.m, memory), operands.d, value_of(operands.n, memory))
