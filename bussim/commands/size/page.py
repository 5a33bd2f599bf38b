"""The figures of a sizing page: every setting that its sliders reach, worked out beforehand.

All of them are rounded to the safe side here, so that the page shows what is in it and reckons nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from bussim.exact.link import TIMEOUT_UNIT, LinkModel
from bussim.exact.polls.failures import failures
from bussim.exact.polls.metrics import Dead
from bussim.exact.polls.poll_list import PollModel
from bussim.exact.scan.outages import clean_scan, longest_scan
from bussim.exact.sizing.choice import Choice, recommend
from bussim.exact.sizing.evaluation import Checked, evaluate_goals
from bussim.exact.sizing.goals import Goals
from bussim.exact.sizing.grid import evaluate, worst_of
from bussim.exact.sizing.noise_levels import BAD, LEVELS, scaled_noise, with_level
from bussim.exact.sizing.ports.setting import PortSetting, at_level, setting_of
from bussim.exact.sizing.ports.size import MOST_RETRIES, PortSizing
from bussim.exact.sizing.size import Sizing
from bussim.exact.sizing.sized import Sized
from bussim.exact.solve import Solved
from bussim.exact.text import a_year, at_most
from bussim.plc.ports.cpavl import TIMEOUT_UNIT as PORT_UNIT
from bussim.plc.profiles import MAX_RETRIES, attempts_per_poll
from bussim.units import TICKS_PER_MS

#: Multiples of the noise as entered, and bit error rates where none is: the assumed levels and ten and a
#: hundred times the worst of them.
_FACTORS = (0.1, 1.0, 10.0, 100.0)
_RATES = (*LEVELS.values(), 10 * LEVELS[BAD], 100 * LEVELS[BAD])
#: Errors a year and probabilities below this are shown as none.
_LEAST = 1e-9
#: The distribution is shown as far as scans at the recommended setting are longer with this probability.
_FAR = 1e-9
#: Most timeouts of a line with bursts, where each setting takes a distribution of its own.
_OF_BURSTS = 8

_Figures = np.ndarray[Any, np.dtype[np.float64]]


@dataclass(frozen=True, slots=True)
class Detail:
    """How many timeouts (of a link that has hundreds) and points of the distribution a page has."""

    timeouts: int = 24
    points: int = 40


@dataclass(frozen=True, slots=True)
class _Noise:
    """One position of the slider for noise: its name, the figure in it, and the link there.

    ``alone`` is false where the level bad counts beside it, as ``size`` takes it.
    """

    name: str
    value: float
    model: LinkModel
    alone: bool = True

    def checked(self, goals: Goals) -> Checked:
        """All settings there."""
        return evaluate_goals(self.model, goals, alone=self.alone)


def page_items(sized: Sized, detail: Detail | None = None) -> list[dict[str, Any]]:
    """Each link and each poll list as plain data for :func:`bussim.report.sizing.sizing_page`."""
    detail = detail or Detail()
    links = [_link(bus, sizing, detail) for bus, sizing in sized.links.items()]
    return [*links, *(_port(node, sizing) for node, sizing in sized.ports.items())]


def _link(bus: str, sizing: Sizing, detail: Detail) -> dict[str, Any]:
    model, goals, best = sizing.model, sizing.goals, sizing.recommended
    item = {
        "kind": "link",
        "name": bus,
        "about": {"stations": len(model.stations) + 1, "mode": model.mode},
        "notes": [*model.not_replying, *model.notes, *sizing.reasons],
        "unmet": [[goals.forms()[name] for name in each.goals] for each in sizing.unmet],
        "remedies": list(sizing.unmet[0].helps if sizing.unmet else ()),
    }
    if not sizing.valid:
        return {**item, "valid": False}
    noises = _noises(model)
    chosen = [
        sizing.recommended if not each.alone else recommend(each.model, goals, alone=True) for each in noises
    ]
    checked = [each.checked(goals) for each in noises]
    wanted = [each.timeout for each in chosen if each is not None]
    many = detail.timeouts if checked[0].memoryless else min(_OF_BURSTS, detail.timeouts)
    timeouts = _some(checked[0].grid.timeouts, many, wanted)
    attempts = [attempts_per_poll(model.reading, retries) for retries in range(MAX_RETRIES + 1)]
    rows = [checked[0].grid.attempts.index(count) for count in attempts]
    columns = [checked[0].grid.timeouts.index(timeout) for timeout in timeouts]

    def figures(name: str) -> _Figures:
        grids = [getattr(each.grid, name) for each in checked]
        return np.array([grid[np.ix_(rows, columns)] for grid in grids])

    judged = next(place for place, each in enumerate(noises) if not each.alone)
    longest = [
        [max(longest_scan(line.with_setting(count, timeout)) for line in model.lines) for timeout in timeouts]
        for count in attempts
    ]
    x = _deadlines(checked[judged], chosen[judged], attempts[-1], timeouts[0], detail.points)
    laws = [
        worst_of(evaluate(view, sorted(set(attempts)), timeouts, x, details=False) for view in each.views)
        for each in checked
    ]
    kept = [laws[0].attempts.index(count) for count in attempts]
    over = np.array([[law.over[deadline][kept] for deadline in x] for law in laws])
    names = list(checked[0].met)
    missed = [
        sum((~each.met[name][np.ix_(rows, columns)]).astype(int) << bit for bit, name in enumerate(names))
        for each in checked
    ]
    forms = goals.forms()
    return {
        **item,
        "valid": True,
        "least": _ms(sizing.floor),
        "retries": list(range(MAX_RETRIES + 1)),
        "attempts": attempts,
        "timeouts": [_ms(timeout) for timeout in timeouts],
        "units": [timeout // TIMEOUT_UNIT for timeout in timeouts],
        "noises": [{"name": each.name, "value": _shown(each.name, each.value)} for each in noises],
        "start": [*_place(chosen[judged], timeouts), judged],
        "recommended": [None if each is None else _place(each, timeouts) for each in chosen],
        "goals": [{"name": name, "form": forms[name]} for name in names],
        "missed": _packed(np.array(missed)),
        "figures": {
            "mean": _times(figures("mean")),
            "longest": _times(np.array([longest], dtype=np.float64)),
            "dead": _times(figures("one_dead")),
            "detect": _times(figures("detect_mean")),
            "detect_longest": _times(figures("detect_longest")),
            "errors": _rates(figures("errors"), goals.errors),
            "ride": _packed(np.floor(np.round(figures("silence") / TICKS_PER_MS, 6))),
        },
        "x": [0, *(_ms(deadline) for deadline in x)],
        "over": _laws(over.transpose(0, 2, 3, 1)),
        "program": [
            f"LD {model.set_under}",
            "MOV K{retries} D8179",
            "MOV K{units} D8180",
        ],
        "assumptions": [
            {
                "text": [each.name, each.alternative],
                "stays": best is not None
                and each.instead is not None
                and _setting(each.instead) == _setting(best),
                "setting": None if each.instead is None else [each.instead.retries, each.instead.d8180],
                "errors": a_year(each.otherwise.errors, goals.errors),
                "dead": _tenths(each.otherwise.dead),
                "ride": math.floor(each.otherwise.ride / TICKS_PER_MS),
            }
            for each in sizing.assumptions
        ],
    }


def _noises(model: LinkModel) -> list[_Noise]:
    if not model.noisy:
        return [
            _Noise("assumed", rate, model, alone=False)
            if rate == LEVELS[BAD]
            else _Noise("rate", rate, with_level(model, rate))
            for rate in _RATES
        ]
    multiples = [_Noise("times", factor, scaled_noise(model, factor)) for factor in _FACTORS]
    return [
        _Noise("judged", LEVELS[BAD], model, alone=False),
        *multiples,
        _Noise("unknown", LEVELS[BAD], with_level(model, LEVELS[BAD])),
    ]


def _some(every: Sequence[int], most: int, wanted: Iterable[int]) -> list[int]:
    """So many of the timeouts, the short ones close together, and all that are wanted."""
    places = np.unique(np.geomspace(1, len(every), most).astype(np.int64)) - 1
    return sorted({*(every[place] for place in places.tolist()), *wanted})


def _place(choice: Choice | None, timeouts: Sequence[int]) -> list[int]:
    return [MAX_RETRIES, 0] if choice is None else [choice.retries, timeouts.index(choice.timeout)]


def _setting(choice: Choice) -> tuple[int, int]:
    return choice.retries, choice.timeout


def _deadlines(
    checked: Checked, best: Choice | None, most: int, timeout: int, points: int
) -> tuple[int, ...]:
    """Link scan times for the axis of the distribution: from the shortest to twice the longest usual."""
    setting = (most, timeout) if best is None else (best.attempts, best.timeout)
    laws = [Solved(view.with_setting(*setting)).distribution for view in checked.views]
    least = min(clean_scan(view, slowest=False) for view in checked.views)
    far = max(2 * max(law.quantile(_FAR) for law in laws), 2.0 * least)
    unit = TICKS_PER_MS // 10
    return tuple(sorted({round(x / unit) * unit for x in np.geomspace(least, far, points).tolist()}))


def _port(node: str, sizing: PortSizing) -> dict[str, Any]:
    model, goals, best = sizing.model, sizing.goals, sizing.recommended
    item = {
        "kind": "port",
        "name": node,
        "about": {"protocol": model.protocol, "bus": model.bus, "polls": len(model.polls)},
        "notes": list(sizing.reasons),
        "unmet": [[goals.form_of(name) for name in each.goals] for each in sizing.unmet],
        "remedies": [each.in_words() for each in sizing.remedies],
    }
    if not sizing.valid:
        return {**item, "valid": False}
    timeouts = sorted({each.timeout for each in sizing.table} | ({best.timeout} if best else set()))
    interval = sizing.table[0].interval if best is None else best.interval
    settings = [
        [setting_of(model, timeout, retries, interval) for timeout in timeouts]
        for retries in range(MOST_RETRIES + 1)
    ]
    noisy = any(poll.hits or poll.loss for poll in model.polls)
    noises = [("judged" if noisy else "assumed", LEVELS[BAD], None), *_port_noises(noisy=noisy)]
    noises.sort(key=lambda each: 0.0 if noisy else each[1])

    def figures(of: Callable[[PortSetting], float | None]) -> _Figures:
        return np.array([[[math.nan if (v := of(each)) is None else v for each in row] for row in settings]])

    errors = np.array(
        [[[_failed(each, change) for each in row] for row in settings] for _, _, change in noises]
    )
    names = goals.of_ports()
    missed = np.array(
        [
            [
                [
                    sum(
                        (not (failed if name == "errors" else each.value(name)) <= goals.limit(name)) << bit
                        for bit, name in enumerate(names)
                    )
                    for each, failed in zip(row, own, strict=True)
                ]
                for row, own in zip(settings, level, strict=True)
            ]
            for level in errors
        ]
    )
    start = [MOST_RETRIES, 0] if best is None else [best.retries, timeouts.index(best.timeout)]
    kept = dict.fromkeys((*([best.timeout] if best else []), sizing.least))
    tried = [timeouts.index(timeout) for timeout in kept if timeout in timeouts]
    costly = max(settings[0][0].figures.dead, key=lambda each: each.mean, default=None)
    judged = next(place for place, (_, _, change) in enumerate(noises) if change is None)
    each_timeout = [replace(sizing, recommended=setting) for setting in settings[0]]
    return {
        **item,
        "valid": True,
        "least": _ms(sizing.least),
        "retries": list(range(MOST_RETRIES + 1)),
        "attempts": list(range(1, MOST_RETRIES + 2)),
        "timeouts": [_ms(timeout) for timeout in timeouts],
        "units": [timeout // PORT_UNIT for timeout in timeouts],
        "noises": [{"name": name, "value": _shown(name, value)} for name, value, _ in noises],
        "start": [*start, judged],
        "recommended": [_cheapest(level, tried) for level in missed],
        "goals": [{"name": name, "form": goals.form_of(name)} for name in names],
        "missed": _packed(missed),
        "figures": {
            "mean": _times(figures(lambda each: each.cycle)),
            "dead": _times(figures(lambda each: each.dead)),
            "dead_longest": _times(figures(lambda each: each.dead_longest)),
            "two_dead": _times(figures(lambda each: each.two_dead)),
            "errors": _rates(errors, goals.errors),
            "age": _times(figures(lambda each: each.age)),
            "lost": _times(figures(lambda each: _lost(each, costly))),
        },
        "reason": next((each.reason for row in settings for each in row if each.reason), ""),
        "costly": None if costly is None else [costly.devices[0], len(costly.polls)],
        "polls": [
            [one.poll.name, one.poll.device, _tenths(one.response.least), _tenths(one.response.most)]
            for one in settings[0][0].figures.polls
        ],
        "program": [
            line.partition("  ;")[0].replace(
                f"K{timeouts[0] // PORT_UNIT} ", "K{units} ", 1 if at == 1 else 0
            )
            for at, line in enumerate(each_timeout[0].mov_lines())
        ],
        "pymodbus": [each.pymodbus().replace("retries=0", "retries={retries}") for each in each_timeout],
        "assumptions": [],
    }


def _lost(setting: PortSetting, costly: Dead | None) -> int | None:
    """What the attempts at a dead device cost in a cycle."""
    found = (each.lost for each in setting.figures.dead if costly and each.devices == costly.devices)
    return next(found, None)


def _cheapest(missed: np.ndarray[Any, Any], columns: Sequence[int]) -> list[int] | None:
    """The first setting that misses no goal: fewest retries, then in the order of the timeouts' columns."""
    met = ([retries, column] for retries, row in enumerate(missed) for column in columns if not row[column])
    return next(met, None)


