"""Rules about stations: off, cut off, misconfigured, slow, away; each leaves a sentence with its numbers."""

from functools import partial

from bussim.engines.nn import codes
from bussim.site.diagnosis.causes import Cause, Tally
from bussim.site.diagnosis.witness import Witness
from bussim.site.readout import COUNT, FLAG, START, own_entries
from bussim.units import format_time
from bussim.wording import counted

_MASTERS_CODES = (codes.NO_REPLY, codes.WRONG_STATION, codes.WRONG_COUNTER)
_ELSEWHERE = (codes.WRONG_STATION, codes.WRONG_COUNTER, codes.HEARD_WRONG_STATION, codes.HEARD_WRONG_COUNTER)
#: A late reply fails in so many of the scans at least; noise fails rarely beside it.
_OFTEN = 0.3


def station_rules(w: Witness, tally: Tally) -> None:
    """All of these rules, settings first."""
    for number in range(8):
        same = [station.place for station in w.readout.stations if station.number == number]
        if len(same) > 1:
            cause = Cause.NUMBER_TWICE if number else Cause.TWO_MASTERS
            tally.add(cause, number, 12, f"D8176 or D8173 is {number} at {' and at '.join(same)}")
    _masters(w, tally)
    _numbers(w, tally)
    for k in w.numbers:
        _off(w, tally, k)
        _late_replies(w, tally, k)
    _deaf(w, tally)
    _slow_scans(w, tally)
    _away(w, tally)
    _master_away(w, tally)


def _masters(w: Witness, tally: Tally) -> None:
    """A second master keeps a master's codes, and the slaves understand neither."""
    for station in w.heard:
        own, at = [k for k in w.numbers if station.code(k) in _MASTERS_CODES], station.supposed
        counted = [k for k in w.numbers if (station.count(k) or 0) > START]
        if own:
            given = f"code {station.code(own[0]):02X} about station {own[0]}"
            tally.add(Cause.TWO_MASTERS, at, 8, f"{station.label} keeps {given}, which only a master gives")
        elif own_entries(station) and station.value(f"D{COUNT}") == 0 and len(counted) > 1:
            why = f"{station.label} counts about slaves, itself included ({own_entries(station)[0]}), "
            tally.add(Cause.TWO_MASTERS, at, 5, f"{why}and nothing about the master")
        else:
            continue
        others = [other for other in w.heard if other is not station]
        if others and all(
            w.deaf(s) or s.code(0) in (codes.MASTER_SILENT, codes.MASTER_DAMAGED) for s in others
        ):
            why = f"no other slave understands a master: {', '.join(s.place for s in others)}"
            tally.add(Cause.TWO_MASTERS, at, 3, why)


def _numbers(w: Witness, tally: Tally) -> None:
    """Two stations with one number do not count about it; a second master takes a number away, too."""
    masters = any(tally.score(*key) >= 8 for key in list(tally.points) if key[0] is Cause.TWO_MASTERS)
    for station in w.heard:
        entries = own_entries(station)
        if not entries or tally.score(Cause.TWO_MASTERS, station.supposed):
            continue
        told = {k: max(w.by_slaves(k).values(), default=0) for k in w.numbers if not station.count(k)}
        k = max(told, key=lambda one: told[one], default=station.supposed)
        why = f"{station.label} counts about its own number ({entries[0]}), so it has another one"
        tally.add(Cause.NUMBER_TWICE, k, 4 if masters else 11, why)
        if k in told and told[k] > START:
            why = f"{station.place} counts nothing about station {k}, others up to {told[k]}"
            tally.add(Cause.NUMBER_TWICE, k, 3, why)


def _off(w: Witness, tally: Tally, k: int) -> None:
    """A slave that is off or in STOP is silent for all."""
    named, add = w.readout.at(k), partial(tally.add, Cause.STATION_OFF, k)
    if named is not None and named.halted:
        add(8, f"{named.place} was found in the state {named.state}")
    if w.master is None or not w.master.flag(k) or w.master.code(k) != codes.NO_REPLY:
        return
    if named is None:
        add(5, f"no station {k} was found, and it is polled: is D8177 = {w.numbers[-1]} right?")
    elif not named.read and named.state == "unread":
        add(5, f"nothing was read at {named.place}")
    others = [other for j in w.by_slaves(k) if (other := w.readout.at(j)) is not None]
    agree = [other for other in others if other.flag(k) and other.code(k) == codes.NOT_IN_NETWORK]
    slaves = f"{len(agree)} of {counted(len(others), 'slave')}"
    why = f"M{FLAG + k} is on with code 01 at the master, with 21 at {slaves}"
    add(2 if len(agree) == len(others) else 0.5, why)
    if named is not None and named.state == "run":
        lamp = named.rd == "flickers"
        add(-5 if lamp else -3, f"but {named.place} is in RUN{' and its RD lamp flickers' if lamp else ''}")


