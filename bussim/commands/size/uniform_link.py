"""The scenario of a link of equal stations: what ``bussim size --stations N --mode M`` sizes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bussim.commands.common.scenario_options import time_of
from bussim.errors import UsageError
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND, format_time

if TYPE_CHECKING:
    from collections.abc import Iterable

    from bussim.scenario.model import Scenario

#: The PLC scan time without ``--scan``, as of a scenario that gives none.
DEFAULT_SCAN = "10 ms"
DEFAULT_PROFILE = "pw10"

#: PLC scan times that a scenario may have, in ticks.
_SCANS = (TICKS_PER_MS // 10, 10 * TICKS_PER_SECOND)
_BUS = "link"


def uniform_link(
    stations: int,
    mode: int,
    *,
    profile: str = DEFAULT_PROFILE,
    scan: str | None = None,
    ber: float | None = None,
    overrides: Iterable[str] = (),
) -> Scenario:
    """A scenario of one link: ``master`` and ``slave1`` to ``slaveN``, all with one profile and PLC scan.

    ``stations`` counts the master too; ``ber`` is the chance that a bit is inverted on the wire, None or
    0 for no noise. D8179 and D8180 are those at power-on. Raises UsageError for a value out of range,
    with the option's name.
    """
    from bussim.plc.profiles import MAX_SLAVES, PROFILES
    from bussim.scenario.loader import from_data
    from bussim.words.values import suggest

    if profile not in PROFILES:
        raise UsageError(f"--profile is {profile!r}; {suggest(profile, list(PROFILES))}")
    _check("--stations", stations, range(2, MAX_SLAVES + 2), "with the master")
    _check("--mode", mode, PROFILES[profile].modes, f"in profile {profile}")
    if scan is not None and not _SCANS[0] <= time_of("--scan", scan) <= _SCANS[1]:
        raise UsageError(f"--scan is {scan}, allowed {' to '.join(map(format_time, _SCANS))}")
    if ber is not None and not 0 <= ber <= 1:
        raise UsageError(f"--ber is {ber:g}, allowed 0..1")
    link = {"bus": _BUS, "port": "COM4"}
    plc = {"profile": profile} | ({} if scan is None else {"scan": scan})
    plcs: list[object] = [
        {"name": "master", **plc, "nn": {**link, "station": 0, "slaves": stations - 1, "mode": mode}}
    ]
    plcs += [
        {"name": f"slave{number}", **plc, "nn": {**link, "station": number}} for number in range(1, stations)
    ]
    noise = [{"name": "line", "bus": _BUS, "ber": ber}] if ber else []
    data: dict[str, object] = {
        "schema": 1,
        "name": f"{stations} stations, mode {mode}",
        "duration": "60 s",
        "buses": [{"name": _BUS, "nn": True}],
        "plcs": plcs,
        "noise": noise,
    }
    return from_data(data, overrides, "options")


def _check(option: str, value: int, allowed: range | tuple[int, ...], where: str) -> None:
    if value not in allowed:
        shown = f"{allowed[0]}..{allowed[-1]}" if len(allowed) > 1 else f"{allowed[0]} only"
        raise UsageError(f"{option} is {value}, allowed {shown} {where}")
