"""Special devices that are not simulated, from the FX programming manual's (JY992D88101) table of them."""

from collections.abc import Iterator

from bussim.plc.link_devices import LINK_STATUS
from bussim.plc.memory import FIRST_SPECIAL, Device, Family, device_ranges
from bussim.plc.program.text.operand_checks import FIRST_FAST_COUNTER, Extent
from bussim.words.language import say

#: Bits that change instructions, or the whole PLC, and do not here, by M's address.
SPECIAL_BITS = frozenset((8028, 8031, 8032, 8034, 8035, 8036, 8037, 8039, 8160, 8161))
#: The special devices that do something here.
_ALIVE = device_ranges(
    "M8000-8004 M8011-8014 M8020-8022 M8024 M8033 M8038 M8061 M8063 M8067-8068 M8179 M8200-8234 "
    "M8438 D8000-8001 D8004 D8010-8019 D8061 D8063 D8067-8069 D8101 D8121 D8173-8180 D8438"
)
#: Those of RS.
_OF_RS = device_ranges("M8121-8124 M8129 M8161 D8120 D8122-8125 D8129")


def not_simulated(extent: Extent, *, with_rs: bool, family: Family) -> Iterator[str]:
    """What is to be said of special devices that are touched: of the first, and of bits that are written.

    So of counters that count in hardware. ``with_rs``: of a program with an RS.
    """
    if extent.letter == "C" and extent.first >= FIRST_FAST_COUNTER:
        yield say("program_fast_counter", number=extent.first)
    letter, known = extent.letter, (*_ALIVE, *(_OF_RS if with_rs else ()))
    for address in range(max(extent.first, FIRST_SPECIAL), extent.last + 1) if letter in "MD" else ():
        effect = say(f"special_{address}") if letter == "M" and address in SPECIAL_BITS else ""
        device = Device(letter, address)
        alive = any(each.holds(device) for each in known)
        own = LINK_STATUS[family].get(device)
        if own is not None and own.address != address == extent.first:
            yield say("program_own_place", device=device, family=family, own=own)
        if not alive and own is None and (address == extent.first or (effect and extent.writes)):
            of_rs = any(each.holds(device) for each in _OF_RS)
            why = say("program_for_rs") if of_rs else say("program_no_simulation")
            yield say("program_special", device=device, effect=effect, why=why)
