"""Goals that no setting meets: by how much they are missed, and what would help."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from bussim.engines.nn.frames import data_chars
from bussim.exact.link import TIMEOUT_UNIT, LineNoise, LinkModel, frame_ticks
from bussim.exact.sizing.evaluation import Checked, Mask, evaluate_goals, least, rows_of
from bussim.exact.sizing.goals import Goals
from bussim.units import TICKS_PER_MS
from bussim.wording import about

#: How much less noise is tried.
_LESS = (2, 5, 10, 20, 50, 100, 1_000, 10_000)


@dataclass(frozen=True, slots=True)
class Unmet:
    """What cannot be met: one goal by itself, or several only together.

    ``goals`` are names, ``text`` says it with numbers, ``helps`` what would make all goals possible.
    """

    goals: tuple[str, ...]
    text: str
    helps: tuple[str, ...]

    def to_json(self) -> dict[str, object]:
        """As plain data."""
        return {"goals": list(self.goals), "text": self.text, "helps": list(self.helps)}


def unmet_goals(model: LinkModel, goals: Goals, checked: Checked) -> tuple[Unmet, ...]:
    """Why no setting meets all goals: each goal that fails alone, else the fewest that fail together."""
    index = sorted(set(rows_of(checked, model.reading)))
    met = {name: mask[index] & checked.grid.valid for name, mask in checked.met.items()}
    if goals.heartbeat is not None:
        met["heartbeat"] = _heartbeats(checked, index, np.logical_and.reduce(list(met.values())))
    texts = goals.texts()
    helps = tuple(_helps(model, goals, checked))
    alone = [name for name, mask in met.items() if not mask.any()]
    if alone:
        every = np.broadcast_to(checked.grid.valid, next(iter(met.values())).shape)
        return tuple(
            Unmet((name,), f"{texts[name]}: no setting does; {_best(checked, index, name, every)}", helps)
            for name in alone
        )
    for size in range(2, len(met) + 1):
        for names in combinations(met, size):
            if not np.logical_and.reduce([met[name] for name in names]).any():
                return (Unmet(names, _conflict(checked, index, names, met, texts), helps),)
    return ()


def _heartbeats(checked: Checked, index: list[int], others: Mask) -> Mask:
    """Where a heartbeat is met, looked at with two timeouts for each number of attempts.

    These are the shortest one, and the shortest one that meets the other goals.
    """
    met = np.zeros(others.shape, dtype=np.bool_)
    for row, attempts in enumerate(index):
        columns = {int(np.argmax(checked.grid.valid)), *np.nonzero(others[row])[0][:1].tolist()}
        for column in columns:
            met[row, column] = checked.heartbeat_met(attempts, column)
    return met


def _conflict(
    checked: Checked, index: list[int], names: tuple[str, ...], met: dict[str, Mask], texts: dict[str, str]
) -> str:
    parts = []
    for name in names:
        others = np.logical_and.reduce([met[other] for other in names if other != name])
        given = " and ".join(texts[other] for other in names if other != name)
        parts.append(f"with {given}, {_best(checked, index, name, others)}")
    return f"{' and '.join(texts[name] for name in names)}: not together; {'; '.join(parts)}"


def _best(checked: Checked, index: list[int], name: str, among: Mask) -> str:
    """The best value that a goal's figure has among settings, and where."""
    every = checked.missed if name == "heartbeat" else checked.values[name]
    values = np.where(among, every[index], np.nan)
    if np.isnan(values).all():
        return "nothing better was found"
    place = int(np.nanargmax(values) if name == "ride" else np.nanargmin(values))
    row, column = divmod(place, values.shape[1])
    value = float(values[row, column])
    attempts = checked.grid.attempts[index[row]]
    d8180 = checked.grid.timeouts[column] // TIMEOUT_UNIT
    shown = {
        "errors": lambda: f"{about(value)} false station errors a year",
        "scan": lambda: f"a probability of {value:.1e}",
        "dead": lambda: f"{about(value / TICKS_PER_MS)} ms",
        "ride": lambda: f"{about(value / TICKS_PER_MS)} ms",
        "heartbeat": lambda: f"{about(value)} times a year",
    }[name]()
    return f"the best is {shown} (attempts {attempts}, D8180 {d8180})"


# -- what would help ------------------------------------------------------------------------------


def _helps(model: LinkModel, goals: Goals, checked: Checked) -> Iterator[str]:
    """Each single change that makes all goals possible, the smallest of its kind, with a setting."""
    for count in range(len(model.stations) - 1, 0, -1):
        fewer = replace(model, stations=model.stations[:count])
        if fewer.alive and (found := _possible(fewer, goals)):
            yield f"{count + 1} stations on the link instead of {len(model.stations) + 1} ({found})"
            break
    for mode in range(model.mode - 1, -1, -1):
        if found := _possible(with_mode(model, mode), goals):
            yield f"refresh mode {mode} instead of {model.mode} ({found})"
            break
    for factor in _LESS:
        if found := _possible(scaled_noise(model, 1 / factor), goals):
            yield f"{factor:,} times less noise ({found})"
            break
    if goals.ride is not None:
        index = rows_of(checked, model.reading)
        others = [mask for name, mask in checked.met.items() if name != "ride"]
        among = (np.logical_and.reduce(others) & checked.grid.valid)[index]
        if among.any() and (ride := float(checked.grid.silence[index][among].max())) > 0:
            less, wanted = about(ride / TICKS_PER_MS), about(goals.ride / TICKS_PER_MS)
            yield f"outages of at most {less} ms instead of {wanted} ms"


def _possible(model: LinkModel, goals: Goals) -> str | None:
    checked = evaluate_goals(model, goals)
    chosen = least([(checked, rows_of(checked, model.reading))])
    if chosen is None:
        return None
    return f"then D8179 {chosen[0]}, D8180 {checked.grid.timeouts[chosen[1]] // TIMEOUT_UNIT}"


def with_mode(model: LinkModel, mode: int) -> LinkModel:
    """The same link in another refresh mode."""
    ratio = frame_ticks(data_chars(mode)) / frame_ticks(data_chars(model.mode))
    return replace(
        model,
        mode=mode,
        data=round(model.data * ratio),
        stations=tuple(replace(s, reply=round(s.reply * ratio)) for s in model.stations),
    )


def scaled_noise(model: LinkModel, factor: float) -> LinkModel:
    """The same link with all bit error rates and losses times a factor, none above 1."""

    def scaled(chance: float) -> float:
        return min(1.0, chance * factor)

    sources = tuple(
        replace(source, good=scaled(source.good), bad=scaled(source.bad)) for source in model.noise.sources
    )
    return replace(
        model,
        noise=LineNoise(sources, model.noise.chains),
        stations=tuple(replace(station, loss=scaled(station.loss)) for station in model.stations),
    )
