"""What a setting must achieve, as the user writes it and as masks over a grid of settings."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from difflib import get_close_matches

from bussim.exact.text import ms
from bussim.units import UNIT_TICKS, parse_time
from bussim.wording import about

#: The forms of a goal, for messages and help texts.
FORMS = {
    "errors": "errors<=1/y",
    "scan": "scan<=200ms@1e-6",
    "dead": "dead<=400ms",
    "ride": "ride>=100ms",
    "heartbeat": "heartbeat=500ms@0.1/y",
}

_GOAL = re.compile(r"\s*([A-Za-z_]+)\s*(<=|>=|=)\s*([^@]+?)\s*(?:@\s*(\S+)\s*)?")
_RATE = re.compile(r"([0-9.eE+-]+)\s*(?:/|per\s*)\s*(y|year|d|day|h)?")
_PER_YEAR = {"y": 1.0, "year": 1.0, "d": 365.0, "day": 365.0, "h": 8760.0, None: 1.0}


@dataclass(frozen=True, slots=True)
class Goals:
    """Goals of a sizing; None where there is no such goal. Times in ticks.

    ``errors``: false station errors a year, of all stations together, at most. ``scan``: (deadline,
    probability) with which a scan may exceed it. ``dead``: mean scan with one station dead, at most.
    ``ride``: silence that raises no station error, at least. ``heartbeat``: (preset, times a year)
    that a heartbeat's watchdog may run out falsely, of any pair.
    """

    errors: float = 1.0
    scan: tuple[int, float] | None = None
    dead: int | None = None
    ride: int | None = None
    heartbeat: tuple[int, float] | None = None

    def with_text(self, text: str) -> Goals:
        """These goals and one more as a user writes it (:data:`FORMS`).

        Raises ValueError, with a message for the user, for anything else.
        """
        match = _GOAL.fullmatch(text)
        if match is None:
            raise ValueError(f"is {text!r}, not a goal; write one of {', '.join(FORMS.values())}")
        name, sign, value, extra = match.groups()
        form = FORMS.get(name)
        if form is None:
            near = get_close_matches(name, FORMS, n=1)
            hint = f"; did you mean {FORMS[near[0]]}?" if near else ""
            raise ValueError(f"is {text!r}, whose goal {name!r} is none of {', '.join(FORMS)}{hint}")
        wanted = ">=" if name == "ride" else "<=" if name != "heartbeat" else "="
        if sign != wanted:
            raise ValueError(f"is {text!r}; write {name}{wanted}…, such as {form}")
        if extra is not None and name not in ("scan", "heartbeat"):
            raise ValueError(f"is {text!r}; @ belongs to scan and heartbeat only, write {form}")
        if name == "errors":
            return replace(self, errors=_rate(text, value, form))
        ticks = _time(text, value)
        if name == "scan":
            return replace(self, scan=(ticks, _probability(text, extra, form)))
        if name == "heartbeat":
            return replace(self, heartbeat=(ticks, 0.1 if extra is None else _rate(text, extra, form)))
        return replace(self, dead=ticks) if name == "dead" else replace(self, ride=ticks)

    def texts(self) -> dict[str, str]:
        """Each goal in words, by its name."""
        plural = "error" if self.errors == 1 else "errors"
        found = {"errors": f"at most {about(self.errors)} false station {plural} a year"}
        if self.scan is not None:
            found["scan"] = f"a scan over {ms(self.scan[0])} ms with probability at most {self.scan[1]:g}"
        if self.dead is not None:
            found["dead"] = f"a scan of at most {ms(self.dead)} ms with one station dead"
        if self.ride is not None:
            found["ride"] = f"an outage of {ms(self.ride)} ms without a station error"
        if self.heartbeat is not None:
            preset, missed = self.heartbeat
            found["heartbeat"] = f"a heartbeat of {ms(preset)} ms missed at most {about(missed)} times a year"
        return found


def _time(text: str, value: str) -> int:
    try:
        ticks = parse_time(value)
    except ValueError as error:
        raise ValueError(f"is {text!r}, whose time {error}") from None
    if not 0 < ticks <= UNIT_TICKS["y"]:
        raise ValueError(f"is {text!r}, whose time must lie between 0 and 1 y")
    return ticks


def _number(text: str, value: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise ValueError(f"is {text!r}, where {value!r} is not a number") from None


def _rate(text: str, value: str, form: str) -> float:
    match = _RATE.fullmatch(value.strip())
    if match is None and not re.fullmatch(r"[0-9.eE+-]+", value.strip()):
        raise ValueError(f"is {text!r}, where {value!r} is not a rate; write {form}")
    number, unit = match.groups() if match else (value.strip(), None)
    rate = _number(text, number) * _PER_YEAR[unit]
    if not 0 < rate < 1e9:
        raise ValueError(f"is {text!r}, whose rate must be above 0 and below 1e9 a year")
    return rate


def _probability(text: str, value: str | None, form: str) -> float:
    if value is None:
        raise ValueError(f"is {text!r}, without a probability; write {form}")
    probability = _number(text, value)
    if not 0 < probability < 1:
        raise ValueError(f"is {text!r}, whose probability must lie between 0 and 1")
    return probability
