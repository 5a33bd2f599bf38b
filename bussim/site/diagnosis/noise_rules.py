"""Rules about noise: on the wire, in a receiver, of a sender, in bursts, or none at all."""

from __future__ import annotations

from math import expm1, log1p, sqrt
from statistics import median

from bussim.engines.nn import codes
from bussim.site.diagnosis.causes import Cause, Tally
from bussim.site.diagnosis.witness import START, Witness
from bussim.site.link import SteadyNoise
from bussim.site.noise.lenses import root

#: A reading this unlikely under steady noise is one of bursts.
_UNLIKELY = 1e-2
#: Below it a station's receiver misses nothing to speak of beside one that does.
_QUIET = 0.05
#: Damaged frames of the master beside so many station errors are their fault, or both that of the line.
_OFTEN = 0.3


def noise_rules(w: Witness, tally: Tally) -> None:
    """All of these rules."""
    told = w.about_master
    most = max(told.values(), default=0)
    if most:
        _slaves_count(w, tally, told, most)
    _sender(w, tally, most)
    _hidden(w, tally, most)
    _healthy(w, tally, most)


def _slaves_count(w: Witness, tally: Tally, told: dict[int, int], most: int) -> None:
    """Damaged frames of the master: the same at all slaves, at one, or different at each."""
    counts = ", ".join(f"{number}: {count}" for number, count in told.items())
    middle = median(told.values())
    late = 0.12 * middle * any(map(w.by_master, w.numbers))  # stations that joined late heard less
    equal = all(abs(count - middle) <= 1.2 * sqrt(middle) + 1 + late for count in told.values())
    misses = {s.supposed: w.own_misses(s) for s in w.listeners}
    several = [str(j) for j, count in misses.items() if count > max(START, 0.1 * most)]
    missed = f"stations {', '.join(several)} each missed replies that others heard"
    first = max(told, key=lambda j: told[j])
    rest = max((count for j, count in told.items() if j != first), default=0)
    if len(told) == 1:
        why = f"the only slave read counts {most} damaged frames of the master"
        tally.add(Cause.NOISE_WIRE, None, 2, why)
        tally.add(Cause.NOISE_RECEIVER, first, 2, why)
    elif rest <= _QUIET * most + 1 and most > START:
        why = f"station {first} counts {most} damaged frames of the master, the others at most {rest}"
        tally.add(Cause.NOISE_RECEIVER, first, 5, why)
        if misses.get(first):
            why = f"it also missed at least {misses[first]} replies that others heard"
            tally.add(Cause.NOISE_RECEIVER, first, 3, why)
        return
    elif equal:
        why = f"D8203 is the same at all slaves, to the count's own spread ({counts})"
        tally.add(Cause.NOISE_WIRE, None, 6 * min(1.0, (most + 2) / 5), why)
        if len(several) > 1:
            tally.add(Cause.NOISE_RECEIVERS, None, 4, missed)
    else:
        tally.add(Cause.NOISE_RECEIVERS, None, 5, f"D8203 differs from slave to slave ({counts})")
        tally.add(Cause.NOISE_WIRE, None, 1, f"all slaves read count damaged frames of the master ({counts})")
        if several:
            tally.add(Cause.NOISE_RECEIVERS, None, 2, missed)
    lone = max(w.errors, key=lambda k: w.errors[k])
    others = sum(w.errors.values()) - w.errors[lone]
    if len(w.errors) > 1 and w.errors[lone] > 10 and others <= _QUIET * w.errors[lone]:
        why = f"only station {lone} is counted ({w.errors[lone]}, others {others}), and noise hits all alike"
        tally.add(Cause.NOISE_WIRE, None, -5, f"but {why}")
        if most > _OFTEN * w.errors[lone]:
            why = f"only station {lone} is counted, and as often the master's frames are damaged ({most})"
            tally.add(Cause.SLOW_REPLY, lone, 5, why)
        return
    _bursts(w, tally, middle)


