"""The lenses read together: how much noise, of what kind, where, and what is not known."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from math import log
from typing import Any

from bussim.engines.nn import codes
from bussim.site.diagnosis.witness import Witness
from bussim.site.link import SiteLink, SteadyNoise
from bussim.site.noise.lenses import Lens, Measured, measure, poisson_mean
from bussim.site.readout import Readout

#: A reading this unlikely without bursts, or without another cause, is one of them.
_UNLIKELY = 1e-3
#: Fewer failing scans than this tell nothing of bursts.
_FEW = 20


@dataclass(frozen=True, slots=True)
class Fails:
    """The probability that an attempt at a station fails, for any cause, and the lens that limits it."""

    value: float
    low: float
    high: float
    lens: str


@dataclass(frozen=True, slots=True)
class Picture:
    """What a readout says of a link's noise.

    ``noise`` are the likeliest values, ``upper`` the upper limits; ``bursts`` is "seen", "not seen" or
    "cannot tell".
    """

    measured: Measured
    fails: Mapping[int, Fails]
    bursts: str
    noise: SteadyNoise
    upper: SteadyNoise
    unexplained: tuple[str, ...]
    unknown: tuple[str, ...]

    @property
    def link(self) -> SiteLink:
        """The link that it is of."""
        return self.measured.link

    def entries(self) -> list[dict[str, object]]:
        """The noise as a scenario has it; of bursts none, as their lengths are not known."""
        return [] if self.bursts == "seen" else self.noise.entries(self.link.names)

    def to_json(self) -> dict[str, Any]:
        """The picture as plain data."""
        return {
            "scans": dict(zip(("least", "likeliest", "most"), self.measured.scans, strict=True)),
            "stations": {str(k): {"attempt_fails": asdict(fails)} for k, fails in self.fails.items()},
            "bursts": self.bursts,
            "noise": self.entries(),
            "noise_upper_limits": self.upper.entries(self.link.names),
            "lenses": [
                {key: value for key, value in asdict(lens).items() if key != "count"}
                for lens in self.measured.lenses
            ],
            "unexplained": list(self.unexplained),
            "not_known": list(self.unknown),
        }


def picture(readout: Readout, link: SiteLink) -> Picture:
    """Read all lenses of a readout together."""
    found = measure(readout, link)
    wires = (_wire(found, lens) for lens in found.named("S"))
    wire = min(wires, key=lambda one: one[2], default=(0.0, 0.0, 0.0))
    own = {int(lens.station or 0): lens for lens in found.named("L") if lens.count}
    masters = [lens for k in range(1, link.settings.slaves + 1) if (lens := found.of("M", k)) is not None]
    for alone in (False, True):
        value, low, high = (
            SteadyNoise(
                0.0 if alone else ber,
                {j: getattr(lens, key) for j, lens in own.items()},
                {0: ber} if alone else {},
            )
            for ber, key in zip(wire, ("value", "low", "high"), strict=True)
        )
        # By the damage that slaves count, of each station; of the wire replies would suffer as well.
        middle, least, most = ([each.failed for each in link.attempt(noise)] for noise in (value, low, high))
        if not masters or any(lens.high >= least[int(lens.station or 0) - 1] for lens in masters):
            break
    numbers, bursts = range(1, link.settings.slaves + 1), _bursts(readout, found)
    if bursts != "not seen":
        least = [min(each, _least_in_bursts(found)) for each in least]
    fails = {k: _fails(found, k, least, (middle[k - 1], most[k - 1]), bursts) for k in numbers}
    unexplained = []
    senders, lost = dict(value.senders), {}
    if alone:
        text = "replies are damaged less often than noise on the wire would: the master's own frames are"
        unexplained.append(f"{text} ({masters[0].reading})")
    for k in numbers:
        lens = found.of("M", k)
        if lens is None or not lens.count or lens.low <= most[k - 1]:
            continue
        excess = 1 - (1 - lens.value) / (1 - middle[k - 1])
        if _silent(readout, found, k):
            lost[k] = excess
        else:
            senders[k] = 1 - (1 - excess) ** (1 / link.data_bits)
        chance = _at_least(lens.count, found.scans[2] * link.station_errors(most[k - 1]))
        by = f"a chance of {chance:.1g}" if chance > 1e-99 else "no chance"
        kind = "lost or missing" if k in lost else "damaged where slaves do not tell"
        unexplained.append(f"{lens.reading} has {by} by the damage that slaves count; replies are {kind}")
    beyond = _ladder_beyond(found, most)
    unexplained += beyond
    if beyond and (ladder := found.of("E", None)) and (share := found.of("T", None)):
        # No station tells where: the same at each station that the master's counts leave.
        rest = [k for k in numbers if k not in lost and k not in senders] or [*numbers]
        known = sum(-log(1 - each) for each in middle) + sum(lost.values())
        more = max(0.0, -log(1 - ladder.value) - known) / len(rest)
        if share.low > _silent_of_damage(link):
            lost |= {k: lost.get(k, 0.0) + more for k in rest}
    noise = SteadyNoise(value.wire, value.receivers, senders, lost)
    left = {k: 1 - (1 - each.high) / (1 - most[k - 1]) for k, each in fails.items()}
    by_noise = link.attempt(noise)
    for k, each in fails.items():
        if bursts != "seen" and not (each.lens == "M" and each.low > 0):
            fails[k] = replace(each, value=min(max(by_noise[k - 1].failed, each.low), each.high))
    upper = replace(high, lost={k: min(0.99, share) for k, share in left.items() if share > 1e-9})
    unknown = _unknown(readout, found, bursts, lost_anywhere=bool(beyond and lost))
    return Picture(found, fails, bursts, noise, upper, tuple(unexplained), tuple(unknown))


def _wire(found: Measured, lens: Lens) -> tuple[float, float, float]:
    """What a slave's count leaves for the wire: all but what only its own receiver misses."""
    own = found.of("L", lens.station)
    if own is None or not own.count:
        return lens.value, lens.low, lens.high
    return max(0.0, lens.value - own.value), max(0.0, lens.low - own.high), lens.high


