"""What ``bussim fit`` prints."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from bussim.commands.sniff.tally import statistics
from bussim.live.fit.comparison import Behaviour, Comparison, compare
from bussim.live.fit.noise import NoiseEstimate
from bussim.live.fit.outages import Losses
from bussim.live.fit.statistics import Estimate
from bussim.results.meters.histogram import BIN_TICKS, Histogram
from bussim.results.numbers import ms as _ms
from bussim.units import milliseconds, seconds
from bussim.wording import counted

if TYPE_CHECKING:
    from bussim.commands.fit.recording import Fitted
    from bussim.live.fit.link import LinkEstimate
    from bussim.live.fit.turnaround import TurnaroundDistribution


@dataclass(frozen=True, slots=True)
class Compared:
    """A recording against a simulation of its estimates: link scans, or exchanges of a Modbus bus."""

    measured: Histogram
    simulated: Histogram
    comparison: Comparison
    what: str


def compared(fitted: Fitted, simulated: Behaviour) -> Compared:
    """How far the two are from each other."""
    histograms = Histogram(), Histogram()
    for histogram, behaviour in zip(histograms, (fitted.behaviour, simulated), strict=True):
        for time in behaviour.times:
            histogram.add(time)
    comparison = compare(fitted.behaviour, simulated, fitted.resolution)
    return Compared(*histograms, comparison, "scan" if fitted.link is not None else "exchange")


def to_json(fitted: Fitted, simulated: Compared | None, warnings: Mapping[str, str]) -> dict[str, Any]:
    """The estimates as plain data; times in ms."""
    found: dict[str, Any] = {
        "schema": 1,
        "bus": fitted.bus,
        "exact_times": fitted.exact,
        "duration_s": round(seconds(fitted.duration), 6),
        "confidence": 0.95,
        "warnings": [{"code": code, "text": text} for code, text in warnings.items()],
    }
    link = fitted.link
    if link is not None:
        found["link"] = {
            "settings": dict(zip(("slaves", "mode", "retries", "timeout_ms"), _settings(link), strict=True)),
            "settings_heard": link.settings_received,
            "master_gap_ms": _interval(link.master_gap, _ms),
            "scan_overhead_ms": _interval(link.scan_overhead, _ms),
            "reply_loss": _interval(link.loss),
            **_noise(link.noise),
            "frames": link.frames,
            "damaged": link.damaged,
            "scans": len(link.behaviour.times),
            "stations": {
                str(each.station): {
                    "name": fitted.names.get(each.station),
                    "polls": each.polls,
                    "turnaround_ms": _interval(each.turnaround, _ms),
                    "law": _distribution(each.distribution),
                    **_losses(each.losses),
                }
                for each in link.stations
            },
        }
    ports = fitted.ports
    if ports is not None:
        found["modbus"] = {
            "protocol": ports.protocol.value,
            "interval_ms": _ms(ports.interval),
            "timeout_ms": _ms(ports.timeout),
            "timeout_between_ms": ports.timeout_between and [*map(_ms, ports.timeout_between)],
            **_noise(ports.noise),
            "frames": ports.frames,
            "damaged": ports.damaged,
            "polls": [
                {
                    "station": poll.station,
                    "function": poll.function,
                    "address": poll.address,
                    "count": poll.quantity,
                    "turns": poll.turns,
                    "every_ms": _ms(poll.every),
                    "every_90_percent_ms": [_ms(poll.low), _ms(poll.high)],
                    "periodic": poll.periodic,
                    "retries": poll.retries,
                }
                for poll in ports.polls
            ],
            "stations": {
                str(each.station): {
                    "requests": each.requests,
                    "delay_ms": _interval(each.delay, _ms),
                    "law": _distribution(each.distribution),
                    **_losses(each.losses),
                    "wrong_answers": each.wrong,
                    "exceptions": {f"{code:02X}": count for code, count in each.exceptions.items()},
                }
                for each in ports.slaves
            },
        }
    if simulated is not None:
        comparison = simulated.comparison
        found["comparison"] = {
            "verdict": comparison.verdict,
            "differs": [
                {"figure": each.name, "measured": each.measured, "simulated": each.simulated, "p": each.p}
                for each in comparison.differs
            ],
            "tail_judged": comparison.tail,
            "ks_distance": comparison.fit.distance,
            "p": comparison.fit.p,
            "measured_ms": {"count": simulated.measured.count, **statistics(simulated.measured)},
            "simulated_ms": {"count": simulated.simulated.count, **statistics(simulated.simulated)},
        }
    return found


def _losses(found: Losses) -> dict[str, Any]:
    return {
        "reply_loss": _interval(found.loss),
        "damaged_replies": _interval(found.damaged_replies),
        "outages_s": [[seconds(o.start), None if o.end is None else seconds(o.end)] for o in found.outages],
    }


def _noise(found: NoiseEstimate) -> dict[str, Any]:
    bursts, master = found.bursts, found.master_receiver
    return {
        "ber": _interval(found.ber),
        "ber_of_senders": {str(sender): _interval(rate) for sender, rate in found.senders.items()},
        "master_receiver": {
            "repeats": master.repeats,
            "loss": _interval(master.loss),
            "unheard": _interval(master.unheard),
            "ber": _interval(master.ber),
        },
        "burst": {key: getattr(bursts, key) for key in _OF_BURSTS}
        | {f"{key}_ms": _interval(getattr(bursts.states, key, None), _ms) for key in ("good", "bad")}
        | {key: _interval(getattr(bursts.states, key, None)) for key in ("ber_good", "ber_bad")},
    }


_OF_BURSTS = ("seen", "attempts", "failures", "p_fail", "p_fail_after_fail", "runs_p", "dispersion")


def _settings(link: LinkEstimate) -> tuple[int, int, int, int]:
    slaves, mode, retries, timeout = link.settings
    return slaves, mode, retries, 10 * timeout


def _interval(
    found: Estimate | None, unit: Callable[[float | None], float | None] = lambda value: value
) -> dict[str, float | None] | None:
    if found is None:
        return None
    ends = {key: unit(getattr(found, key)) for key in ("value", "low", "high")}
    return ends | {"count": found.count}


def _distribution(distribution: TurnaroundDistribution | None) -> dict[str, Any] | None:
    if distribution is None:
        return None
    return {
        "mean_ms": _ms(distribution.mean),
        "jitter_ms": _ms(distribution.jitter),
        "values_ms": [_ms(value) for value in distribution.values],
        "uniform_ks_distance": distribution.fit.distance,
        "uniform_p": distribution.fit.p,
    }


def show(fitted: Fitted, simulated: Compared | None, warnings: Mapping[str, str]) -> None:
    """Print the estimates, and both histograms side by side."""
    from rich.text import Text

    from bussim.commands.common.console import plain_table, wide_console

    console = wide_console()
    for text in warnings.values():
        click.echo(f"warning: {text}")
    source = "exact times" if fitted.exact else "times of the operating system, its delays included"
    click.echo(f"{fitted.bus}: {seconds(fitted.duration):.1f} s, {source}")
    if fitted.link is not None:
        slaves, mode, retries, timeout = _settings(fitted.link)
        origin = "by a parameter frame" if fitted.link.settings_received else "as observed"
        settings = f"{counted(slaves, 'slave')}, mode {mode}, {counted(retries, 'retry')}"
        click.echo(f"  {settings}, timeout {timeout} ms ({origin})")
    table = plain_table(["  estimate"], ["value", "95 % confidence", "from"])
    for row in _rows(fitted):
        table.add_row(*map(Text, row))
    console.print(table)
    for line in _outages(fitted):
        click.echo(line)
    if simulated is not None:
        for line in _side_by_side(simulated):
            console.print(line, markup=False)


def _rows(fitted: Fitted) -> list[tuple[str, str, str, str]]:
    rows: list[tuple[str, str, str, str]] = []

    def add(form: Callable[[float], str], unit: str, most: str, name: str, found: Estimate | None) -> None:
        if found is not None:
            low = "0" if found.low is None else form(found.low)
            high = most if found.high is None else form(found.high)
            rows.append((f"  {name}", form(found.value) + unit, f"{low} … {high}", f"{found.count:,}"))

    time = partial(add, lambda ticks: f"{milliseconds(ticks):.4f}", " ms", "–")
    rate = partial(add, "{:.3g}".format, "", "1")
    link, ports = fitted.link, fitted.ports
    if link is not None:
        time("master gap", link.master_gap)
        time("scan overhead", link.scan_overhead)
        for each in link.stations:
            name = fitted.names.get(each.station) or f"station {each.station}"
            time(f"turnaround of {name}", each.turnaround)
            _add_distribution(rows, each.distribution)
            rate(f"lost replies of {name}", each.losses.loss)
            rate(f"damaged replies of {name}", each.losses.damaged_replies)
        rate("lost replies, all", link.loss)
    if ports is not None:
        for poll in ports.polls:
            every = "–" if poll.every is None else f"{milliseconds(poll.every):.3f} ms"
            span = "–"
            if poll.low is not None and poll.high is not None:
                span = f"90 % in {milliseconds(poll.low):.3f} … {milliseconds(poll.high):.3f}"
            rows.append((f"  every {poll.name}", every, span, f"{poll.turns:,}"))
        for slave in ports.slaves:
            time(f"response of station {slave.station} after", slave.delay)
            _add_distribution(rows, slave.distribution)
            rate(f"no response of station {slave.station}", slave.losses.loss)
            rate(f"damaged responses of station {slave.station}", slave.losses.damaged_replies)
        for name, ticks in (("pause before a request", ports.interval), ("timeout", ports.timeout)):
            if ticks is not None:
                rows.append((f"  {name}", f"{milliseconds(ticks):.3f} ms", "", ""))
    noise = fitted.noise
    rate("bit error rate", noise.ber)
    for sender, ber in noise.senders.items():
        rate(f"  of {f'station {sender}' if sender else 'the master'}", ber)
    rate("sound replies that the master lost", noise.master_receiver.loss)
    rate("bit error rate at the master's receiver", noise.master_receiver.ber)
    bursts, states = noise.bursts, noise.bursts.states
    seen = {True: "seen", False: "not seen", None: "too few to tell"}[bursts.seen]
    after = "" if bursts.p_fail_after_fail is None else f"{bursts.p_fail_after_fail:.3g} after a failed one"
    rows.append(("  errors in bursts", seen, after, f"{bursts.failures:,} of {bursts.attempts:,}"))
    if states is not None:
        time("  good state", states.good)
        time("  bad state", states.bad)
        rate("  bit error rate in the good state", states.ber_good)
        rate("  bit error rate in the bad state", states.ber_bad)
    return rows


def _add_distribution(
    rows: list[tuple[str, str, str, str]], distribution: TurnaroundDistribution | None
) -> None:
    if distribution is None:
        return
    text = f"± {milliseconds(distribution.jitter):.4f} ms"
    number = len(distribution.values)
    what = f"measured law of {counted(number, 'value')}" if number else "uniform"
    rows.append((f"    {what}", text, f"p {distribution.fit.p:.2g}", ""))


def _outages(fitted: Fitted) -> list[str]:
    lines = []
    for outage in (outage for losses in fitted.losses for outage in losses.outages):
        name = fitted.names.get(outage.station) or f"station {outage.station}"
        until = "the end" if outage.end is None else f"{seconds(outage.end):.3f} s"
        lines.append(f"  {name} was silent from {seconds(outage.start):.3f} s to {until}")
    return lines


_ROWS, _WIDTH = 24, 30


def _side_by_side(found: Compared) -> list[str]:
    measured, simulated, comparison = found.measured, found.simulated, found.comparison
    low = min(*measured.bins, *simulated.bins)
    high = max(*measured.bins, *simulated.bins)
    step = max(1, -(-(high - low + 1) // _ROWS))
    scans = counted(measured.count, found.what)
    title = "link scan time (ms)" if found.what == "scan" else "exchange (ms)"
    lines = [f"  {title:<19}   measured, {scans}{'':12}simulated, {simulated.count:,}"]
    for row in range(low, high + 1, step):
        shares = [
            sum(count for at, count in one.bins.items() if row <= at < row + step) / one.count
            for one in (measured, simulated)
        ]
        if not any(shares):
            continue
        bars = ["█" * round(_WIDTH * share) or ("▏" if share else "") for share in shares]
        left = milliseconds(row * BIN_TICKS)
        lines.append(
            f"  {left:12.2f}  {shares[0]:7.2%} {bars[0]:<{_WIDTH}} {shares[1]:7.2%} {bars[1]}".rstrip()
        )
    for name, one in (("measured", measured), ("simulated", simulated)):
        figures = statistics(one)
        shown = ", ".join(f"{key} {value:.3f}" for key, value in figures.items() if value is not None)
        lines.append(f"  {name:<10} {shown}")
    lines.append(
        f"  Kolmogorov-Smirnov distance {comparison.fit.distance:.4f}, "
        f"p {comparison.fit.p:.3g} (probability of a distance like this if both are one law)"
    )
    judged = (
        "tail included" if comparison.tail else f"too short to judge the tail: fewer than 100 {found.what}s"
    )
    verdict = "differs from" if comparison.differs else "agrees with"
    lines.append(f"  the simulation {verdict} the recording; {judged}")
    return lines
