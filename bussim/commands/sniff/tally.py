"""What ``bussim sniff`` counts and shows while it listens."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

from bussim.live.sniff.link import LinkDecoder
from bussim.live.sniff.listener import Listener
from bussim.results.collector import Collector, Rows
from bussim.results.meters.histogram import QUANTILES, Histogram
from bussim.trace.records import AttemptRecord, Record, ScanRecord, TransactionRecord
from bussim.units import milliseconds, seconds
from bussim.wording import counted

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table


#: Stations or requests that are counted by themselves.
MOST_ASKED = 500


class Asked:
    """Exchanges with one station (of N:N), or of one request."""

    def __init__(self) -> None:
        self.attempts = 0
        self.outcomes: Counter[str] = Counter()
        self.response = Histogram()  # from the request's end to the first edge of its response

    def to_json(self) -> dict[str, Any]:
        """Plain data; times in ms."""
        return {
            "attempts": self.attempts,
            "outcomes": dict(sorted(self.outcomes.items())),
            "response_ms": statistics(self.response),
        }


class Tally(Collector):
    """A collector that also counts exchanges, by station or by request."""

    def __init__(self, *, traced: bool, rows: Rows | None, bus_of: dict[str, str]) -> None:
        super().__init__(traced=traced, rows=rows, bus_of=bus_of)
        self.asked: dict[str, Asked] = {}
        self.scan_times = Histogram()

    def _asked(self, name: str) -> Asked:
        known = self.asked.get(name)
        if known is None:
            # A master that sends another request every time must not fill the memory.
            name = name if len(self.asked) < MOST_ASKED else "others"
            known = self.asked.setdefault(name, Asked())
        return known

    def take(self, record: Record) -> None:
        """Count a record."""
        match record:
            case ScanRecord():
                self.scan_times.add(record.duration)
            case AttemptRecord():
                asked = self._asked(f"station {record.station}")
                asked.attempts += 1
                asked.outcomes[record.outcome] += 1
                if record.turnaround is not None:
                    asked.response.add(max(0, record.turnaround))
            case TransactionRecord():
                asked = self._asked(record.poll)
                asked.attempts += 1
                outcome = f"exception {record.exception:02X}" if record.exception else record.outcome
                asked.outcomes[outcome] += 1
                if record.answer_start is not None and record.asked is not None:
                    asked.response.add(max(0, record.answer_start - record.asked))
        super().take(record)


def statistics(times: Histogram) -> dict[str, float | None]:
    """The figures of a histogram, in ms."""
    quantiles = {name: times.quantile(thousandths) for name, thousandths in QUANTILES.items()}
    figures = {"min": times.minimum, "mean": times.mean, **quantiles, "max": times.maximum}
    return {name: None if value is None else round(milliseconds(value), 6) for name, value in figures.items()}


def to_json(listener: Listener, tally: Tally, duration: int, *, exact: bool) -> dict[str, Any]:
    """What was heard, as plain data."""
    decoder = listener.decoder
    found: dict[str, Any] = {
        "schema": 1,
        "protocol": None if listener.protocol is None else listener.protocol.value,
        "baud": listener.timing.baud,
        "format": str(listener.timing.format),
        "exact_times": exact,
        "duration_s": round(seconds(duration), 6),
        "characters": listener.characters,
        "frames": 0 if decoder is None else decoder.frames,
        "damaged": 0 if decoder is None else decoder.damaged,
        "unasked": 0 if decoder is None else decoder.unasked,
        "bus_load": round(decoder.busy / duration, 6) if decoder is not None and duration else 0.0,
        "exchanges": {name: asked.to_json() for name, asked in sorted(tally.asked.items())},
    }
    if isinstance(decoder, LinkDecoder):
        totals = decoder.totals()
        found["link"] = {
            "slaves": totals.slaves,
            "mode": totals.mode,
            "retries": totals.retries,
            "timeout_ms": None if totals.timeout is None else milliseconds(totals.timeout),
            "settings_heard": decoder.settings is not None,
            "scans": decoder.scans,
            "station_errors": {str(k): number for k, number in totals.station_errors.items()},
            "station_error_onsets": {str(k): decoder.station_error_onsets[k] for k in totals.station_errors},
            "scan_time_ms": statistics(tally.scan_times),
        }
    return found


def show(listener: Listener, tally: Tally, duration: int, *, exact: bool) -> RenderableType:
    """The same for a terminal."""
    from rich.console import Group
    from rich.text import Text

    found = to_json(listener, tally, duration, exact=exact)
    protocol = found["protocol"] or "not recognised yet"
    lines = [
        f"{protocol}, {found['baud']} bps {found['format']}; {found['duration_s']:.1f} s, "
        f"{counted(found['characters'], 'character')}, {counted(found['frames'], 'frame')}, "
        f"{found['damaged']:,} damaged, bus load {found['bus_load']:.1%}"
        + ("" if exact else "; times are the operating system's")
    ]
    if found["unasked"]:
        lines.append(f"{counted(found['unasked'], 'frame')} of no exchange")
    link = found.get("link")
    if link is not None:
        times = link["scan_time_ms"]
        shown = ", ".join(f"{name} {times[name]:.3f}" for name in times if times[name] is not None)
        origin = "by a parameter frame" if link["settings_heard"] else "as observed"
        lines.append(
            f"mode {link['mode']}, {counted(link['slaves'], 'slave')}, {counted(link['retries'], 'retry')}, "
            f"timeout {link['timeout_ms']:g} ms ({origin})"
        )
        lines.append(f"link scan time   {shown or '–'} ms   ({counted(link['scans'], 'scan')})")
    return Group(*map(Text, lines), _table(tally, by_station=isinstance(listener.decoder, LinkDecoder)))


def _table(tally: Tally, *, by_station: bool) -> Table:
    from rich.text import Text

    from bussim.commands.common.console import plain_table

    table = plain_table(
        ["station" if by_station else "station: function at address × count"],
        ["attempts", "ok", "failed", "response: median ms", "mean", "max"],
    )
    for name, asked in sorted(tally.asked.items()):
        figures = statistics(asked.response)
        failed = ", ".join(
            f"{count:,} × {word}" for word, count in sorted(asked.outcomes.items()) if word != "ok"
        )
        times = ["–" if figures[key] is None else f"{figures[key]:.3f}" for key in ("p50", "mean", "max")]
        row = (name, f"{asked.attempts:,}", f"{asked.outcomes['ok']:,}", failed or "0", *times)
        table.add_row(*map(Text, row))
    return table