def _least_in_bursts(found: Measured) -> float:
    """The least mean probability of a damaged data frame, bursts or not, by the frames that slaves count.

    Each count is one damaged frame at least, of the master's data frame and its polls.
    """
    frames = 1 + found.link.settings.slaves
    rates = [poisson_mean(lens.count)[0] / found.scans[2] / frames for lens in found.named("S")]
    return min(rates, default=0.0)


def _fails(found: Measured, k: int, least: list[float], damage: tuple[float, float], bursts: str) -> Fails:
    """The probability of a failed attempt: at least the damage that slaves tell, at most any cause's.

    Only where failures come one by one is p^n the probability that all attempts of an exchange fail; where
    they come together that is likelier, up to p itself, and D8202 and the ladder bound nothing. ``damage``
    are the likeliest and the greatest value by the slaves' counts.
    """
    lens, ladder, link = found.of("M", k), found.of("E", None), found.link
    if lens is not None and lens.count:
        lowest = lens.low if bursts == "not seen" else link.station_errors(lens.low)
        low = min(max(lowest, least[k - 1]), lens.high)
        share = ladder.value / link.settings.slaves if ladder is not None else low
        value = max(share, low) if bursts == "seen" else max(lens.value, low)
        # Of failures that come together a count of onsets tells the least only.
        high = 1.0 if bursts == "seen" and link.model.error_count.on_edge else lens.high
        return Fails(min(value, lens.high), low, high, "M")
    limits = {"M": lens.high} if lens is not None else {}
    if bursts != "seen" and (bounds := found.named("X")):
        # At one station alone, the same longest scan leaves so much more.
        limits["X"] = min(1.0, max(bound.high for bound in bounds) * link.settings.slaves)
    if bursts != "seen" and ladder is not None:
        others = sum(each for j, each in enumerate(least, 1) if j != k)
        limits["E"] = max(0.0, -log(1 - ladder.high) - others)
    name = min(limits, key=lambda one: limits[one], default="")
    # A limit below what the slaves count contradicts them: both cannot be of one law.
    high = limits.get(name, 1.0) if limits.get(name, 1.0) >= least[k - 1] else max(damage[1], least[k - 1])
    value = min(max(damage[0], least[k - 1]), high)
    by = " and ".join(each for each in ("S" if damage[0] else "", name) if each) or "none"
    return Fails(value, min(least[k - 1], high), high, by)


