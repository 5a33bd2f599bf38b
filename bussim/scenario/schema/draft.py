"""From plain data to the schema's values: every mistake reported, and what is right kept.

An entry with a mistake is read again without the wrong keys, or with others in their stead, so that the
rules can check the rest of it in the same pass. Such an entry remembers what was left out (``cut``); rules
about what is absent leave that alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from bussim.forms.fields import EMPTY, OWN, PlcPoint
from bussim.forms.form import Model
from bussim.scenario.schema.disturbances import FaultIn, NoiseIn
from bussim.scenario.schema.document import (
    MAX_BUSES,
    MAX_DEVICES,
    MAX_FAULTS,
    MAX_NOISE,
    MAX_PLCS,
    MAX_POLLS,
    BusIn,
    DocumentIn,
    PlcIn,
    PortIn,
)
from bussim.scenario.schema.programs import MAX_LATENCIES, LatencyIn
from bussim.scenario.yaml.source_map import Path, Report
from bussim.wording import nearest
from bussim.words.language import say
from bussim.words.tables import recognised
from bussim.words.values import odd, show

if TYPE_CHECKING:
    from bussim.devices.forms import DeviceIn
    from bussim.scenario.schema.polls import TransactionIn

T = TypeVar("T", bound=Model)

#: What one entry of a list that is read by itself looks like, and a mapping of free keys.
_EXAMPLES = {
    "buses": BusIn.example,
    "plcs": PlcIn.example,
    "devices": "{name: feeder1, model: stepper, bus: feeder, station: 1}",
    "polls": "{station: 1, function: 3, address: 0, count: 2, every: 200 ms}",
    "noise": NoiseIn.example,
    "faults": FaultIn.example,
    "latency": LatencyIn.example,
    "observe": "press1.D8201",
    "registers": "{D8176: 1}",
    "ports": f"{{COM3: {PortIn.example}}}",
    "sources": "{M1000: {toggle: 1 s}}",
    "inputs": "{X0: {square: 500 ms}}",
    "power_on": "{press2: 4 s}",
}
#: Stands for the keys that a scenario must have where one of them is wrong, so that others can be read.
_TOP = {"schema": 1, "name": "scenario", "duration": "1 s"}
#: From so many keys on a form is large.
_MANY = 13
#: Sections that may stand empty, as when all of their entries are commented out.
EMPTY_LISTS = frozenset({"buses", "devices", "polls", "noise", "faults", "observe", "latency"})
#: Keys of entries that name a bus, by section.
_NEED_BUSES = {"plcs": ("nn", "ports"), "devices": ("bus",), "noise": ("bus",), "faults": ("cable_cut",)}
EMPTY_MAPPINGS = frozenset({"registers", "ports", "sources", "inputs"})


@dataclass(slots=True)
class Entry(Generic[T]):
    """One entry of a section. ``value`` is None if nothing of it can be used."""

    path: Path
    value: T | None
    raw: object
    cut: tuple[Path, ...] = ()  # keys that were left out because they are wrong

    @property
    def name(self) -> str | None:
        """The name that the file gives it, also if the rest of it is wrong."""
        name = self.raw.get("name") if isinstance(self.raw, dict) else None
        return name if isinstance(name, str) else None

    def lost(self, *keys: str) -> bool:
        """Whether something below one of these keys was wrong, so that nothing follows from its absence."""
        return self.value is None or any(cut[:1] == (key,) for cut in self.cut for key in keys)


def readable(entries: Iterable[Entry[T]]) -> Iterator[tuple[Entry[T], T]]:
    """The entries of which something could be read, each with that."""
    return ((entry, entry.value) for entry in entries if entry.value is not None)


def values_of(entries: Iterable[Entry[T]]) -> list[T]:
    """What could be read of some entries."""
    return [value for _, value in readable(entries)]


@dataclass(slots=True)
class Draft:
    """All that could be read. ``document`` is None if the top-level keys are wrong.

    ``polls`` are those of each PLC and HMI, by the path of their owner; ``observe`` and ``skips`` (what is
    not simulated) are read whatever else is wrong at the top.
    """

    document: DocumentIn | None = None
    observe: list[PlcPoint] = field(default_factory=list)
    skips: bool = False
    buses: list[Entry[BusIn]] = field(default_factory=list)
    plcs: list[Entry[PlcIn]] = field(default_factory=list)
    devices: list[Entry[DeviceIn]] = field(default_factory=list)
    polls: dict[Path, list[Entry[TransactionIn]]] = field(default_factory=dict)
    noise: list[Entry[NoiseIn]] = field(default_factory=list)
    faults: list[Entry[FaultIn]] = field(default_factory=list)
    latency: list[Entry[LatencyIn]] = field(default_factory=list)


def read_draft(data: object, report: Report) -> Draft:
    """Check the form of a whole scenario."""
    draft = Draft()
    if not isinstance(data, dict):
        report.mistake(
            (), say("form_scenario", example=recognised(DocumentIn.example, "example_"), found=show(data))
        )
        return draft
    draft.document, _ = read_form(DocumentIn, data, (), report)
    top = draft.document or read_form(DocumentIn, {**data, **_TOP}, (), Report(report.source_map))[0]
    if top is not None:
        draft.observe, draft.skips = top.observe, top.allow_unsimulated
    draft.buses = _section(lambda _: BusIn, data, ("buses",), (0, MAX_BUSES), report)
    _check_buses_given(data, report)
    least = 0 if data.get("devices") else 1  # an HMI and its slaves need no PLC
    if least and "plcs" not in data:
        report.error(("plcs",), say("form_missing"))
    draft.plcs = _section(lambda _: PlcIn, data, ("plcs",), (least, MAX_PLCS), report)
    if data.get("devices"):
        from bussim.devices.registry import form_of  # what only a scenario with devices pays

        draft.devices = _section(form_of, data, ("devices",), (0, MAX_DEVICES), report)
    draft.noise = _section(lambda _: NoiseIn, data, ("noise",), (0, MAX_NOISE), report)
    draft.faults = _section(lambda _: FaultIn, data, ("faults",), (0, MAX_FAULTS), report)
    draft.latency = _section(lambda _: LatencyIn, data, ("latency",), (0, MAX_LATENCIES), report)
    owners: list[Entry[Any]] = [*draft.plcs, *draft.devices]
    for owner in owners:
        if isinstance(owner.raw, dict) and owner.raw.get("polls"):
            draft.polls[owner.path] = _polls(owner, report)
    return draft


def _check_buses_given(data: dict[Any, Any], report: Report) -> None:
    """PLCs may run their programs by themselves; what is wired to something, or disturbs it, needs a bus."""
    if data.get("buses"):
        return
    for section, keys in _NEED_BUSES.items():
        entries = data.get(section)
        for index, entry in enumerate(entries if isinstance(entries, list) else []):
            key = next((key for key in keys if isinstance(entry, dict) and entry.get(key)), None)
            if key is not None:
                path = (section, index, key)
                found = say("form_empty") if "buses" in data else say("form_missing")
                who = report.source_map.full_name(path)
                report.error(
                    ("buses",), say("form_needs_one", found=found, who=who, where=report.where(path))
                )
                return


def _polls(owner: Entry[Any], report: Report) -> list[Entry[TransactionIn]]:
    from bussim.devices.forms import MasterIn
    from bussim.devices.registry import form_of
    from bussim.scenario.schema.polls import HmiPollIn, PollIn

    if owner.path[0] == "devices" and not issubclass(form_of(owner.raw), MasterIn):
        return []  # it has no polls, which was reported
    form: type[TransactionIn] = PollIn if owner.path[0] == "plcs" else HmiPollIn
    return _section(lambda _: form, owner.raw, (*owner.path, "polls"), (0, MAX_POLLS), report)


def _section(
    form: Callable[[object], type[T]], owner: object, path: Path, size: tuple[int, int], report: Report
) -> list[Entry[T]]:
    """The entries of one list, at ``path``, of the scenario or of a part of it.

    That it is missing, or no list, was reported with its owner.
    """
    items = owner.get(path[-1]) if isinstance(owner, dict) else None
    if not isinstance(items, list):
        return []
    least, most = size
    if not least <= len(items) <= most:
        report.error(path, say("form_entries_between", items=len(items), least=least, most=most))
        return []
    entries = []
    for index, item in enumerate(items):
        value, cut = read_form(form(item), item, (*path, index), report)
        entries.append(Entry((*path, index), value, item, cut))
    return entries


def read_form(model: type[T], raw: object, path: Path, report: Report) -> tuple[T | None, tuple[Path, ...]]:
    """The model of ``raw`` without its wrong keys, and these keys; None if nothing is left of it."""
    data = _prepared(raw)
    pruned: list[Path] = []
    while True:
        try:
            return model.model_validate(data, context=pruned), tuple(pruned)
        except ValidationError as error:
            wrong = []
            for detail in error.errors(include_url=False):
                if not _consequence(detail["type"], detail["loc"], pruned):
                    _explain(model, detail, path, data, report)
                loc = tuple(detail["loc"])
                owner = _model_at(model, loc[:-1])
                stands = loc != () and loc not in pruned and _existing(loc[:-1], data) == loc[:-1]
                if owner is not None and stands and loc[-1] in owner.stand_ins:
                    _put(data, loc, owner.stand_ins[loc[-1]])
                    pruned.append(loc)
                else:
                    wrong.append(_existing(loc, data))
            # A list loses its meaning without one of its entries: cut above the first position.
            cuts = {_above_index(at) for at in wrong}
            if () in cuts:
                return None, ((),)
            for cut in cuts:
                _remove(data, cut)
            pruned.extend(cuts)


def _prepared(value: object, key: str | None = None) -> Any:
    """A copy in which a key without a value cannot be taken for a key that is not given."""
    if isinstance(value, dict):
        return {k: _prepared(v, k) for k, v in value.items()}
    if isinstance(value, list):
        return [_prepared(item) for item in value]
    if value is None:
        if key in EMPTY_LISTS:
            return []
        if key in EMPTY_MAPPINGS:
            return {}
        return EMPTY
    return value


def _existing(loc: Path, data: object) -> Path:
    """The part of an error's location that the data really have (a shorthand has no keys)."""
    for depth, part in enumerate(loc):
        if isinstance(data, list) and isinstance(part, int) and part < len(data):
            data = data[part]
            continue
        if not isinstance(data, dict) or part not in data:
            return loc[:depth]
        data = data[part]
    return loc


