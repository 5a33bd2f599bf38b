"""What a setting must achieve, as the user writes it and as masks over a grid of settings."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from typing import Any

from bussim.exact.text import a_year, at_most, ms_at_least, ms_at_most
from bussim.units import TICKS_PER_MS, UNIT_TICKS, format_time, parse_time
from bussim.wording import about
from bussim.words.language import say

#: The forms of a goal, for messages and help texts.
FORMS = {
    "errors": "errors<=1/y",
    "onsets": "onsets<=1/y",
    "scan": "scan<=200ms@1e-6",
    "dead": "dead<=400ms",
    "ride": "ride>=100ms",
    "heartbeat": "heartbeat=500ms@0.1/y",
    "cycle": "cycle<=500ms",
    "age": "age<=1s",
}
#: The goals of an N:N link and those of a Modbus poll list.
LINK_GOALS = ("errors", "onsets", "scan", "dead", "ride", "heartbeat")
PORT_GOALS = ("errors", "cycle", "dead", "age")

_GOAL = re.compile(r"\s*([A-Za-z_]+)\s*(<=|>=|=)\s*([^@]+?)\s*(?:@\s*(\S+)\s*)?")
_RATE = re.compile(r"([0-9.eE+-]+)\s*(?:/|per\s*)\s*(y|year|d|day|h)?")
_PER_YEAR = {"y": 1.0, "d": 365.0, "h": 8760.0}

#: The outage of the line in ticks that must pass unless the user says otherwise (assumed).
OUTAGE = 100 * TICKS_PER_MS


class Rate(float):
    """How often a year, with the count and the unit (``y``, ``d``, ``h``) that the user wrote."""

    count: float
    unit: str

    def __new__(cls, count: float, unit: str = "y") -> Rate:
        """So many times a year, day or hour."""
        self = super().__new__(cls, count * _PER_YEAR[unit])
        self.count, self.unit = count, unit
        return self

    @classmethod
    def of(cls, per_year: float) -> Rate:
        """A rate in its own unit: of a bare number that is the year."""
        return per_year if isinstance(per_year, Rate) else cls(per_year)

    @property
    def form(self) -> str:
        """The rate as in a goal: ``1/d``."""
        return f"{self.count:.12g}/{self.unit}"

    def in_words(self) -> str:
        """The rate in words: ``1 a day``."""
        return say(f"goal_rate_{self.unit}", count=f"{self.count:.12g}")

    def in_times(self) -> str:
        """The rate in words: ``once a day``, ``2 times a day``."""
        how = "once" if self.count == 1 else "times"
        return say(f"goal_{how}_{self.unit}", count=f"{self.count:.12g}")


@dataclass(frozen=True, slots=True)
class Goals:
    """Goals of a sizing; None where there is no such goal. Times in ticks.

    ``errors``: false station errors (scans in which a living station is in error) a year, of all stations
    together, at most. ``scan``: (deadline, probability) with which a scan may exceed it. ``dead``: mean
    scan with one station dead, at most. ``ride``: interruption of the line that raises no station error, at
    least; 0 for no such goal. ``heartbeat``: (preset, times a year) that a heartbeat's watchdog may run out
    falsely, of any pair. ``onsets``: how often a year a false station error begins, at most. ``given``
    names the goals that the user wrote. Of a poll list ``errors`` are failed turns a year, ``dead`` is the
    mean cycle with one device dead; ``cycle``: the longest cycle without errors, ``age``: that of the oldest
    data, at most.
    """

    errors: float = 1.0
    scan: tuple[int, float] | None = None
    dead: int | None = None
    ride: int = OUTAGE
    heartbeat: tuple[int, float] | None = None
    onsets: float | None = None
    cycle: int | None = None
    age: int | None = None
    given: tuple[str, ...] = field(default=(), compare=False)

    def with_texts(self, texts: Iterable[str]) -> Goals:
        """These goals and more as a user writes them. Raises ValueError with a line for each wrong one."""
        goals, wrong = self, []
        for text in texts:
            try:
                goals = goals.with_text(text)
            except ValueError as error:
                wrong.append(f"--goal {error}")
        if wrong:
            raise ValueError("\n".join(wrong))
        return goals

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
        if name in self.given:
            raise ValueError(f"is {text!r}, a second goal {name}; give each once")
        limit: Any
        match name:
            case "errors" | "onsets":
                limit = _rate(text, value, form)
            case "ride":
                limit = 0 if value.strip() == "0" else _time(text, value, least=0)
            case "dead" | "cycle" | "age":
                limit = _time(text, value)
            case "scan":
                limit = _time(text, value), _probability(text, extra, form)
            case _:
                missed = Rate(0.1) if extra is None else _rate(text, extra, form)
                limit = _time(text, value), missed
        return replace(self, given=(*self.given, name), **{name: limit})

    def forms(self) -> dict[str, str]:
        """Each goal as a user writes it, by its name."""
        return {name: form.replace(" ", "") for name, (form, *_) in self._described().items()}

    def texts(self) -> dict[str, str]:
        """Each goal in words, by its name, with the user's own figures."""
        return {name: words for name, (_, words, _) in self._described().items()}

    def limits(self) -> dict[str, str]:
        """What each goal is limited to, in words, by its name."""
        return {name: limit for name, (*_, limit) in self._described().items()}

    def of_ports(self) -> tuple[str, ...]:
        """The goals of a poll list that there are."""
        return tuple(name for name in PORT_GOALS if self.limit(name) < math.inf or name == "errors")

    def limit(self, name: str) -> float:
        """What a figure of a poll list may be at most, by the goal's name."""
        found = getattr(self, name)
        return math.inf if found is None else float(found)

    def with_limit(self, name: str, limit: float) -> Goals:
        """These goals with another limit of one that poll lists have; infinity for none."""
        value: Any = limit if name == "errors" else None if math.isinf(limit) else round(limit)
        return replace(self, **{name: value})

    def rounded_up(self, name: str, value: float) -> float:
        """A limit that a figure of a poll list keeps, rounded to the safe side as a user would write it."""
        return Rate(at_most(value, 1)) if name == "errors" else math.ceil(value / TICKS_PER_MS) * TICKS_PER_MS

    def port_texts(self) -> dict[str, str]:
        """Each goal of a poll list in words, by its name."""
        limits = self.port_limits()
        errors = {"errors": say("goal_port_errors", rate=limits.pop("errors"))}
        return errors | {name: say(f"goal_port_{name}", time=time) for name, time in limits.items()}

    def port_limits(self) -> dict[str, str]:
        """What each goal of a poll list is limited to, in words, by its name."""
        limits = {name: self.limit(name) for name in self.of_ports()}
        times = {name: format_time(round(limit)) for name, limit in limits.items() if name != "errors"}
        return {"errors": Rate.of(self.errors).in_words()} | times

    def figure(self, name: str, value: float) -> str:
        """The figure that a goal limits, in words that claim no more than it, by the goal's name."""
        match name:
            case "ride":
                return ms_at_least(value)
            case "dead":
                return ms_at_most(value)
            case "scan":
                return say("figure_probability", chance=at_most(value))
            case "heartbeat":
                return say("figure_times_a_year", number=about(at_most(value)))
            case "errors" if value <= self.errors:
                return say("figure_many_errors")
            case _:
                return say("figure_a_year", number=a_year(value))

    def _described(self) -> dict[str, tuple[str, str, str]]:
        every = Rate.of(self.errors)
        rate = every.in_words()
        found = {"errors": (f"errors<={every.form}", say("goal_errors", rate=rate), rate)}
        if self.onsets is not None:
            onsets = Rate.of(self.onsets)
            rate = onsets.in_words()
            found["onsets"] = (f"onsets<={onsets.form}", say("goal_onsets", rate=rate), rate)
        if self.scan is not None:
            limit, chance = format_time(self.scan[0]), f"{self.scan[1]:.12g}"
            values = {"time": limit, "chance": chance}
            words, short = say("goal_scan", **values), say("goal_limit_scan", **values)
            found["scan"] = (f"scan<={limit}@{chance}", words, short)
        if self.dead is not None:
            limit = format_time(self.dead)
            found["dead"] = (f"dead<={limit}", say("goal_dead", time=limit), limit)
        if self.ride:
            time = format_time(self.ride)
            found["ride"] = (f"ride>={time}", say("goal_ride", time=time), time)
        elif "ride" in self.given:
            found["ride"] = ("ride>=0", say("goal_no_ride"), "0 ms")
        if self.heartbeat is not None:
            preset, missed = format_time(self.heartbeat[0]), Rate.of(self.heartbeat[1])
            values = {"time": preset, "rate": missed.in_times()}
            words, short = say("goal_heartbeat", **values), say("goal_limit_heartbeat", **values)
            found["heartbeat"] = (f"heartbeat={preset}@{missed.form}", words, short)
        return found


