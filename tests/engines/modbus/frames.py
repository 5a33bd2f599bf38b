"""Frames that the manuals of three devices print, and what they mean."""

from __future__ import annotations

from typing import NamedTuple

from bussim.engines.modbus.pdu import (
    Request,
    Response,
    write_coil,
    write_coils,
    write_register,
    write_registers,
)


class Exchange(NamedTuple):
    """A request and its response, as characters and as meanings."""

    what: str
    station: int
    request_chars: bytes
    request: Request
    response_chars: bytes
    response: Response


def _exchange(
    what: str,
    station: int,
    request_chars: str,
    request: Request,
    response_chars: str,
    values: tuple[int, ...],
) -> Exchange:
    response = Response(request.function, request.address, request.quantity, values)
    return Exchange(
        what, station, bytes.fromhex(request_chars), request, bytes.fromhex(response_chars), response
    )


# CD 6B B2 0E 1B: coils 20 to 56, the lowest one in bit 0.
_COILS_20_56 = tuple(int(bit) for bit in "10110011_11010110_01001101_01110000_11011".replace("_", ""))

EXCHANGES = [
    _exchange(
        "stepper: read 40001, 40002",
        1,
        "01 03 00 00 00 02 C4 0B",
        Request(3, 0, 2),
        "01 03 04 00 B4 00 08 BB D3",
        (180, 8),
    ),
    _exchange(
        "stepper: coil 00008 on",
        1,
        "01 05 00 07 FF 00 3D FB",
        write_coil(7, on=True),
        "01 05 00 07 FF 00 3D FB",
        (0xFF00,),
    ),
    _exchange(
        "stepper: 40002 = 4",
        1,
        "01 06 00 01 00 04 D9 C9",
        write_register(1, 4),
        "01 06 00 01 00 04 D9 C9",
        (4,),
    ),
    _exchange(
        "stepper: distance = 200",
        1,
        "01 10 00 09 00 02 04 00 C8 00 00 B2 3B",
        write_registers(9, (200, 0)),
        "01 10 00 09 00 02 91 CA",
        (),
    ),
    _exchange(
        "V80: read 40108 to 40110",
        6,
        "06 03 00 6B 00 03 75 A0",
        Request(3, 107, 3),
        "06 03 06 00 63 00 63 00 63 73 7A",
        (0x63, 0x63, 0x63),
    ),
    _exchange(
        "V80: read coils 00020 to 00056",
        17,
        "11 01 00 13 00 25 0E 84",
        Request(1, 19, 37),
        "11 01 05 CD 6B B2 0E 1B 45 E6",
        _COILS_20_56,
    ),
    _exchange(
        "V80: read 40108 to 40110 of 17",
        17,
        "11 03 00 6B 00 03 76 87",
        Request(3, 107, 3),
        "11 03 06 02 2B 00 00 00 64 C8 BA",
        (555, 0, 100),
    ),
    _exchange(
        "V80: coil 00173 on",
        17,
        "11 05 00 AC FF 00 4E 8B",
        write_coil(172, on=True),
        "11 05 00 AC FF 00 4E 8B",
        (0xFF00,),
    ),
    _exchange(
        "V80: 40136 = 0x039E",
        17,
        "11 06 00 87 03 9E BA 2B",
        write_register(135, 0x039E),
        "11 06 00 87 03 9E BA 2B",
        (0x039E,),
    ),
    _exchange(
        "V80: coils 00020 to 00029",
        17,
        "11 0F 00 13 00 0A 02 CD 00 7E CB",
        write_coils(19, (1, 0, 1, 1, 0, 0, 1, 1, 0, 0)),
        "11 0F 00 13 00 0A 26 99",
        (),
    ),
    _exchange(
        "V80: 40136, 40137",
        17,
        "11 10 00 87 00 02 04 00 0A 01 02 4E BA",
        write_registers(135, (0x000A, 0x0102)),
        "11 10 00 87 00 02 F3 71",
        (),
    ),
]
EXCHANGE_IDS = [exchange.what for exchange in EXCHANGES]

#: The RS2 examples of the PW10 manual: H0103, 0064, 4 words; and its section 6.2.2 program.
RS2_REQUESTS = [
    (1, Request(3, 0x64, 4), bytes.fromhex("01 03 00 64 00 04 05 D6")),
    (1, Request(3, 0x04, 10), bytes.fromhex("01 03 00 04 00 0A 84 0C")),
]

#: The V80 manual's first example in ASCII.
ASCII_REQUEST = b":0603006B000389\r\n"
ASCII_RESPONSE = b":060306006300630063C8\r\n"