def _deaf(w: Witness, tally: Tally) -> None:
    """Who hears nothing: a tail of the cable is cut off, one alone has a wrong format."""
    readout, order, master = w.readout, w.readout.order, w.readout.at(0)
    found = {s.place: w.deaf(s) for s in readout.slaves if s.supposed in w.numbers and w.deaf(s)}
    if not found or (len(found) == len(readout.slaves) and (w.master is None or w.master.halted)):
        return
    number = {station.place: station.supposed for station in readout.stations}
    lamps = {station.place: station.rd for station in readout.stations}
    dark, flickers = ([place for place in found if lamps[place] == lamp] for lamp in ("dark", "flickers"))
    silent = any(s.place in found and s.sd == "dark" for s in readout.stations)
    away = {*found, *(s.place for s in readout.stations if s.halted)}
    here = order.index(master.place) if master is not None else 0
    ends = [(order[at], order[at:]) for at in range(here + 1, len(order))]
    ends += [(order[at - 1], order[:at]) for at in range(1, here + 1)]
    for first, beyond in ends:
        if not {*found} <= {*beyond} <= away:
            continue
        why = "; ".join(f"{place}: {reason}" for place, reason in found.items())
        cut = partial(tally.add, Cause.CABLE_CUT, number.get(first))
        cut(5 + (len(found) > 1), f"all beyond hear nothing, and no other ({why})")
        if dark:
            cut(3, f"the RD lamp is dark at {', '.join(dark)}")
        if flickers:
            cut(-6, f"but the RD lamp flickers at {', '.join(flickers)}")
    if len(found) == 1:
        place, reason = next(iter(found.items()))
        wrong = partial(tally.add, Cause.WRONG_FORMAT, number[place])
        wrong(4, f"{place} alone hears nothing ({reason}); 7E2 for 7E1 would leave no trace")
        if flickers:
            wrong(4, f"the RD lamp of {place} flickers: signals arrive")
        if dark:
            wrong(-4, f"but the RD lamp of {place} is dark")
        if flickers and silent:
            wrong(1, f"the SD lamp of {place} is dark: it never replies")


def _late_replies(w: Witness, tally: Tally, k: int) -> None:
    """A late reply collides with what follows, or is taken for that of another poll."""
    named = w.readout.at(k)
    for station in w.tellers:
        if station.code(k) in _ELSEWHERE:
            why = f"{station.place} has code {station.code(k):02X} about station {k}, a reply to another poll"
            tally.add(Cause.SLOW_REPLY, k, 5, why)
            break
    told = [count for number, count in w.about_master.items() if number != k]
    if named is None or named not in w.listeners or own_entries(named) or not told or w.master is None:
        return
    most = max(w.by_master(k), *w.by_slaves(k).values(), 0)
    scans = w.readout.watched / max(w.link.healthy, (w.master.value("D8201") or 0) * w.link.model.unit)
    if w.master.flag(k) and named.value("M8191") and min(told) > START and most > _OFTEN * scans:
        why = f"M{FLAG + k} is on, but {named.place} takes part (M8191 on) and the others count "
        late = f"{min(told)} to {max(told)} about the master: its replies come late, and collide"
        tally.add(Cause.SLOW_REPLY, k, 8, why + late)


def _slow_scans(w: Witness, tally: Tally) -> None:
    """Every look at D8201 is too long, by no number of failed attempts."""
    if w.flagged or not w.always_long:
        return
    unit, n, low, looks = w.link.units, w.link.n, min(w.looks), w.looks
    steps = [i * unit(w.link.torn) + j * unit(w.link.silent) for i in range(n) for j in range(n - i)]
    if all(abs(low - unit(w.link.healthy) - step) > 1.5 for step in steps):
        always = w.least_longest is not None and w.least_longest <= low + 2
        why = f"D8201 is {low} or more at every look (healthy: {w.link.normal}), by no number of failures"
        slowest = max(w.readout.slaves, key=lambda s: s.plc_scan or 0, default=None)
        at = None
        if slowest is not None and (slowest.plc_scan or 0) > w.link.healthy:
            why += f"; the PLC scan of {slowest.place} takes {format_time(slowest.plc_scan or 0)}"
            at = slowest.supposed
        points = 1 if len(looks) == 1 else 7 if always or len(looks) > 2 * len(w.numbers) else 4
        tally.add(Cause.SLOW_REPLY, at, points, why)


def _away(w: Witness, tally: Tally) -> None:
    """Who was switched off, or on late, is counted as silent by those that were there."""
    absent = [k for k in w.numbers if w.absent(k)]
    for k in absent:
        named, told, most = w.readout.at(k), w.by_slaves(k), w.by_master(k)
        away = partial(tally.add, Cause.WAS_AWAY, k)
        away(4, w.absent(k))
        if named in w.missed_master and not w.all_missed:
            away(4, f"{named.place} missed the master (code 11): it was on, and cut off")
        if named is not None and named.code(k) == codes.NO_PARAMETERS:
            away(0.5, f"{named.place} was polled before it had parameters (its own code 31)")
        # Who came late itself is counted by those that were there, and not by this one, which was not.
        late = [j for j in told if w.by_master(j) > START >= ((named and named.count(j)) or 0)]
        after = [j for j in late if abs(told[j] - most) <= START]
        if after:
            away(4, f"station {after[0]}, itself late, counts {told[after[0]]} too: it was away afterwards")
        elif w.staggered and len(absent) > 1 and named not in w.missed_master:
            away(-2, "all counts would also follow from power-up one after the other")


def _master_away(w: Witness, tally: Tally) -> None:
    """Every slave misses a master that is away, once."""
    master, add = w.readout.at(0), partial(tally.add, Cause.MASTER_AWAY, 0)
    if master is not None and master.halted:
        add(8, f"{master.place} was found in the state {master.state}")
    silent = [s for s in w.heard if s.code(0) == codes.MASTER_SILENT]
    now = [s.place for s in silent if s.flag(0)]
    once = max((s.count(0) or 0 for s in silent), default=0)
    if silent and len(silent) < len([s for s in w.heard if not s.halted]):
        add(-3, f"code 11 at {len(silent)} of {counted(len(w.heard), 'slave')} only")
    elif now and master is not None and master.state == "run" and master.value("M8191"):
        add(-2, f"M8183 is on at {', '.join(now)}, but the master is in RUN")
    elif silent:
        why = f"code 11 about the master at every slave read ({counted(once, 'count')} at most)"
        add(6 if now or once <= START else 2, why)