def _port_noises(*, noisy: bool) -> Iterator[tuple[str, float, Callable[[PollModel], PollModel]]]:
    """Noise alone, as a change of each poll."""
    if noisy:
        for factor in _FACTORS:
            yield (
                "times",
                factor,
                partial(_times_as_noisy, factor),
            )
    for rate in (LEVELS[BAD],) if noisy else [rate for rate in _RATES if rate != LEVELS[BAD]]:
        name = "unknown" if noisy else "rate"
        yield name, rate, partial(at_level, ber=rate)


def _times_as_noisy(factor: float, poll: PollModel) -> PollModel:
    hits = tuple((bits, min(0.5, factor * ber)) for bits, ber in poll.hits)
    return replace(poll, hits=hits, loss=min(1.0, factor * poll.loss))


def _failed(setting: PortSetting, change: Callable[[PollModel], PollModel] | None) -> float:
    """Failed turns a year with another noise, None for that which ``size`` takes."""
    if change is None or math.isnan(setting.errors):
        return setting.errors
    model = replace(setting.figures.model, noise_reasons=())
    return math.fsum(
        failures(model, change(one.poll), one.failures.a_year).failed_a_year
        for one in setting.figures.polls
        if one.failures is not None and one.poll.device
    )


def _shown(name: str, value: float) -> float:
    """A multiple of the noise as such, a rate as one wrong bit in so many."""
    return value if name == "times" else round(1 / value)