def _above_index(path: Path) -> Path:
    for depth, part in enumerate(path):
        if isinstance(part, int):
            return path[:depth]
    return path


def _put(data: Any, path: Path, value: object) -> None:
    for part in path[:-1]:
        data = data[part]
    data[path[-1]] = value


def _remove(data: Any, path: Path) -> None:
    for part in path[:-1]:
        data = data.get(part, {})
    data.pop(path[-1], None)


def _consequence(kind: str, loc: Path, pruned: Sequence[Path]) -> bool:
    """Whether an error is only there because a wrong key was left out."""
    if kind == "missing":
        return any(cut[: len(loc)] == loc or loc[: len(cut)] == cut for cut in pruned)
    return any(cut[: len(loc)] == loc for cut in pruned)


def _explain(model: type[Model], detail: Any, path: Path, data: object, report: Report) -> None:
    """Report one of pydantic's errors in our words."""
    kind, loc, context = detail["type"], tuple(detail["loc"]), detail.get("ctx", {})
    if kind == OWN:
        if context["at"] is not None:
            loc = (*loc, context["at"])
        shown = _existing(loc, data)
        # The name of a missing key is part of its message; a shorthand's invisible key is not.
        at = loc if context["at"] is not None and shown == loc[:-1] else shown
        report.error((*path, *at), say("form_and_hint", text=context["text"], hint=odd(detail["input"])))
    elif kind == "missing":
        shown = _existing(loc[:-1], data)
        if shown == loc[:-1]:
            report.error((*path, *loc), say("form_missing"))
        else:
            report.error((*path, *shown), say("form_lacks", found=show(detail["input"]), missing=loc[-1]))
    elif kind == "extra_forbidden":
        _unknown(model, path, loc, report)
    elif kind in ("too_short", "too_long"):
        low, high = context.get("min_length"), context.get("max_length")
        wanted = say("form_at_least", low=low) if kind == "too_short" else say("form_at_most", high=high)
        report.error(
            (*path, *loc), say("form_entries_allowed", entries=context["actual_length"], wanted=wanted)
        )
    else:
        found = say("form_empty") if detail["input"] is EMPTY else say("form_is", found=show(detail["input"]))
        text = say("form_expected", found=found, expected=_expected(model, loc, kind))
        report.error(
            (*path, *_existing(loc, data)), say("form_and_hint", text=text, hint=odd(detail["input"]))
        )


