"""The device model ``v80``: a V80 or PPC controller, its items by reference number."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Annotated, Any

from pydantic import Field

from bussim.devices.areas import SECTIONS
from bussim.devices.contract import SlaveSettings
from bussim.devices.forms import Find, SlaveIn, Word
from bussim.devices.v80.map import V80, V80_ITEMS, V80_PORT
from bussim.engines.modbus.server import Space
from bussim.forms.fields import whole
from bussim.forms.mistakes import EntryView, Reporter
from bussim.forms.rtu_gaps import RtuGapsIn
from bussim.plc.ports.spec import PollSpec
from bussim.words.language import say

_Bits = dict[str, Annotated[int, whole(0, 1)]]
_Words = dict[str, Word]


@dataclass(frozen=True, slots=True)
class V80Settings(SlaveSettings):
    """``items`` are the values at power-on, by address space and address (from 0)."""

    port = V80_PORT

    items: dict[tuple[Space, int], int] = field(default_factory=dict)

    def register_map(self) -> V80:
        """The controller's items."""
        device = V80()
        for (space, address), value in self.items.items():
            device.set(space, address, value)
        return device


class V80GapsIn(RtuGapsIn):
    """Its silences."""

    base = V80_PORT.gaps


class V80In(SlaveIn):
    """An entry of this model."""

    example = """
{name: oven, model: v80, bus: feeder, station: 9, mode: ascii, delay: 3 ms, jitter: 2 ms,
  rtu_gaps: {end: 5, inner: 2, fast_character: 400 us},
  coils: {"00127": 1}, inputs: {"10002": 1}, input_registers: {"30001": 7}, registers: {"40108": 99}}
"""
    port = V80_PORT

    rtu_gaps: V80GapsIn | None = None
    coils: _Bits = Field({})
    inputs: _Bits = Field({})
    input_registers: _Words = Field({})
    registers: _Words = Field({})

    def _items(self) -> Iterator[tuple[str, str, int]]:
        """Section, key and value of every item."""
        return (
            (section, key, value) for section in SECTIONS for key, value in getattr(self, section).items()
        )

    def check(self, entry: EntryView, find: Find, report: Reporter) -> None:
        """Check the reference numbers."""
        super().check(entry, find, report)
        seen: dict[tuple[str, int], str] = {}
        for section, key, _ in self._items():
            path = (*entry.path, section, key)
            try:
                address = _address(section, key)
            except ValueError as error:
                report.error(path, error.args[0], key=True)
                continue
            first = seen.setdefault((section, address), key)
            if first != key:
                report.error(path, say("model_same_item", first=first), key=True)

    def settings(self, polls: tuple[PollSpec, ...], find: Find) -> V80Settings:
        """Its items by address."""
        return V80Settings(
            {
                (SECTIONS[section], _address(section, key)): value & 0xFFFF
                for section, key, value in self._items()
            }
        )

    def fill(self, written: dict[str, Any]) -> None:
        """Reference numbers of five digits."""
        super().fill(written)
        for section in SECTIONS:
            if section in written:
                written[section] = {
                    f"{_first(section) + _address(section, key):05}": value
                    for key, value in written[section].items()
                }


def _first(section: str) -> int:
    """The first reference number of a section: 1, 10001, 30001 or 40001."""
    return int(SECTIONS[section].value[0]) * 10_000 + 1


def _address(section: str, key: str) -> int:
    """The address of a reference number such as 40108 or 00127, or of a plain number such as 127.

    Raises ValueError with a message for the user.
    """
    low = _first(section)
    high, prefixed = low + V80_ITEMS - 1, low > 1
    if not (key.isascii() and key.isdecimal() and len(key) <= 5):
        raise ValueError(say("model_no_reference", allowed=_allowed(low)))
    number = int(key)
    if low <= number <= high:
        return number - low
    if 1 <= number <= V80_ITEMS and not (len(key) == 5 and prefixed):
        return number - 1
    owner = next((name for name in SECTIONS if _first(name) // 10_000 == number // 10_000), None)
    other = say("model_but_of", owner=owner) if owner not in (None, section) and len(key) == 5 else ""
    raise ValueError(say("model_no_reference_of", section=section, other=other, allowed=_allowed(low)))


def _allowed(low: int) -> str:
    key = "model_v80_prefixed" if low > 1 else "model_v80"
    return say(key, low=low, high=low + V80_ITEMS - 1, items=V80_ITEMS)
