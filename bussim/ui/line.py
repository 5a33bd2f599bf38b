"""A link's scenario as the fields of a form, and the fields as changes of its text."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, Any, Literal, assert_never, cast

from pydantic import BaseModel, ConfigDict, Field

from bussim.api import examine
from bussim.errors import Problem, UsageError
from bussim.exact.link import TIMEOUT_UNIT
from bussim.plc.link_registers import D_MODE, D_RETRIES, D_SLAVES, D_TIMEOUT, setting_values
from bussim.scenario.loader import Examined
from bussim.scenario.model import BitErrors, Burst, Impulse, Plc, ReplyLoss, Scenario
from bussim.scenario.yaml.edit import edit
from bussim.scenario.yaml.parser import read
from bussim.scenario.yaml.plain import copied
from bussim.ui.guard import Refusal
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND, format_time

#: What a scenario may have that the form does not show.
_BESIDE = ("devices", "latency", "observe")

Data = dict[str, Any]
Number = Annotated[int, Field(ge=0, le=100_000)]
Positive = Annotated[float, Field(gt=0, lt=1e9, allow_inf_nan=False)]
Chance = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
Name = Annotated[str, Field(max_length=10_000)]


class Strict(BaseModel):
    """Plain data of a request; a key that is not known is a mistake."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class Scan(Strict):
    """The PLC scan of one PLC, in ms."""

    mean: Annotated[float, Field(ge=0, lt=1e6)]
    jitter: Annotated[float, Field(ge=0, lt=1e6)] = 0.0


class NoiseIn(Strict):
    """What the form says of the noise of its link: not known, a bit error rate or bursts (times in ms).

    ``counters`` are ``entries`` of a scenario's ``noise``, worked out from counters that were read on site.
    """

    kind: Literal["unknown", "ber", "burst", "counters"]
    ber: Chance = 0.0
    good: Positive = 10_000.0
    bad: Positive = 20.0
    entries: Annotated[list[dict[Name, str | float]], Field(max_length=40)] = []


class Form(Strict):
    """The fields that a user has changed; what is None stays as the text has it.

    ``timeout`` is D8180, ``scan`` the PLC scan of all PLCs of the link (ms), ``scans`` that of single ones.
    ``off`` are the PLCs that are switched off for the whole run.
    """

    name: Name | None = None
    profile: Name | None = None
    stations: Annotated[int, Field(ge=2, le=8)] | None = None
    mode: Number | None = None
    retries: Number | None = None
    timeout: Number | None = None
    scan: Annotated[float, Field(ge=0, lt=1e6)] | None = None
    scans: Annotated[dict[Name, Scan], Field(max_length=8)] = {}
    noise: NoiseIn | None = None
    off: Annotated[list[Name], Field(max_length=8)] | None = None


@dataclass(frozen=True, slots=True)
class Line:
    """A text with the form's changes in it, and the scenario that it is."""

    text: str
    scenario: Scenario
    bus: str
    warnings: tuple[Problem, ...]

    @property
    def members(self) -> dict[int, Plc]:
        """The PLCs of the link by their station, of several with one number the first."""
        found: dict[int, Plc] = {}
        for plc in self.scenario.plcs:
            if plc.link is not None and plc.link.bus == self.bus:
                found.setdefault(plc.registers.get("D8176", 0), plc)
        return found


def line_of(text: str, form: Form, bus: str, name: str, files: Mapping[str, bytes]) -> Line:
    """The line that a form makes of a text; ``bus`` is the link's, "" for the first one.

    Raises ScenarioError with every mistake, those of the text before those that the form makes.
    """
    before = examine(text, name=name, files=files) if files else _alone(text, name)
    scenario = before.get()
    links = scenario.links
    if bus and bus not in links:
        raise Refusal(400, "no_bus", "the scenario has no such link", {"links": links})
    line = Line(text, scenario, bus or next(iter(links), ""), before.warnings)
    if not form.model_fields_set or not line.bus:
        return line
    try:
        changed = edit(text, _changes(line, form))
    except UsageError as error:
        raise Refusal(400, "edit", error.args[0]) from error
    after = examine(changed, name=name, files=files)
    line = Line(changed, after.get(), line.bus, after.warnings)
    found = values_of(line)
    for field in ("stations", "mode", "retries", "timeout"):
        asked = getattr(form, field)
        if asked is not None and found[field] != asked:  # first scan of its program
            raise Refusal(400, "by_program", f"{field}: the master's program sets it", {"field": field})
    return line


