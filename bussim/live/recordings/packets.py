"""pcapng and pcap files with the frames of a serial line.

Each packet is the characters of one frame or chunk: link types DLT_USER0 to DLT_USER3 (147 Modbus RTU,
148 N:N, 149 Modbus ASCII, 150 free, as this program's own export writes them; bit 7 of a character of
148 and 149 marks one whose parity or stop bit was wrong), or RTAC serial, 250, whose header is
skipped. Block layout: draft-ietf-opsawg-pcapng, sections 3 and 4; draft-ietf-opsawg-pcap. Written here
because what is needed are three kinds of blocks, and a reader that is bounded whatever the file holds.
"""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from bussim.engines.contract import RxChar
from bussim.files import reading
from bussim.live.arrival import placed
from bussim.live.recordings.errors import RecordingError
from bussim.live.recordings.source import PROGRESS_EVERY, Chunk, Facts, LineSetup, Source
from bussim.units import TICKS_PER_SECOND
from bussim.wording import counted, visible

_SECTION = 0x0A0D0D0A
_INTERFACE, _SIMPLE, _ENHANCED = 1, 3, 6
_MAGIC = 0x1A2B3C4D
_OPTION_NAME, _OPTION_SPEED, _OPTION_RESOLUTION, _OPTION_OFFSET = 2, 8, 9, 14
#: What a pcap file begins with, in either order of its bytes: how many of its units are a second.
_PCAP = {0xA1B2C3D4: 1_000_000, 0xA1B23C4D: 1_000_000_000}
PCAP_MAGICS = frozenset(struct.pack(order + "I", magic) for magic in _PCAP for order in "<>")
#: Link types: user 0 to 3, and RTAC serial with the bytes of its header.
_USER, RTAC = range(147, 151), 250
_RTAC_HEADER = 12
#: What the link types say of the protocol.
PROTOCOLS = {147: "modbus-rtu", 148: "nn", 149: "modbus-ascii"}
#: Link types whose characters have seven bits and a mark.
_MARKED = (148, 149)
_MARK = 0x80
_FASTEST = 100_000_000
#: A larger block is none of a serial line's.
_LARGEST = 16 * 1024 * 1024
_MOST_INTERFACES = 1000


class Interface(NamedTuple):
    """What the file says of one line."""

    link_type: int
    name: str = ""
    per_second: int = 1_000_000  # units of its timestamps
    offset: int = 0  # seconds to add to them
    speed: int = 0  # bits per second, 0: not said


class Packet(NamedTuple):
    """The characters of one packet, ``whole`` or only the first ones, as a capture with a snaplen keeps.

    ``tick`` is its timestamp, None where it has none.
    """

    interface: int
    tick: int | None
    data: bytes
    whole: bool = True


class PacketReader:
    """Reads a file packet by packet; raises RecordingError with ``name`` and offset."""

    def __init__(self, file: BinaryIO, name: str) -> None:
        self._file = file
        self._name = name
        self._order = "<"
        self._offset = 0
        #: The interfaces of the section that is read.
        self.interfaces: list[Interface] = []
        #: The file ends inside a packet, which is left out.
        self.cut = False
        self.classic = False

    def packets(self) -> Iterator[Packet]:
        """The packets of serial lines, in the file's order; others are left out."""
        head = self._file.read(4)
        if head in PCAP_MAGICS:
            yield from self._pcap(head)
            return
        self._file.seek(0)
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

    def _pcap(self, magic: bytes) -> Iterator[Packet]:
        self.classic, self._order = True, "<" if struct.unpack("<I", magic)[0] in _PCAP else ">"
        header = self._file.read(20)
        if len(header) < 20:
            raise self._error("the file ends inside its header")
        link_type = struct.unpack(self._order + "I", header[16:])[0] & 0xFFFF
        per_second = _PCAP[struct.unpack(self._order + "I", magic)[0]]
        self.interfaces = [Interface(link_type, per_second=per_second)]
        self._offset = 24
        while head := self._file.read(16):
            seconds, part, size, length = struct.unpack(self._order + "IIII", head.ljust(16, b"\0"))
            if size > _LARGEST:
                raise self._error(f"a packet of {size} bytes")
            data = self._file.read(size)
            if len(head) < 16 or len(data) < size:
                self.cut = True
                return
            self._offset += 16 + size
            packet = self._of_interface(0, seconds * per_second + part, data, whole=length <= size)
            if packet is not None:
                yield packet

    def _block(self, *, first: bool) -> tuple[int, bytes] | None:
        head = self._file.read(8)
        if not head:
            return None
        if len(head) < 8:
            self._ends_inside(first=first)
            return None
        kind, size = struct.unpack(self._order + "II", head)
        if kind == _SECTION or first:
            if kind != _SECTION:
                raise self._error("not a pcapng file")
            magic = self._file.read(4)
            if len(magic) < 4:
                self._ends_inside(first=first)
                return None
            self._order = "<" if struct.unpack("<I", magic)[0] == _MAGIC else ">"
            if struct.unpack(self._order + "I", magic)[0] != _MAGIC:
                raise self._error("the section has no byte-order mark")
            size = struct.unpack(self._order + "I", head[4:])[0]
            head += magic
        if size % 4 or not len(head) + 4 <= size <= _LARGEST:
            raise self._error(f"a block of {size} bytes")
        rest = self._file.read(size - len(head))
        if len(rest) < size - len(head):
            self._ends_inside(first=first)
            return None
        if struct.unpack(self._order + "I", rest[-4:])[0] != size:
            raise self._error("a block whose two lengths differ")
        self._offset += size
        return kind, head[8:] + rest[:-4]

    def _ends_inside(self, *, first: bool) -> None:
        if first:
            raise self._error("the file ends inside a block")
        self.cut = True

    def _add_interface(self, body: bytes) -> None:
        if len(body) < 8:
            raise self._error("an interface block that is too short")
        if len(self.interfaces) >= _MOST_INTERFACES:
            raise self._error(f"more than {_MOST_INTERFACES} interfaces")
        found = Interface(struct.unpack(self._order + "H", body[:2])[0])
        for code, value in self._options(body[8:]):
            if code == _OPTION_NAME:
                found = found._replace(name=visible(value.decode("utf-8", "replace")))
            elif code == _OPTION_RESOLUTION and value:
                exponent = value[0] & 0x7F
                if exponent > (63 if value[0] & 0x80 else 18):
                    raise self._error("a resolution of timestamps beyond every clock")
                found = found._replace(per_second=(2 if value[0] & 0x80 else 10) ** exponent)
            elif code == _OPTION_OFFSET and len(value) == 8:
                found = found._replace(offset=struct.unpack(self._order + "q", value)[0])
            elif code == _OPTION_SPEED and len(value) == 8:
                found = found._replace(speed=min(struct.unpack(self._order + "Q", value)[0], _FASTEST))
        self.interfaces.append(found)

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
            length = struct.unpack(self._order + "I", body[:4])[0]
            return self._of_interface(0, None, body[4 : 4 + length], whole=length <= len(body) - 4)
        if len(body) < 20:
            raise self._error("a packet block that is too short")
        number, high, low, size, length = struct.unpack(self._order + "IIIII", body[:20])
        if size > len(body) - 20:
            raise self._error("a packet that is longer than its block")
        return self._of_interface(number, high << 32 | low, body[20 : 20 + size], whole=length <= size)

    def _of_interface(self, number: int, stamp: int | None, data: bytes, *, whole: bool) -> Packet | None:
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
        return Packet(number, tick, data, whole)


