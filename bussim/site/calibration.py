"""What experiments at a machine at rest decide of its profile, what they leave open, and where no rule fits.

A scan with one slave off lasts A - slot + m × (gap + poll + timeout) + gap + 14 characters, with m the
attempts made at it; A and slot (gap, poll, turnaround, data frame) follow from scans with all slaves and
with one. Readings are rounded, so times have the intervals that the rounding leaves.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from math import log
from statistics import fmean, median_high
from typing import Any

from bussim.engines.nn.codes import MASTER_SILENT
from bussim.engines.nn.frames import PARAMETERS_CHARS, POLL_CHARS, data_chars
from bussim.exact.link import TIMEOUT_UNIT, frame_ticks
from bussim.plc.profiles import PROFILES, AbsentStation, Attempts, ErrorCount, Reply, attempts_per_poll
from bussim.site.readout import COUNT, START, Calibration, Experiment
from bussim.units import TICKS_PER_MS, format_time, milliseconds

FIELDS = ("attempts", "absent_station", "error_count", "reply", "link_scan_unit")
TIMES = ("master_gap", "turnaround", "scan_overhead")
_UNITS = tuple(TICKS_PER_MS * Fraction(factor) for factor in (Fraction(1, 10), 1, 10))
#: A look at D8201 may be off by this beside its rounding, as turnarounds spread (assumed).
_SPREAD = TICKS_PER_MS / 10
#: Attempts are whole to so much, or the rule is wrong.
_WHOLE = 0.3
#: A scan is not so many times longer or shorter than its frames, in the nearest unit.
_LIKE = 5
#: Two experiments have the same scan to so many units.
_NEAR = 2.5
#: A cut that lasts for fewer scans than this for each cut does not tell counts of scans from those of cuts.
_LONG = 10
#: The least D8180 that the manuals have (x 10 ms).
FLOOR = 5 * TIMEOUT_UNIT
#: A count of one a scan is at least such a part of what the scans allow.
_MANY = 0.3


@dataclass(slots=True)
class Found:
    """Fields decided; times in ms (value, low, high); what is open and what no rule explains, and why.

    ``checked`` says what was found to hold, or how a short timeout is taken; no field of a profile has it.
    """

    fields: dict[str, str] = field(default_factory=dict)
    times: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    open: dict[str, str] = field(default_factory=dict)
    unexplained: list[str] = field(default_factory=list)
    checked: list[str] = field(default_factory=list)

    def to_json(self) -> dict[str, Any]:
        """The result as plain data."""
        times = {name: self.times.get(name, (None, None, None)) for name in TIMES}
        parts = ("value", "low", "high")
        return {
            "fields": {name: self.fields.get(name) for name in FIELDS},
            "times_ms": {name: dict(zip(parts, each, strict=True)) for name, each in times.items()},
            "open": [f"{name}: {why}" for name, why in self.open.items()],
            "unexplained": self.unexplained,
            "checked": self.checked,
        }

    def profile(self, base: Mapping[str, object]) -> dict[str, Any]:
        """The profile file as plain data; what is open keeps the value that ``base`` has."""
        times: dict[str, object] = {name: _microseconds(value) for name, (value, _, _) in self.times.items()}
        if "turnaround" in times:  # whose spread was not measured
            jitter = milliseconds(PROFILES[str(base["base"])].turnaround.jitter)
            limited = _microseconds(min(jitter, self.times["turnaround"][0]))
            times["turnaround"] = {"mean": times["turnaround"], "jitter": limited}
        profile = {**base, **self.fields, **times}
        return {"schema": 1, "kind": "profile", "profile": profile, "open": sorted(self.open)}


def _microseconds(ms: float) -> str:
    """A time of a profile, to a microsecond."""
    return format_time(round(ms * 1000) * TICKS_PER_MS // 1000)


def calibrate(given: Calibration) -> Found:
    """Decide each field by the experiments that there are."""
    return _Decoder(given).found


class _Decoder:
    """Reads the experiments, from the simplest to those that rest on it. Times in ticks."""

    def __init__(self, given: Calibration) -> None:
        self.given, self.found = given, Found()
        self.family = PROFILES[str(given.profile.form["base"])]
        self.data, self.poll = frame_ticks(data_chars(given.mode)), frame_ticks(POLL_CHARS)
        self.parameters, self.gap = frame_ticks(PARAMETERS_CHARS), self.family.master_gap
        self.unit = float(TICKS_PER_MS)
        self.all, self.one = self._scan("all"), self._scan("one")
        if not self.all:
            self.found.open = dict.fromkeys((*FIELDS, *TIMES), "the experiment all gives no D8201")
            return
        self._unit()
        self.all, self.one = self._scan("all"), self._scan("one")
        self.slot = 2.0 * self.gap + self.poll + self.data
        timed = self._slot()
        self._reply()
        cuts = [each for name in ("off_3_100", "off_10_50") if (each := given.experiments.get(name))]
        for each in cuts:
            self._cut(each)
            self._counted(each)
        for name in ("attempts", "absent_station", "error_count"):
            self._leave(name, "no experiment cuts a slave's supply")
        self._listeners()
        self._slow_master()
        self._floor()
        if why := self._times(cuts, timed=timed):
            self.found.open |= dict.fromkeys(TIMES, why)

    def _scan(self, name: str) -> float:
        """The mean of an experiment's looks within 2 units of their median; 0 without any."""
        experiment = self.given.experiments.get(name)
        if experiment is None or not experiment.reading.looks:
            return 0.0
        middle = median_high(experiment.reading.looks)
        return fmean(look for look in experiment.reading.looks if abs(look - middle) <= 2) * self.unit

    def _decide(self, name: str, value: str, by: str) -> None:
        """Set a field; two experiments that contradict each other are not explained."""
        before = self.found.fields.get(name)
        if before is not None and before != value:
            self.found.unexplained.append(f"{name}: {before} by one experiment, {value} by {by}")
        self.found.fields[name] = value
        self.found.open.pop(name, None)

    def _leave(self, name: str, why: str) -> None:
        if name not in self.found.fields:
            self.found.open.setdefault(name, why)

    @property
    def probes(self) -> bool:
        """Whether a station that is off costs one attempt."""
        return self.found.fields.get("absent_station") == AbsentStation.PROBE.value

    def _unit(self) -> None:
        expected = 1.3 * ((self.given.slaves + 1) * self.data + self.given.slaves * self.poll)
        shown = self.all / self.unit
        self.unit = float(min(_UNITS, key=lambda one: abs(log(expected / float(one) / shown))))
        if not 1 / _LIKE < expected / self.unit / shown < _LIKE:
            law = f"frames and turnarounds take about {milliseconds(expected):.0f} ms"
            self.found.unexplained.append(f"D8201 is {shown:.0f}, and {law}")
        self._decide("link_scan_unit", format_time(int(self.unit)), "all")

    def _slot(self) -> bool:
        """Whether the time of one exchange follows from scans with all slaves and with one."""
        more = self.given.slaves - 1
        if not self.one or not more:
            return False
        slot = (self.all - self.one) / more
        if fits := slot + 2 * self.unit / more >= self.poll + self.data:
            self.slot = slot
        else:
            text = f"an exchange takes {milliseconds(slot):.1f} ms by all and one, and its frames alone"
            self.found.unexplained.append(f"{text} {milliseconds(self.poll + self.data):.1f} ms")
        return fits

    def _reply(self) -> None:
        experiment, now = self.given.experiments.get("one_slow"), self._scan("one_slow")
        if experiment is None or experiment.slow_plc is None or not now:
            self.found.open["reply"] = "the experiment one_slow decides it"
            return
        scan, near = float(experiment.slow_plc.scan * self.family.scan_factor), _NEAR * self.unit
        before = self.one or min(now, scan - 20 * TICKS_PER_MS)
        if scan < before + 10 * TICKS_PER_MS:
            self.found.open["reply"] = "the slow PLC scan is not longer than the link scan with one slave"
        elif abs(now - scan) <= near:
            self._decide("reply", Reply.END.value, "one_slow")
        elif abs(now - before) <= near:
            self._decide("reply", Reply.INTERRUPT.value, "one_slow")
        else:
            seen, own, usual = (f"{milliseconds(ticks):.1f} ms" for ticks in (now, scan, before))
            text = f"reply: D8201 is {seen} with a PLC scan of {own} at the slave, neither that nor {usual}"
            self.found.unexplained.append(text)

    def _attempts(self, ticks: float, timeout: int) -> float:
        """How many attempts a scan with one slave off has room for."""
        rest = self.all - self.slot + self.gap + self.parameters
        return (ticks - rest) / (self.gap + self.poll + timeout)

    def _cut(self, experiment: Experiment) -> None:
        """What a slave without supply costs: one attempt or all."""
        if not (scan := self._scan(experiment.name)):
            return
        name, retries = experiment.name, experiment.retries
        allowed = {each: attempts_per_poll(each, retries) for each in Attempts}
        shown = self._attempts(scan, experiment.timeout)
        made = round(shown)
        whole = abs(shown - made) <= _WHOLE and made in {1, *allowed.values()}
        if not whole and shown > 0.5 and self.found.fields.get("reply") != Reply.INTERRUPT.value:
            why = f"{shown:.2f} attempts by {name}, with waits for END that are not known"
            self._leave("absent_station", why)
            self._leave("attempts", why)  # a scan's waits for END are no part of the rule
        elif not whole:
            text = f"{name}: D8201 has room for {shown:.2f} attempts at the slave that is off"
            self.found.unexplained.append(text)
        elif {*allowed.values()} == {1}:
            self._leave("absent_station", f"one attempt a poll at D8179 = {retries} either way")
            self._leave("attempts", f"D8179 = {retries} means one attempt either way")
        elif made == 1:
            self._decide("absent_station", AbsentStation.PROBE.value, name)
            self._probed(experiment, allowed)
        else:
            self._decide("absent_station", AbsentStation.FULL.value, name)
            self._decide("attempts", next(each.value for each, n in allowed.items() if n == made), name)

    def _probed(self, experiment: Experiment, allowed: Mapping[Attempts, int]) -> None:
        """With one attempt at a flagged station only the first scan after a cut has them all: D8202."""
        longest, cut = experiment.reading.values.get("D8202"), experiment.cut
        shown = self._attempts((longest or 0) * self.unit, experiment.timeout)
        made = round(shown)
        fits = [each for each, n in allowed.items() if n == made]
        if longest is None:
            why = "under probe only D8202 shows it, which was not read"
        elif abs(shown - made) > _WHOLE or not fits:
            why = f"D8202 after the cuts has room for {shown:.2f} attempts; it may be spoilt"
        elif cut is not None and cut.times < 3 and len(fits) == 1 and made == min(allowed.values()):
            why = f"{cut.times} cuts may all have fallen in mid-reply, which shortens D8202"
        else:
            self._decide("attempts", fits[0].value, experiment.name)
            return
        self._leave("attempts", why)

    def _counted(self, experiment: Experiment) -> None:
        """Whether D8203+k counts once a loss or once a scan."""
        cut, name, scan = experiment.cut, experiment.name, self._scan(experiment.name)
        count = None if cut is None else experiment.reading.values.get(f"D{COUNT + cut.number}")
        if cut is None or count is None:
            self._leave("error_count", "D8203+k of the slave that was cut was not read")
            return
        scans = (cut.last_for or 0) / scan if scan else 0.0
        if 0 < scans < _LONG * cut.times:
            self._leave("error_count", f"the last cut of {name} lasted for {scans:.1g} scans only")
        elif scans and count >= max(_MANY * scans, 2 * cut.times + 1):
            self._decide("error_count", ErrorCount.PER_SCAN.value, name)
        elif count <= 2 * cut.times:
            self._decide("error_count", ErrorCount.ON_EDGE.value, name)
        elif scans:
            text = f"{name}: {count} errors after {cut.times} cuts, the last of {scans:.0f} scans"
            self.found.unexplained.append(text)

    # -- what is checked ---------------------------------------------------------------------------

    def _listeners(self) -> None:
        """Slaves count the master's absence once, and a slave's alike: else what they count is of no use."""
        check = self.given.experiments.get("listeners")
        count = None if check is None else check.reading.values.get(f"D{COUNT}")
        if check is not None and count is not None:
            times = check.cut.times if check.cut is not None else 1
            once = count == times and check.reading.values.get("D8211", MASTER_SILENT) == MASTER_SILENT
            self._listens(f"a slave counts {count} for {times} absences of the master", holds=once)
        for each in self.given.experiments.values():
            if counts := each.at_slaves:
                said = f"slaves count {', '.join(map(str, counts))} about one that was cut"
                self._listens(said, holds=max(counts) - min(counts) <= START)

    def _listens(self, said: str, *, holds: bool) -> None:
        if holds:
            self.found.checked.append(said)
        else:
            self.found.open["listeners"] = said

    def _slow_master(self) -> None:
        """The master's PLC scan is no part of a link scan, or the rules are others."""
        experiment, now = self.given.experiments.get("master_slow"), self._scan("master_slow")
        usual = self.all if experiment and experiment.slaves == self.given.slaves else self.one
        if now and usual and abs(now - usual) <= _NEAR * self.unit:
            self.found.checked.append("D8201 does not rise with the master's PLC scan")
        elif now and usual:
            seen = f"{milliseconds(now):.1f} ms instead of {milliseconds(usual):.1f} ms"
            self.found.unexplained.append(f"D8201 rises with the master's PLC scan: it is {seen}")

    def _floor(self) -> None:
        """How a D8180 below 5 is taken: as an error, as 50 ms, or as it is. A slave that is off tells it."""
        meaning = self.found.fields.get("attempts")
        for name in ("floor_40", "floor_30"):
            if (each := self.given.experiments.get(name)) is None:
                continue
            what, values, scan = (
                f"D8180 = {each.timeout // TIMEOUT_UNIT}",
                each.reading.values,
                self._scan(name),
            )
            if values.get("M8063") or values.get("D8063"):
                code = values.get("D8063", "not read")
                self.found.checked.append(f"{what} is a parameter error (D8063 = {code})")
            elif each.cut is None or not scan or meaning is None:
                self.found.open[what] = "only D8201 with a slave off tells it, and what that slave costs"
            else:
                made = 1 if self.probes else attempts_per_poll(Attempts(meaning), each.retries)
                cost = self.gap + self.poll
                timeout = self._attempts(scan, each.timeout) * (cost + each.timeout) / made - cost
                near = min((each.timeout, FLOOR), key=lambda one: abs(one - timeout))
                taken = "as it is" if near == each.timeout else f"as {format_time(FLOOR)}"
                text = f"{what} is taken {taken} (a timeout of {milliseconds(timeout):.1f} ms)"
                off = abs(near - timeout) > 0.3 * TIMEOUT_UNIT
                (self.found.unexplained if off else self.found.checked).append(text)

    # -- times -------------------------------------------------------------------------------------

    def _times(self, cuts: list[Experiment], *, timed: bool) -> str:
        """Gap, turnaround and overhead with the intervals of rounding; or why they are not told."""
        if "reply" not in self.found.fields:
            return "whether replies wait for END is open"
        if self.found.fields["reply"] == Reply.END.value:
            return "replies wait for END"
        if self.unit > TICKS_PER_MS:
            return "D8201 is too coarse"
        if not timed:
            return "the experiment one tells the time of an exchange"
        gaps = [gap for cut in cuts if (gap := self._gap(cut)) is not None]
        if not gaps:
            return "an experiment with a slave off tells it"
        if self.probes and (len(gaps) < 2 or abs(gaps[0][0] - gaps[1][0]) > 1):
            return "under probe two experiments with a slave off must agree, as noise may have hit the scan"
        gap, slaves = min(gaps, key=lambda one: one[2] - one[1]), self.given.slaves
        part, found = 1 / (slaves - 1), {"master_gap": gap}
        # An exchange without its frames; a scan without frames and exchanges: each with a gap.
        for name, of_all, of_one, frames in (
            ("turnaround", part, -part, self.poll + self.data),
            ("scan_overhead", 1 - slaves * part, slaves * part, self.data),
        ):
            value, low, high = self._corners(of_all, of_one, -frames)
            found[name] = (value - gap[0], low - gap[2], high - gap[1])
        if any(value < -0.2 for value, _, _ in found.values()):
            self.found.unexplained.append("the times that the readings leave are below 0")
        self.found.times = {
            name: (max(0.0, v), max(0.0, low), high) for name, (v, low, high) in found.items()
        }
        return ""

    def _corners(self, of_all: float, of_one: float, fixed: float) -> tuple[float, float, float]:
        """A time in ms that both scans make, and its ends by all that rounding may have made of them."""
        value = of_all * self.all + of_one * self.one + fixed
        more = (self.unit / 2 + _SPREAD) * (abs(of_all) + abs(of_one))
        return milliseconds(value), milliseconds(value - more), milliseconds(value + more)

    def _gap(self, cut: Experiment) -> tuple[float, float, float] | None:
        """The master's gap: what a scan with n attempts at a silent slave has beside polls and timeouts."""
        attempts, longest = self.found.fields.get("attempts"), cut.reading.values.get("D8202")
        shown = float(longest or 0) * self.unit if self.probes else self._scan(cut.name)
        if attempts is None or not shown or not cut.reading.looks:
            return None
        n, part = attempts_per_poll(Attempts(attempts), cut.retries), 1 / (self.given.slaves - 1)
        fixed = shown - n * (self.poll + cut.timeout) - self.parameters
        value, low, high = self._corners((part - 1) / (n + 1), -part / (n + 1), fixed / (n + 1))
        spread = _SPREAD * self.given.slaves if self.probes else _SPREAD  # D8202 is the longest of many scans
        more = milliseconds((self.unit / 2 + spread) / (n + 1))
        return value, low - more, high + more
