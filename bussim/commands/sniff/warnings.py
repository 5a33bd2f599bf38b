"""What a reader of a recording has to know, by code."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bussim.live.recordings.text import TextFile
from bussim.live.sniff.modbus import ModbusDecoder

if TYPE_CHECKING:
    from bussim.commands.common.recording import OpenLine
    from bussim.live.sniff.listener import Listener


def warnings_of(listener: Listener | None, line: OpenLine | None) -> dict[str, str]:
    """The warnings of a recording that was read, or of a port."""
    found: dict[str, str] = {}
    if line is not None:
        found |= line.found.warnings | line.source.facts.warnings
        if line.misfit is not None:
            found.pop("not_recognised", None)
            found["layout"] = line.misfit.text
        facts = line.source.facts
        if facts.unreadable_lines:
            first = "; ".join(facts.unreadable)
            found["unreadable_lines"] = f"{facts.unreadable_lines} lines cannot be read: {first}"
        if isinstance(line.source, TextFile) and line.source.directions:
            found["software_times"] = (
                "response times are those of a program that logged what it sent and received"
            )
    if listener is None:
        return found
    decoder = listener.decoder
    if isinstance(decoder, ModbusDecoder):
        if decoder.outcomes["unclear"]:
            found["unclear_writes"] = (
                f"{decoder.outcomes['unclear']} frames that are all alike may be requests or responses"
            )
        if decoder.reserved:
            stations = ", ".join(map(str, sorted(decoder.reserved)))
            found["reserved_station"] = f"station {stations}: numbers above 247 are reserved"
    if listener.unusual:
        found["ascii_frames"] = (
            f"{listener.unusual} Modbus ASCII frames end with CR or LF alone, or have lower-case digits"
        )
    return found
