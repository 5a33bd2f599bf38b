"""A plain register map for the engines' tests."""

from __future__ import annotations

from collections.abc import Sequence

from bussim.engines.modbus.codes import ExceptionCode
from bussim.engines.modbus.pdu import FUNCTIONS, STANDARD_LIMITS, Limits
from bussim.engines.modbus.server import Space


class PlainMap:
    """``size`` items in every space, 0 at first; everything can be written."""

    def __init__(
        self, size: int = 200, functions: frozenset[int] = FUNCTIONS, limits: Limits = STANDARD_LIMITS
    ) -> None:
        self.functions = functions
        self.limits = limits
        self.items = {space: [0] * size for space in Space}
        self.calls: list[tuple[str, Space, int, int]] = []

    def read(self, space: Space, address: int, count: int, now: int) -> Sequence[int] | ExceptionCode:
        self.calls.append(("read", space, address, now))
        items = self.items[space]
        return ExceptionCode.ILLEGAL_ADDRESS if address + count > len(items) else items[address:][:count]

    def write(self, space: Space, address: int, values: Sequence[int], now: int) -> ExceptionCode | None:
        self.calls.append(("write", space, address, now))
        items = self.items[space]
        if address + len(values) > len(items):
            return ExceptionCode.ILLEGAL_ADDRESS
        items[address : address + len(values)] = values
        return None
