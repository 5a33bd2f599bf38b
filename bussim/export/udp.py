"""Modbus RTU frames in Ethernet, IPv4 and UDP, as a gateway would forward them.

The wrapping has what a serial line has not: requests go to port 5020, responses come from it. Addresses
are made up: ``10.B.1.S`` is station S on the B-th bus, ``10.B.0.N`` its N-th node that has no station
number, such as a master, ``10.B.255.255`` all stations (a broadcast). A frame that is neither request nor
response goes from port 5020 to port 5020.
"""

import struct
from ipaddress import IPv4Address

from bussim.errors import UsageError
from bussim.export.selection import BusSurvey
from bussim.trace.records import FrameRecord

#: The port of a Modbus server behind the gateway; 502 is that of Modbus/TCP, another layout.
PORT = 5020
#: The port from which a master sends its requests.
_ASKING_PORT = 50_200
_MOST_BUSES = 254
_UDP = 17
_HOPS = 64


class Gateway:
    """The addresses of one bus, ``number`` counting from 1, and the master that asked last on it."""

    def __init__(self, number: int, bus: BusSurvey) -> None:
        if number > _MOST_BUSES:
            raise UsageError(f"--encap udp has addresses for {_MOST_BUSES} buses: choose a --bus")
        self._network = 10 << 24 | number << 16
        self._stations = bus.stations
        self._masters: dict[str, int] = {}
        for node in bus.nodes:
            if node not in self._stations:
                self._masters[node] = self._network | (len(self._masters) + 1) & 0xFF
        self._all_stations = self._network | 0xFFFF
        self._asking = next(iter(self._masters.values()), self._network | 1)

    def names(self) -> dict[IPv4Address, str]:
        """Nodes by their addresses."""
        found = {IPv4Address(address): node for node, address in self._masters.items()}
        for node, station in self._stations.items():
            found.setdefault(IPv4Address(self._station(station)), node)
        return found

    def wrap(self, frame: FrameRecord, chars: bytes) -> bytes:
        """The packet in which characters of a frame travel."""
        own = self._address(frame.sender)
        if frame.kind == "request":
            self._asking = own
            target = self._all_stations if not frame.station else self._station(frame.station)
            return _packet(own, _ASKING_PORT, target, PORT, chars)
        if frame.kind == "response":
            source = own if not frame.station else self._station(frame.station)
            return _packet(source, PORT, self._asking, _ASKING_PORT, chars)
        return _packet(own, PORT, self._all_stations, PORT, chars)

    def _station(self, station: int) -> int:
        return self._network | 1 << 8 | station & 0xFF

    def _address(self, node: str) -> int:
        station = self._stations.get(node)
        if station is not None:
            return self._station(station)
        return self._masters.get(node, self._network | 0xFF)


def _packet(source: int, source_port: int, target: int, target_port: int, data: bytes) -> bytes:
    size = len(data) + 8
    udp = struct.pack(">HHHH", source_port, target_port, size, 0)  # sum 0: none
    head = struct.pack(">BBHHHBBHII", 0x45, 0, size + 20, 0, 0x4000, _HOPS, _UDP, 0, source, target)
    total = sum(struct.unpack(">10H", head))
    total = (total & 0xFFFF) + (total >> 16)
    total = (total & 0xFFFF) + (total >> 16)
    head = head[:10] + struct.pack(">H", total ^ 0xFFFF) + head[12:]
    return _mac(target) + _mac(source) + b"\x08\x00" + head + udp + data


def _mac(address: int) -> bytes:
    """A locally administered one from an address; that of all stations is the broadcast."""
    return b"\xff" * 6 if address & 0xFFFF == 0xFFFF else b"\x02\x00" + address.to_bytes(4, "big")