@lru_cache(maxsize=4)
def _alone(text: str, name: str) -> Examined:
    """What a text says that names no files: the same at each move of a slider."""
    return examine(text, name=name)


def values_of(line: Line) -> dict[str, Any]:
    """The form's fields as a line has them, and in ``also`` what else is in it."""
    scenario, members = line.scenario, line.members
    master = members.get(0)
    data = _data(line.text)
    found: dict[str, Any] = {
        "name": scenario.name,
        "bus": line.bus,
        "links": scenario.links,
        "also": _also(line, data),
        "duration_s": scenario.duration / TICKS_PER_SECOND,
    }
    if master is None:
        return found
    settings = setting_values(master.profile, master.registers)
    return {
        **found,
        "profile": master.profile.name,
        "stations": settings[D_SLAVES] + 1,
        "mode": settings[D_MODE],
        "retries": settings[D_RETRIES],
        "timeout": settings[D_TIMEOUT],
        "timeout_range": list(master.profile.timeout_range),
        "modes": list(master.profile.modes),
        "scans": [
            {"name": plc.name, "station": number, "mean": _ms(plc.scan.mean), "jitter": _ms(plc.scan.jitter)}
            for number, plc in sorted(members.items())
        ],
        "scan": _ms(max(plc.scan.mean for plc in members.values())),
        "noise": _noise_of(line, data),
        "off": [plc.name for plc in members.values() if _off(plc.name) in _list(data, "faults")],
    }


def field_of(line_path: str) -> str:
    """The field of the form that a path of a scenario belongs to, "" for none."""
    parts = line_path.split(".")
    last = {"slaves": "stations", "mean": "scan", "jitter": "scan"}.get(parts[-1], parts[-1])
    if parts[0] in ("noise", "name"):
        return parts[0]
    # Of a PLC its link and its scan: ports have a timeout, and all else a name, too.
    return last if last in Form.model_fields and parts[2:3] in (["nn"], ["scan"], ["profile"]) else ""


def _also(line: Line, data: Data) -> dict[str, int]:
    """How many things of which kind are in a line beside what the form shows."""
    scenario, own = line.scenario, [_off(plc.name) for plc in line.members.values()]
    found = {
        "faults": sum(fault not in own for fault in _list(data, "faults")),
        "programs": sum(plc.program is not None for plc in scenario.plcs),
        "ports": sum(len(plc.polls) for plc in scenario.plcs),
        **{name: len(_list(data, name)) for name in _BESIDE},
    }
    return {name: many for name, many in found.items() if many}


def _changes(line: Line, form: Form) -> dict[str, object]:
    """What a form changes, by the top keys of the text."""
    before = _data(line.text)
    after = cast("Data", copied(before, "<form>"))
    plcs: dict[str, Data] = {each["name"]: each for each in after.get("plcs", ()) if isinstance(each, dict)}
    master = line.members.get(0)
    if master is None:
        raise Refusal(400, "no_master", "the link has no master, whose settings the form could change")
    added = [] if form.stations is None else _stations(line, after, plcs, form.stations - 1)
    for key, number, value in (
        ("slaves", D_SLAVES, form.stations and form.stations - 1),
        ("mode", D_MODE, form.mode),
        ("retries", D_RETRIES, form.retries),
        ("timeout", D_TIMEOUT, form.timeout),
    ):
        if value is not None:
            _set(plcs[master.name], key, f"D{number}", value)
    own = [name for name in plcs if name in {plc.name for plc in line.members.values()} or name in added]
    for name in own:
        if form.profile is not None:
            plcs[name]["profile"] = form.profile
        if form.scan is not None:
            _set_scan(plcs[name], form.scan)
        if name in form.scans:
            _set_scan(plcs[name], form.scans[name].mean, form.scans[name].jitter)
    if form.noise is not None:
        _set_noise(after, line.bus, form.noise)
    if form.off is not None:
        kept = [fault for fault in _list(after, "faults") if fault not in [_off(name) for name in own]]
        after["faults"] = kept + [_off(name) for name in own if name in form.off]
        if not after["faults"] and "faults" not in before:
            del after["faults"]
    if form.name is not None:
        after["name"] = form.name
    return {key: value for key, value in after.items() if key not in before or before[key] != value}


