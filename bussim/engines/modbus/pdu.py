"""Modbus PDUs of the functions 01 02 03 04 05 06 0F 10, both directions, for client and server.

A PDU is what RTU and ASCII frames carry between the station number and the check: a function code
and its data, at most 253 bytes. What cannot be decoded is a value (:class:`Malformed`).
"""

from collections.abc import Iterable, Sequence
from enum import IntEnum, StrEnum
from functools import lru_cache
from struct import pack, unpack_from
from typing import Final, NamedTuple

from bussim.engines.modbus.codes import ExceptionCode

#: Longest PDU (Modbus over serial line, section 2.5.1: 256 bytes less station and CRC).
MAX_PDU: Final = 253
#: Set in the function code of an exception response.
EXCEPTION_BIT: Final = 0x80

#: Function 05's data for ON and OFF; no other word is legal.
COIL_ON: Final = 0xFF00
COIL_OFF: Final = 0x0000


class Function(IntEnum):
    """The functions that are known here."""

    READ_COILS = 0x01
    READ_INPUTS = 0x02
    READ_HOLDING = 0x03
    READ_INPUT_REGISTERS = 0x04
    WRITE_COIL = 0x05
    WRITE_REGISTER = 0x06
    WRITE_COILS = 0x0F
    WRITE_REGISTERS = 0x10


_READ_BITS: Final = frozenset((0x01, 0x02))
_READ_WORDS: Final = frozenset((0x03, 0x04))
#: Their good response is the request once more (Application Protocol V1.1b3, 6.5 and 6.6).
WRITE_ONE: Final = frozenset((0x05, 0x06))
_WRITE_MANY: Final = frozenset((0x0F, 0x10))
FUNCTIONS: Final = frozenset(int(function) for function in Function)
READS: Final = _READ_BITS | _READ_WORDS
#: The functions that may be broadcast.
WRITES: Final = WRITE_ONE | _WRITE_MANY


class Limits(NamedTuple):
    """How many coils or registers one request may name (Modbus application protocol, section 6)."""

    read_coils: int = 2000
    read_inputs: int = 2000
    read_holding: int = 125
    read_input_registers: int = 125
    write_coils: int = 1968
    write_registers: int = 123

    def of(self, function: int) -> int:
        """The most that a request of a function (one of :data:`FUNCTIONS`) may name."""
        index = _LIMIT_INDEX[function]
        return 1 if index is None else self[index]


_LIMIT_INDEX: Final[dict[int, int | None]] = {1: 0, 2: 1, 3: 2, 4: 3, 5: None, 6: None, 15: 4, 16: 5}

STANDARD_LIMITS: Final = Limits()


class Request(NamedTuple):
    """One request. ``address`` counts from 0 and names the first coil or register.

    ``values`` are empty for reads, else one entry a coil (0/1) or register (0…65535); for function
    05 the one word that its frame carries, which only :data:`COIL_ON` and :data:`COIL_OFF` make legal.
    """

    function: int
    address: int
    quantity: int = 1
    values: tuple[int, ...] = ()


class Response(NamedTuple):
    """One normal response.

    Of a read: ``values``, one entry a coil (0/1) or register; ``address`` and ``quantity`` are the
    request's, which the frame does not carry. Of a write: what it echoes, for 05 and 06 with the
    word in ``values``.
    """

    function: int
    address: int
    quantity: int
    values: tuple[int, ...] = ()


class ExceptionResponse(NamedTuple):
    """A refusal: the request's function (without the exception bit) and the exception code."""

    function: int
    code: int


class Flaw(StrEnum):
    """Why bytes are not a PDU of the direction in which they were received."""

    EMPTY = "empty"
    FUNCTION = "unknown function"
    REPLY = "an exception response where a request is expected"
    LENGTH = "shorter or longer than its function says"
    COUNT = "byte count, quantity and length disagree"


#: What a server replies to each flaw; 0: nothing, the frame is ignored.
FLAW_EXCEPTIONS: Final[dict[Flaw, int]] = {
    Flaw.EMPTY: 0,
    Flaw.FUNCTION: ExceptionCode.ILLEGAL_FUNCTION,
    Flaw.REPLY: 0,
    Flaw.LENGTH: 0,
    Flaw.COUNT: ExceptionCode.ILLEGAL_VALUE,
}


