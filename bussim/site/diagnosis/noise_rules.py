"""Rules about noise: on the wire, in a receiver, of a sender, in bursts, or none at all."""

from math import expm1, log1p, sqrt
from statistics import median

from bussim.engines.nn import codes
from bussim.site.diagnosis.causes import Cause, Tally
from bussim.site.diagnosis.witness import Witness
from bussim.site.link import SteadyNoise
from bussim.site.noise.lenses import root
from bussim.site.readout import START

#: A reading this unlikely under steady noise is one of bursts.
_UNLIKELY = 1e-2
#: Below it a station's receiver misses nothing to speak of beside one that does.
_QUIET = 0.05
#: Of noise for all alike station errors are not so few beside what is expected, all approximations included.
_FEW = 0.4
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
    counts = w.listed(told)
    stopped = [s.place for s in w.listeners if s.supposed in told and s.exact(0) is None]
    middle = median(told.values())
    late = 0.12 * middle * any(map(w.by_master, w.numbers))  # stations that joined late heard less
    equal = all(abs(count - middle) <= 1.2 * sqrt(middle) + 1 + late for count in told.values())
    misses = {s.supposed: w.own_misses(s) for s in w.listeners}
    several = [str(j) for j, count in misses.items() if count > max(START, 0.1 * most)]
    missed = f"stations {', '.join(several)} each missed replies that others heard"
    first = max(told, key=lambda j: told[j])
    rest = max((count for j, count in told.items() if j != first), default=0)
    if len(told) == 1:
        why = f"D8203 was read at one slave only, and counts damaged frames of the master ({counts})"
        tally.add(Cause.NOISE_WIRE, None, 2, why)
        tally.add(Cause.NOISE_RECEIVER, first, 2, why)
    elif rest <= _QUIET * most + 1 and most > START:
        why = f"station {first} counts {most} damaged frames of the master, the others at most {rest}"
        tally.add(Cause.NOISE_RECEIVER, first, 5, why)
        if misses.get(first):
            why = f"it also missed at least {misses[first]} replies that others heard"
            tally.add(Cause.NOISE_RECEIVER, first, 3, why)
        return
    elif stopped:
        why = f"all slaves read count damaged frames of the master ({counts}); how many is not known at "
        tally.add(Cause.NOISE_WIRE, None, 4, f"{why}{', '.join(stopped)}")
        tally.add(Cause.NOISE_RECEIVERS, None, 2, f"{why}{', '.join(stopped)}")
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
    from scipy.special import gammainc, gammaincc

    link, base = w.link, tally.score(Cause.NOISE_WIRE)
    # The weakest and the strongest steady noise that may have given such a count.
    ends = (max(0.0, count - 2 * sqrt(count)), max(count, 1) + 2 * sqrt(max(count, 1)))
    least, ber = (root(lambda b: w.scans(b) * link.master_damaged(b), wanted, 2e-3) for wanted in ends)
    noise, seen = SteadyNoise(ber), sum(w.errors.values())
    fewest, expected = (
        w.scans(b) * link.station_errors(link.attempt(SteadyNoise(b))[0].failed) * len(w.numbers)
        for b in (least, ber)
    )
    counted = w.master is not None and all(w.master.exact(k) is not None for k in w.numbers)
    alike = counted and not tally.score(Cause.NOISE_RECEIVERS)
    few = float(gammaincc(seen + 1, fewest)) < _UNLIKELY  # P(that many or fewer)
    if alike and few and seen < _FEW * fewest:
        why = f"{seen} station errors that all saw; noise for all alike would give {fewest:.2g} at least"
        tally.add(Cause.NOISE_SENDER, 0, base + 1.5, f"the master's frames alone are damaged: {why}")
        why = "late replies would damage the master's frames alone, too"
        tally.add(Cause.SLOW_REPLY, None, base + (2.5 if w.always_long else 1), why)
        return
    why = f"damage by {w.readout.label(0)} as it sends counts alike in all slaves, too"
    tally.add(Cause.NOISE_SENDER, 0, 1, why)
    found = []
    if seen and float(gammainc(seen, expected)) < _UNLIKELY:  # P(that many or more)
        found.append(
            f"{seen} station errors that all saw; steady noise of this strength gives {expected:.2g}"
        )
    longest, law, since = w.least_longest, link.distribution(noise), w.readout.since
    away = any(map(w.missing, w.numbers))  # which makes scans long by itself
    if longest is not None and law is not None and since is not None and not away:
        tail = float(law.tail((longest - 0.5) * link.model.unit))
        chance = -expm1(w.scans(ber, since) * log1p(-min(tail, 1 - 1e-12)))
        if chance < _UNLIKELY:
            text = f"D8202 is {longest} or more at all stations read, for which steady noise has a chance of"
            found.append(f"{text} {chance:.1g}")
    if w.all_missed:
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
        gone = named is not None and (named.halted or bool(w.deaf(named)))
        if w.master is not None and w.master.flag(k) and teller.code(k) == codes.NO_REPLY:
            gone |= named is None or not named.read  # it is missing, and nothing says that it is on
        if gone or others > _QUIET * errors[k] + 1 or most > max(START, _OFTEN * errors[k]):
            continue
        points, code = 3.0 + min(3.0, errors[k]) - (errors[k] < max(errors.values())), teller.code(k)
        given = f"code {code:02X}" if code else "its code not read"
        count = "it climbs" if teller.climbs(k) else f"{errors[k]} by all"
        why = f"only station {k} is counted ({count}), with {given} at {teller.place}"
        damaged = code == codes.DAMAGED
        tally.add(Cause.NOISE_SENDER, k, points if damaged else points - 3, why)
        tally.add(Cause.REPLIES_LOST, k, points - 3 if damaged else points, why)


