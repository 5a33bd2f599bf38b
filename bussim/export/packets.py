"""Frames as packets of a pcapng file: what a receiver on the bus read, and remarks on what went wrong.

A packet's time is its first edge. A frame is one packet; where it is read with silences in it that end a
frame (others sent at the same time, or its sender paused), it is several. Characters of seven bits leave
bit 7 free: there it marks one whose parity or stop bit was wrong (in N:N and Modbus ASCII packets; the
dissectors of this package know).
"""

from importlib.resources import files
from pathlib import Path
from typing import Final

from bussim.errors import UsageError
from bussim.export.pcapng import SYMBOL_ERROR, PcapngWriter
from bussim.export.received import Received, receive, remarks
from bussim.export.selection import BusSurvey, Job, Selection, Survey, Written, in_order
from bussim.export.udp import PORT, Gateway
from bussim.line.protocols import BusProtocol
from bussim.units import nanoseconds
from bussim.version import __version__

#: Link types by protocol: USER0 to USER3 of the list of tcpdump.org; and Ethernet.
LINK_TYPES: Final = {"modbus-rtu": 147, "nn": 148, "modbus-ascii": 149, "free": 150}
ETHERNET: Final = 1
_NAMES: Final = {"modbus-rtu": "Modbus RTU", "nn": "N:N", "modbus-ascii": "Modbus ASCII", "free": "free"}
_WRONG: Final = 0x80
#: The protocol of a bus on which no frame was recorded.
_USUAL: Final = {BusProtocol.NN: "nn", BusProtocol.SERIAL: "modbus-rtu"}
#: The dissectors in Lua, by protocol.
DISSECTORS: Final = {"nn": "nn.lua", "modbus-ascii": "mbascii.lua"}


def write_pcapng(path: Path, job: Job) -> Written:
    """Write the frames as packets, one interface a bus (two where two protocols are used on it)."""
    selection, survey, encapsulation = job.selection, job.survey, job.encapsulation
    with path.open("wb") as file:
        writer = PcapngWriter(file, f"bussim {__version__}", job.comment)
        interfaces: dict[tuple[str, str], int] = {}
        gateways: dict[str, Gateway] = {}
        for number, bus in enumerate(survey.buses.values(), 1):
            for protocol in bus.protocols or _protocols_of(selection, bus.name):
                wrapped = encapsulation == "udp" and protocol == "modbus-rtu"
                if protocol not in LINK_TYPES:
                    raise UsageError(f"frames of the protocol {protocol!r} have no link type in pcapng")
                link_type = ETHERNET if wrapped else LINK_TYPES[protocol]
                name = bus.name if len(bus.protocols) < 2 else f"{bus.name} ({protocol})"
                interfaces[bus.name, protocol] = writer.interface(
                    link_type, name, _description(bus, protocol), bus.timing.baud
                )
                if wrapped:
                    gateways[bus.name] = Gateway(number, bus)
        for gateway in gateways.values():
            writer.names(gateway.names())
        for received in receive(in_order(selection.frames(), survey.lateness), survey):
            frame = received.frame
            bus, data = survey.buses[frame.bus], _data(received)
            packets = [
                (start, data[first:end]) for start, first, end in received.pieces(bus.timing.characters(1))
            ]
            if frame.protocol == "modbus-rtu" and frame.bus in gateways:
                packets = [(frame.start, gateways[frame.bus].wrap(frame, data))]
            for start, piece in packets:
                writer.packet(
                    interfaces[frame.bus, frame.protocol],
                    nanoseconds(start),
                    piece,
                    _comment(received, bus),
                    SYMBOL_ERROR if received.wrong else 0,
                )
    return Written(survey.frames, tuple(survey.buses), tuple(how_to_open(survey, encapsulation)))


def _protocols_of(selection: Selection, name: str) -> list[str]:
    """The protocol of a bus without a frame."""
    bus = selection.trace.header.bus(name)
    return ["modbus-rtu" if bus is None else _USUAL[bus.protocol]]


def _description(bus: BusSurvey, protocol: str) -> str:
    nodes = ", ".join(bus.nodes)
    return f"{_NAMES[protocol]}, {bus.timing.baud} {bus.timing.format}: {nodes}"


def _data(received: Received) -> bytes:
    if not received.wrong or received.frame.protocol not in DISSECTORS:
        return received.chars
    data = bytearray(received.chars)
    for index, _ in received.wrong:
        data[index] |= _WRONG
    return bytes(data)


def _comment(received: Received, bus: BusSurvey) -> str:
    found = remarks(received, bus.timing)
    if received.frame.kind == "jabber":
        found.insert(0, "jabber")
    return f"{received.frame.sender}: {'; '.join(found)}" if found else ""


def how_to_open(survey: Survey, encapsulation: str) -> list[str]:
    """The options that Wireshark needs to read these packets, as lines for the user."""
    protocols = {protocol for bus in survey.buses.values() for protocol in bus.protocols}
    options: list[str] = []
    if "modbus-rtu" in protocols:
        options.append(
            f"-o mbrtu.udp.port:{PORT}"
            if encapsulation == "udp"
            else """-o 'uat:user_dlts:"User 0 (DLT=147)","mbrtu","0","","0",""'"""
        )
        options.append("-o mbrtu.crc_verification:TRUE")
    options += [f"-X lua_script:{script(name)}" for key, name in DISSECTORS.items() if key in protocols]
    return [f"Wireshark or tshark needs: {' '.join(options)}"] if options else []


def script(name: str) -> Path:
    """Where a dissector of this package lies."""
    return Path(str(files("bussim.export") / name))
