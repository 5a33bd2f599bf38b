"""Times far from what is usual: probably another unit is meant."""

from collections.abc import Iterator

from bussim.scenario.yaml.source_map import Path, Report
from bussim.units import UNIT_TICKS, parse_time
from bussim.words.language import say

#: So many times beyond a range a value is reported: the ranges are what is usual, no limits.
FAR = 10
#: A section and a key in it (any: "*"), the key of what the time is of, and its usual range; the first that
#: fits counts.
#: A PLC's watchdog ends scans of over 200 ms (D8000 at power-on).
RANGES = (
    ("plcs", "scan", "usual_plc_scan", "100 us", "200 ms"),
    ("scan", "mean", "usual_plc_scan", "100 us", "200 ms"),
    ("scan", "jitter", "usual_scan_jitter", "0 s", "200 ms"),
    ("plcs", "phase", "usual_phase", "0 s", "200 ms"),
    ("profile", "*", "usual_profile", "0 s", "200 ms"),
    ("ports", "timeout", "usual_timeout", "10 ms", "5 s"),
    ("devices", "timeout", "usual_timeout", "10 ms", "5 s"),
    ("ports", "interval", "usual_pause", "0 s", "1 s"),
    ("devices", "interval", "usual_pause", "0 s", "1 s"),
    ("devices", "delay", "usual_delay", "0 s", "500 ms"),
    ("devices", "turnaround", "usual_turnaround", "0 s", "500 ms"),
    ("polls", "every", "usual_poll", "5 ms", "1 min"),
    ("sources", "toggle", "usual_bit", "5 ms", "1 min"),
    ("sources", "counter", "usual_counter", "5 ms", "1 min"),
    ("burst", "good", "usual_between_bursts", "1 ms", "1 h"),
    ("burst", "bad", "usual_burst", "10 us", "1 s"),
    ("impulse", "every", "usual_between_impulses", "100 us", "10 s"),
    ("impulse", "width", "usual_impulse", "100 ns", "10 ms"),
    ("slow", "extra", "usual_slow", "0 s", "1 s"),
    ("late_release", "by", "usual_late_release", "0 s", "10 ms"),
    ("", "duration", "usual_run", "1 s", "1 d"),
)


def check_plausible(report: Report) -> None:
    """Warn of every time that is far from what is usual, with the unit that may be meant."""
    for path, text in _texts(report.source_map.data, ()):
        sections, key = ["", *path[:-1]], path[-1]
        usual = next((row for row in RANGES if row[0] in sections and row[1] in (key, "*")), None)
        if usual is None or text.strip()[:1] not in "+-.0123456789":
            continue
        try:
            ticks = parse_time(text)
        except ValueError:
            continue  # where a time is wanted this was reported
        if not ticks:
            continue
        *_, what, shortest, longest = usual
        low, high = parse_time(shortest), parse_time(longest)
        if low <= ticks * FAR and ticks <= high * FAR:
            continue
        number = text.strip().rstrip("abcdefghijklmnopqrstuvwxyzµμ").rstrip()
        others = {parse_time(f"{number} {unit}"): f"{number} {unit}" for unit in UNIT_TICKS if unit != "µs"}
        fits = [other for other in others if max(low, 1) <= other <= high]
        nearest = min(fits, key=lambda other: max(ticks / other, other / ticks), default=0)
        meant = say("form_meant", meant=others[nearest]) if fits else ""
        usually = say("rule_usual_range" if low else "rule_usual_most", shortest=shortest, longest=longest)
        name = report.source_map.full_name(path)
        report.warn(
            path,
            say(
                "rule_implausible", name=name, text=text.strip(), what=say(what), usually=usually, meant=meant
            ),
        )


def _texts(data: object, path: Path) -> Iterator[tuple[Path, str]]:
    """Every text of plain data that has a key, with its path."""
    if isinstance(data, str) and path:
        yield path, data
    pairs = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in pairs:
        yield from _texts(value, (*path, key))