def _hidden(w: Witness, tally: Tally, most: int) -> None:
    """Failed attempts that retries hide show in D8202 and at one end of the line only."""
    misses, longest, link = w.master_misses, w.least_longest, w.link
    if misses > max(START, 10 * most):
        read = any(w.master.code(k) for k in w.numbers) if w.master is not None else False
        why = f"the master counts {misses} {'damaged' if read else 'failed'} replies that no slave misses"
        tally.add(Cause.NOISE_RECEIVER, 0, 7, why)
    if most > 1 or longest is None or longest <= link.normal or w.flagged or any(w.errors.values()):
        return
    silent = longest * link.model.unit - link.healthy >= (link.torn + link.silent) / 2
    none = ", no slave damaged frames" if w.about_master else ""
    why = f"each station read saw a scan of {longest} or more (healthy: {link.normal}){none}; "
    kinds = (("damaged", link.torn), ("lost", link.silent))
    costs = [f"{why}a {kind} reply costs {link.units(ticks):.0f}" for kind, ticks in kinds]
    # Scans that are always long are explained by a late reply.
    less = 3 if any(tally.score(*key) >= 4 for key in [*tally.points] if key[0] is Cause.SLOW_REPLY) else 0
    tally.add(Cause.NOISE_SENDER, None, (2.5 if silent else 4) - less, costs[0])
    tally.add(Cause.REPLIES_LOST, None, (4 if silent else 0.5) - less, costs[1])
    why += "noise in the master's own receiver would do that"
    tally.add(Cause.NOISE_RECEIVER, 0, (2 if silent else 3.5) - less, why)


def _healthy(w: Witness, tally: Tally, most: int) -> None:
    """Counts that a start leaves, normal scans, no station missing."""
    longest, normal = w.least_longest, w.link.normal
    gone = any(w.deaf(s) or s.halted for s in w.readout.stations)
    if w.flagged or gone or most > START or (w.master is None and not w.listeners):
        return
    if all(s.count(k) is None for s in w.tellers for k in w.numbers):
        pass  # not read is not 0
    elif all(w.by_master(k) <= START for k in w.numbers):
        tally.add(Cause.HEALTHY, None, 3, f"no station is counted more than {START} times, and no flag is on")
    elif any(s.climbs(k) for s in w.readout.stations for k in (0, *w.numbers)):
        tally.add(Cause.HEALTHY, None, -2, "there are counts that climb")
    elif w.staggered:
        why = "all counts follow from power-up one station after the other, and no flag is on"
        tally.add(Cause.HEALTHY, None, 1, why)
    else:
        tally.add(Cause.HEALTHY, None, -2, "there are counts that no start explains")
    if w.all_missed:
        tally.add(Cause.HEALTHY, None, -2, "code 11 at every slave: no start leaves that")
    if most:
        tally.add(
            Cause.HEALTHY, None, -3, f"slaves count damaged frames of the master ({w.listed(w.about_master)})"
        )
    if longest is not None:
        points = 3 if longest <= normal else -4
        tally.add(Cause.HEALTHY, None, points, f"the least D8202 is {longest}, of a healthy scan {normal}")
