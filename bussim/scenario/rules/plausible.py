"""Times far from what is usual: probably another unit is meant."""

from collections.abc import Iterator

from bussim.scenario.yaml.source_map import Path, Report
from bussim.units import UNIT_TICKS, parse_time

#: So many times beyond a range a value is reported: the ranges are what is usual, no limits.
FAR = 10
#: A section and a key in it (any: "*"), what the time is, and its usual range; the first that fits counts.
#: A PLC's watchdog ends scans of over 200 ms (D8000 at power-on).
RANGES = (
    ("plcs", "scan", "a PLC's scan", "100 us", "200 ms"),
    ("scan", "mean", "a PLC's scan", "100 us", "200 ms"),
    ("scan", "jitter", "the jitter of a scan", "0 s", "200 ms"),
    ("plcs", "phase", "a PLC's phase", "0 s", "200 ms"),
    ("profile", "*", "a time of a profile", "0 s", "200 ms"),
    ("ports", "timeout", "the timeout of a Modbus master", "10 ms", "5 s"),
    ("devices", "timeout", "the timeout of a Modbus master", "10 ms", "5 s"),
    ("ports", "interval", "the pause before a request", "0 s", "1 s"),
    ("devices", "interval", "the pause before a request", "0 s", "1 s"),
    ("devices", "delay", "the delay of a reply", "0 s", "500 ms"),
    ("devices", "turnaround", "the turnaround after a broadcast", "0 s", "500 ms"),
    ("polls", "every", "the period of a poll", "5 ms", "1 min"),
    ("sources", "toggle", "the period of a bit", "5 ms", "1 min"),
    ("sources", "counter", "the period of a counter", "5 ms", "1 min"),
    ("burst", "good", "the time between bursts", "1 ms", "1 h"),
    ("burst", "bad", "a burst", "10 us", "1 s"),
    ("impulse", "every", "the time between impulses", "100 us", "10 s"),
    ("impulse", "width", "an impulse", "100 ns", "10 ms"),
    ("slow", "extra", "the delay of a slow station", "0 s", "1 s"),
    ("late_release", "by", "the late release of a driver", "0 s", "10 ms"),
    ("", "duration", "a run", "1 s", "1 d"),
)


def check_plausible(report: Report) -> None:
    """Warn of every time that is far from what is usual, with the unit that may be meant."""
    for path, text in _texts(report.source_map.data, ()):
        sections, key = ["", *path[:-1]], path[-1]
        usual = next((row for row in RANGES if row[0] in sections and row[1] in (key, "*")), None)
        try:
            ticks = parse_time(text)
        except ValueError:
            continue  # where a time is wanted this was reported
        if usual is None or not ticks:
            continue
        *_, what, shortest, longest = usual
        low, high = parse_time(shortest), parse_time(longest)
        if low <= ticks * FAR and ticks <= high * FAR:
            continue
        number = text.strip().rstrip("abcdefghijklmnopqrstuvwxyzµμ").rstrip()
        others = {parse_time(f"{number} {unit}"): f"{number} {unit}" for unit in UNIT_TICKS if unit != "µs"}
        fits = [other for other in others if max(low, 1) <= other <= high]
        nearest = min(fits, key=lambda other: max(ticks / other, other / ticks), default=0)
        meant = f"; did you mean {others[nearest]}?" if fits else ""
        usually = f"{shortest} to {longest}" if low else f"at most {longest}"
        name = report.source_map.full_name(path)
        report.warn(path, f"{name} is {text.strip()}, but {what} is usually {usually}{meant}")


def _texts(data: object, path: Path) -> Iterator[tuple[Path, str]]:
    """Every text of plain data that has a key, with its path."""
    if isinstance(data, str) and path:
        yield path, data
    pairs = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in pairs:
        yield from _texts(value, (*path, key))