def _bursts(w: Witness, tally: Tally, count: float) -> None:
    """More station errors, or longer scans, than steady noise of this strength gives."""
    from scipy.special import gammainc

    link, base = w.link, tally.score(Cause.NOISE_WIRE)
    # The strongest steady noise that may have given such a count.
    ber = root(lambda b: w.scans(b) * link.master_damaged(b), max(count, 1) + 2 * sqrt(max(count, 1)), 2e-3)
    noise = SteadyNoise(ber)
    scans, seen = w.scans(ber), sum(w.errors.values())
    expected = scans * link.station_errors(link.attempt(noise)[0].failed) * len(w.numbers)
    found = []
    if seen and float(gammainc(seen, expected)) < _UNLIKELY:  # P(that many or more)
        found.append(
            f"{seen} station errors that all saw; steady noise of this strength gives {expected:.2g}"
        )
    longest, law = w.least_longest, link.distribution(noise)
    if longest is not None and law is not None:
        tail = float(law.tail((longest - 0.5) * link.model.unit))
        chance = -expm1(scans * log1p(-min(tail, 1 - 1e-12)))
        if chance < _UNLIKELY:
            found.append(f"D8202 = {longest} at all, which steady noise would show with {chance:.1g}")
    silent = [s for s in w.listeners if s.code(0) == codes.MASTER_SILENT]
    if silent and len(silent) == len(w.listeners):
        found.append("code 11 at every slave, beside damaged frames")
    if w.bursts == "seen":
        found.append("the ladder counts more scans with several failures than chance makes")
    for index, why in enumerate(found):
        tally.add(Cause.NOISE_BURSTS, None, 1 if index else base + 2.5, why)  # one alone leads by less than 3
    if not found and w.bursts == "not seen":
        tally.add(Cause.NOISE_WIRE, None, 2, "by the ladder's counts failures do not come together")
    elif not found:
        why = "there is noise on the wire, and nothing here tells bursts from steady noise"
        tally.add(Cause.NOISE_BURSTS, None, 0.6 * base, why)


def _sender(w: Witness, tally: Tally, most: int) -> None:
    """Only one station's replies are damaged or missing, alike at all observers."""
    errors = w.errors
    for k in [k for k, count in errors.items() if count]:
        # Of a station that came late a part may be of the start: it says nothing of the others.
        others = sum(errors[j] for j in errors if j != k and w.by_master(j) <= errors[j] + START)
        named, teller = w.readout.at(k), w.master or w.listeners[0]
        gone = named is not None and (w.deaf(named) or w.halted(named))
        if gone or others > _QUIET * errors[k] + 1 or most > max(START, _OFTEN * errors[k]):
            continue
        points, code = 3.0 + min(3.0, errors[k]) - (errors[k] < max(errors.values())), teller.code(k) or 0
        why = f"only station {k} is counted ({errors[k]} by all), with code {code:02X} at {teller.place}"
        damaged = code == codes.DAMAGED
        tally.add(Cause.NOISE_SENDER, k, points if damaged else points - 3, why)
        tally.add(Cause.REPLIES_LOST, k, points - 3 if damaged else points, why)


def _hidden(w: Witness, tally: Tally, most: int) -> None:
    """Failed attempts that retries hide show in D8202 and at one end of the line only."""
    misses, longest, link = w.master_misses, w.least_longest, w.link
    if most > 1:
        return
    if misses > START:
        why = f"the master counts {misses} damaged replies that no slave misses"
        tally.add(Cause.NOISE_RECEIVER, 0, 7, why)
    if longest is None or longest <= link.normal or w.flagged or any(w.errors.values()):
        return
    silent = longest * link.model.unit - link.healthy >= (link.torn + link.silent) / 2
    why = f"every station saw a scan of {longest} or more (healthy: {link.normal}), none damaged frames; "
    kinds = (("damaged", link.torn), ("lost", link.silent))
    costs = [f"{why}a {kind} reply costs {link.units(ticks):.0f}" for kind, ticks in kinds]
    tally.add(Cause.NOISE_SENDER, None, 2.5 if silent else 4, costs[0])
    tally.add(Cause.REPLIES_LOST, None, 4 if silent else 0.5, costs[1])
    why += "noise in the master's own receiver would do that"
    tally.add(Cause.NOISE_RECEIVER, 0, 2 if silent else 3.5, why)


def _healthy(w: Witness, tally: Tally, most: int) -> None:
    """Counts that a start leaves, normal scans, no station missing."""
    longest, normal = w.least_longest, w.link.normal
    gone = any(w.deaf(s) or w.halted(s) for s in w.readout.stations)
    if w.flagged or gone or most > START or (w.master is None and not w.listeners):
        return
    if all(w.by_master(k) <= START for k in w.numbers):
        tally.add(Cause.HEALTHY, None, 3, f"no station is counted more than {START} times, and no flag is on")
    elif w.staggered:
        why = "all counts follow from power-up one station after the other, and no flag is on"
        tally.add(Cause.HEALTHY, None, 1, why)
    else:
        tally.add(Cause.HEALTHY, None, -2, "there are counts that no start explains")
    if most:
        tally.add(Cause.HEALTHY, None, -3, f"a slave counts {most} damaged frames of the master")
    if longest is not None:
        points = 3 if longest <= normal else -4
        tally.add(Cause.HEALTHY, None, points, f"the least D8202 is {longest}, of a healthy scan {normal}")
