"""Writes pcapng files (draft-ietf-opsawg-pcapng): sections, interfaces, names and packets.

Own, because it is four kinds of blocks, and the libraries that write them are not kept up
(python-pcapng) or bring a whole network stack with them (scapy).
"""

import struct
from collections.abc import Iterable, Mapping
from ipaddress import IPv4Address
from typing import BinaryIO

_SECTION, _INTERFACE, _NAMES, _PACKET = 0x0A0D0D0A, 1, 4, 6
_BYTE_ORDER = 0x1A2B3C4D
_END_OF_OPTIONS = 0
_COMMENT = 1
_SECTION_APPLICATION = 4
_IF_NAME, _IF_DESCRIPTION, _IF_SPEED, _IF_RESOLUTION = 2, 3, 8, 9
_PACKET_FLAGS = 2
#: Bit of a packet's flags: some symbol (here: a character) was received wrongly.
SYMBOL_ERROR = 1 << 31
_NANOSECONDS = 9  # decimals of a second
_NAME_IPV4, _NAME_END = 1, 0
_LONGEST_OPTION = 65_535

Option = tuple[int, bytes]


class PcapngWriter:
    """One section of a file that is open. Texts are stored as UTF-8, cut to 65,535 bytes."""

    def __init__(self, file: BinaryIO, application: str, comment: str) -> None:
        self._file = file
        self._interfaces = 0
        head = struct.pack("<IHHq", _BYTE_ORDER, 1, 0, -1)  # version 1.0, length not known beforehand
        options = [(_COMMENT, _text(comment)), (_SECTION_APPLICATION, _text(application))]
        self._block(_SECTION, head + _options(options))

    def interface(self, link_type: int, name: str, description: str, speed: int) -> int:
        """Add an interface with nanosecond time stamps; ``speed`` in bits per second. Returns its number."""
        options: list[Option] = [
            (_IF_NAME, _text(name)),
            (_IF_DESCRIPTION, _text(description)),
            (_IF_SPEED, struct.pack("<Q", speed)),
            (_IF_RESOLUTION, bytes((_NANOSECONDS,))),
        ]
        self._block(_INTERFACE, struct.pack("<HHI", link_type, 0, 0) + _options(options))
        self._interfaces += 1
        return self._interfaces - 1

    def names(self, names: Mapping[IPv4Address, str]) -> None:
        """The names of addresses, which Wireshark shows in their place if it is set to."""
        records = b"".join(
            _record(_NAME_IPV4, address.packed + _text(name).replace(b"\0", b"")[:255] + b"\0")
            for address, name in names.items()
        )
        if records:
            self._block(_NAMES, records + _record(_NAME_END, b""))

    def packet(self, interface: int, ns: int, data: bytes, comment: str = "", flags: int = 0) -> None:
        """Add a packet of an interface at a time in nanoseconds."""
        options: list[Option] = []
        if comment:
            options.append((_COMMENT, _text(comment)))
        if flags:
            options.append((_PACKET_FLAGS, struct.pack("<I", flags)))
        head = struct.pack("<IIIII", interface, ns >> 32, ns & 0xFFFFFFFF, len(data), len(data))
        self._block(_PACKET, head + _padded(data) + (_options(options) if options else b""))

    def _block(self, kind: int, body: bytes) -> None:
        size = struct.pack("<I", len(body) + 12)
        self._file.write(struct.pack("<I", kind) + size + body + size)


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 4)


def _record(code: int, value: bytes) -> bytes:
    return struct.pack("<HH", code, len(value)) + _padded(value)


def _options(options: Iterable[Option]) -> bytes:
    return b"".join(_record(code, value) for code, value in (*options, (_END_OF_OPTIONS, b"")))


def _text(text: str) -> bytes:
    data = text.encode("utf-8", "replace")
    # A cut inside a character would not be UTF-8 any more.
    return data if len(data) <= _LONGEST_OPTION else data[:_LONGEST_OPTION].decode("utf-8", "ignore").encode()