class PacketFile(Source):
    """A pcapng or pcap file as a recording: its first serial interface, or those that are named."""

    exact, tolerant, times = True, True, "exact"

    def __init__(self, path: Path, channels: tuple[str, ...]) -> None:
        self._path, self._channels = path, channels
        self.wires = max(1, len(channels))
        self.facts = Facts()
        with self._opened() as file:
            reader = PacketReader(file, str(path))
            chosen = next((p.interface for p in reader.packets() if self._wanted(reader, p.interface)), None)
            if chosen is None:
                names = ", ".join(each.name or str(at) for at, each in enumerate(reader.interfaces)) or "none"
                what = f"no interface {channels[0]!r}" if channels else "no frames of a serial line"
                raise RecordingError(f"{path} has {what}; its interfaces are {names}")
            #: The interface that is read.
            self.interface = reader.interfaces[chosen]
            self._chosen = chosen
        self.resolution = -(-TICKS_PER_SECOND // self.interface.per_second)

    def _opened(self) -> BinaryIO:
        with reading(self._path):
            return self._path.open("rb")

    def _wire(self, reader: PacketReader, number: int) -> int:
        """The wire of an interface, -1 if it is not read."""
        names = (reader.interfaces[number].name, str(number))
        return next((wire for wire, name in enumerate(self._channels) if name in names), -1)

    def _wanted(self, reader: PacketReader, number: int) -> bool:
        return not self._channels or self._wire(reader, number) >= 0

    def chunks(self, setup: LineSetup) -> Iterator[Chunk]:
        """See the source of a recording.

        The first packet is time 0 in a pcap file, and where times count from 1970.
        """
        marked = self.interface.link_type in _MARKED
        end, since, latest, parts = 0, None, 0, 0
        with self._opened() as file:
            reader = PacketReader(file, str(self._path))
            for count, (number, tick, data, whole) in enumerate(reader.packets()):
                if not count % PROGRESS_EVERY:
                    self.progress("reading", file.tell(), self._path.stat().st_size)
                wire = self._wire(reader, number) if self._channels else 0 if number == self._chosen else -1
                if wire < 0 or not data:
                    continue
                parts += not whole
                if tick is not None and latest - tick > TICKS_PER_SECOND:
                    before = (latest - tick) / TICKS_PER_SECOND
                    raise RecordingError(
                        f"{self._path}: packet {count + 1} is {before:.3f} s before one above it: the clock "
                        "was set back, two captures follow each other, or packets are not in order, which "
                        "Wireshark's reordercap mends"
                    )
                latest = max(latest, tick or 0)
                if since is None and tick is not None:
                    since = tick if reader.classic or tick > _A_MONTH else 0
                # A simple packet has no time: right behind the one before.
                begun = end if tick is None else max(tick - (since or 0), 0)
                chars = placed(data, begun, setup.timing)
                if marked and max(data) >= _MARK:
                    chars = [
                        char if byte < _MARK else (RxChar(byte & ~_MARK, parity_ok=False), char[1], char[2])
                        for byte, char in zip(data, chars, strict=True)
                    ]
                end = chars[-1][2]
                yield Chunk(chars, wire)
            if parts:
                self.facts.warnings["cut_packets"] = (
                    f"{counted(parts, 'packet')} of {count + 1:,} are only the first bytes of frames: the "
                    "capture kept no more of each (its snaplen)"
                )
            if reader.cut:
                self.facts.warnings["cut_file"] = "the file ends inside a packet, which is left out"


#: Recordings whose times begin later count from 1970.
_A_MONTH = 31 * 86_400 * TICKS_PER_SECOND
