"""What experiments at a machine at rest decide of its profile, what they leave open, and where no rule fits.

A scan with one slave off lasts A - slot + m × (gap + poll + timeout) + gap + 14 characters, with m the
attempts made at it; A and slot (gap, poll, turnaround, data frame) follow from scans with all slaves and
with one. Readings are rounded, so times have the intervals that the rounding leaves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import product
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
        return {
            "fields": {name: self.fields.get(name) for name in FIELDS},
            "times_ms": {
                name: dict(zip(("value", "low", "high"), each, strict=True)) for name, each in times.items()
            },
            "open": [f"{name}: {why}" for name, why in self.open.items()],
            "unexplained": list(self.unexplained),
            "checked": list(self.checked),
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
    """Reads the experiments, from the simplest to those that rest on it."""

    def __init__(self, given: Calibration) -> None:
        self.given, self.found = given, Found()
        self.data, self.poll = frame_ticks(data_chars(given.mode)), frame_ticks(POLL_CHARS)
        self.parameters = frame_ticks(PARAMETERS_CHARS)
        self.unit = float(TICKS_PER_MS)
        gap = PROFILES[str(given.profile.form["base"])].master_gap
        self.all, self.one = given.experiments.get("all"), given.experiments.get("one")
        if self.all is None or not self.all.reading.looks:
            for name in (*FIELDS, *TIMES):
                self.found.open[name] = "the experiment all gives no D8201"
            return
        self._unit(self.all)
        self._reply()
        slot = self._slot()
        self.slot = slot if slot is not None else 2.0 * gap + self.poll + self.data
        cuts = [each for name in ("off_3_100", "off_10_50") if (each := given.experiments.get(name))]
        for name in ("attempts", "absent_station", "error_count"):
            if not cuts:
                self.found.open[name] = "no experiment cuts a slave's supply"
        for each in cuts:
            self._cut(each, gap)
        self._listeners()
        self._slow_master()
        self._floor(gap)
        self._times(slot, cuts)

    def _ticks(self, experiment: Experiment) -> float:
        """The mean of the looks within 2 units of their median."""
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
            self.found.open[name] = why

    def _unit(self, experiment: Experiment) -> None:
        expected = 1.3 * ((experiment.slaves + 1) * self.data + experiment.slaves * self.poll)
        shown = max(1.0, median_high(experiment.reading.looks))
        unit = min(_UNITS, key=lambda one: abs(log(expected / float(one) / shown)))
        self.unit = float(unit)
        if not 1 / _LIKE < expected / self.unit / shown < _LIKE:
            text = (
                f"D8201 is {shown:.0f}, and frames and turnarounds take about {milliseconds(expected):.0f} ms"
            )
            self.found.unexplained.append(text)
        self._decide("link_scan_unit", format_time(int(unit)), "all")

    def _reply(self) -> None:
        slow = self.given.experiments.get("one_slow")
        if slow is None or slow.slow_plc is None or not slow.reading.looks:
            self.found.open["reply"] = "the experiment one_slow decides it"
            return
        factor = PROFILES[str(self.given.profile.form["base"])].scan_factor
        now, scan, near = self._ticks(slow), float(slow.slow_plc.scan * factor), 2.5 * self.unit
        known = self.one is not None and self.one.reading.looks
        before = (
            self._ticks(self.one) if self.one is not None and known else min(now, scan - 20 * TICKS_PER_MS)
        )
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

    def _slot(self) -> float | None:
        """The time of one exchange, from scans with all slaves and with one."""
        if (
            self.all is None
            or self.one is None
            or not self.one.reading.looks
            or self.all.slaves == self.one.slaves
        ):
            return None
        more = self.all.slaves - self.one.slaves
        slot = (self._ticks(self.all) - self._ticks(self.one)) / more
        if slot + 2 * self.unit / more >= self.poll + self.data:
            return slot
        text = f"an exchange takes {milliseconds(slot):.1f} ms by all and one, and its frames alone"
        self.found.unexplained.append(f"{text} {milliseconds(self.poll + self.data):.1f} ms")
        return None

    def _attempts(self, ticks: float, experiment: Experiment, gap: float) -> float:
        """How many attempts a scan with one slave off has room for."""
        rest = self._ticks(self.all) - self.slot + gap + self.parameters if self.all is not None else 0.0
        return (ticks - rest) / (gap + self.poll + experiment.timeout)

    def _cut(self, experiment: Experiment, gap: float) -> None:
        """What a slave without supply costs: one attempt or all, and how it is counted."""
        name, reading = experiment.name, experiment.reading
        allowed = {each: attempts_per_poll(each, experiment.retries) for each in Attempts}
        if reading.looks:
            shown = self._attempts(self._ticks(experiment), experiment, gap)
            made = round(shown)
            whole = abs(shown - made) <= _WHOLE and made in {1, *allowed.values()}
            if not whole and shown > 0.5 and self.found.fields.get("reply") != Reply.INTERRUPT.value:
                for each in ("absent_station", "attempts"):  # a scan's waits for END are no part of the rule
                    self._leave(
                        each, f"{shown:.2f} attempts by {name}, with waits for END that are not known"
                    )
            elif not whole:
                self.found.unexplained.append(
                    f"{name}: D8201 has room for {shown:.2f} attempts at the slave that is off"
                )
            elif {*allowed.values()} == {1}:
                self._leave(
                    "absent_station", f"one attempt a poll at D8179 = {experiment.retries} either way"
                )
                self._leave("attempts", f"D8179 = {experiment.retries} means one attempt either way")
            elif made == 1:
                self._decide("absent_station", AbsentStation.PROBE.value, name)
                self._probed(experiment, gap, allowed)
            else:
                self._decide("absent_station", AbsentStation.FULL.value, name)
                self._decide("attempts", next(each.value for each, n in allowed.items() if n == made), name)
        self._counted(experiment)

    def _probed(self, experiment: Experiment, gap: float, allowed: Mapping[Attempts, int]) -> None:
        """With one attempt at a flagged station only the first scan after a cut has them all: D8202."""
        longest, cut = experiment.reading.values.get("D8202"), experiment.cut
        if longest is None:
            self._leave("attempts", "under probe only D8202 shows it, which was not read")
            return
        shown = self._attempts(longest * self.unit, experiment, gap)
        made = round(shown)
        fits = [each for each, n in allowed.items() if n == made]
        if abs(shown - made) > _WHOLE or not fits:
            self._leave(
                "attempts", f"D8202 after the cuts has room for {shown:.2f} attempts; it may be spoilt"
            )
        elif cut is not None and cut.times < 3 and len(fits) == 1 and made == min(allowed.values()):
            self._leave(
                "attempts", f"{cut.times} cuts may all have fallen in mid-reply, which shortens D8202"
            )
        else:
            self._decide("attempts", fits[0].value, experiment.name)

    def _counted(self, experiment: Experiment) -> None:
        """Whether D8203+k counts once a loss or once a scan."""
        cut, reading = experiment.cut, experiment.reading
        count = None if cut is None else reading.values.get(f"D{COUNT + cut.number}")
        if cut is None or count is None:
            self._leave("error_count", "D8203+k of the slave that was cut was not read")
            return
        scans = (cut.last_for or 0) / self._ticks(experiment) if reading.looks else 0.0
        if 0 < scans < _LONG * cut.times:
            self._leave("error_count", f"the last cut of {experiment.name} lasted for {scans:.1g} scans only")
        elif scans and count >= max(_MANY * scans, 2 * cut.times + 1):
            self._decide("error_count", ErrorCount.PER_SCAN.value, experiment.name)
        elif count <= 2 * cut.times:
            self._decide("error_count", ErrorCount.ON_EDGE.value, experiment.name)
        elif scans:
            self.found.unexplained.append(
                f"{experiment.name}: {count} errors after {cut.times} cuts, the last of {scans:.0f} scans"
            )

    def _listeners(self) -> None:
        """Slaves count the master's absence once, and a slave's alike: else what they count is of no use."""
        check = self.given.experiments.get("listeners")
        count = None if check is None else check.reading.values.get(f"D{COUNT}")
        if check is not None and count is not None:
            times = check.cut.times if check.cut is not None else 1
            if count != times or check.reading.values.get("D8211", MASTER_SILENT) != MASTER_SILENT:
                self.found.open["listeners"] = f"a slave counts {count} for {times} absences of the master"
            else:
                self.found.checked.append("a slave counts each absence of the master once")
        for each in self.given.experiments.values():
            counts = ", ".join(map(str, each.at_slaves))
            if each.at_slaves and max(each.at_slaves) - min(each.at_slaves) > START:
                self.found.open["listeners"] = f"slaves count {counts} about one that was cut"
            elif each.at_slaves:
                self.found.checked.append(f"slaves count alike about one that was cut ({counts})")

    def _slow_master(self) -> None:
        """The master's PLC scan is no part of a link scan, or the rules are others."""
        slow = self.given.experiments.get("master_slow")
        usual = next(
            (each for each in (self.all, self.one) if each and slow and each.slaves == slow.slaves), None
        )
        if slow is None or usual is None or not (slow.reading.looks and usual.reading.looks):
            return
        now, before = self._ticks(slow), self._ticks(usual)
        if abs(now - before) <= 2.5 * self.unit:
            self.found.checked.append("D8201 does not rise with the master's PLC scan")
            return
        seen = f"{milliseconds(now):.1f} ms instead of {milliseconds(before):.1f} ms"
        self.found.unexplained.append(f"D8201 rises with the master's PLC scan: it is {seen}")

    def _floor(self, gap: float) -> None:
        """How a D8180 below 5 is taken: as an error, as 50 ms, or as it is. A slave that is off tells it."""
        for name in ("floor_40", "floor_30"):
            if (each := self.given.experiments.get(name)) is None:
                continue
            what, values = f"D8180 = {each.timeout // TIMEOUT_UNIT}", each.reading.values
            absent, meaning = (self.found.fields.get(name) for name in ("absent_station", "attempts"))
            if values.get("M8063") or values.get("D8063"):
                self.found.checked.append(
                    f"{what} is a parameter error (D8063 = {values.get('D8063', 'not read')})"
                )
            elif each.cut is None or not each.reading.looks or absent is None or meaning is None:
                self.found.open[what] = "only D8201 with a slave off tells it, and what that slave costs"
            else:
                probes = absent == AbsentStation.PROBE.value
                made = 1 if probes else attempts_per_poll(Attempts(meaning), each.retries)
                took = self._attempts(self._ticks(each), each, gap) * (gap + self.poll + each.timeout) / made
                timeout = took - gap - self.poll
                near = min((each.timeout, FLOOR), key=lambda one: abs(one - timeout))
                taken = "as it is" if near == each.timeout else f"as {format_time(FLOOR)}"
                text = f"{what} is taken {taken} (a timeout of {milliseconds(timeout):.1f} ms)"
                off = abs(near - timeout) > 0.3 * TIMEOUT_UNIT
                (self.found.unexplained if off else self.found.checked).append(text)

    # -- times -------------------------------------------------------------------------------------

    def _times(self, slot: float | None, cuts: list[Experiment]) -> None:
        why = ""
        if self.found.fields.get("reply", Reply.END.value) == Reply.END.value:
            why = (
                "replies wait for END"
                if "reply" in self.found.fields
                else "whether replies wait for END is open"
            )
        elif self.unit > TICKS_PER_MS:
            why = "D8201 is too coarse"
        elif slot is None:
            why = "the experiment one tells the time of an exchange"
        gaps = [] if why else [gap for cut in cuts if (gap := self._gap(cut)) is not None]
        if not why and not gaps:
            why = "an experiment with a slave off tells it"
        probes = self.found.fields.get("absent_station") == AbsentStation.PROBE.value
        if not why and probes and (len(gaps) < 2 or abs(gaps[0][0] - gaps[1][0]) > 1):
            why = "under probe two experiments with a slave off must agree, as noise may have hit the scan"
        if why:
            self.found.open |= dict.fromkeys(TIMES, why)
            return
        gap = min(gaps, key=lambda one: one[2] - one[1])
        exchange = list(
            self._corners(lambda all_, one: (all_ - one) / (self.given.slaves - 1) - self.poll - self.data)
        )
        least, most = min(exchange), max(exchange)
        ends = list(self._corners(self._overhead))
        low, high = min(ends) - gap[2], max(ends) - gap[1]
        self.found.times = {
            "master_gap": gap,
            "turnaround": (exchange[0] - gap[0], max(0.0, least - gap[2]), most - gap[1]),
            "scan_overhead": (ends[0] - gap[0], max(0.0, low), high),
        }
        if any(value < -0.2 for value, _, _ in self.found.times.values()):
            self.found.unexplained.append("the times that the readings leave are below 0")
        self.found.times = {name: (max(0.0, v), lo, hi) for name, (v, lo, hi) in self.found.times.items()}

    def _overhead(self, all_: float, one: float) -> float:
        """Overhead and gap together: what a scan has beside frames and exchanges."""
        slaves = self.given.slaves
        return all_ - self.data - slaves * (all_ - one) / (slaves - 1)

    def _corners(self, of: Callable[[float, float], float]) -> Iterator[float]:
        """A time in ms by both scans as read, then by all that rounding may have made of them."""
        assert self.all is not None and self.one is not None  # noqa: S101, PT018 - there is a slot
        scans = self._ticks(self.all), self._ticks(self.one)
        half = self.unit / 2 + _SPREAD
        for one, two in ((0.0, 0.0), *product((-half, half), repeat=2)):
            yield milliseconds(of(scans[0] + one, scans[1] + two))

    def _gap(self, cut: Experiment) -> tuple[float, float, float] | None:
        """The master's gap: what a scan with n attempts at a silent slave has beside polls and timeouts."""
        attempts = self.found.fields.get("attempts")
        probes = self.found.fields.get("absent_station") == AbsentStation.PROBE.value
        longest = cut.reading.values.get("D8202")
        if attempts is None or not cut.reading.looks or (probes and longest is None):
            return None
        n = attempts_per_poll(Attempts(attempts), cut.retries)
        shown = float(longest or 0) * self.unit if probes else self._ticks(cut)
        fixed = n * (self.poll + cut.timeout) + self.parameters

        def gap(all_: float, one: float) -> float:
            return (shown - all_ + (all_ - one) / (self.given.slaves - 1) - fixed) / (n + 1)

        values = list(self._corners(gap))
        spread = _SPREAD * self.given.slaves if probes else _SPREAD  # D8202 is the longest of many scans
        more = milliseconds((self.unit / 2 + spread) / (n + 1))
        return values[0], max(0.0, min(values) - more), max(values) + more
