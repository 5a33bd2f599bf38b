"""The settings of the stations on an N:N link: register table and instructions that set them.

PW10 board manual, sections 5 and 7 (D8176–D8180, M8179; under M8002, on an FX under M8038).
"""

from collections.abc import Mapping
from typing import Any

#: The settings by their registers.
SETTINGS = ("D8176", "D8177", "D8178", "D8179", "D8180", "M8179")
#: A slave needs only these; it learns the rest from the master.
_OF_SLAVES = ("D8176", "M8179")


def used(registers: Mapping[str, Any]) -> dict[str, int]:
    """The settings that a station's registers hold and that count there."""
    names = SETTINGS if registers.get("D8176") == 0 else _OF_SLAVES
    return {name: int(registers[name]) for name in names if name in registers}


def mov_lines(registers: Mapping[str, Any], contact: str = "M8002") -> list[str]:
    """The setting program of a station, executed in the first scan after RUN, when its ``contact`` is on."""
    lines = [f"LD {contact}"]
    for name, value in used(registers).items():
        if name.startswith("D"):
            lines.append(f"MOV K{value} {name}")
    if "M8179" in registers:
        lines.append("SET M8179" if registers["M8179"] else "RST M8179")
    return lines
