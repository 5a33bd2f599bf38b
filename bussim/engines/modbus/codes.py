"""Modbus exception codes, and the error codes that a PLC's port keeps in D8063."""

from enum import IntEnum, StrEnum
from typing import Final


class ExceptionCode(IntEnum):
    """Exception codes that a slave responds with (Modbus application protocol, section 7)."""

    ILLEGAL_FUNCTION = 1
    ILLEGAL_ADDRESS = 2
    ILLEGAL_VALUE = 3
    DEVICE_FAILURE = 4


class PortError(IntEnum):
    """The yy of D8063 = 7xyy (PW10 board manual, section 8). One event defines each."""

    STATION = 0  # own station number outside 1–247
    LENGTH = 1  # response shorter or longer than its function says
    ADDRESS = 2  # exception 02, or an address beyond the map
    CHECK = 3  # CRC or LRC wrong
    FUNCTION = 4  # exception 01, or a function that RS2 cannot send
    RECEPTION = 5  # parity error or overrun in a response
    DATA = 6  # exception 03, or a value that the PLC cannot take
    OVERFLOW = 7  # more than 256 bytes received
    FRAMING = 8  # a stop bit was missing
    TIMEOUT = 9  # no response within the timeout


#: What a slave's port raises as well, of damaged and of refused requests; see the profile's ``slave_errors``.
SLAVE_ERRORS: Final = frozenset(
    {PortError.LENGTH, PortError.ADDRESS, PortError.CHECK, PortError.FUNCTION, PortError.OVERFLOW}
)

#: The meaning of each code, in words.
MEANINGS: Final[dict[int, str]] = {
    PortError.STATION: "slave address setting",
    PortError.LENGTH: "frame length",
    PortError.ADDRESS: "address",
    PortError.CHECK: "CRC or LRC",
    PortError.FUNCTION: "unsupported function",
    PortError.RECEPTION: "reception",
    PortError.DATA: "data",
    PortError.OVERFLOW: "buffer overflow",
    PortError.FRAMING: "framing",
    PortError.TIMEOUT: "no response in time",
}

#: The port error that a master derives from an exception response. Codes above 03 are not in the manual's
#: table: a data error (assumed).
EXCEPTION_ERRORS: Final[dict[int, PortError]] = {
    ExceptionCode.ILLEGAL_FUNCTION: PortError.FUNCTION,
    ExceptionCode.ILLEGAL_ADDRESS: PortError.ADDRESS,
    ExceptionCode.ILLEGAL_VALUE: PortError.DATA,
}


def exception_error(code: int) -> PortError:
    """The port error that an exception response (1–255) raises at the master."""
    return EXCEPTION_ERRORS.get(code, PortError.DATA)


class Rejection(StrEnum):
    """Why characters are not accepted as a frame, or a frame not as a request."""

    CHECK = "CRC or LRC wrong"
    LENGTH = "length impossible"
    GAP = "silence inside"
    PARITY = "parity error"
    FRAMING = "framing error"
    OVERFLOW = "too long"
    NOT_HEX = "not hexadecimal"
    UNFINISHED = "unfinished"
    MALFORMED = "not a request"
    BROADCAST_READ = "broadcast read"
    BUSY = "busy with another request"


#: The port error that each damage of a response is (a silence inside and an unfinished frame count
#: as its length, a character that is not hexadecimal as its check: assumed).
REJECTION_ERRORS: Final[dict[Rejection, PortError]] = {
    Rejection.CHECK: PortError.CHECK,
    Rejection.LENGTH: PortError.LENGTH,
    Rejection.GAP: PortError.LENGTH,
    Rejection.PARITY: PortError.RECEPTION,
    Rejection.FRAMING: PortError.FRAMING,
    Rejection.OVERFLOW: PortError.OVERFLOW,
    Rejection.NOT_HEX: PortError.CHECK,
    Rejection.UNFINISHED: PortError.LENGTH,
}
