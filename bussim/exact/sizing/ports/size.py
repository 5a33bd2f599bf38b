"""Which timeout, retries and interval a port's poll list should have: what ``bussim size`` prints of it."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, product

from bussim.exact.polls.from_scenario import poll_lists
from bussim.exact.polls.poll_list import PollListModel
from bussim.exact.sizing.goals import Goals
from bussim.exact.sizing.ports.setting import (
    MOST_UNITS,
    PortSetting,
    intervals,
    least_timeout,
    setting_of,
    timeout_unit,
    top_of_step,
)
from bussim.exact.sizing.unmet_goals import Unmet, smallest_sets
from bussim.exact.text import a_year, in_ms, ms, ms_at_most
from bussim.plc.ports.cpavl import DEFAULT_INTERVAL, INTERVAL, INTERVAL_UNIT, TIMEOUT, TIMEOUT_UNIT
from bussim.scenario.fault_kinds import Slow
from bussim.scenario.model import Scenario
from bussim.units import TICKS_PER_MS
from bussim.words.language import say

#: Retries that are looked at, and steps of timeouts in the table.
MOST_RETRIES, _STEPS = 10, 3
#: What a device that is off is asked in, as a remedy.
_SKIP = 10
#: Rates that are tried where a higher one might help.
_BAUDS = (19200, 38400, 57600, 115200)


@dataclass(frozen=True, slots=True)
class Remedy:
    """A change with which a setting meets all goals, and that setting."""

    text: str
    setting: PortSetting

    def in_words(self) -> str:
        """The change, the setting, and what it gives."""
        found = self.setting
        times = {"timeout": ms(found.timeout), "interval": ms(found.interval)}
        setting = say("help_port_setting", **times, retries=found.retries)
        if found.cycle is not None:
            setting = say("help_port_cycle", setting=setting, cycle=ms_at_most(found.cycle))
        if found.dead is not None:
            setting = say("help_port_dead", setting=setting, dead=ms_at_most(found.dead))
        if found.dead_longest is not None and found.dead_longest > (found.dead or 0):
            setting = say("help_port_longest", setting=setting, longest=ms_at_most(found.dead_longest))
        return say("help_then", change=self.text, setting=setting)


@dataclass(frozen=True, slots=True)
class PortSizing:
    """A recommendation for one poll list, or why there is none. Times in ticks.

    ``least`` is the least timeout that no response outlasts; ``table`` has settings by timeout and retries.
    """

    model: PollListModel
    goals: Goals
    reasons: tuple[str, ...] = ()
    least: int = 0
    recommended: PortSetting | None = None
    table: tuple[PortSetting, ...] = ()
    unmet: tuple[Unmet, ...] = ()
    remedies: tuple[Remedy, ...] = ()

    @property
    def valid(self) -> bool:
        """Whether the list can be sized."""
        return not self.reasons

    def mov_lines(self) -> list[str]:
        """Instructions that set the words of a PLC's port, with what they mean behind a semicolon."""
        best, words = self.recommended, self.model.words
        if best is None or words is None:
            return []
        lines = {
            "LD M8002": say("mov_port_first"),
            f"MOV K{best.timeout // TIMEOUT_UNIT} D{words + TIMEOUT}": say(
                "mov_timeout", time=ms(best.timeout)
            ),
            f"MOV K{best.interval // INTERVAL_UNIT} D{words + INTERVAL}": say(
                "mov_interval", time=ms(best.interval)
            ),
        }
        return [say("mov_line", code=code, meaning=meaning) for code, meaning in lines.items()]

    def pymodbus(self) -> str:
        """The same for pymodbus's serial client, whose timeout counts from handing a request over."""
        best, timing = self.recommended, self.model.timing
        if best is None or timing is None:
            return ""
        longest = max((poll.request for poll in self.model.polls), default=0)
        timeout = math.ceil((best.timeout + longest) / TICKS_PER_MS) / 1000
        fmt = timing.format
        framer = ", framer=FramerType.ASCII" if self.model.protocol.endswith("ascii") else ""
        return (
            f"ModbusSerialClient(port, baudrate={timing.baud}, bytesize={fmt.data_bits}, "
            f"parity='{fmt.parity}', stopbits={fmt.stop_bits}, "
            f"timeout={timeout:g}, retries={best.retries}{framer})"
        )

    def margin(self) -> str:
        """What a longer timeout would cost, in words."""
        best = self.recommended
        if best is None or best.timeout == self.least:
            return ""
        return say("poll_margin", most=ms(best.timeout), least=ms(self.least))

    def to_json(self) -> dict[str, object]:
        """One poll list of the JSON form, times in ms."""
        best = self.recommended
        return {
            "valid": self.valid,
            "reasons": list(self.reasons),
            "goals": list(self.goals.port_texts().values()),
            "timeout_floor_ms": in_ms(self.least) if self.valid else None,
            "recommended": None if best is None else best.to_json(),
            "table": [setting.to_json() for setting in self.table],
            "unmet": [unmet.to_json() for unmet in self.unmet],
            "remedies": [remedy.in_words() for remedy in self.remedies],
            "in_words": [] if best is None else best.figures.in_words(),
            "mov": self.mov_lines(),
            "pymodbus": self.pymodbus(),
        }