def _expected(model: type[Model], loc: Path, kind: str) -> str:
    owner, example = _model_at(model, loc), _EXAMPLES.get(str(loc[-1]), "") if loc else ""
    if kind == "list_type":
        example = example or (owner.example if owner is not None else "")
        return say("form_list", example=example) if example else say("form_list_brackets")
    if kind == "string_type":
        return say("form_text")
    if kind.startswith("model") and owner is not None and owner.example:
        return recognised(owner.example, "example_")
    if not kind.startswith(("model", "dict")):
        return say("form_other")
    return say("form_mapping_such", example=example) if example else say("form_mapping")


def _unknown(model: type[Model], path: Path, loc: Path, report: Report) -> None:
    key = str(loc[-1])
    owner = _model_at(model, loc[:-1])
    if not getattr(owner, "known", True):
        return  # a device of an unknown model, whose keys are not known
    allowed = _keys_of(owner)
    elsewhere = [other for other in allowed if key in _keys_of(_model_at(model, (*loc[:-1], other)))]
    if elsewhere:
        hint = say("form_belongs", key_of=elsewhere[0])
    elif path and key != "name" and key in _keys_of(DocumentIn):
        hint = say("form_belongs_top")
    else:
        near = nearest(key, allowed)
        hint = say("form_mean", near=near) if near else ""
    # A part of the many keys of a large form would be of no help beside the one that is meant.
    helps = allowed and not (hint and len(allowed) > _MANY)
    known = say("form_and_allowed", allowed=", ".join(allowed)) if helps else ""
    hint = say("form_hint", hint=hint) if hint else ""
    report.unknown_key((*path, *loc), say("form_no_key", known=known, hint=hint, more=odd(key)))


def _keys_of(model: type[Model] | None) -> list[str]:
    return [] if model is None else [info.alias or name for name, info in model.model_fields.items()]


def _model_at(model: type[Model], loc: Path) -> type[Model] | None:
    """The model that describes what stands at an error's location."""
    found: type[Model] | None = model
    inner = False  # a mapping of freely named keys: the next part is one of them
    for part in loc:
        if inner or isinstance(part, int):  # of a list's entries the form is that of the list
            inner = False
            continue
        if found is None:
            return None
        by_key = {info.alias or name: info for name, info in found.model_fields.items()}
        info = by_key.get(str(part))
        annotation = info.annotation if info is not None else None
        inner = _is_dict(annotation)
        found = _model_in(annotation)
    return found


def _is_dict(annotation: Any) -> bool:
    return getattr(annotation, "__origin__", None) is dict or any(map(_is_dict, get_args(annotation)))


def _model_in(annotation: Any) -> type[Model] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation if issubclass(annotation, Model) else None
    for argument in get_args(annotation):
        found = _model_in(argument)
        if found is not None:
            return found
    return None
