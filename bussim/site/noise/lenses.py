"""What single readings tell of a link's noise: each an exact interval, side by side, never averaged.

A count is inverted by way of its expectation, which rises with what is asked for: Garwood's interval of a
Poisson mean (Biometrika 28, 1936), Clopper and Pearson's of a probability. The number of scans is not read:
it lies between what it would be if all failed attempts had run to their deadline, and if none had.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from math import exp, factorial, log

from bussim.live.fit.statistics import CONFIDENCE, proportion
from bussim.site.diagnosis.witness import Witness
from bussim.site.link import SiteLink, SteadyNoise
from bussim.site.readout import COUNT, START, Readout

#: The greatest bit error rate that a count is inverted to.
_WORST = 2e-3
_ONE_SIDED = 1 - CONFIDENCE


@dataclass(frozen=True, slots=True)
class Lens:
    """One reading: what it is, of which station, and the value that it tells with its interval.

    Without events the interval is one-sided: its upper end holds with 95 %.
    """

    name: str
    station: int | None
    reading: str
    tells: str
    count: int
    value: float
    low: float
    high: float
    rests_on: str


def root(rising: Callable[[float], float], wanted: float, high: float) -> float:
    """The x in 0…``high`` at which a rising function has a value; an end of the range where it has not."""
    from scipy.optimize import brentq

    if wanted <= rising(0.0):
        return 0.0
    if rising(high) <= wanted:
        return high
    return float(brentq(lambda x: rising(x) - wanted, 0.0, high, xtol=1e-15, rtol=1e-9))


def poisson_mean(count: int) -> tuple[float, float]:
    """The interval of a Poisson mean; without events its upper end is one-sided."""
    from scipy.special import gammainccinv, gammaincinv

    tail = _ONE_SIDED / 2
    low = float(gammaincinv(count, tail)) if count else 0.0
    return low, float(gammainccinv(count + 1, tail if count else _ONE_SIDED))


@dataclass
class Measured:
    """The lenses of a readout, and its number of scans: at least, most likely, at most."""

    link: SiteLink
    lenses: list[Lens] = field(default_factory=list)
    scans: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def named(self, name: str) -> list[Lens]:
        """The lenses with a name."""
        return [lens for lens in self.lenses if lens.name == name]

    def of(self, name: str, station: int | None) -> Lens | None:
        """The lens with a name about a station."""
        return next((lens for lens in self.named(name) if lens.station == station), None)


def measure(readout: Readout, link: SiteLink) -> Measured:
    """All lenses that a readout has, with the number of scans solved together with what they tell."""
    scans = readout.watched / link.healthy
    found = Measured(link, scans=(scans, scans, scans))
    witness = Witness(readout, link)
    if witness.stopped:  # since when is not known: no number of scans, and no lens
        found.scans = (0.0, *found.scans[1:])
        return found
    # Where a calibration found that listeners count otherwise, what they count tells nothing.
    listeners = (_slaves, _missed) if "listeners" not in readout.profile.open else ()
    for _ in range(6):
        found.lenses = [*_masters(witness, found), *_ladder(witness, found)]
        for lens_of in listeners:
            found.lenses += [*lens_of(witness, found)]
        before, found.scans = found.scans, _scans(witness, found)
        if abs(before[0] - found.scans[0]) < 0.5:
            break
    found.lenses += _longest(witness, found)
    return found


def _away(witness: Witness, link: SiteLink) -> tuple[float, float, float]:
    """The time that stations which are or were away have cost, at most, likeliest and at least."""
    each = {k: (1 if link.model.absent.probes else link.n) for k in witness.numbers if witness.missing(k)}
    ended = link.model.parameters_cost - link.slot if link.n > 1 else 0.0
    costs = {k: tries * link.silent + ended for k, tries in each.items()}
    always = witness.readout.watched / (link.healthy + sum(costs.values()))
    counts = {k: None if witness.master is None else witness.master.exact(k) for k in costs}
    if link.model.error_count.on_edge or None in counts.values():
        most = always * sum(costs.values())
        return most, most / 2, 0.0
    spent = [(counts[k] or 0) * cost for k, cost in costs.items()]
    return sum(spent), sum(spent), sum(spent)


def _scans(witness: Witness, found: Measured) -> tuple[float, float, float]:
    """Scans by what failed attempts cost: with the most failures, all silent, to the fewest, all torn."""
    link, slaves, away = found.link, found.link.settings.slaves, _away(witness, found.link)
    ladder, share = found.of("E", None), found.of("T", None)
    if ladder is not None:
        failures = [-log(max(1e-9, 1 - q)) for q in (ladder.high, ladder.value, ladder.low)]
    else:
        # Of M lenses without events the limits are no estimate: p may lie far below.
        wire, counted = found.named("S"), [lens for lens in found.named("M") if lens.count]
        failures = []
        for key in ("high", "value", "low"):
            ber = min((getattr(lens, key) for lens in wire), default=0.0)
            p = link.attempt(SteadyNoise(ber))[0].failed * slaves
            failures.append(max(p, sum(getattr(lens, key) for lens in counted)))
    silent = (share.high, share.value, share.low) if share is not None and share.count else (1.0, 0.5, 0.0)
    costs = [
        each * (part * link.silent + (1 - part) * link.torn)
        for each, part in zip(failures, silent, strict=True)
    ]
    watched = [max(0.01 * witness.readout.watched, witness.readout.watched - spent) for spent in away]
    least, middle, most = (time / (link.healthy + cost) for time, cost in zip(watched, costs, strict=True))
    return least, middle, most


def _inverted(
    rising: Callable[[float], float], rate: tuple[float, float, float], high: float
) -> tuple[float, float, float]:
    """The value, low and high at which a rate per scan, rising with them, is reached."""
    value, low, upper = (root(rising, wanted, high) for wanted in rate)
    return value, low, upper


def _rates(found: Measured, count: int, *, fewer: int = 0) -> tuple[float, float, float]:
    """A count per scan, its lower limit with the most scans and its upper limit with the fewest."""
    least, middle, most = found.scans
    return count / middle, poisson_mean(max(0, count - fewer))[0] / most, poisson_mean(count)[1] / least


def _masters(witness: Witness, found: Measured) -> Iterable[Lens]:
    """M: station errors that the master counts. On the rising branch, where most exchanges succeed."""
    master, link = witness.master, found.link
    for k in witness.numbers:
        count = None if master is None else master.exact(k)
        if master is None or count is None or witness.missing(k):
            continue
        fewer = 0 if master.before else min(START, count)  # which the start may have left
        most = 0.5 ** (1 / link.n) if link.model.error_count.on_edge else 1 - 1e-9
        value, low, high = _inverted(link.station_errors, _rates(found, count, fewer=fewer), most)
        reading = f"D{COUNT + k} of {master.place} = {count}"
        rests = f"n = {link.n}, {link.model.absent}, {link.model.error_count}"
        yield Lens("M", k, reading, "failed attempts", count, value, low, high, rests)


def _slaves(witness: Witness, found: Measured) -> Iterable[Lens]:
    """S: damaged frames of the master that a slave counts, whatever retries hide."""
    link, least = found.link, found.scans[1]
    polls = link.settings.slaves + max(0.0, (witness.readout.watched / least - link.healthy) / link.torn)
    for station in witness.listeners:
        count = witness.about_master.get(station.supposed)
        if count is None or station.exact(0) is None:
            continue
        rates = _rates(found, count)
        value, low, high = _inverted(lambda ber: link.master_damaged(ber, polls), rates, _WORST)
        reading = f"D{COUNT} of {station.place} = {count}"
        tells = "BER: wire and ends"
        yield Lens("S", station.supposed, reading, tells, count, value, low, high, "how listeners count")


def _missed(witness: Witness, found: Measured) -> Iterable[Lens]:
    """L: replies that one slave missed and others heard.

    What all observers count alike may be of the wire or of all receivers: it is left out of the value and of
    the lower limit, and in the upper one.
    """
    link = found.link
    wire = min((lens.value for lens in found.named("S")), default=0.0)
    # Only of a reply that some attempt brings whole to the others can one station alone miss it.
    whole = 1 - link.attempt(SteadyNoise(wire))[0].failed ** link.n
    for station in witness.listeners:
        j, total, seen, all_ = station.supposed, 0, 0, 0
        for k in witness.numbers:
            others = [count for i, count in witness.by_slaves(k).items() if i != j]
            others += [witness.by_master(k)] if witness.master is not None else []
            if k != j and (count := station.exact(k)) is not None and others and not witness.missing(k):
                total, seen, all_ = total + 1, seen + max(0, count - min(others)), all_ + count
        if not total:
            continue
        # Stations are read one after the other, so that counts differ a little.
        value, low, _ = (rate / total / whole for rate in _rates(found, seen, fewer=START))
        rates = value, low, _rates(found, all_)[2] / total / whole
        value, low, high = _inverted(lambda ber: link.damaged(ber, link.data_bits), rates, _WORST)
        reading = f"{seen} missed by {station.place} alone"
        tells, rests = "BER: its receiver alone", "how listeners count"
        yield Lens("L", j, reading, tells, seen, value, low, high, rests)


def _ladder(witness: Witness, found: Measured) -> Iterable[Lens]:
    """E: scans with a failed attempt; T: the share of them that were silent."""
    ladder, master = witness.readout.ladder, witness.readout.at(0)
    if ladder is None:
        return
    rises = ladder.rises
    value, low, high = _inverted(lambda q: q * (1 - q), _rates(found, rises[0]), 0.5)
    if master is not None and (master.plc_scan or 0) >= found.link.healthy:
        high = 0.5  # a ladder that is not run in each link scan misses some
    reading = f"{rises[0]} rises of D8201 to {ladder.thresholds_ms[0]:g}"
    tells = "failing scans"
    yield Lens("E", None, reading, tells, rises[0], value, low, high, "a short PLC scan")
    if len(rises) > 1 and rises[0]:
        again = _inverted(lambda q: q * (1 - q), _rates(found, rises[1]), 0.5)[0]
        scans = [round(found.scans[1] * share) for share in (value, again)]
        part = proportion(min(scans), scans[0])
        shares = [
            _silent_share(found.link, value, value * (each or 0.0))
            for each in (part.value, part.low, part.high)
        ]
        reading = f"{rises[1]} rises to {ladder.thresholds_ms[1]:g}"
        tells = "silent share of failed"
        rests = "the healthy scan"
        yield Lens("T", None, reading, tells, rises[0], shares[0], shares[1], shares[2], rests)


def _silent_share(link: SiteLink, failing: float, long: float) -> float:
    """The share of silent attempts, by the scans that fail and those so long: of one, or many torn ones."""
    mean = -log(1 - min(failing, 1 - 1e-9))
    many = int((link.torn + link.silent) / 2 / link.torn) + 1

    def beyond(share: float) -> float:
        torn = mean * (1 - share)
        few = sum(torn**i / factorial(i) for i in range(many)) * exp(-torn)
        return 1 - exp(-mean * share) * few

    return root(beyond, long, 1.0)


def _longest(witness: Witness, found: Measured) -> Iterable[Lens]:
    """X: the least D8202 of all stations, which bounds and does not measure; for both kinds of failure."""
    link, ladder, read = found.link, witness.readout.ladder, witness.least_longest
    seen = [] if read is None else [(read, "the least D8202")]
    if ladder is not None and ladder.max_ms is not None:
        seen.append((round(ladder.max_ms), "the ladder's longest"))
    if not seen or not link.fits:
        return  # a law that does not hold bounds nothing
    longest, where = min(seen, key=lambda one: one[0])
    edge, slaves = (longest + 0.5) * link.model.unit, link.settings.slaves
    tail = 1 - _ONE_SIDED ** (1 / found.scans[0])

    def beyond(noise: SteadyNoise) -> float:
        law = link.distribution(noise)
        return 1.0 if law is None else float(law.tail(edge))

    def lost(p: float) -> SteadyNoise:
        return SteadyNoise(lost=dict.fromkeys(range(1, slaves + 1), p))

    wire = link.attempt(SteadyNoise(_rough(lambda ber: beyond(SteadyNoise(ber)), tail, _WORST)))[0].failed
    kinds = {"damaged": wire, "lost": _rough(lambda p: beyond(lost(p)), tail, 0.6)}
    for kind, high in kinds.items():
        reading = f"{where} = {longest} (healthy: {link.normal})"
        rests = f"all alike, all {kind}"
        yield Lens("X", None, reading, "failed attempts", 0, 0.0, 0.0, high, rests)


def _rough(rising: Callable[[float], float], wanted: float, high: float) -> float:
    """An upper bound of the x at which a rising tail, nearly a power of x, has a value, to a few per cent."""
    from scipy.optimize import brentq

    low, close = high * 1e-9, 0.02

    def above(x: float) -> float:
        return log(max(rising(exp(x)), 1e-300) / wanted)

    if above(log(low)) >= 0:
        return low
    if above(log(high)) <= 0:
        return high
    return float(min(high, exp(brentq(above, log(low), log(high), xtol=close, rtol=1e-6) + close)))
