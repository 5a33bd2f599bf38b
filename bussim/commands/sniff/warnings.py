"""What a reader of a recording has to know, by code."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bussim.live.recordings.text import TextFile
from bussim.live.sniff.modbus import ModbusDecoder
from bussim.units import TICKS_PER_MS, milliseconds
from bussim.wording import counted

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
            lines = counted(facts.unreadable_lines, "line")
            found["unreadable_lines"] = f"{lines} cannot be read: {first}"
        if isinstance(line.source, TextFile) and line.source.directions:
            found["software_times"] = (
                "response times are those of a program that logged what it sent and received"
            )
    if listener is None:
        return found
    decoder = listener.decoder
    resolution = 0 if line is None or line.source.times != "system" else line.source.resolution
    if resolution > TICKS_PER_MS and decoder.frames > 1:
        found["coarse_times"] = (
            f"times are known to {milliseconds(resolution):g} ms, and what is told of them no better; if "
            "they are numbers of lines there are none"
        )
    if line is None or line.found.suggested is None:
        found |= _one_sided(listener)
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


#: Requests without a reply, and replies without a request, from which a side of the line is missing.
_ENOUGH = 5
#: A larger share of characters in no sound frame is seldom noise.
_MOST_LOST = 0.2


def _one_sided(listener: Listener) -> dict[str, str]:
    """Whether a side of the line is missing, or another line is on the same wire."""
    decoder, found = listener.decoder, dict[str, str]()
    silent = decoder.outcomes["no_answer"]
    if decoder.unasked >= _ENOUGH and not decoder.outcomes.total():
        found["one_side"] = "there are replies and no request: this wire carries the stations' side alone"
    elif silent >= _ENOUGH and silent == decoder.outcomes.total() - decoder.outcomes["undecided"]:
        found["one_side"] = (
            "not one request has a reply: no station replies, or this wire carries the master's side alone"
        )
    lost = listener.characters - decoder.sound_characters
    if lost > _MOST_LOST * listener.characters and not decoder.echoes:
        found["mixed_line"] = (
            f"{lost:,} of {counted(listener.characters, 'character')} are in no sound frame: strong noise, "
            "two senders at once, or a second rate, format or protocol, which -b, -P and --protocol show"
        )
    return found