def size_ports(
    scenario: Scenario, goals: Goals, responses: Mapping[str, int] | None = None
) -> dict[str, PortSizing]:
    """Size every Modbus poll list of a scenario; faults are left out, but what makes slaves slow.

    What the ports have as timeout, retries and interval does not matter. ``responses`` are the longest that
    were measured (ticks, by master): no timeout is shorter.
    """
    seen = responses or {}
    faults = tuple(fault for fault in scenario.faults if isinstance(fault.kind, Slow))
    scenario = replace(scenario, faults=faults)

    def changed(node: str, baud: int | None, join: bool) -> PollListModel | None:  # noqa: FBT001 (private)
        found = poll_lists(scenario, sized=True, baud=baud, join=join).get(node)
        return None if found is None else replace(found, seen=seen.get(node, 0))

    lists = poll_lists(scenario, sized=True)
    return {
        node: _size(replace(model, seen=seen.get(node, 0)), goals, partial(changed, node))
        for node, model in lists.items()
        if model.protocol != "free"
    }


#: A poll list at another rate or with joined reads, None where there is none.
_Changed = Callable[[int | None, bool], PollListModel | None]


def _size(model: PollListModel, goals: Goals, changed: _Changed) -> PortSizing:
    reasons = model.obstacles or model.noise_reasons
    if not reasons and not model.cyclic:
        reasons = (say("poll_commands_only"),)
    if reasons:
        return PortSizing(model, goals, tuple(reasons))
    least = least_timeout(model)
    if least > MOST_UNITS * timeout_unit(model):
        return PortSizing(model, goals, (say("poll_longest", time=ms(least)),))
    best = _least(_settings(model), goals)
    found = PortSizing(model, goals, least=least, recommended=best, table=_table(model, best))
    if best is not None:
        dead = best.dead or 0
        tries: list[tuple[str, Iterable[PortSetting]]] = []
        if dead > 2 * (best.cycle or 0):
            tries.append((say("help_skip", turns=_SKIP), _settings(_skipping(model))))
        sooner = [each for each in intervals(model) if each < best.interval]
        if sooner and best.interval > DEFAULT_INTERVAL:
            pause = say("help_interval", new=ms(sooner[0]), old=ms(best.interval))
            tries.append((pause, _settings(model, sooner)))
        others = [(text, _least(settings, goals)) for text, settings in tries]
        remedies = tuple(
            Remedy(text, each) for text, each in others if each is not None and (each.dead or 0) < dead
        )
        return replace(found, remedies=remedies)
    tried = list(_settings(model))
    names = goals.of_ports()
    sets = smallest_sets(names, lambda some: any(_meets(each, goals, some) for each in tried))
    remedies = tuple(_remedies(model, tried, goals, changed))
    helps = tuple(remedy.in_words() for remedy in remedies)
    unmet = tuple(Unmet(some, _conflict(tried, goals, some), helps) for some in sets)
    return replace(found, unmet=unmet, remedies=remedies)


