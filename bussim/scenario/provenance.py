"""Where what the figures of a link are made of comes from, and so the class of each figure.

Published: in a manual. Measured: in a recording that the scenario names (``measured``). Derived: from the
published link times. Entered: by the user. Assumed: since no public source says so.
"""

from collections.abc import Iterable, Mapping

from bussim.plc.link_registers import D_STATION
from bussim.scenario.model import Plc, Scenario
from bussim.words.origins import CLASSES, rank

PUBLISHED, MEASURED, DERIVED, ENTERED, ASSUMED = CLASSES

NOISE, LEVEL, GOALS = "noise", "the level of noise bad", "goals"
_FRAMES, _TIMES, _JITTER = "frame lengths", "gaps and turnarounds", "jitter of turnarounds"
_ATTEMPTS, _ABSENT, _REPLY = "attempts of D8179", "absent_station", "when a slave replies"
_SCANS, _SLAVES, _BYTES = "PLC scan times", "how slaves watch the master", "frame bytes"
_SETTINGS = "line format and settings"
_CLEAN, _ERRORS = (_FRAMES, _TIMES), (NOISE, _ATTEMPTS, _ABSENT)
#: What the figures of a link are made of in the first place, by their keys in the JSON forms.
_MADE_OF: dict[tuple[str, ...], str] = {
    (*_CLEAN, NOISE): "mean_ms mean_random_data_ms bus_load scans polls",
    (*_CLEAN, NOISE, _JITTER): "no_error_ms collisions sd_ms",
    (*_CLEAN, _JITTER, _SCANS): "timeout_floor_ms",
    (*_CLEAN, _JITTER, _ATTEMPTS): "ride_through_ms worst_case_ms",
    (*_CLEAN, _SLAVES): "master_lost",
    (NOISE, _BYTES): "failed_attempts undetected_frames",
    (_FRAMES, *_ERRORS): "station_error_per_scan station_error_per_year station_errors station_error_onsets "
    "false_errors_per_year false_error_onsets_per_year years_between_false_errors",
    (*_CLEAN, *_ERRORS): "one_dead_ms two_dead_ms detect_ms",
    (*_CLEAN, *_ERRORS, _JITTER): "quantiles_ms p_scan_over_ms maximum_ms scan_time_ms",
    (*_CLEAN, *_ERRORS, _JITTER, _SCANS): "refresh_gap_ms stale_ms healthy_at_s",
}
FIGURES = {figure: inputs for inputs, figures in _MADE_OF.items() for figure in figures.split()}


def _of(plcs: Iterable[Plc], *fields: str, built_in: str = ASSUMED) -> list[str]:
    """Where fields of profiles come from."""
    return [plc.origins.get(name, built_in) for plc in plcs for name in fields]


def _weakest(origins: Iterable[str]) -> str:
    """The weakest class of several origins, and all recordings among them."""
    found = dict.fromkeys(origins) or {ASSUMED: None}
    weakest = max(found, key=rank)
    start = f"{MEASURED} in "
    files = ", ".join(origin.removeprefix(start) for origin in found if origin.startswith(start))
    if weakest.startswith(start):
        return f"{start}{files}"
    return f"{weakest} (in part {start}{files})" if files else weakest


def link_inputs(scenario: Scenario, bus: str) -> dict[str, str]:
    """What the figures of an N:N link are made of, each with where it comes from."""
    plcs = [plc for plc in scenario.plcs if plc.link is not None and plc.link.bus == bus]
    masters = [plc for plc in plcs if plc.registers.get(f"D{D_STATION}", 0) == 0]
    slaves = [plc for plc in plcs if plc not in masters]
    gaps = _of(masters, "master_gap", "scan_overhead", built_in=DERIVED)
    noise = [each for each in scenario.noise if each.target.bus == bus and not each.harmless]
    return {
        _SETTINGS: PUBLISHED,
        _FRAMES: DERIVED,
        _TIMES: _weakest([*gaps, *_of(slaves, "turnaround", built_in=DERIVED)]),
        NOISE: _weakest(f"{MEASURED} in {each.measured}" if each.measured else ENTERED for each in noise),
        _SCANS: _weakest(plc.scan_origin for plc in plcs),
        _JITTER: _weakest(_of(slaves, "turnaround")),
        _ATTEMPTS: _weakest(_of(masters, "attempts")),
        _ABSENT: _weakest(_of(masters, "absent_station")),
        _REPLY: _weakest(_of(slaves, "reply")),
        _SLAVES: ASSUMED,
        _BYTES: ASSUMED,
    }


def classes(inputs: Mapping[str, str], keys: Iterable[str]) -> dict[str, dict[str, str]]:
    """The inputs, and the class of each key that is a figure: the weakest of what it is made of."""
    figures = {
        key: CLASSES[max(rank(inputs.get(name, ASSUMED)) for name in FIGURES[key])]
        for key in keys
        if key in FIGURES
    }
    return {"inputs": dict(inputs), "figures": figures}
