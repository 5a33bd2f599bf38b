"""pcapng files with the frames of a serial line.

Each packet is the characters of one frame or chunk: link types DLT_USER0 to DLT_USER3 (147 Modbus RTU,
148 N:N, 149 Modbus ASCII, 150 free, as this program's own export writes them; bit 7 of a character of
148 and 149 marks one whose parity or stop bit was wrong), or RTAC serial, 250, whose header is
skipped. Block layout: draft-ietf-opsawg-pcapng, sections 3 and 4. Written here because what is needed
are three kinds of blocks, and a reader that is bounded whatever the file holds.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import BinaryIO, NamedTuple

from bussim.live.recordings.errors import RecordingError
from bussim.units import TICKS_PER_SECOND

_SECTION = 0x0A0D0D0A
_INTERFACE, _SIMPLE, _ENHANCED = 1, 3, 6
_MAGIC = 0x1A2B3C4D
_OPTION_NAME, _OPTION_SPEED, _OPTION_RESOLUTION, _OPTION_OFFSET = 2, 8, 9, 14
#: Link types: user 0 to 3, and RTAC serial with the bytes of its header.
_USER, RTAC = range(147, 151), 250
_RTAC_HEADER = 12
#: Link types whose characters have seven bits and a mark.
_MARKED = (148, 149)
_FASTEST = 100_000_000
#: A larger block is none of a serial line's.
_LARGEST = 16 * 1024 * 1024
_MOST_INTERFACES = 1000


class Interface(NamedTuple):
    """What the file says of one line."""

    link_type: int
    name: str
    per_second: int  # units of its timestamps
    offset: int  # seconds to add to them
    speed: int = 0  # bits per second, 0: not said

    @property
    def marked(self) -> bool:
        """Whether bit 7 of a character marks one that was received wrongly."""
        return self.link_type in _MARKED


class Packet(NamedTuple):
    """The characters of one packet. ``tick`` is its timestamp, None where it has none."""

    interface: int
    tick: int | None
    data: bytes


class PcapngReader:
    """Reads a file block by block; raises RecordingError with ``name`` and the byte."""

    def __init__(self, file: BinaryIO, name: str) -> None:
        self._file = file
        self._name = name
        self._order = "<"
        self._offset = 0
        #: The interfaces of the section that is read.
        self.interfaces: list[Interface] = []

    def packets(self) -> Iterator[Packet]:
        """The packets of serial lines, in the file's order; others are left out."""
        first = True
        while True:
            block = self._block(first=first)
            if block is None:
                if first:
                    raise self._error("the file is empty")
                return
            first = False
            kind, body = block
            if kind == _SECTION:
                self.interfaces = []
            elif kind == _INTERFACE:
                self._add_interface(body)
            elif kind in (_ENHANCED, _SIMPLE):
                packet = self._packet(kind, body)
                if packet is not None:
                    yield packet

    def _error(self, what: str) -> RecordingError:
        return RecordingError(f"{self._name}: at byte {self._offset}: {what}")

    def _block(self, *, first: bool) -> tuple[int, bytes] | None:
        head = self._file.read(8)
        if not head:
            return None
        if len(head) < 8:
            raise self._error("the file ends inside a block")
        kind, size = struct.unpack(self._order + "II", head)
        if kind == _SECTION or first:
            if kind != _SECTION:
                raise self._error("not a pcapng file")
            magic = self._file.read(4)
            if len(magic) < 4:
                raise self._error("the file ends inside a block")
            self._order = "<" if struct.unpack("<I", magic)[0] == _MAGIC else ">"
            if struct.unpack(self._order + "I", magic)[0] != _MAGIC:
                raise self._error("the section has no byte-order mark")
            size = struct.unpack(self._order + "I", head[4:])[0]
            head += magic
        if size % 4 or not len(head) + 4 <= size <= _LARGEST:
            raise self._error(f"a block of {size} bytes")
        rest = self._file.read(size - len(head))
        if len(rest) < size - len(head):
            raise self._error("the file ends inside a block")
        if struct.unpack(self._order + "I", rest[-4:])[0] != size:
            raise self._error("a block whose two lengths differ")
        self._offset += size
        return kind, head[8:] + rest[:-4]

    def _add_interface(self, body: bytes) -> None:
        if len(body) < 8:
            raise self._error("an interface block that is too short")
        if len(self.interfaces) >= _MOST_INTERFACES:
            raise self._error(f"more than {_MOST_INTERFACES} interfaces")
        link_type = struct.unpack(self._order + "H", body[:2])[0]
        name, per_second, offset, speed = "", 1_000_000, 0, 0
        for code, value in self._options(body[8:]):
            if code == _OPTION_NAME:
                name = value.decode("utf-8", "replace")
            elif code == _OPTION_RESOLUTION and value:
                exponent = value[0] & 0x7F
                if exponent > (63 if value[0] & 0x80 else 18):
                    raise self._error("a resolution of timestamps beyond every clock")
                per_second = (2 if value[0] & 0x80 else 10) ** exponent
            elif code == _OPTION_OFFSET and len(value) == 8:
                offset = struct.unpack(self._order + "q", value)[0]
            elif code == _OPTION_SPEED and len(value) == 8:
                speed = min(struct.unpack(self._order + "Q", value)[0], _FASTEST)
        self.interfaces.append(Interface(link_type, name, per_second, offset, speed))

    def _options(self, data: bytes) -> Iterator[tuple[int, bytes]]:
        at = 0
        while at + 4 <= len(data):
            code, size = struct.unpack(self._order + "HH", data[at : at + 4])
            if code == 0:
                return
            yield code, data[at + 4 : at + 4 + size]
            at += 4 + size + -size % 4

    def _packet(self, kind: int, body: bytes) -> Packet | None:
        if kind == _SIMPLE:
            if len(body) < 4:
                raise self._error("a packet block that is too short")
            number, stamp = 0, None
            size = min(struct.unpack(self._order + "I", body[:4])[0], len(body) - 4)
            data = body[4 : 4 + size]
        else:
            if len(body) < 20:
                raise self._error("a packet block that is too short")
            number, high, low, size, _ = struct.unpack(self._order + "IIIII", body[:20])
            if size > len(body) - 20:
                raise self._error("a packet that is longer than its block")
            stamp = high << 32 | low
            data = body[20 : 20 + size]
        if number >= len(self.interfaces):
            raise self._error(f"a packet of interface {number}, which the file does not name")
        interface = self.interfaces[number]
        if interface.link_type == RTAC:
            data = data[_RTAC_HEADER:]
        elif interface.link_type not in _USER:
            return None
        tick = None
        if stamp is not None:
            tick = (2 * stamp * TICKS_PER_SECOND + interface.per_second) // (2 * interface.per_second)
            tick += interface.offset * TICKS_PER_SECOND
        return Packet(number, tick, data)