def _silent(readout: Readout, found: Measured, k: int) -> bool:
    """Whether failed attempts at a station are silence rather than damage: by the codes, then the ladder."""
    told = [station.code(k) for station in readout.stations if station.supposed != k]
    silent = sum(code in (codes.NO_REPLY, codes.NOT_IN_NETWORK) for code in told)
    damaged = sum(code == codes.DAMAGED for code in told)
    share = found.of("T", None)
    return silent > damaged if silent != damaged else share is not None and share.value > 0.5


def _at_least(count: int, expected: float) -> float:
    """P(so many events or more) of a Poisson number."""
    from scipy.special import gammainc

    return float(gammainc(count, expected)) if count else 1.0


def _bursts(readout: Readout, found: Measured) -> str:
    """Whether failed attempts come together: scans with more than one, against those with one."""
    ladder, lens = readout.ladder, found.of("E", None)
    if ladder is None or lens is None or len(ladder.rises) < 3:
        return "cannot tell"
    # All failures at one station would come together most often of what has no memory.
    expected = found.scans[2] * lens.high**2
    if ladder.rises[2] and _at_least(ladder.rises[2], expected) < _UNLIKELY:
        return "seen"
    return "not seen" if ladder.rises[0] >= _FEW else "cannot tell"


def _silent_of_damage(link: SiteLink) -> float:
    """The share of failed attempts that are silent where bits are wrong: a poll or a header was hit."""
    return 60 / (50 + link.data_bits)


def _ladder_beyond(found: Measured, most: list[float]) -> list[str]:
    """What the ladder counts beyond the damage that slaves tell."""
    lens, share = found.of("E", None), found.of("T", None)
    if lens is None or share is None:
        return []
    texts = []
    by_damage = -sum(log(1 - p) for p in most)
    if -log(1 - lens.low) > by_damage and found.named("S"):
        texts.append(
            f"{lens.reading}: at least {lens.low:.2g} of the scans, by damage at slaves "
            f"{by_damage:.2g} at most; replies are lost, or damaged at the master or by a slave's driver"
        )
    base = _silent_of_damage(found.link)
    if share.low > base:
        texts.append(
            f"{share.value:.0%} of the failed attempts are silent, of damage {base:.0%}: replies are lost"
        )
    return texts


def _unknown(readout: Readout, found: Measured, bursts: str, *, lost_anywhere: bool) -> list[str]:
    """What these readings cannot tell, each with the reading that would."""
    link, master, ladder = found.link, readout.at(0), found.of("E", None)
    witness = Witness(readout, link)
    hidden = link.n > 1 and readout.ladder is None and not any(lens.count for lens in found.named("M"))
    share = f" ({ladder.low:.2g} to {ladder.high:.2g} of the scans)" if ladder is not None else ""
    law = f"{link.units(link.lawful):.0f} by profile and settings: of another machine, or replies wait less"
    texts = {
        "how many scans there were: the master does not work now, since when is not known": witness.stopped,
        **{
            f"what fails at {readout.label(k)} while it works: it is or was away, and counted for that": True
            for k in witness.numbers
            if witness.missing(k)
        },
        f"limits by D8202: scans of {link.shown} were seen, {law}": not link.fits,
        "lost or damaged, and where: there is no count of a slave that works (D8203 tells of the wire, "
        "others of receivers)": not found.named("S"),
        "which station fails: the master was not read; its D8204 on tell that": witness.master is None,
        f"failed attempts that retries hide (n = {link.n}): the ladder counts them (see --plan)": hidden,
        "bursts: only the ladder's third threshold tells them from steady noise": bursts == "cannot tell",
        f"burst: shares are known{share}, lengths are not; bussim sniff measures them": bursts == "seen",
        "all failing scans: the master's PLC scan is longer than the link's, so the ladder misses some": (
            ladder is not None and master is not None and (master.plc_scan or 0) >= link.healthy
        ),
        "what the start left: up to 2 counts of a station and the longest scans may be of it": (
            not any(station.before for station in readout.stations)
        ),
        "which station leaves polls without a reply: the same share is entered at each": lost_anywhere,
        "noise in the master's receiver and of a slave's driver apart: slaves do not tell them": True,
    }
    return [text for text, holds in texts.items() if holds]