class Malformed(NamedTuple):
    """Bytes that are no PDU. ``function`` is their first byte, 0 if there is none."""

    function: int
    flaw: Flaw
    pdu: bytes


# -- making requests ---------------------------------------------------------------------------------


def write_coil(address: int, *, on: bool) -> Request:
    """A request of function 05."""
    return Request(Function.WRITE_COIL, address, 1, (COIL_ON if on else COIL_OFF,))


def write_register(address: int, value: int) -> Request:
    """A request of function 06."""
    return Request(Function.WRITE_REGISTER, address, 1, (value,))


def write_coils(address: int, values: Iterable[int]) -> Request:
    """A request of function 0F; any value but 0 is ON."""
    bits = tuple(1 if value else 0 for value in values)
    return Request(Function.WRITE_COILS, address, len(bits), bits)


def write_registers(address: int, values: Iterable[int]) -> Request:
    """A request of function 10."""
    words = tuple(values)
    return Request(Function.WRITE_REGISTERS, address, len(words), words)


# -- packing -----------------------------------------------------------------------------------------


def pack_bits(bits: Sequence[int]) -> bytes:
    """Coils as bytes, the lowest one in bit 0 of the first, the last byte filled up with zeros."""
    packed = 0
    for number, bit in enumerate(bits):
        if bit:
            packed |= 1 << number
    return packed.to_bytes((len(bits) + 7) // 8, "little")


def unpack_bits(data: bytes, quantity: int) -> tuple[int, ...]:
    """The first ``quantity`` coils of packed bytes."""
    packed = int.from_bytes(data, "little")
    return tuple(packed >> number & 1 for number in range(quantity))


def pack_words(words: Iterable[int]) -> bytes:
    """Registers as bytes, high byte first."""
    words = tuple(words)
    return pack(f">{len(words)}H", *words)


def unpack_words(data: bytes) -> tuple[int, ...]:
    """The registers of bytes, high byte first."""
    count = len(data) // 2
    return unpack_from(f">{count}H", data)


def _word(pdu: bytes, at: int) -> int:
    return pdu[at] << 8 | pdu[at + 1]


def _data(function: int, values: Sequence[int]) -> bytes:
    return pack_bits(values) if function in (0x01, 0x02, 0x0F) else pack_words(values)


def _counted(head: bytes, data: bytes) -> bytes:
    if len(head) + 1 + len(data) > MAX_PDU:
        raise ValueError(f"a PDU of {len(head) + 1 + len(data)} bytes, at most {MAX_PDU} are allowed")
    return head + bytes((len(data),)) + data


# -- requests: the client encodes, the server decodes ----------------------------------------------


@lru_cache(maxsize=1024)
def encode_request(request: Request) -> bytes:
    """The PDU of a request.

    Raises ValueError for a function that is not known here, numbers that have no 16 bits, a count of
    values other than ``quantity``, or a PDU over 253 bytes. A quantity beyond a device's limits is
    encoded: whether it is refused is the device's business.
    """
    function, address, quantity, values = request
    _check_words(address, quantity)
    if function in READS:
        return b"%c%b" % (function, pack_words((address, quantity)))
    if len(values) != quantity:
        raise ValueError(f"a quantity of {quantity} has so many values: {len(values)}")
    _check_words(*values)
    if function in WRITE_ONE:
        return b"%c%b" % (function, pack_words((address, *values)))
    if function in _WRITE_MANY:
        return _counted(b"%c%b" % (function, pack_words((address, quantity))), _data(function, values))
    raise ValueError(f"function {function} is not one of {', '.join(f'{f:02X}' for f in sorted(FUNCTIONS))}")


def _check_words(*words: int) -> None:
    if words and not (min(words) >= 0 and max(words) <= 0xFFFF):
        bad = next(word for word in words if not 0 <= word <= 0xFFFF)
        raise ValueError(f"{bad} does not fit into 16 bits, allowed 0…65535")


@lru_cache(maxsize=1024)
def decode_request(pdu: bytes) -> Request | Malformed:
    """The request that a PDU is. Quantities are not checked here."""
    if not pdu:
        return Malformed(0, Flaw.EMPTY, pdu)
    function, size = pdu[0], len(pdu)
    if function in READS or function in WRITE_ONE:
        if size != 5:
            return Malformed(function, Flaw.LENGTH, pdu)
        address, second = _word(pdu, 1), _word(pdu, 3)
        if function in READS:
            return Request(function, address, second)
        return Request(function, address, 1, (second,))
    if function not in _WRITE_MANY:
        return Malformed(function, Flaw.REPLY if function & EXCEPTION_BIT else Flaw.FUNCTION, pdu)
    if size < 6:
        return Malformed(function, Flaw.LENGTH, pdu)
    address, quantity, data = _word(pdu, 1), _word(pdu, 3), pdu[6:]
    bits = function == Function.WRITE_COILS
    if not len(data) == pdu[5] == ((quantity + 7) // 8 if bits else 2 * quantity):
        return Malformed(function, Flaw.COUNT, pdu)
    return Request(function, address, quantity, unpack_bits(data, quantity) if bits else unpack_words(data))


# -- responses: the server encodes, the client decodes ---------------------------------------------


@lru_cache(maxsize=1024)
def encode_response(response: Response) -> bytes:
    """The PDU of a normal response. Raises ValueError as :func:`encode_request` does."""
    function, address, quantity, values = response
    if function in READS:
        _check_words(*values)
        return _counted(bytes((function,)), _data(function, values))
    second = values[0] if function in WRITE_ONE else quantity
    _check_words(address, second)
    if function not in WRITES:
        raise ValueError(f"function {function} has no response here")
    return b"%c%b" % (function, pack_words((address, second)))


def encode_exception(function: int, code: int) -> bytes:
    """The PDU of a refusal: the function with its highest bit set, and the exception code."""
    return bytes((function | EXCEPTION_BIT, code))


@lru_cache(maxsize=1024)
def response_size(request: Request) -> int:
    """Bytes of the PDU of a normal response."""
    if request.function in _READ_BITS:
        return 2 + (request.quantity + 7) // 8
    if request.function in _READ_WORDS:
        return 2 + 2 * request.quantity
    return 5


#: Bytes of the PDU that refuses any request.
EXCEPTION_SIZE: Final = 2


@lru_cache(maxsize=1024)
def decode_response(pdu: bytes, request: Request | None = None) -> Response | ExceptionResponse | Malformed:
    """The response that a PDU is.

    ``request`` says how many coils a read asked for and from where; without it all bits of the last
    byte are taken for coils. That the response fits the request is not checked here, except that a
    read of the same function must carry as many bytes as it asked for (else a Flaw.LENGTH).
    """
    if not pdu:
        return Malformed(0, Flaw.EMPTY, pdu)
    function, size = pdu[0], len(pdu)
    if function & EXCEPTION_BIT:
        if size != EXCEPTION_SIZE:
            return Malformed(function, Flaw.LENGTH, pdu)
        return ExceptionResponse(function & ~EXCEPTION_BIT, pdu[1])
    if function in READS:
        return _decode_read(pdu, request)
    if function not in WRITES:
        return Malformed(function, Flaw.FUNCTION, pdu)
    if size != 5:
        return Malformed(function, Flaw.LENGTH, pdu)
    address, second = _word(pdu, 1), _word(pdu, 3)
    if function in WRITE_ONE:
        return Response(function, address, 1, (second,))
    return Response(function, address, second)


def _decode_read(pdu: bytes, request: Request | None) -> Response | Malformed:
    function, data = pdu[0], pdu[2:]
    if len(pdu) < 2 or pdu[1] != len(data):
        return Malformed(function, Flaw.LENGTH, pdu)
    bits = function in _READ_BITS
    if not bits and len(data) % 2:
        return Malformed(function, Flaw.COUNT, pdu)
    if request is not None and request.function == function:
        if len(pdu) != response_size(request):
            return Malformed(function, Flaw.LENGTH, pdu)
        address, quantity = request.address, request.quantity
    else:
        address, quantity = 0, 8 * len(data) if bits else len(data) // 2
    return Response(function, address, quantity, unpack_bits(data, quantity) if bits else unpack_words(data))
