"""From a file to a readout or a calibration, or to every mistake in it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from os.path import isfile
from pathlib import Path
from typing import Any

from bussim.errors import Problem, ScenarioError, UsageError
from bussim.exact.link import TIMEOUT_UNIT
from bussim.files import plain
from bussim.forms.form import as_written
from bussim.plc.link_registers import D_MIRROR_STATION, D_STATION, mode_numbers, status_devices
from bussim.plc.profiles import PROFILES
from bussim.scenario.schema.draft import read_form
from bussim.scenario.schema.profiles import ProfileIn
from bussim.scenario.yaml.parser import MAX_BYTES, read
from bussim.scenario.yaml.source_map import Path as At
from bussim.scenario.yaml.source_map import Report
from bussim.site.forms import LIMIT, CalibrationIn, ProfileFileIn, ReadoutIn, StationIn
from bussim.site.link import SiteLink
from bussim.site.readout import (
    CODE,
    COUNT,
    START,
    STYLES,
    Calibration,
    Experiment,
    Reading,
    Readout,
    SiteProfile,
    Station,
    own_entries,
    with_numbers,
)
from bussim.wording import counted, names, nearest
from bussim.words.values import show, suggest

_CODES = frozenset(f"D{CODE + station}" for station in range(8))
_GROWING = frozenset({"D8202", *(f"D{COUNT + station}" for station in range(8))})
_FLAGS = {"on": 1, "true": 1, "1": 1, "off": 0, "false": 0, "0": 0}
Raw = Mapping[Any, object]


def load(path: Path) -> Readout | Calibration:
    """What is noted in a file. Raises UsageError where it cannot be read, ScenarioError where it is wrong."""
    data, report = _data(path)
    kind = data.get("kind") if isinstance(data, dict) else None
    if kind == "profile":
        raise UsageError(f"{path} is a profile: name it as profile: of a readout")
    form, cut = read_form(CalibrationIn if kind == "calibration" else ReadoutIn, data, (), report)
    made = None if form is None or cut else _Reader(form, report, path.parent).made()
    if report.errors:
        raise ScenarioError(report.errors)
    assert isinstance(made, Readout | Calibration)  # noqa: S101 - without mistakes there is one
    return made


def _data(path: Path) -> tuple[object, Report]:
    try:
        with plain(path).open("rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        raise UsageError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}") from error
    data, source_map, problems = read(raw, str(path))
    if data is None and not problems:
        problems = [Problem(str(path), 0, 0, f"is empty; a readout begins with {ReadoutIn.example}")]
    return data, Report(source_map, problems)


class _Reader:
    """Makes values of a form, and reports what does not fit together."""

    def __init__(self, form: Any, report: Report, folder: Path) -> None:
        self.form, self.report = form, report
        self.profile = self._profile(form.profile, folder)
        self.family = PROFILES[str(self.profile.form["base"])]
        #: The common name of every register of the link by the family's own.
        self.names = {
            str(device): common
            for port in ("COM4", "COM3")
            for common, device in status_devices(self.family, port).items()
        }
        self.notes: list[str] = []
        self.styles: dict[str, list[str]] = {}

    def made(self) -> Readout | Calibration:
        """The readout or the calibration."""
        if self.form.settings.mode not in self.family.modes:
            allowed = f"in profile {self.family.name}: {mode_numbers(self.family.modes)}"
            self.report.error(("settings", "mode"), f"is {self.form.settings.mode}, allowed {allowed}")
        return self._calibration() if isinstance(self.form, CalibrationIn) else self._readout()

    def _profile(self, given: object, folder: Path) -> SiteProfile:
        """A built-in profile, one as a scenario writes it, or that of a file beside the readout."""
        if isinstance(given, str) and given not in PROFILES:
            path = folder / given
            if isfile(path):  # noqa: PTH113 - Path.is_file raises for a name that is too long
                data, found = _data(path)
                form, cut = read_form(ProfileFileIn, data, (), found)
                for problem in found.errors:
                    self.report.add(problem, fatal=True)
                if form is not None and not cut:
                    return SiteProfile(as_written(form.profile), tuple(form.open))
            else:
                text = f"is {show(given)}, neither a profile nor a file of one; "
                self.report.error(("profile",), text + suggest(given, list(PROFILES)))
            return SiteProfile({"base": "pw10"})
        written, cut = read_form(ProfileIn, given, ("profile",), self.report)
        return SiteProfile({"base": "pw10"} if written is None or cut else as_written(written))

    # -- registers ---------------------------------------------------------------------------------

    def _name(self, own: object, at: At, *, key: bool = True) -> str | None:
        """The common name of a register, None for one that is none of the link's."""
        text = str(own).strip().upper()
        if text not in self.names:
            meant = next((mine for mine, common in self.names.items() if common == text), None)
            near = meant or nearest(text, list(self.names))
            hint = f"did you mean {near}?" if near else f"allowed are {names(self.names)}"
            found = "" if key else f"is {show(own)}, "
            self.report.error(at, f"{found}is no register of the link; {hint}", key=key)
        return self.names.get(text)

    def _reading(self, raw: Raw, at: At) -> Reading:
        """The registers of one reading; codes as they are in the file."""
        values: dict[str, int] = {}
        looks: list[int] = []
        for own, value in raw.items():
            here, common = (*at, str(own)), self._name(own, (*at, str(own)))
            if common in values:
                self.report.error(here, f"is the register {common} once more", key=True)
            elif common == "D8201":
                listed = value if isinstance(value, list) else [value]
                read = [self._number(each, here) for each in listed] or [self._number(None, here)]
                looks = [each for each in read if each is not None]
                values |= {common: sorted(looks)[len(looks) // 2]} if looks else {}
            elif common is not None:
                number = self._number(value, here, flag=common[0] == "M")
                values |= {} if number is None else {common: number}
        longest = values.get("D8202", LIMIT)
        if looks and max(looks) > longest:
            text = f"is {longest}, below a look at D8201 ({max(looks)}), of which it is the longest"
            self.report.error((*at, self._own("D8202", raw)), text)
        return Reading(values, tuple(looks))

    def _own(self, common: str, raw: Raw) -> str:
        return next(str(own) for own in raw if self.names.get(str(own).strip().upper()) == common)

    def _number(self, value: object, at: At, *, flag: bool = False) -> int | None:
        if flag and (found := _FLAGS.get(show(value).strip("'").lower())) is not None:
            return found
        if not flag and isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= LIMIT:
            return int(value)
        allowed = "on, off" if flag else f"0..{LIMIT}"
        hint = "" if flag or isinstance(value, int) else "; a register that was not read is left out"
        self.report.error(at, f"is {show(value)}, allowed {allowed}{hint}")
        return None

    def _decoded(self, place: str, read: Sequence[tuple[Reading, At, Raw]]) -> list[Reading]:
        """The readings of one station with their codes as the PLC stores them."""
        found = {reading.values[name] for reading, _, _ in read for name in _CODES & {*reading.values}} - {0}
        # Of two styles the one that fits more of the codes; the first where both do.
        style = max(STYLES, key=lambda one: len(found & {*STYLES[one]}))
        if any(found & {*STYLES[style]} - {*table} for table in STYLES.values()):
            self.styles.setdefault(style, []).append(place)
        made = []
        for reading, at, raw in read:
            values = dict(reading.values)
            for name in sorted(_CODES & {*values}):
                if (code := values[name]) and code not in STYLES[style]:
                    other = any(code in table for table in STYLES.values())
                    hint = f"; the other codes of this station are {style}" if other else ""
                    allowed = ", ".join(map(str, STYLES[style]))
                    text = f"is {code}, no error code; allowed 0, {allowed}{hint}"
                    self.report.error((*at, self._own(name, raw)), text)
                values[name] = STYLES[style].get(code, 0)
            made.append(replace(reading, values=values))
        return made

    # -- a readout ---------------------------------------------------------------------------------

    def _readout(self) -> Readout:
        form, report = self.form, self.report
        low, high = self.family.timeout_range
        if not low <= form.settings.timeout // TIMEOUT_UNIT <= high:
            self.notes.append(f"D8180 is outside of {low}..{high}: a parameter error")
        stations = [self._station(each, ("stations", index)) for index, each in enumerate(form.stations)]
        stations = with_numbers(stations, form.settings.slaves)
        places = [station.place for station in stations]
        order = form.order or places
        for index, place in enumerate(places):
            at: At = ("stations", index, "place")
            if place in places[:index]:
                report.error(at, f"is {show(place)}, as of another station")
            elif place not in order:
                report.error(at, f"is {show(place)}, which is not in order; {suggest(place, order)}")
        if form.order and len({*order}) < len(order):
            report.error(("order",), "names a place twice")
        self._check_settings(stations, len(form.order or ()))
        given = [station.place for station in stations if station.before is not None]
        for index, station in enumerate(stations):
            if given and station.before is None and station.after.values:
                text = f"has no before, which {given[0]} has; give both readings for all, or leave before out"
                report.error(("stations", index), text)
        if form.ladder is not None:
            self._check_ladder(form.ladder.thresholds_ms, form.ladder.rises, form.ladder.max_ms)
        self.notes += [
            f"error codes are taken {style} at {', '.join(where)}" for style, where in self.styles.items()
        ]
        made = Readout(
            *(self.profile, form.settings, tuple(order), form.watched, tuple(stations)),
            *(form.started, form.ladder, frozenset(form.symptoms)),
        )
        if not report.errors:
            self._check_against_scans(made)
        return replace(made, notes=tuple(self.notes))

    def _check_settings(self, stations: Sequence[Station], along: int) -> None:
        """Note where what was read, or the number of stations, is not what the settings say."""
        given = self.form.settings
        if along and along != given.slaves + 1:
            self.notes.append(
                f"order has {counted(along, 'station')}, and the master polls {given.slaves} (D8177)"
            )
        for station in stations:
            if (station.number or 0) > given.slaves:
                self.notes.append(f"{station.label} is never polled: D8177 is {given.slaves} at the master")
            for name, wanted in (("D8174", given.slaves), ("D8175", given.mode)):
                if (found := station.value(name)) not in (None, wanted) and (found or not station.supposed):
                    self.notes.append(f"{station.place} has {name} = {found}, and settings say {wanted}")
            self.notes += [
                f"{station.label} counts about itself ({entry}): it is a master, or the place is wrong"
                for entry in own_entries(station)
                if station.number is not None
            ]

    def _station(self, form: StationIn, at: At) -> Station:
        raws = {key: raw for key, raw in (("before", form.before), ("after", form.after)) if raw is not None}
        read = [(self._reading(raw, (*at, key)), (*at, key), raw) for key, raw in raws.items()]
        found = dict(zip(raws, self._decoded(form.place, read), strict=True))
        before, after = found.get("before"), found.get("after", Reading({}))
        for name in sorted(_GROWING & {*after.values}):
            now, then = after.values[name], before.values.get(name, 0) if before else 0
            if now < then:
                text = f"is {now}, below the {then} of before; after a restart leave before out"
                self.report.error((*at, "after", self._own(name, raws["after"])), text)
            elif now == LIMIT:
                text = f"{form.place}: {name} is {LIMIT}, where counters stop: it is a lower bound"
                self.notes.append(text)
        rising = [self._name(each, (*at, "rising"), key=False) for each in form.rising]
        values, number = after.values, form.number
        if number is None:
            number = values.get(f"D{D_MIRROR_STATION}", values.get(f"D{D_STATION}"))
        climbing = frozenset(each for each in rising if each is not None)
        lamps, scan = form.lamps, form.plc_scan
        made = Station(form.place, number, form.state, after, before, rising=climbing)
        return replace(made, sd=lamps.SD, rd=lamps.RD, plc_scan=scan)

    def _check_ladder(self, thresholds: Sequence[float], rises: Sequence[int], longest: float | None) -> None:
        error, at = self.report.error, "ladder"
        if len(rises) != len(thresholds):
            text = f"has {counted(len(rises), 'count')} for {counted(len(thresholds), 'threshold')}"
            error((at, "rises"), text)
        for index, (one, two) in enumerate(pairwise(thresholds), 1):
            if two <= one:
                error((at, "thresholds_ms", index), f"is {two:g}, not above the {one:g} before it")
        for index, (threshold, count) in enumerate(zip(thresholds, rises, strict=False)):
            if count and not rises[0]:
                error((at, "rises", index), f"is {count}, and D8201 never rose to {thresholds[0]:g}")
            if longest is not None and (longest >= threshold) != (count > 0):
                error((at, "max_ms"), f"is {longest:g}, with {counted(count, 'rise')} to {threshold:g}")
                break

    def _check_against_scans(self, made: Readout) -> None:
        """Report or note more counts than scans: of a slave one each, of the master one a frame."""
        link, ladder = SiteLink.of(made), made.ladder
        scans, healthy = made.watched / link.healthy, link.units(link.healthy)
        if ladder is not None and (first := ladder.thresholds_ms[0]) <= healthy:
            text = f"is {first:g}, not above the healthy scan of {healthy:.1f}"
            self.report.error(("ladder", "thresholds_ms", 0), text)
        for index, rises in enumerate(ladder.rises if ladder is not None else ()):
            if rises > scans:
                text = f"is {rises}, more than the {scans:.0f} scans that were watched"
                self.report.error(("ladder", "rises", index), text)
        own = {common: mine for mine, common in self.names.items()}
        for index, station in enumerate(made.stations):
            for about in range(made.settings.slaves + 1):
                most = scans if about else scans * (1 + made.settings.slaves * link.n)
                if (count := station.exact(about) or 0) <= most + START:
                    continue
                name = own[f"D{COUNT + about}"]
                text = f"counts {count} while it was watched, which is {scans:.0f} scans"
                if station.before or not station.supposed:
                    self.report.error(("stations", index, "after", name), text)
                else:  # a slave may have run before the master's last start
                    self.notes.append(f"{station.label}: {name} {text}: it counts from before; give before")

    # -- a calibration -----------------------------------------------------------------------------

    def _calibration(self) -> Calibration:
        made: dict[str, Experiment] = {}
        for index, one in enumerate(self.form.experiments):
            at: At = ("experiments", index)
            if one.name in made:
                self.report.error((*at, "name"), f"is {one.name}, as of another experiment")
            raw = one.model_extra or {}
            reading = self._decoded(one.name, [(self._reading(raw, at), at, raw)])[0]
            made[one.name] = Experiment(
                *(one.name, one.retries, one.timeout, one.slaves, reading, one.cut, one.slow_plc),
                tuple(one.at_slaves or ()),
            )
            self._check_experiment(made[one.name], at)
        settings = self.form.settings
        return Calibration(self.profile, settings.slaves, settings.mode, made)

    def _check_experiment(self, one: Experiment, at: At) -> None:
        """Report what an experiment of its name cannot have."""
        slaves = self.form.settings.slaves
        polled = (
            {1} if one.name in ("one", "one_slow") else {1, slaves} if one.name == "master_slow" else {slaves}
        )
        if one.slaves not in polled:
            allowed = " and ".join(map(str, sorted(polled)))
            self.report.error((*at, "slaves"), f"is {one.slaves}, allowed {allowed} in {one.name}")
        if not all(one.reading.looks):
            self.report.error((*at, "D8201"), "is 0, which is no scan: look again while the link works")
        slow = one.name in ("one_slow", "master_slow")
        for key, given in (("cut", one.cut), ("slow_plc", one.slow_plc)):
            master = one.name in ("listeners", "master_slow")
            if given is not None and not (given.number == 0 if master else 1 <= given.number <= one.slaves):
                allowed = "0" if master else f"1..{one.slaves}"
                self.report.error((*at, key, "number"), f"is {given.number}, allowed {allowed} in {one.name}")
            elif (given is not None) and slow is (key == "cut"):
                self.report.error((*at, key), f"belongs to another experiment than {one.name}")