def _ms(ticks: float) -> float | int:
    found = ticks / TICKS_PER_MS
    return int(found) if found == int(found) else round(found, 3)


def _tenths(ticks: float) -> float:
    """A time in tenths of a ms, rounded up."""
    return math.ceil(round(10 * ticks / TICKS_PER_MS, 6)) / 10


def _laws(over: _Figures) -> Any:
    """Rows of probabilities, as how many are certain and the others up to the last above :data:`_LEAST`."""
    if over.ndim > 1:
        return [_laws(each) for each in over]
    shown = [at_most(p) for p in over.tolist() if p >= _LEAST]
    certain = shown.count(1.0)
    return [certain, *shown[certain:]]


def _times(ticks: _Figures) -> list[Any]:
    return _packed(np.ceil(np.round(10 * ticks / TICKS_PER_MS, 6)) / 10)


def _rates(a_year_each: _Figures, goal: float) -> list[Any]:
    """Errors a year as ``size`` prints them, those of less than one in 1e9 years as none."""
    return _packed(
        _each(
            a_year_each, lambda value: float(a_year(value, goal).replace(",", "")) if value >= _LEAST else 0.0
        )
    )


def _each(values: _Figures, change: Callable[[float], float]) -> _Figures:
    flat = [value if math.isnan(value) else change(value) for value in values.ravel().tolist()]
    return np.array(flat).reshape(values.shape)


def _packed(values: np.ndarray[Any, Any]) -> list[Any]:
    """As nested lists; of an axis along which nothing changes only the first."""
    for axis in range(values.ndim):
        first = values.take([0], axis)
        if np.array_equal(np.broadcast_to(first, values.shape), values, equal_nan=values.dtype.kind == "f"):
            values = first
    return [_plain(each) for each in values.tolist()]


def _plain(value: Any) -> Any:
    if isinstance(value, list):
        return [_plain(each) for each in value]
    if isinstance(value, float):
        return None if math.isnan(value) else int(value) if value == int(value) and value < 1e15 else value
    return value
