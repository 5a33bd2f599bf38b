"""What outputs are once they are bound to a machine.

A :class:`Coil` takes its condition's value; a :class:`Level` is carried out in every scan in which its
condition is on, at a cost of ``extra`` nanoseconds; a :class:`Drive` takes the condition's value in
every scan.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from bussim.plc.program.machine import Machine
from bussim.plc.program.text.catalog import Instruction

Act = Callable[[], None]
Take = Callable[[int], None]


@dataclass(frozen=True, slots=True)
class Coil:
    """OUT of a bit."""

    bits: bytearray
    at: int


@dataclass(frozen=True, slots=True)
class Level:
    """An instruction that does nothing while its condition is off."""

    act: Act
    extra: int = 0


@dataclass(frozen=True, slots=True)
class Drive:
    """An instruction that must know its condition in every scan."""

    take: Take


Output = Coil | Level | Drive
#: Binds an instruction to a machine; of an applied one only what it does while it is on.
Bind = Callable[[Machine, Instruction], Act]
