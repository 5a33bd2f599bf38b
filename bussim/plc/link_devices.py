"""Where each family keeps the special devices of the N:N link.

The common names are D8201–D8218 and M8183–M8191 (PW10, section 7.5). An FX1S has D201–D218, M504 for the
master's error, M505–M511 for the slaves', and M503 for the running link (FX communication manual).
"""

from typing import NamedTuple

from bussim.plc.memory import Device, Family

#: Words of the link: two times, then a count and a code of each of eight stations.
_WORDS, _FLAGS = 18, 8


class LinkDevices(NamedTuple):
    """The addresses of a family's D8201 and M8183, in which order others follow, and of its M8191."""

    first_word: int
    first_flag: int
    running: int


_COMMON = LinkDevices(8201, 8183, 8191)
LINK_DEVICES = {Family.FX1S: LinkDevices(201, 504, 503), Family.FX2N: _COMMON, Family.FX3U: _COMMON}


def _by_common(own: LinkDevices) -> dict[Device, Device]:
    words = {Device("D", _COMMON.first_word + at): Device("D", own.first_word + at) for at in range(_WORDS)}
    flags = {Device("M", _COMMON.first_flag + at): Device("M", own.first_flag + at) for at in range(_FLAGS)}
    return {**words, **flags, Device("M", _COMMON.running): Device("M", own.running)}


#: Each family's devices by their common names.
LINK_STATUS = {family: _by_common(own) for family, own in LINK_DEVICES.items()}
