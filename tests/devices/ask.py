"""Ask a device as a slave would."""

from __future__ import annotations

from bussim.devices.serial_settings import DevicePort
from bussim.engines.modbus.adu import Mode
from bussim.engines.modbus.pdu import (
    ExceptionResponse,
    Request,
    Response,
    write_coil,
    write_register,
    write_registers,
)
from bussim.engines.modbus.server import RegisterMap, serve
from bussim.engines.modbus.slave import SlaveConfig
from bussim.line.characters import LineTiming


def ask(device: RegisterMap, request: Request, now: int = 0) -> tuple[int, ...] | int:
    """The values of a good response, or the exception code."""
    response = serve(device, request, now)
    return response.code if isinstance(response, ExceptionResponse) else response.values


def registers(device: RegisterMap, address: int, count: int = 1, now: int = 0) -> tuple[int, ...] | int:
    return ask(device, Request(3, address, count), now)


def put(device: RegisterMap, address: int, *values: int, now: int = 0) -> int:
    """Write registers (one: function 06, more: 10); 0 when done, else the exception code."""
    request = write_register(address, values[0]) if len(values) == 1 else write_registers(address, values)
    return code(device, request, now)


def coil(device: RegisterMap, address: int, *, on: bool = True, now: int = 0) -> int:
    return code(device, write_coil(address, on=on), now)


def code(device: RegisterMap, request: Request, now: int = 0) -> int:
    """The exception code of a request, 0 without one."""
    response = serve(device, request, now)
    return 0 if isinstance(response, Response) else response.code


def slave_config(port: DevicePort, mode: Mode, line: LineTiming) -> SlaveConfig:
    """A model's slave engine, which responds by itself."""
    return SlaveConfig(port.framing(mode, line), port.delay)
