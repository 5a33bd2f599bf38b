"""How long Modbus requests and responses are, and what a request may say.

All functions of the application protocol (V1.1b3, section 6) that a serial line carries. Sizes are of
PDUs: an RTU frame has three characters more. A size is 0 where no such PDU begins so; it is negative where
so many characters (its amount) are needed before more can be said.
"""

from collections.abc import Callable
from typing import Final, NamedTuple

from bussim.engines.modbus.adu import BROADCAST
from bussim.engines.modbus.pdu import COIL_OFF, COIL_ON, EXCEPTION_BIT, EXCEPTION_SIZE, MAX_PDU

Pdu = bytes | bytearray

_DIAGNOSTICS, _QUEUE, _INTERFACE = 8, 24, 43
#: Sizes of requests that do not depend on what they carry (diagnostics: usually).
_REQUESTS: Final = {1: 5, 2: 5, 3: 5, 4: 5, 5: 5, 6: 5, 7: 1, 8: 5, 11: 1, 12: 1, 17: 1, 22: 7, 24: 3, 43: 4}
#: Where a request has its byte count, which ends it.
_REQUEST_COUNTS: Final = {15: 5, 16: 5, 20: 1, 21: 1, 23: 9}
KNOWN: Final = frozenset((*_REQUESTS, *_REQUEST_COUNTS))
_RESPONSES: Final = {7: 2, 11: 5, 15: 5, 16: 5}
#: Responses with a byte count behind the function.
_COUNTED: Final = frozenset((1, 2, 3, 4, 12, 17, 20, 23))
_BITS: Final = frozenset((1, 2, 15))
_WORDS: Final = frozenset((3, 4, 16, 23))
#: Functions whose response is the request again.
REPEATED: Final = frozenset((5, 6, 8, 21, 22))
#: Functions whose requests begin with an address, and those that a broadcast may carry.
_ADDRESSED: Final = frozenset((1, 2, 3, 4, 5, 6, 15, 16, 22, 23, 24))
_BROADCAST: Final = frozenset((5, 6, 8, 15, 16, 21, 22))
_LISTEN_ONLY: Final = b"\x08\x00\x04"
#: The type of function 43 that reads a device's identification.
_IDENTIFICATION: Final = 14


def _word(pdu: Pdu, at: int) -> int:
    return pdu[at] << 8 | pdu[at + 1]


_ALLOWED: Final[dict[int, Callable[[bytes], bool]]] = {
    **dict.fromkeys((1, 2), lambda pdu: 1 <= _word(pdu, 3) <= 2000),
    **dict.fromkeys((3, 4), lambda pdu: 1 <= _word(pdu, 3) <= 125),
    5: lambda pdu: _word(pdu, 3) in (COIL_OFF, COIL_ON),
    15: lambda pdu: 1 <= _word(pdu, 3) <= 1968 and pdu[5] == (_word(pdu, 3) + 7) // 8,
    16: lambda pdu: 1 <= _word(pdu, 3) <= 123 and pdu[5] == 2 * _word(pdu, 3),
    20: lambda pdu: 7 <= pdu[1] <= 245 and pdu[1] % 7 == 0,
    21: lambda pdu: 9 <= pdu[1] <= 251,
    23: lambda pdu: 1 <= _word(pdu, 3) <= 125 and 1 <= _word(pdu, 7) <= 121 and pdu[9] == 2 * _word(pdu, 7),
    43: lambda pdu: pdu[1] == _IDENTIFICATION,
}


class Asked(NamedTuple):
    """A request. ``address`` and ``quantity`` are 0 where its function has none."""

    station: int
    pdu: bytes
    address: int = 0
    quantity: int = 0

    @property
    def function(self) -> int:
        """The function code."""
        return self.pdu[0]

    @property
    def without_response(self) -> bool:
        """Whether no station may respond: a broadcast that writes, or the request to listen only."""
        return self.pdu[:3] == _LISTEN_ONLY or (self.station == BROADCAST and self.function in _BROADCAST)

    @property
    def name(self) -> str:
        """What a listener calls a request that recurs: ``1: 03 at 22 × 2``."""
        where = f" at {self.address} × {self.quantity}" if self.quantity else ""
        return f"{self.station}: {self.function:02X}{where}"


def request_size(data: Pdu, at: int) -> int:
    """The size of the request PDU that may begin at an index."""
    size = _REQUESTS.get(data[at])
    if size is not None:
        return size
    count_at = _REQUEST_COUNTS.get(data[at])
    if count_at is None:
        return 0
    if at + count_at >= len(data):
        return -(count_at + 1)
    size = count_at + 1 + data[at + count_at]
    return size if size <= MAX_PDU else 0


def asked_of(station: int, pdu: bytes) -> Asked | None:
    """The request that a PDU is; None if its length, byte count, quantity or value is not allowed."""
    function, size = pdu[0], len(pdu)
    expected = request_size(pdu, 0)
    if size != expected and not (function == _DIAGNOSTICS and size > 1 and size % 2):
        return None
    allowed = _ALLOWED.get(function)
    if allowed is not None and not allowed(pdu):
        return None
    if function not in _ADDRESSED:
        return Asked(station, pdu)
    return Asked(station, pdu, _word(pdu, 1), _word(pdu, 3) if function in _BITS | _WORDS else 1)


def response_size(data: Pdu, at: int, asked: Asked | None) -> int:
    """The size of the response PDU that may begin at an index.

    ``asked`` is the request that it has to fit; None: whatever its own byte count says.
    """
    function, have = data[at], len(data) - at
    if asked is not None:
        if function == asked.function | EXCEPTION_BIT:
            return EXCEPTION_SIZE
        if function != asked.function:
            return 0
        if function in REPEATED or function in _RESPONSES:
            return usual_size(asked)
    if function in _COUNTED:
        if have < 2:
            return -2
        count = data[at + 1]
        if asked is not None and asked.quantity:
            return 2 + count if 2 + count == usual_size(asked) else 0
        whole = 0 < count <= MAX_PDU - 2 and not (function in _WORDS and count % 2)
        return 2 + count if whole else 0
    if function == _QUEUE:
        if have < 3:
            return -3
        count = _word(data, at + 1)
        return 3 + count if 2 <= count <= 64 else 0  # their number and at most 31 registers
    return _identification_size(data, at) if function == _INTERFACE else 0


def usual_size(asked: Asked) -> int:
    """The size of the normal response to a request; 0 where its length is the station's."""
    function = asked.function
    if function in REPEATED:
        return len(asked.pdu)
    if function in _RESPONSES:
        return _RESPONSES[function]
    if function not in _COUNTED or not asked.quantity:
        return 0
    return 2 + ((asked.quantity + 7) // 8 if function in _BITS else 2 * asked.quantity)


def _identification_size(data: Pdu, at: int) -> int:
    """The size of the response with a device's identification: its objects have lengths of their own."""
    size, have = 7, len(data) - at
    if have < size:
        return -size
    for _ in range(data[at + 6]):
        if have < size + 2:
            return -(size + 2)
        size += 2 + data[at + size + 1]
        if size > MAX_PDU:
            return 0
    return size if data[at + 1] == _IDENTIFICATION else 0


def responds(pdu: bytes, asked: Asked) -> bool:
    """Whether a PDU is the normal response or an exception to a request."""
    if len(pdu) != response_size(pdu, 0, asked):
        return False
    if pdu[0] in REPEATED:
        return pdu == asked.pdu
    return pdu[0] not in (15, 16) or pdu[1:5] == asked.pdu[1:5]
