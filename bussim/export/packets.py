"""Frames as packets of a pcapng file: what a receiver on the bus read, and remarks on what went wrong.

A packet's time is the frame's first edge. Characters of seven bits leave bit 7 free: there it marks
one whose parity or stop bit was wrong (in N:N and Modbus ASCII packets; the dissectors of this package know).
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Final

from bussim.export.heard import Heard, hear, remarks
from bussim.export.pcapng import SYMBOL_ERROR, PcapngWriter
from bussim.export.source import BusSurvey, Selection, Survey, in_order
from bussim.export.udp import PORT, Gateway
from bussim.line.protocols import BusProtocol
from bussim.units import nanoseconds
from bussim.version import __version__

#: Link types by protocol: USER0 to USER3 of the list of tcpdump.org; and Ethernet.
LINK_TYPES: Final = {"modbus-rtu": 147, "nn": 148, "modbus-ascii": 149, "free": 150}
ETHERNET: Final = 1
_NAMES: Final = {"modbus-rtu": "Modbus RTU", "nn": "N:N", "modbus-ascii": "Modbus ASCII", "free": "free"}
_WRONG: Final = 0x80
#: The dissectors in Lua, by protocol.
DISSECTORS: Final = {"nn": "nn.lua", "modbus-ascii": "mbascii.lua"}


def write_pcapng(path: Path, selection: Selection, survey: Survey, comment: str, encapsulation: str) -> None:
    """Write the frames as packets, one interface a bus (two where two protocols are spoken on it)."""
    with path.open("wb") as file:
        writer = PcapngWriter(file, f"bussim {__version__}", comment)
        interfaces: dict[tuple[str, str], int] = {}
        gateways: dict[str, Gateway] = {}
        for number, bus in enumerate(survey.buses.values(), 1):
            for protocol in bus.protocols or _spoken(selection, bus.name):
                wrapped = encapsulation == "udp" and protocol == "modbus-rtu"
                link_type = ETHERNET if wrapped else LINK_TYPES.get(protocol, LINK_TYPES["free"])
                name = bus.name if len(bus.protocols) < 2 else f"{bus.name} ({protocol})"
                interfaces[bus.name, protocol] = writer.interface(
                    link_type, name, _description(bus, protocol), bus.timing.baud
                )
                if wrapped:
                    gateways[bus.name] = Gateway(number, bus)
        for gateway in gateways.values():
            writer.names(gateway.names())
        for heard in hear(in_order(selection.frames(), survey.lateness), survey):
            frame = heard.frame
            bus, data = survey.buses[frame.bus], _data(heard)
            if frame.protocol == "modbus-rtu" and frame.bus in gateways:
                data = gateways[frame.bus].wrap(frame, data)
            writer.packet(
                interfaces[frame.bus, frame.protocol],
                nanoseconds(frame.start),
                data,
                _comment(heard, bus),
                SYMBOL_ERROR if heard.wrong else 0,
            )


def _spoken(selection: Selection, name: str) -> list[str]:
    """What a bus speaks on which nobody said anything."""
    bus = selection.trace.header.bus(name)
    return ["nn"] if bus is not None and bus.protocol is BusProtocol.NN else ["modbus-rtu"]


def _description(bus: BusSurvey, protocol: str) -> str:
    nodes = ", ".join(bus.nodes)
    return f"{_NAMES.get(protocol, protocol)}, {bus.timing.baud} {bus.timing.format}: {nodes}"


def _data(heard: Heard) -> bytes:
    if not heard.wrong or heard.frame.protocol not in DISSECTORS:
        return heard.chars
    data = bytearray(heard.chars)
    for place, _ in heard.wrong:
        data[place] |= _WRONG
    return bytes(data)


def _comment(heard: Heard, bus: BusSurvey) -> str:
    found = remarks(heard, bus.timing)
    if heard.frame.kind == "jabber":
        found.insert(0, "jabber")
    return f"{heard.frame.sender}: {'; '.join(found)}" if found else ""


def how_to_open(survey: Survey, encapsulation: str) -> list[str]:
    """What Wireshark has to be told to read these packets, as lines for the user."""
    spoken = {protocol for bus in survey.buses.values() for protocol in bus.protocols}
    options: list[str] = []
    if "modbus-rtu" in spoken:
        options.append(
            f"-o mbrtu.udp.port:{PORT}"
            if encapsulation == "udp"
            else """-o 'uat:user_dlts:"User 0 (DLT=147)","mbrtu","0","","0",""'"""
        )
        options.append("-o mbrtu.crc_verification:TRUE")
    options += [f"-X lua_script:{script(name)}" for key, name in DISSECTORS.items() if key in spoken]
    return [f"Wireshark or tshark needs: {' '.join(options)}"] if options else []


def script(name: str) -> Path:
    """Where a dissector of this package lies."""
    return Path(str(files("bussim.export") / name))
