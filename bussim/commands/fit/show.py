"""What ``bussim fit`` prints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

from bussim.commands.sniff.tally import statistics
from bussim.live.fit.statistics import Estimate, Fit, compare
from bussim.results.meters.histogram import BIN_TICKS, Histogram
from bussim.units import milliseconds, seconds
from bussim.wording import counted

if TYPE_CHECKING:
    from bussim.commands.fit.recording import Fitted
    from bussim.live.fit.link import LinkEstimate
    from bussim.live.fit.turnaround import TurnaroundDistribution
    from bussim.results.run_record import RunRecord


@dataclass(frozen=True, slots=True)
class Comparison:
    """Measured link scans against simulated ones."""

    measured: Histogram
    simulated: Histogram
    fit: Fit


def comparison_of(fitted: Fitted, simulated: RunRecord) -> Comparison:
    """How far the two histograms, of bins of 10 µs, are from each other."""
    theirs = simulated.links[fitted.bus].scan_times.histogram
    ours = fitted.measured.links[fitted.bus].scan_times.histogram
    return Comparison(ours, theirs, compare(_samples(ours), _samples(theirs)))


def _samples(histogram: Histogram) -> list[int]:
    return [position * BIN_TICKS for position, count in histogram.bins.items() for _ in range(count)]


def to_json(fitted: Fitted, comparison: Comparison | None) -> dict[str, Any]:
    """The estimates as plain data; times in ms."""
    found: dict[str, Any] = {
        "schema": 1,
        "bus": fitted.bus,
        "exact_times": fitted.exact,
        "duration_s": round(seconds(fitted.duration), 6),
        "confidence": 0.95,
    }
    link = fitted.link
    if link is not None:
        found["link"] = {
            "settings": dict(zip(("slaves", "mode", "retries", "timeout_ms"), _settings(link), strict=True)),
            "settings_heard": link.settings_received,
            "master_gap_ms": _interval(link.master_gap, _ms),
            "scan_overhead_ms": _interval(link.scan_overhead, _ms),
            "reply_loss": _interval(link.loss),
            "ber": _interval(link.ber),
            "frames": link.frames,
            "damaged": link.damaged,
            "scans": len(link.scans),
            "stations": {
                str(each.station): {
                    "name": fitted.names.get(each.station),
                    "polls": each.polls,
                    "turnaround_ms": _interval(each.turnaround, _ms),
                    "law": _distribution(each.distribution),
                    "reply_loss": _interval(each.loss),
                    "outages_s": [
                        [seconds(o.start), None if o.end is None else seconds(o.end)] for o in each.outages
                    ],
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
            "ber": _interval(ports.ber),
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
                    "reply_loss": _interval(each.loss),
                    "exceptions": {f"{code:02X}": count for code, count in each.exceptions.items()},
                }
                for each in ports.slaves
            },
        }
    if comparison is not None:
        found["comparison"] = {
            "ks_distance": comparison.fit.distance,
            "p": comparison.fit.p,
            "measured_ms": {"count": comparison.measured.count, **statistics(comparison.measured)},
            "simulated_ms": {"count": comparison.simulated.count, **statistics(comparison.simulated)},
        }
    return found


def _settings(link: LinkEstimate) -> tuple[int, int, int, int]:
    slaves, mode, retries, timeout = link.settings
    return slaves, mode, retries, 10 * timeout


def _ms(ticks: float | None) -> float | None:
    return None if ticks is None else round(milliseconds(ticks), 6)


def _same(value: float | None) -> float | None:
    return value


def _interval(
    found: Estimate | None, unit: Callable[[float | None], float | None] = _same
) -> dict[str, float | None] | None:
    if found is None:
        return None
    return {
        "value": unit(found.value),
        "low": unit(found.low),
        "high": unit(found.high),
        "count": found.count,
    }


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


def show(fitted: Fitted, comparison: Comparison | None) -> None:
    """Print the estimates, and both histograms side by side."""
    from rich.text import Text

    from bussim.commands.common.console import plain_table, wide_console

    console = wide_console()
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
    if comparison is not None:
        for line in _side_by_side(comparison):
            console.print(line, markup=False)


def _rows(fitted: Fitted) -> list[tuple[str, str, str, str]]:
    rows: list[tuple[str, str, str, str]] = []

    def time(name: str, found: Estimate | None) -> None:
        if found is not None:
            span = "–"
            if found.low is not None and found.high is not None:
                span = f"{milliseconds(found.low):.4f} … {milliseconds(found.high):.4f}"
            rows.append((f"  {name}", f"{milliseconds(found.value):.4f} ms", span, f"{found.count:,}"))

    def rate(name: str, found: Estimate | None) -> None:
        if found is not None:
            low = "0" if found.low is None else f"{found.low:.3g}"
            high = "1" if found.high is None else f"{found.high:.3g}"
            rows.append((f"  {name}", f"{found.value:.3g}", f"{low} … {high}", f"{found.count:,}"))

    link, ports = fitted.link, fitted.ports
    if link is not None:
        time("master gap", link.master_gap)
        time("scan overhead", link.scan_overhead)
        for each in link.stations:
            name = fitted.names.get(each.station) or f"station {each.station}"
            time(f"turnaround of {name}", each.turnaround)
            _add_distribution(rows, each.distribution)
            rate(f"lost replies of {name}", each.loss)
        rate("lost replies, all", link.loss)
        rate("bit error rate", link.ber)
    if ports is not None:
        for poll in ports.polls:
            name = f"{poll.station}: {poll.function:02X} at {poll.address} × {poll.quantity}"
            every = "–" if poll.every is None else f"{milliseconds(poll.every):.3f} ms"
            span = "–"
            if poll.low is not None and poll.high is not None:
                span = f"90 % in {milliseconds(poll.low):.3f} … {milliseconds(poll.high):.3f}"
            rows.append((f"  every {name}", every, span, f"{poll.turns:,}"))
        for slave in ports.slaves:
            time(f"response of station {slave.station} after", slave.delay)
            _add_distribution(rows, slave.distribution)
            rate(f"no response of station {slave.station}", slave.loss)
        rate("bit error rate", ports.ber)
        for name, ticks in (("pause before a request", ports.interval), ("timeout", ports.timeout)):
            if ticks is not None:
                rows.append((f"  {name}", f"{milliseconds(ticks):.3f} ms", "", ""))
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
    for each in fitted.link.stations if fitted.link is not None else ():
        name = fitted.names.get(each.station) or f"station {each.station}"
        for outage in each.outages:
            until = "the end" if outage.end is None else f"{seconds(outage.end):.3f} s"
            lines.append(f"  {name} was silent from {seconds(outage.start):.3f} s to {until}")
    return lines


_ROWS, _WIDTH = 24, 30


def _side_by_side(comparison: Comparison) -> list[str]:
    measured, simulated = comparison.measured, comparison.simulated
    low = min(*measured.bins, *simulated.bins)
    high = max(*measured.bins, *simulated.bins)
    step = max(1, -(-(high - low + 1) // _ROWS))
    scans = counted(measured.count, "scan")
    lines = [f"  link scan time (ms)   measured, {scans}{'':12}simulated, {simulated.count:,}"]
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
    return lines