def _settings(model: PollListModel, pauses: Sequence[int] = ()) -> Iterator[PortSetting]:
    """The settings that may be recommended, the cheapest first: no response is too late in any of them."""
    least = least_timeout(model)
    timeouts = dict.fromkeys((top_of_step(model, least), least))
    for interval, retries, timeout in product(pauses or intervals(model), range(MOST_RETRIES + 1), timeouts):
        yield setting_of(model, timeout, retries, interval)


def _meets(setting: PortSetting, goals: Goals, names: tuple[str, ...]) -> bool:
    return all(setting.value(name) <= goals.limit(name) for name in names)


def _least(tried: Iterable[PortSetting], goals: Goals) -> PortSetting | None:
    return next((each for each in tried if _meets(each, goals, goals.of_ports())), None)


def _table(model: PollListModel, best: PortSetting | None) -> tuple[PortSetting, ...]:
    """Some timeouts, also ones that are too short, and all retries up to one more than is recommended."""
    unit, least = timeout_unit(model), least_timeout(model)
    interval = intervals(model)[0] if best is None else best.interval
    timeouts = {max(unit, least // 2 // unit * unit), least}
    top = least
    for _ in range(_STEPS):
        top = top_of_step(model, top)
        timeouts.add(top)
        top += unit if model.words is not None else least
    if model.timeout % unit == 0 and model.timeout:
        timeouts.add(model.timeout)
    last = max(3, (best.retries if best is not None else 2) + 1)
    return tuple(
        setting_of(model, timeout, retries, interval)
        for timeout in sorted(timeouts)
        for retries in range(last + 1)
    )


def _conflict(tried: list[PortSetting], goals: Goals, names: tuple[str, ...]) -> str:
    """What stands against what, with the best of each that the others leave."""
    texts = goals.port_texts()
    parts = []
    for name in names:
        others = tuple(other for other in names if other != name)
        best = min((each.value(name) for each in tried if _meets(each, goals, others)), default=math.inf)
        figure = say("figure_a_year", number=a_year(best)) if name == "errors" else ms_at_most(best)
        said = say("unmet_best_port", figure=figure)
        parts.append(
            say("unmet_given", goals=[texts[other] for other in others], best=said) if others else said
        )
    if len(names) == 1:
        return say("unmet_alone", goal=texts[names[0]], best=parts[0])
    return say("unmet_together", goals=[texts[name] for name in names], parts=parts)


def _skipping(model: PollListModel) -> PollListModel:
    polls = tuple(replace(poll, skip=_SKIP if poll.device else 1) for poll in model.polls)
    return replace(model, polls=polls)


def _remedies(
    model: PollListModel, tried: list[PortSetting], goals: Goals, changed: _Changed
) -> Iterator[Remedy]:
    """Changes that make all goals possible: the fewest of them that do, each with its setting."""
    for count in (1, 2, 3):
        found = False
        for kinds in combinations(("join", "baud", "skip"), count):
            remedy = _tried(model, goals, changed, kinds)
            if remedy is not None:
                found = True
                yield remedy
        if found:
            break
    for name in goals.of_ports():
        eased = goals.with_limit(name, math.inf)
        best = min(
            (each.value(name) for each in tried if _meets(each, eased, goals.of_ports())), default=None
        )
        if best is not None:
            limit = goals.rounded_up(name, best)
            easier = goals.with_limit(name, limit)
            setting = _least(tried, easier)
            if setting is not None:
                text = say("help_goal", new=easier.port_texts()[name], old=goals.port_limits()[name])
                yield Remedy(text, setting)


def _tried(model: PollListModel, goals: Goals, changed: _Changed, kinds: tuple[str, ...]) -> Remedy | None:
    own = model.timing.baud if model.timing is not None else 0
    join = "join" in kinds
    for baud in [each for each in _BAUDS if each > own] if "baud" in kinds else [None]:
        found = changed(baud, join)
        if found is None or not found.valid or (join and not found.joined):
            continue
        texts = [say("help_join", names=", ".join(names)) for names in found.joined] if join else []
        texts += [say("help_rate", new=baud, old=own)] if baud is not None else []
        texts += [say("help_skip", turns=_SKIP)] if "skip" in kinds else []
        setting = _least(_settings(_skipping(found) if "skip" in kinds else found), goals)
        if setting is not None:
            return Remedy(say("help_all", changes=texts), setting)
    return None