def _stations(line: Line, data: Data, plcs: dict[str, Data], slaves: int) -> list[str]:
    """Add PLCs for stations that are not there, and take away plain ones at the end that are too many.

    Returns the names of those that were added.
    """
    like = next((plcs[plc.name] for number, plc in sorted(line.members.items()) if number), {})
    master = plcs[line.members[0].name]
    link = like.get("nn") or master.get("nn") or {}
    copy: Data = {key: like[key] for key in ("profile", "scan") if key in like}
    port, added = ({"port": link["port"]} if "port" in link else {}), []
    for number in set(range(1, slaves + 1)) - line.members.keys():
        name = next(name for each in range(number, 999) if (name := f"slave{each}") not in plcs)
        plcs[name] = {"name": name, **copy, "nn": {"bus": line.bus, **port, "station": number}}
        data["plcs"].append(plcs[name])
        added.append(name)
    many = {plc.name: number for number, plc in line.members.items() if number > slaves}
    while (last := data["plcs"][-1])["name"] in many and last.keys() <= {"name", "profile", "scan", "nn"}:
        if repr(last["name"]) in repr([each for key, each in data.items() if key != "plcs"]):
            break  # a fault or noise is about it
        data["plcs"].pop()
        del plcs[last["name"]]
    return added


def _set(plc: Data, key: str, register: str, value: int) -> None:
    """A setting of the master, where its text has it: under ``nn`` or among its registers."""
    if isinstance(plc.get("nn"), dict):
        plc["nn"][key] = format_time(value * TIMEOUT_UNIT) if key == "timeout" else value
    else:
        plc.setdefault("registers", {})[register] = value


def _set_scan(plc: Data, mean: float, jitter: float | None = None) -> None:
    """A PLC scan in ms; without a jitter that stays as it is."""
    old, times = plc.get("scan"), {"mean": _time(mean)} | ({"jitter": _time(jitter)} if jitter else {})
    if jitter is None and isinstance(old, dict):
        times = {**old, **times}
    plc["scan"] = times if len(times) > 1 else times["mean"]


def _set_noise(data: Data, bus: str, noise: NoiseIn) -> None:
    """Noise of the link, in place of all that its text has."""
    entries = _list(data, "noise")
    place = next((place for place, each in enumerate(entries) if each.get("bus") == bus), len(entries))
    own = entries[place] if place < len(entries) and _simple(entries[place]) else {}
    kept: Data = {key: own[key] for key in ("name", "bus") if key in own} or {"bus": bus}
    if noise.kind == "ber":
        made = [{**kept, "ber": noise.ber}]
    elif noise.kind == "burst":
        times = {"good": _time(noise.good), "bad": _time(noise.bad)}
        made = [{**kept, "burst": {**own.get("burst", {}), **times, "ber_bad": noise.ber}}]
    else:
        made = [{**each, "bus": bus} for each in noise.entries if noise.kind == "counters"]
    rest = [each for each in entries[place:] if each.get("bus") != bus]
    if entries or made:
        data["noise"] = [*entries[:place], *made, *rest]


def _noise_of(line: Line, data: Data) -> dict[str, Any]:
    """The noise of a link as the form shows it; ``file``: more than that."""
    entries = [each for each in _list(data, "noise") if each.get("bus") == line.bus]
    if not entries:
        return {"kind": "unknown"}
    (kind, *more) = (each.kind for each in line.scenario.noise if each.target.bus == line.bus)
    if more or not _simple(entries[0]):
        return {"kind": "file"}
    match kind:
        case BitErrors(ber):
            return {"kind": "ber", "ber": ber}
        case Burst(good, bad, _, ber):
            return {"kind": "burst", "ber": ber, "good": _ms(good), "bad": _ms(bad)}
        case Impulse() | ReplyLoss():
            return {"kind": "file"}
        case _:
            assert_never(kind)


def _simple(entry: Data) -> bool:
    kinds = entry.keys() - {"name", "bus"}
    return kinds == {"ber"} or (kinds == {"burst"} and not entry["burst"].get("ber_good"))


def _off(name: str) -> Data:
    return {"power_off": name}


def _list(data: Data, key: str) -> list[Data]:
    found = data.get(key) or []
    return [each for each in found if isinstance(each, dict)] if isinstance(found, list) else []


@lru_cache(maxsize=8)  # the same text at each move of a slider
def _data(text: str) -> Data:
    return cast("Data", copied(read(text, "<text>")[0], "<text>"))


def _time(ms: float) -> str:
    return format_time(round(ms * TICKS_PER_MS))


def _ms(ticks: float) -> float:
    return round(ticks / TICKS_PER_MS, 6)