def _time(text: str, value: str, least: int = 1) -> int:
    try:
        ticks = parse_time(value)
    except ValueError as error:
        raise ValueError(f"is {text!r}, whose time {error}") from None
    if not least <= ticks <= UNIT_TICKS["y"]:
        raise ValueError(f"is {text!r}, whose time must lie between 0 and 1 y")
    return ticks


def _number(text: str, value: str, form: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise ValueError(f"is {text!r}, where {value!r} is not a number; write {form}") from None


def _rate(text: str, value: str, form: str) -> Rate:
    match = _RATE.fullmatch(value.strip())
    if match is None and not re.fullmatch(r"[0-9.eE+-]+", value.strip()):
        raise ValueError(
            f"is {text!r}, where {value!r} is not a rate; write a number and /h, /d or /y: {form}"
        )
    number, unit = match.groups() if match else (value.strip(), None)
    rate = Rate(_number(text, number, form), (unit or "y")[0])
    if not 0 < rate < 1e9:
        raise ValueError(f"is {text!r}, whose rate must be above 0 and below 1e9 a year")
    return rate


def _probability(text: str, value: str | None, form: str) -> float:
    if value is None:
        raise ValueError(f"is {text!r}, without a probability; write {form}")
    probability = _number(text, value, form)
    if not 0 < probability < 1:
        raise ValueError(f"is {text!r}, whose probability must lie between 0 and 1")
    return probability
