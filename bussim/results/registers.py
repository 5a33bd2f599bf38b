"""What each PLC itself calls a register that ``summary.json`` lists under a name common to all families."""

from collections.abc import Iterable, Mapping
from typing import Any


def own_name(summary: Mapping[str, Any], plc: str, name: str) -> str:
    """What a PLC calls the register ``name``: D211 of an FX1S where others have D8211."""
    return str(summary["plcs"].get(plc, {}).get("own_names", {}).get(name, name))


def own_names(summary: Mapping[str, Any], plcs: Iterable[str], name: str) -> str:
    """What PLCs call it, each name once: ``D8211/D211``."""
    return "/".join(dict.fromkeys(own_name(summary, plc, name) for plc in plcs)) or name
