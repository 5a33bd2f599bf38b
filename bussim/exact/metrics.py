"""The figures of one link with one setting: what ``bussim exact`` prints and its JSON form."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from bussim.exact.bursts.exchange import different
from bussim.exact.bursts.timeout_stacks import Scans
from bussim.exact.link import LinkModel
from bussim.exact.refresh import GapDistribution, gap_distributions
from bussim.exact.scan.detection import Detection, detection
from bussim.exact.scan.mixture import Distribution
from bussim.exact.scan.outages import clean_scan, dead_means, longest_scan, longest_unnoticed, ride_through
from bussim.exact.scan.turnaround_sums import Floats
from bussim.exact.solve import Solved
from bussim.exact.text import LONGEST_YEARS, in_ms, ms, ms_cell, scans_over, years_between
from bussim.units import TICKS_PER_MS, TICKS_PER_SECOND, UNIT_TICKS
from bussim.words.language import say

YEAR = int(UNIT_TICKS["y"])

#: A quantile is given only where the weight of dropped components is less than this part of its level.
_RESOLVED = 1e-3
#: The part of the mean link scan by which the blocks' data must change it to be worth telling.
_TELLING = 1e-3
#: The heaviest components of a distribution, and how many points each gets in a fine curve.
_FINE_COMPONENTS, _FINE_POINTS = 40, 65


@dataclass(frozen=True, slots=True)
class Request:
    """What to work out.

    ``levels`` are probabilities of exceeding by the keys that the user wrote; ``deadlines`` and
    ``mission`` are ticks; ``missed_per_year`` is how often a heartbeat may be missed falsely.
    ``refresh`` asks for the times between refreshes, which take by far the longest on a very noisy line.
    """

    levels: Mapping[str, float] = field(default_factory=lambda: {"1e-3": 1e-3, "1e-6": 1e-6, "1e-9": 1e-9})
    deadlines: tuple[int, ...] = ()
    mission: int = YEAR
    missed_per_year: float = 0.1
    refresh: bool = True


@dataclass(frozen=True, slots=True)
class Refresh:
    """The time between refreshes of one pair, in ticks: mean, quantiles by key, heartbeat preset.

    The preset is for a word that changes in every PLC scan of the source: the gap that is exceeded
    ``missed_per_year`` times a year, plus the longest PLC scans of both, up to the next 10 ms. None
    where the distribution does not reach so far; the mean is None where it is more than a hundred years.
    """

    mean: float | None
    quantiles: dict[str, float | None]
    heartbeat: int | None


@dataclass(frozen=True, slots=True)
class Figures:
    """Figures of one link. Times in ticks; None where ``valid`` is false or there is no such figure.

    ``error_per_scan`` is each living station's chance to be in error in a scan, ``error_per_year`` to
    be so at least once in a year; ``errors_per_year`` counts all scans of all living stations that
    are in error, ``onsets_per_year`` the times a flag goes on. ``maximum`` has quantiles of D8202 over
    ``mission``, by probability of exceeding, neighbouring scans taken as independent. ``detect_*`` are
    for the station that takes longest; if all other stations are silent as well, a death is noticed
    within ``worst_case``. ``random`` is the distribution of the link scan with random data in the blocks
    instead of zeros, where bit errors make a difference.
    """

    model: LinkModel
    valid: bool
    reasons: tuple[str, ...]
    distribution: Distribution | None = None
    mean: float | None = None
    sd: float | None = None
    shortest: int | None = None
    longest_clean: int | None = None
    worst_case: int | None = None
    quantiles: dict[str, float] = field(default_factory=dict)
    over: dict[int, float] = field(default_factory=dict)
    error_per_scan: dict[int, float] = field(default_factory=dict)
    error_per_year: dict[int, float] = field(default_factory=dict)
    errors_per_year: float | None = None
    onsets_per_year: float | None = None
    mission: int | None = None
    maximum: dict[str, float] = field(default_factory=dict)
    silence: int | None = None
    corruption: int | None = None
    one_dead: float | None = None
    two_dead: float | None = None
    detect_mean: float | None = None
    detect_longest: int | None = None
    detect: dict[str, float] = field(default_factory=dict)
    refresh: dict[str, Refresh] = field(default_factory=dict)
    random: Distribution | None = None

    def to_json(self) -> dict[str, object]:
        """One link of the JSON form, times in ms. Quantities that do not exist are null."""
        model = self.model
        return {
            "valid": self.valid,
            "reasons": list(self.reasons),
            "notes": list(model.notes),
            "not_replying": list(model.not_replying),
            "stations_dead": [station.number for station in model.dead],
            "stations": len(model.stations) + 1,
            "mode": model.mode,
            "retries": model.retries,
            "attempts": model.attempts,
            "timeout_ms": in_ms(model.timeout),
            "mean_ms": in_ms(self.mean),
            "sd_ms": in_ms(self.sd),
            "mean_random_data_ms": in_ms(self.random.mean if self.random else self.mean),
            "no_error_ms": {"min": in_ms(self.shortest), "max": in_ms(self.longest_clean)},
            "worst_case_ms": in_ms(self.worst_case),
            "quantiles_ms": {key: in_ms(x) for key, x in self.quantiles.items()},
            "p_scan_over_ms": {ms(x): p for x, p in self.over.items()},
            "station_error_per_scan": {str(k): p for k, p in self.error_per_scan.items()},
            "station_error_per_year": {str(k): p for k, p in self.error_per_year.items()},
            "false_errors_per_year": self.errors_per_year,
            "false_error_onsets_per_year": self.onsets_per_year,
            "years_between_false_errors": 1 / max(self.onsets_per_year, 1e-300)
            if self.onsets_per_year
            else None,
            "maximum_ms": {key: in_ms(x) for key, x in self.maximum.items()},
            "mission_s": None if self.mission is None else self.mission / TICKS_PER_SECOND,
            "ride_through_ms": {"silence": in_ms(self.silence), "corruption": in_ms(self.corruption)},
            "one_dead_ms": in_ms(self.one_dead),
            "two_dead_ms": in_ms(self.two_dead),
            "detect_ms": {
                "mean": in_ms(self.detect_mean),
                "max": in_ms(self.detect_longest),
                "bound": in_ms(self.worst_case if self.detect_mean is not None else None),
                **{key: in_ms(x) for key, x in self.detect.items()},
            },
            "refresh_gap_ms": {
                pair: {
                    "mean": in_ms(refresh.mean),
                    **{key: in_ms(x) for key, x in refresh.quantiles.items()},
                    "heartbeat": in_ms(refresh.heartbeat),
                }
                for pair, refresh in self.refresh.items()
            },
        }

    def in_words(self) -> list[str]:
        """The figures that are read best as sentences."""
        if not self.valid:
            return [say("exact_no_law", reason=reason) for reason in self.reasons]
        said = [scans_over(p, x) for x, p in self.over.items()]
        if self.random is not None and self.mean is not None:
            others = [scans_over(float(self.random.tail(float(x))), x) for x in self.over]
            if others != said or abs(self.random.mean - self.mean) > _TELLING * self.mean:
                mean = say("exact_random_mean", mean=ms_cell(self.random.mean))
                said.append(say("exact_random", others=[mean, *others]))
        if self.model.alive and self.onsets_per_year is not None:
            on = [each.name for each in self.model.alive if self.error_per_scan[each.number] > 0]
            if on and not self.onsets_per_year:  # it never goes off
                said.append(f"with the noise as entered the error flag of {', '.join(on)} is always on")
            else:
                said.append(years_between(self.onsets_per_year, noisy=self.model.noisy))
        never = [pair for pair, refresh in self.refresh.items() if refresh.mean is None]
        if never:
            key = "exact_no_blocks_noise" if self.model.noisy else "exact_no_blocks"
            said.append(say(key, pairs=", ".join(never)))
        if any(each.mean is not None and None in each.quantiles.values() for each in self.refresh.values()):
            said.append(say("exact_dash"))
        return said


def tail_curve(
    distribution: Distribution, least: float = 1e-12, points: int = 2_000
) -> tuple[Floats, Floats]:
    """Points of P(scan > x) for a plot with a logarithmic axis: x in ms, and the probabilities.

    From the least scan to the one exceeded with probability ``least``; both ends of every component that
    matters are among the points, so that steps stay steep.
    """
    low, high = distribution.support[0], distribution.quantile(least)
    heavy = distribution.weight >= least
    ends = np.concatenate(
        (distribution.shift[heavy], distribution.upper[heavy], np.linspace(low, high, points))
    )
    x = np.unique(ends[(ends >= low) & (ends <= high)])
    return x / TICKS_PER_MS, distribution.tail(x)


def fine_curve(distribution: Distribution) -> tuple[Floats, Floats]:
    """Points as of :func:`tail_curve`, close together where most scans are: bars of 10 µs are cut from it."""
    heaviest = np.argsort(distribution.weight)[-_FINE_COMPONENTS:]
    fine = np.linspace(distribution.shift[heaviest], distribution.upper[heaviest], _FINE_POINTS)
    rough, _ = tail_curve(distribution)
    # A component without a width is a jump: a point just before it keeps the line upright.
    ticks = np.concatenate((rough * TICKS_PER_MS, fine.ravel(), distribution.shift[heaviest] - 1))
    x = np.unique(ticks)
    return x / TICKS_PER_MS, distribution.tail(x)


def over_mission(distribution: Distribution, mission: int, level: float) -> float:
    """What the longest scan of a mission exceeds with a probability, in ticks (D8202 before rounding)."""
    scans = max(1.0, mission / distribution.mean)
    # P(maximum > x) = 1 - (1 - p)^scans = level
    return distribution.quantile(-math.expm1(math.log1p(-level) / scans))


def figures_of(
    model: LinkModel, request: Request | None = None, progress: Callable[[str, int, int], None] | None = None
) -> Figures:
    """All figures of a link; only ``valid`` and ``reasons`` where the closed form does not hold."""
    request = request or Request()
    if not model.valid:
        return Figures(model, valid=False, reasons=model.reasons)
    solved = Solved(model)
    distribution = solved.distribution
    scans = YEAR / distribution.mean
    chances = {s.number: f for s, f in zip(model.stations, solved.fails, strict=True) if s.alive}
    passed = ride_through(model, model.attempts, np.full(1, float(model.timeout)))
    random = Solved(replace(model, zeros=False)).distribution if model.noise.sources else None
    slowest = _slowest(solved)
    unnoticed = [longest_unnoticed(model, s, np.full(1, float(model.timeout))) for s in model.alive]
    return Figures(
        model,
        valid=True,
        reasons=(),
        distribution=distribution,
        mean=distribution.mean,
        sd=math.sqrt(distribution.variance),
        shortest=clean_scan(model, slowest=False),
        longest_clean=clean_scan(model, slowest=True),
        worst_case=longest_scan(model),
        quantiles={key: distribution.quantile(level) for key, level in request.levels.items()},
        over={x: float(distribution.tail(float(x))) for x in request.deadlines},
        error_per_scan={k: f.error for k, f in chances.items()},
        error_per_year={k: _once(f.error, scans) for k, f in chances.items()},
        errors_per_year=scans * sum(f.error for f in chances.values()),
        onsets_per_year=scans * sum(f.onset for f in chances.values()),
        mission=request.mission,
        maximum={
            key: over_mission(distribution, request.mission, p) for key, p in (("p50", 0.5), ("p99", 0.01))
        },
        silence=int(passed.silence[0]) if chances else None,
        corruption=int(passed.corruption[0]) if chances else None,
        one_dead=dead_means(solved, 1),
        two_dead=dead_means(solved, 2),
        detect_mean=slowest.mean if slowest else None,
        detect_longest=max((int(each[0]) for each in unnoticed), default=None),
        detect=dict(zip(request.levels, slowest.quantiles(request.levels.values()), strict=True))
        if slowest
        else {},
        refresh=_refreshes(solved, request, progress) if request.refresh else {},
        random=random,
    )


def _slowest(solved: Solved) -> Detection | None:
    """How soon the death is noticed of the station with which it takes longest."""
    model, stations = solved.model, [*different(solved.model).values()]
    if len(stations) > 1 and not model.absent.probes:
        scans, mean = Scans(solved.stacks, model.attempts), np.full(1, solved.distribution.mean)
        stations = [max(stations, key=lambda station: float(scans.noticed_of(station, mean)[0]))]
    return max((detection(solved, station) for station in stations), key=lambda d: d.mean, default=None)


def _once(probability: float, times: float) -> float:
    """The probability of at least once in so many independent attempts."""
    return 1.0 if probability >= 1 else -math.expm1(times * math.log1p(-probability))


def _refreshes(
    solved: Solved, request: Request, progress: Callable[[str, int, int], None] | None
) -> dict[str, Refresh]:
    model = solved.model
    resolved = _RESOLVED * max(request.levels.values(), default=0.5)
    known: dict[int, tuple[dict[str, float | None], float | None]] = {}
    found = {}
    for (source, receiver), gap in gap_distributions(solved, resolved=resolved, progress=progress).items():
        # Distributions of pairs that do not differ are one object; only the PLCs' scans may.
        if id(gap.distribution) not in known:
            quantiles = {key: _resolved(gap.distribution, level) for key, level in request.levels.items()}
            known[id(gap.distribution)] = quantiles, _rare_gap(solved, gap, request.missed_per_year)
        quantiles, rare = known[id(gap.distribution)]
        preset = None if rare is None else _preset(model, gap, rare)
        # Whatever the distribution: receptions a scan × mean gap = mean scan.
        often = gap.per_scan * LONGEST_YEARS * YEAR > solved.distribution.mean
        mean = solved.distribution.mean / gap.per_scan if often else None
        found[f"{model.name(source)}->{model.name(receiver)}"] = Refresh(mean, quantiles, preset)
    return found


def _resolved(distribution: Distribution, level: float) -> float | None:
    return distribution.quantile(level) if 0 < level < 1 and distribution.lost <= _RESOLVED * level else None


def _rare_gap(solved: Solved, gap: GapDistribution, per_year: float) -> float | None:
    """The gap in ticks that is exceeded so often a year; None where its probability is not resolved."""
    gaps = YEAR / solved.distribution.mean * gap.per_scan
    return _resolved(gap.distribution, min(0.5, per_year / gaps)) if gaps else None


def _preset(model: LinkModel, gap: GapDistribution, x: float) -> int:
    """A heartbeat's preset in ticks, a multiple of 10 ms; see :class:`Refresh`."""
    unit = 10 * TICKS_PER_MS
    return math.ceil((x + model.scans_between(gap.source, gap.receiver)) / unit) * unit
