"""What is wrong or odd about devices of a PLC that a mapping gives values to."""

from collections.abc import Iterable, Iterator, Mapping

from bussim.forms.mistakes import Path, Reporter
from bussim.plc.link_devices import LINK_STATUS
from bussim.plc.memory import Device, Family, parse_device
from bussim.words.language import say

#: What the link writes beside its times, counts, codes and flags: mirrors of its settings.
_MIRRORS = tuple(Device("D", address) for address in range(8173, 8176))


def check_registers(
    path: Path, registers: Mapping[str, int], report: Reporter, *, link: bool, family: Family = Family.FX2N
) -> None:
    """Check devices and values; ``link``: of a PLC that can take part in N:N; ``family``: whose they are."""
    written = (*_MIRRORS, *LINK_STATUS[family].values()) if link else ()
    for name, device in named_devices(path, registers, report, family=family):
        value = registers[name]
        if not device.is_word and value not in (0, 1):
            report.error((*path, name), say("form_bit", value=value))
        if device in written:
            report.warn((*path, name), say("form_by_link"))


def named_devices(
    path: Path,
    names: Iterable[str],
    report: Reporter,
    *,
    family: Family = Family.FX2N,
    observed: bool = False,
) -> Iterator[tuple[str, Device]]:
    """The keys of the mapping at ``path`` with the devices that they name.

    Those that name none (``family``: whose they are; ``observed``: that can be observed) are reported,
    and those that name one that another names.
    """
    seen: dict[Device, str] = {}
    for name in names:
        try:
            device = parse_device(name, observed=observed, family=family)
        except ValueError as error:
            report.mistake((*path, name), say("form_device_of", path=path[-1], error=error.args[0]), key=True)
            continue
        if device in seen:
            report.error((*path, name), say("form_same_device", seen=seen[device]), key=True)
        seen[device] = name
        yield name, device
