"""The parts of a run between which faults and noise come and go, each with its own link."""

from dataclasses import dataclass, replace

from bussim.exact.from_scenario import from_scenario
from bussim.exact.link import LinkModel
from bussim.scenario.fault_kinds import PowerOff
from bussim.scenario.model import ALWAYS, Fault, Noise, Scenario, Window
from bussim.units import format_time
from bussim.words.language import say


@dataclass(frozen=True, slots=True)
class Period:
    """Parts of a run in which a link is the same: ``spans`` of ticks, from and until.

    ``acting`` names the faults and noise that act in the first of them and not in the whole run. Faults that
    damage single frames or characters are left out, as the notes of ``model`` say.
    """

    spans: tuple[tuple[int, int], ...]
    acting: tuple[str, ...]
    model: LinkModel

    def in_words(self) -> str:
        """The times, and what acts in them."""
        times = [
            say("exact_from_to", start=format_time(start), end=format_time(end)) for start, end in self.spans
        ]
        return say("exact_period", times=times, acting=self.acting or [say("exact_undisturbed")])

    def to_json(self, per_second: float) -> dict[str, object]:
        """The times in s, of so many ticks each, and what acts in them."""
        spans = [{"from_s": start / per_second, "until_s": end / per_second} for start, end in self.spans]
        return {"spans": spans, "acting": list(self.acting)}


def periods_of(scenario: Scenario) -> dict[str, tuple[Period, ...]]:
    """The periods of a scenario's N:N links by the names of their buses, in the order of their beginning."""
    windows = [*(fault.window for fault in scenario.faults), *(noise.window for noise in scenario.noise)]
    edges = {0, *(plc.power_on for plc in scenario.plcs)}
    edges |= {tick for window in windows for tick in (window.at, window.until) if tick is not None}
    inside = sorted(edge for edge in edges if 0 <= edge < scenario.duration)
    single = [fault.name for fault in scenario.faults if getattr(fault.kind, "count", None) is not None]
    notes = tuple(say("link_single_frames", name=name) for name in single)
    found: dict[str, dict[LinkModel, Period]] = {}
    for start, end in zip(inside, [*inside[1:], scenario.duration], strict=True):
        for bus, read in from_scenario(_during(scenario, start, end)).items():
            model = replace(read, notes=(*read.notes, *notes))
            known = found.setdefault(bus, {})
            before = known.get(model)
            if before is None:
                known[model] = Period(((start, end),), _acting(scenario, bus, start, end), model)
            elif before.spans[-1][1] == start:
                joined = (*before.spans[:-1], (before.spans[-1][0], end))
                known[model] = replace(before, spans=joined)
            else:
                known[model] = replace(before, spans=(*before.spans, (start, end)))
    return {bus: tuple(known.values()) for bus, known in found.items()}


def _during(scenario: Scenario, start: int, end: int) -> Scenario:
    """A run with what acts from one tick to another as if it acted always, and without the rest."""
    late = tuple(
        Fault(f"late power-on of {plc.name}", PowerOff(plc.name))
        for plc in scenario.plcs
        if plc.power_on > start
    )
    return replace(
        scenario,
        plcs=tuple(replace(plc, power_on=0) for plc in scenario.plcs),
        faults=(*(replace(f, window=ALWAYS) for f in scenario.faults if _lasts(f, start, end)), *late),
        noise=tuple(replace(n, window=ALWAYS) for n in scenario.noise if _covers(n.window, start, end)),
    )


def _lasts(fault: Fault, start: int, end: int) -> bool:
    return getattr(fault.kind, "count", None) is None and _covers(fault.window, start, end)


def _covers(window: Window, start: int, end: int) -> bool:
    return window.at <= start and (window.until is None or window.until >= end)


def _acting(scenario: Scenario, bus: str, start: int, end: int) -> tuple[str, ...]:
    members = {plc.name for plc in scenario.plcs if plc.link is not None and plc.link.bus == bus}

    def here(entry: Fault | Noise) -> bool:
        if isinstance(entry, Noise):
            return entry.target.bus == bus
        return getattr(entry.kind, "bus", None) == bus or getattr(entry.kind, "node", None) in members

    entries: list[Fault | Noise] = [
        *(fault for fault in scenario.faults if _lasts(fault, start, end)),
        *(noise for noise in scenario.noise if _covers(noise.window, start, end)),
    ]
    passing = [e.name for e in entries if here(e) and not _covers(e.window, 0, scenario.duration)]
    late = [plc.name for plc in scenario.plcs if plc.name in members and plc.power_on > start]
    return (*passing, *(say("exact_not_yet_on", name=name) for name in late))
