"""The figures of a sizing page: every setting that its sliders reach, worked out beforehand.

All of them are rounded to the safe side here, so that the page shows what is in it and reckons nothing.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bussim.exact.link import TIMEOUT_UNIT, LinkModel
from bussim.exact.scan.outages import clean_scan, longest_scan
from bussim.exact.sizing.choice import Choice, recommend
from bussim.exact.sizing.evaluation import Checked, evaluate_goals
from bussim.exact.sizing.grid import evaluate, worst_of
from bussim.exact.sizing.noise_levels import BAD, LEVELS, scaled_noise, with_level
from bussim.exact.sizing.page.figures import (
    FACTORS,
    LEAST,
    RATES,
    Figures,
    noise_value,
    packed,
    plain_ms,
    rates,
    tenths,
    times,
)
from bussim.exact.sizing.page.ports import port_item
from bussim.exact.sizing.size import Sizing
from bussim.exact.sizing.sized import Sized
from bussim.exact.solve import Solved
from bussim.exact.text import a_year, at_most
from bussim.plc.profiles import MAX_RETRIES, attempts_per_poll
from bussim.units import TICKS_PER_MS

#: The distribution is shown as far as scans at the recommended setting are longer with this probability.
_FAR = 1e-9
#: Most timeouts of a line with bursts, where each setting takes a distribution of its own.
_OF_BURSTS = 8


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


def page_items(sized: Sized, detail: Detail | None = None) -> list[dict[str, Any]]:
    """Each link and each poll list as plain data for :func:`bussim.report.sizing.sizing_page`."""
    detail = detail or Detail()
    links = [_link(bus, sizing, detail) for bus, sizing in sized.links.items()]
    return [*links, *(port_item(node, sizing) for node, sizing in sized.ports.items())]


def _link(bus: str, sizing: Sizing, detail: Detail) -> dict[str, Any]:
    model, goals, best = sizing.model, sizing.goals, sizing.recommended
    item = {
        "kind": "link",
        "name": bus,
        "about": {"stations": len(model.stations) + 1, "mode": model.mode},
        "notes": [*model.not_replying, *model.notes, *sizing.reasons],
        "unmet": [[goals.texts()[name] for name in each.goals] for each in sizing.unmet],
        "remedies": list(sizing.unmet[0].helps if sizing.unmet else ()),
    }
    if not sizing.valid:
        return {**item, "valid": False}
    noises = _noises(model)
    chosen = [recommend(each.model, goals, alone=True) if each.alone else best for each in noises]
    checked = [evaluate_goals(each.model, goals, alone=each.alone) for each in noises]
    wanted = [each.timeout for each in chosen if each is not None]
    many = detail.timeouts if checked[0].memoryless else min(_OF_BURSTS, detail.timeouts)
    timeouts = _some(checked[0].grid.timeouts, many, wanted)
    attempts = [attempts_per_poll(model.reading, retries) for retries in range(MAX_RETRIES + 1)]
    rows = [checked[0].grid.attempts.index(count) for count in attempts]
    columns = [checked[0].grid.timeouts.index(timeout) for timeout in timeouts]

    def figures(name: str) -> Figures:
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
    met = [np.array([each.met[name][np.ix_(rows, columns)] for each in checked]) for name in names]
    missed = np.sum([(~each).astype(int) << bit for bit, each in enumerate(met)], axis=0)
    texts = goals.texts()
    return {
        **item,
        "valid": True,
        "least": plain_ms(sizing.floor),
        "retries": list(range(MAX_RETRIES + 1)),
        "attempts": attempts,
        "timeouts": [plain_ms(timeout) for timeout in timeouts],
        "units": [timeout // TIMEOUT_UNIT for timeout in timeouts],
        "noises": [{"name": each.name, "value": noise_value(each.name, each.value)} for each in noises],
        "start": [*_place(chosen[judged], timeouts), judged],
        "recommended": [None if each is None else _place(each, timeouts) for each in chosen],
        "goals": [{"name": name, "text": texts[name]} for name in names],
        "beside": [text for name, text in texts.items() if name not in names and best and name != "ride"],
        "missed": packed(missed),
        "figures": {
            "mean": times(figures("mean")),
            "longest": times(np.array([longest], dtype=np.float64)),
            "dead": times(figures("one_dead")),
            "detect": times(figures("detect_mean")),
            "detect_longest": times(figures("detect_longest")),
            "errors": rates(figures("errors"), goals.errors),
            "ride": packed(np.floor(np.round(figures("silence") / TICKS_PER_MS, 6))),
        },
        "x": [0, *(plain_ms(deadline) for deadline in x)],
        "over": _laws(over.transpose(0, 2, 3, 1)),
        "program": [f"LD {model.set_under}", "MOV K{retries} D8179", "MOV K{units} D8180"],
        "assumptions": [
            {
                "text": [each.name, each.alternative],
                "stays": _setting(each.instead) == _setting(best),
                "setting": _setting(each.instead),
                "errors": a_year(each.otherwise.errors, goals.errors),
                "dead": tenths(each.otherwise.dead),
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
            for rate in RATES
        ]
    multiples = [_Noise("times", factor, scaled_noise(model, factor)) for factor in FACTORS]
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


def _setting(choice: Choice | None) -> list[int] | None:
    return None if choice is None else [choice.retries, choice.d8180]


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


def _laws(over: Figures) -> Any:
    """Rows of probabilities, as how many are certain and the others up to the last above :data:`LEAST`."""
    if over.ndim > 1:
        return [_laws(each) for each in over]
    shown = [at_most(p) for p in over.tolist() if p >= LEAST]
    certain = shown.count(1.0)
    return [certain, *shown[certain:]]
