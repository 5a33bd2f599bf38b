"""The figures of a sizing page that are of a Modbus poll list."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from operator import methodcaller
from typing import Any

import numpy as np

from bussim.exact.polls.failures import failures
from bussim.exact.polls.metrics import Dead
from bussim.exact.polls.poll_list import PollModel
from bussim.exact.sizing.noise_levels import BAD, LEVELS
from bussim.exact.sizing.page.figures import (
    FACTORS,
    RATES,
    Figures,
    noise_value,
    packed,
    plain_ms,
    rates,
    tenths,
    times,
)
from bussim.exact.sizing.ports.setting import PortSetting, at_level, setting_of
from bussim.exact.sizing.ports.size import MOST_RETRIES, PortSizing
from bussim.plc.ports.cpavl import TIMEOUT_UNIT


def port_item(node: str, sizing: PortSizing) -> dict[str, Any]:
    """One poll list for the page, with all its settings."""
    model, goals, best = sizing.model, sizing.goals, sizing.recommended
    item = {
        "kind": "port",
        "name": node,
        "about": {"protocol": model.protocol, "bus": model.bus, "polls": len(model.polls)},
        "notes": list(sizing.reasons),
        "unmet": [[goals.port_texts()[name] for name in each.goals] for each in sizing.unmet],
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

    def figures(of: Callable[[PortSetting], float | None]) -> Figures:
        return np.array([[[math.nan if (v := of(each)) is None else v for each in row] for row in settings]])

    errors = np.array(
        [[[_failed(each, change) for each in row] for row in settings] for _, _, change in noises]
    )
    names = goals.of_ports()
    values = {name: figures(methodcaller("value", name)) for name in names} | {"errors": errors}
    met = [np.broadcast_to(values[name] <= goals.limit(name), errors.shape) for name in names]
    missed = np.sum([(~each).astype(int) << bit for bit, each in enumerate(met)], axis=0)
    start = [MOST_RETRIES, 0] if best is None else [best.retries, timeouts.index(best.timeout)]
    tried = [timeouts.index(sizing.least)] if best is None else [start[1], timeouts.index(sizing.least)]
    costly = max(settings[0][0].figures.dead, key=lambda each: each.mean, default=None)
    judged = next(place for place, (_, _, change) in enumerate(noises) if change is None)
    each_timeout = [replace(sizing, recommended=setting) for setting in settings[0]]
    return {
        **item,
        "valid": True,
        "least": plain_ms(sizing.least),
        "interval": plain_ms(interval),
        "retries": list(range(MOST_RETRIES + 1)),
        "attempts": list(range(1, MOST_RETRIES + 2)),
        "timeouts": [plain_ms(timeout) for timeout in timeouts],
        "units": [timeout // TIMEOUT_UNIT for timeout in timeouts],
        "noises": [{"name": name, "value": noise_value(name, value)} for name, value, _ in noises],
        "start": [*start, judged],
        "recommended": [_cheapest(level, tried) for level in missed],
        "goals": [{"name": name, "text": goals.port_texts()[name]} for name in names],
        "missed": packed(missed),
        "figures": {
            "mean": times(figures(lambda each: each.cycle)),
            "dead": times(figures(lambda each: each.dead)),
            "dead_longest": times(figures(lambda each: each.dead_longest)),
            "two_dead": times(figures(lambda each: each.two_dead)),
            "errors": rates(errors, goals.errors),
            "age": times(figures(lambda each: each.age)),
            "lost": times(figures(lambda each: _lost(each, costly))),
        },
        "reason": next((each.reason for row in settings for each in row if each.reason), ""),
        "costly": None if costly is None else [costly.devices[0], len(costly.polls)],
        "polls": [
            [one.poll.name, one.poll.device, tenths(one.response.least), tenths(one.response.most)]
            for one in settings[0][0].figures.polls
        ],
        "program": [
            line.partition("  ;")[0].replace(
                f"K{timeouts[0] // TIMEOUT_UNIT} ", "K{units} ", 1 if at == 1 else 0
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
        for factor in FACTORS:
            yield "times", factor, partial(_times_as_noisy, factor)
    for rate in (LEVELS[BAD],) if noisy else [rate for rate in RATES if rate != LEVELS[BAD]]:
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
