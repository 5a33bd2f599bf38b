"""Address ranges: gaps, borders, items that must not be split, and writes that are all or nothing."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from bussim.devices.areas import Area, AreaMap, Part
from bussim.engines.modbus.codes import ExceptionCode
from bussim.engines.modbus.server import Space

HOLDING = Space.HOLDING
REFUSED = ExceptionCode.ILLEGAL_ADDRESS


class Plain(AreaMap):
    """Remembers what is written, by area name and offset."""

    def __init__(self, areas: list[Area]) -> None:
        super().__init__(areas)
        self.values = {area.name: [0] * area.count for area in areas}

    def _fetch(self, part: Part, now: int) -> Sequence[int]:
        del now
        return self.values[part.area.name][part.offset :][: part.size]

    def _refuse(self, part: Part, values: Sequence[int], now: int) -> ExceptionCode | None:
        del part, now
        return ExceptionCode.ILLEGAL_VALUE if 666 in values else None

    def _store(self, part: Part, values: Sequence[int], now: int) -> None:
        del now
        self.values[part.area.name][part.offset : part.offset + part.size] = values


def plain() -> Plain:
    return Plain(
        [
            Area(HOLDING, 10, 4, "low"),
            Area(HOLDING, 14, 2, "fixed", writable=False),
            Area(HOLDING, 20, 4, "long", width=2),
            Area(HOLDING, 24, 1, "last"),
            Area(Space.COILS, 0, 8, "coils"),
        ]
    )


@pytest.mark.parametrize(
    ("address", "count", "ok"),
    [
        (10, 1, True),
        (10, 6, True),  # across two areas
        (9, 1, False),
        (9, 2, False),
        (15, 2, False),  # into the gap
        (13, 8, False),  # across the gap
        (20, 2, True),
        (20, 5, True),
        (20, 1, False),
        (21, 2, False),
        (22, 3, True),
        (23, 2, False),
        (24, 2, False),
        (0, 1, False),  # there are coils, not registers
    ],
)
def test_reads(address: int, count: int, ok: bool) -> None:
    got = plain().read(HOLDING, address, count, 0)
    assert got == ([0] * count if ok else REFUSED)


def test_writes_are_all_or_nothing() -> None:
    device = plain()
    assert device.write(HOLDING, 12, (1, 2, 3), 0) is REFUSED  # into what cannot be written
    assert device.write(HOLDING, 22, (1, 2, 666), 0) is ExceptionCode.ILLEGAL_VALUE
    assert not any(any(values) for values in device.values.values())
    assert device.write(HOLDING, 22, (1, 2, 3), 0) is None
    assert device.values["long"] == [0, 0, 1, 2]
    assert device.values["last"] == [3]


@pytest.mark.parametrize(
    ("areas", "message"),
    [
        ([Area(HOLDING, 0, 4, "a"), Area(HOLDING, 3, 1, "b")], "b overlaps a at address 3"),
        ([Area(HOLDING, 65530, 7, "a")], "a: addresses 65530…65536, allowed 0…65535"),
        ([Area(HOLDING, 0, 0, "a")], "a: addresses 0…-1, allowed"),
        ([Area(HOLDING, 0, 3, "a", width=2)], "a: items of 2 do not fill 3"),
    ],
)
def test_maps_that_cannot_be(areas: list[Area], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Plain(areas)
