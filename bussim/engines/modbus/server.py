"""What a slave does with a request: the checks of the standard, over any register map."""

from collections.abc import Sequence
from enum import StrEnum
from typing import Protocol

from bussim.engines.modbus.codes import ExceptionCode
from bussim.engines.modbus.pdu import (
    COIL_OFF,
    COIL_ON,
    READS,
    ExceptionResponse,
    Function,
    Limits,
    Request,
    Response,
)


class Space(StrEnum):
    """The four address spaces of Modbus, each 0…65535, by the name of their reference numbers."""

    COILS = "0xxxx"
    INPUTS = "1xxxx"
    INPUT_REGISTERS = "3xxxx"
    HOLDING = "4xxxx"

    @property
    def is_bit(self) -> bool:
        """Whether its items are bits."""
        return self in (Space.COILS, Space.INPUTS)


#: The space that a function reads or writes.
SPACES: dict[int, Space] = {
    Function.READ_COILS: Space.COILS,
    Function.READ_INPUTS: Space.INPUTS,
    Function.READ_HOLDING: Space.HOLDING,
    Function.READ_INPUT_REGISTERS: Space.INPUT_REGISTERS,
    Function.WRITE_COIL: Space.COILS,
    Function.WRITE_REGISTER: Space.HOLDING,
    Function.WRITE_COILS: Space.COILS,
    Function.WRITE_REGISTERS: Space.HOLDING,
}


class RegisterMap(Protocol):
    """A device as its Modbus port shows it. Times are ticks and never decrease.

    ``functions`` are the function codes that it serves, ``limits`` how many items one request may
    name. A refused write must leave everything as it was.
    """

    @property
    def functions(self) -> frozenset[int]:
        """The function codes that it serves."""

    @property
    def limits(self) -> Limits:
        """How many coils or registers one request may name."""

    def read(self, space: Space, address: int, count: int, now: int) -> Sequence[int] | ExceptionCode:
        """``count`` items (≥ 1) from an address on: 0/1 or 0…65535 each, or why not."""

    def write(self, space: Space, address: int, values: Sequence[int], now: int) -> ExceptionCode | None:
        """Write items (≥ 1) from an address on; returns why not, None when done."""


def serve(device: RegisterMap, request: Request, now: int) -> Response | ExceptionResponse:
    """Carry out a request on a device.

    Function, quantity and value, address, execution are checked in this order (Modbus application
    protocol, section 6, the flow of each function).
    """
    function, address, quantity, values = request
    refused = _refusal(device, request)
    if refused is None:
        if function in READS:
            read = device.read(SPACES[function], address, quantity, now)
            if not isinstance(read, ExceptionCode):
                return Response(function, address, quantity, tuple(read))
            refused = read
        else:
            written = (1 if values[0] == COIL_ON else 0,) if function == Function.WRITE_COIL else values
            refused = device.write(SPACES[function], address, written, now)
    if refused is not None:
        return ExceptionResponse(function, refused)
    return Response(function, address, quantity, values if function in _ECHOED else ())


_ECHOED = (Function.WRITE_COIL, Function.WRITE_REGISTER)


def _refusal(device: RegisterMap, request: Request) -> ExceptionCode | None:
    function, address, quantity, values = request
    if function not in device.functions:
        return ExceptionCode.ILLEGAL_FUNCTION
    if not 1 <= quantity <= device.limits.of(function):
        return ExceptionCode.ILLEGAL_VALUE
    if function == Function.WRITE_COIL and values[0] not in (COIL_ON, COIL_OFF):
        return ExceptionCode.ILLEGAL_VALUE
    if address + quantity > 0x10000:
        return ExceptionCode.ILLEGAL_ADDRESS
    return None
