"""What ``bussim sniff`` counts and shows while it listens."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from typing import TYPE_CHECKING, Any

from bussim.commands.sniff.warnings import warnings_of
from bussim.line.characters import LineTiming
from bussim.live.layout.judge import Misfit
from bussim.live.recordings.source import Facts
from bussim.live.sniff.heard import LineProtocol
from bussim.live.sniff.link import OUTCOMES, LinkDecoder
from bussim.live.sniff.listener import Listener
from bussim.live.sniff.modbus import NO_ATTEMPT
from bussim.results.collector import Collector, Rows
from bussim.results.meters import histogram
from bussim.results.meters.histogram import QUANTILES, Histogram
from bussim.trace.records import AttemptRecord, Record, ScanRecord, TransactionRecord
from bussim.units import milliseconds, seconds
from bussim.wording import counted

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from bussim.commands.common.recording import OpenLine
    from bussim.live.sniff.reading import Reading


#: Stations or requests that are counted by themselves.
MOST_ASKED = 500


class Asked:
    """Exchanges with one station (of N:N), or of one request."""

    def __init__(self) -> None:
        self.attempts = 0
        self.outcomes: Counter[str] = Counter()
        self.exceptions: Counter[int] = Counter()
        self.response = Histogram()  # from the request's end to the first edge of its response

    def to_json(self) -> dict[str, Any]:
        """Plain data; times in ms."""
        found: dict[str, Any] = {"attempts": self.attempts, "outcomes": dict(sorted(self.outcomes.items()))}
        if self.exceptions:
            found["exceptions"] = {f"{code:02X}": count for code, count in sorted(self.exceptions.items())}
        return found | {"response_ms": statistics(self.response)}


class Tally(Collector):
    """A collector that also counts exchanges, by station or by request."""

    def __init__(self, *, traced: bool, rows: Rows | None, bus_of: dict[str, str]) -> None:
        super().__init__(traced=traced, rows=rows, bus_of=bus_of)
        self.asked: defaultdict[str, Asked] = defaultdict(Asked)
        self.scan_times = Histogram()

    def _named(self, name: str) -> str:
        """The name by which a station or request is counted."""
        # A master that sends another request every time must not fill the memory.
        return name if name in self.asked or len(self.asked) < MOST_ASKED else "others"

    def take(self, record: Record) -> None:
        """Count a record."""
        match record:
            case ScanRecord():
                self.scan_times.add(record.duration)
            case AttemptRecord():
                asked = self.asked[self._named(f"station {record.station}")]
                asked.attempts += 1
                asked.outcomes[OUTCOMES[record.code]] += 1
                if record.turnaround is not None:
                    asked.response.add(max(0, record.turnaround))
            case TransactionRecord():
                name = self._named(record.poll)
                asked = self.asked[name]
                asked.attempts += record.outcome not in NO_ATTEMPT
                asked.outcomes[record.outcome] += 1
                if record.exception:
                    asked.exceptions[record.exception] += 1
                if record.answer_start is not None and record.asked is not None:
                    asked.response.add(max(0, record.answer_start - record.asked))
                if record.outcome not in NEITHER:
                    self._ports.take(record if name == record.poll else record._replace(poll=name))
                self._keep(record)
                return
        super().take(record)


#: Outcomes that are neither good nor bad, and enter no rate.
NEITHER = NO_ATTEMPT | {"unclear"}


def statistics(times: Histogram) -> dict[str, float | None]:
    """The figures of a histogram, in ms."""
    found = histogram.statistics(times)
    return {name: found[name] for name in ("min", "mean", *QUANTILES, "max")}


def to_json(
    listener: Listener | None,
    tally: Tally,
    timing: LineTiming,
    duration: int,
    *,
    exact: bool,
    line: OpenLine | None = None,
) -> dict[str, Any]:
    """What was heard, as plain data. ``listener`` is None where no protocol was recognised."""
    decoder = None if listener is None else listener.decoder
    misfit = None if line is None else line.misfit
    unknown = (
        listener is None and line is not None and misfit is None
    )  # a port has the rate and format that it was opened with
    found: dict[str, Any] = {
        "schema": 1,
        "protocol": None if listener is None else listener.protocol.value,
        "layout": None if misfit is None else _layout(misfit),
        "baud": None if unknown else timing.baud,
        "format": None if unknown else str(timing.format),
        "inverted": None if line is None else line.found.reading.setup.inverted,
        "channels": [] if line is None else list(line.found.reading.setup.channels),
        "suggested": _suggested(line.found.suggested if line is not None else None),
        "exact_times": exact,
        "times": ("exact" if exact else "system") if line is None else line.source.times,
        "duration_s": round(seconds(duration), 6),
        "characters": 0 if listener is None else listener.characters,
    }
    facts = Facts() if line is None else line.source.facts
    found |= {key: getattr(decoder, key, 0) for key in COUNTS}
    found |= {key: getattr(facts, key) for key in ("unreadable_lines", "unreadable", "time_steps", "spikes")}
    found |= {
        "bus_load": round(decoder.busy / duration, 6) if decoder is not None and duration else 0.0,
        "outcomes": {} if decoder is None else {k: n for k, n in sorted(decoder.outcomes.items()) if n},
        "exchanges": {name: tally.asked[name].to_json() for name in sorted(tally.asked, key=_in_order)},
        "warnings": [{"code": code, "text": text} for code, text in warnings_of(listener, line).items()],
    }
    if misfit is not None:
        found |= {
            "characters": misfit.characters,
            "protocol": "nn" if line is not None and line.found.reading.protocol is LineProtocol.NN else None,
            "frames": misfit.bursts,
            "damaged": None,
            "scans_unmeasured": sum(scan.duration is None for scan in misfit.polling.scans[:-1]),
            "bus_load": round(misfit.busy / duration, 6) if duration else 0.0,
            "outcomes": dict(
                sorted(sum((each.outcomes for each in tally.asked.values()), Counter()).items())
            ),
        }
    elif line is not None and line.found.described:
        found["described"] = line.found.described
    link = misfit if misfit is not None else decoder
    if isinstance(link, Misfit | LinkDecoder):
        found["link"] = _link(link, tally)
    return found


def _in_order(name: str) -> list[int | str]:
    """A key by which station 2 comes before station 10."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)]


def _link(heard: Misfit | LinkDecoder, tally: Tally) -> dict[str, Any]:
    """What was heard of an N:N link, or of a polled line of another layout."""
    totals = heard.totals()
    stations = [(name, tally.asked[name]) for name in sorted(tally.asked, key=_in_order)]
    return {
        "slaves": totals.slaves,
        "mode": totals.mode,
        "retries": totals.retries,
        "timeout_ms": None if totals.timeout is None else milliseconds(totals.timeout),
        "settings_heard": heard.settings is not None,
        "scans": heard.scans,
        "repeats": sum(asked.attempts for _, asked in stations) - totals.polls,
        "silent_stations": [int(name.split()[-1]) for name, asked in stations if not asked.outcomes["ok"]],
        "station_errors": {str(k): number for k, number in totals.station_errors.items()},
        "station_error_onsets": {str(k): heard.station_error_onsets[k] for k in totals.station_errors},
        "scan_time_ms": statistics(tally.scan_times),
    }


def _layout(misfit: Misfit) -> dict[str, Any]:
    """That the layout does not fit, and the one that is proposed as the text of its file."""
    from bussim.live.layout.file import to_text

    proposed = None if misfit.proposed is None else to_text(misfit.proposed, PROPOSED)
    return {
        "fits": False,
        "taken": misfit.taken,
        "unsound": misfit.unsound,
        "proposed": proposed,
        "sound": misfit.sound,
    }


#: The first line of a layout that is proposed.
PROPOSED = "Layout of N:N frames, proposed by bussim sniff: read the recording by it, and another one."


#: Counts of decoders by their keys: of all, of a link's, of a Modbus bus's.
COUNTS = (
    *("frames", "damaged", "unasked", "strays", "stray_characters", "echoes", "recorder_damage"),
    *("parity_errors", "stop_errors", "scans_unmeasured", "late", "wrong_seen"),
)


def _suggested(reading: Reading | None) -> dict[str, Any] | None:
    if reading is None:
        return None
    setup = reading.setup
    return {
        "protocol": None if reading.protocol is None else reading.protocol.value,
        "baud": setup.timing.baud,
        "format": str(setup.timing.format),
        "inverted": setup.inverted,
        "channels": list(setup.channels),
    }


def show(found: dict[str, Any]) -> RenderableType:
    """The same for a terminal."""
    from rich.console import Group
    from rich.text import Text

    damaged = "unknown how many" if found["damaged"] is None else f"{found['damaged']:,}"
    lines = [
        f"not recognised; {found['duration_s']:.1f} s"
        if found["protocol"] is None and not found["layout"]
        else (found["protocol"] or "polled")
        + (", layout not known" if found["layout"] else "")
        + (f", {found['baud']} bps {found['format']}" if found["baud"] else "")
        + (", inverted" if found["inverted"] else "")
        + (f", channel {', '.join(found['channels'])}" if found["channels"] else "")
        + f"; {found['duration_s']:.1f} s, {counted(found['characters'], 'character')}, "
        f"{counted(found['frames'], 'frame')}, {damaged} damaged, bus load {found['bus_load']:.1%}"
        + ("" if found["exact_times"] else "; times are the operating system's")
    ]
    numbers = found | found["outcomes"]
    lines += [
        f"{counted(numbers[key], noun)} {what}" for key, (noun, what) in _SHOWN.items() if numbers.get(key)
    ]
    lines += [f"warning: {each['text']}" for each in found["warnings"]]
    lines += [described(each) for each in found.get("described", ())]
    link = found.get("link")
    if link is not None:
        times = link["scan_time_ms"]
        shown = ", ".join(f"{name} {times[name]:.3f}" for name in times if times[name] is not None)
        origin = "by a parameter frame" if link["settings_heard"] else "as observed"
        mode, timeout = (
            "unknown" if link[key] is None else f"{link[key]:g}" for key in ("mode", "timeout_ms")
        )
        lines.append(
            f"mode {mode}, {counted(link['slaves'], 'slave')}, {counted(link['retries'], 'retry')}, "
            f"timeout {timeout}{' ms' if link['timeout_ms'] is not None else ''} ({origin})"
        )
        if silent := ", ".join(map(str, link["silent_stations"])):
            lines.append(f"no reply from station {silent}")
        lines.append(f"link scan time   {shown or '–'} ms   ({counted(link['scans'], 'scan')})")
    return Group(*map(Text, lines), *([_table(found)] if found["exchanges"] else []))


#: Outcomes in words.
_WORDS = {"no_answer": "no reply", "wrong_answer": "wrong reply"}
#: Numbers that are shown where they are not 0: what is counted, and more of it.
_SHOWN = {
    "unasked": ("frame", "of no exchange"),
    "strays": ("stray", "(characters that are no frame, as of a driver that switches off)"),
    "echoes": ("request", "heard twice: echoes"),
    "broadcast": ("request", "to all stations"),
    "undecided": ("request", "whose outcome the recording does not show"),
    "late": ("response", "after the master's timeout"),
    "wrong_seen": ("wrong reply", "before the right one"),
    "recorder_damage": ("frame", "damaged at the recorder only"),
    "parity_errors": ("character", "with a wrong parity bit"),
    "stop_errors": ("character", "with a wrong stop bit"),
    "scans_unmeasured": ("link scan", "without a time: the frame at one end was not heard"),
    "time_steps": ("line", "whose time is up to a second before that above"),
    "spikes": ("pulse", "too short for a bit"),
}


def described(found: dict[str, Any]) -> str:
    """What is known of a channel in which nothing was recognised."""
    parts = [f"channel {found['channel']}:" if found.get("channel") else "begins:"]
    if "edges" in found:
        parts.append(f"{counted(found['edges'], 'edge')};")
    if not found.get("pieces"):
        parts.append("no characters")
    if "baud" in found:
        wrong = ", ".join(f"{form} {share:.0%}" for form, share in found["wrong_share"].items())
        parts.append(
            f"idles {'high' if found['idle_level'] else 'low'}, likely {found['baud']} bps, "
            f"samples a bit: {found['samples_a_bit']:g}, "
            f"{counted(found['characters'], 'character')}, wrong bits {wrong};"
        )
    return " ".join([*parts, *(f"[{piece}]" for piece in found.get("pieces", ()))])


def _table(found: dict[str, Any]) -> Table:
    from rich.text import Text

    from bussim.commands.common.console import plain_table

    table = plain_table(
        ["station" if "link" in found else "station: function at address × count"],
        ["attempts", "ok", "failed", "response: median ms", "mean", "max"],
    )
    for name, asked in found["exchanges"].items():
        figures = asked["response_ms"]
        failed = ", ".join(
            f"{count:,} × {_WORDS.get(word, word)}"
            for word, count in asked["outcomes"].items()
            if word != "ok"
        )
        times = ["–" if figures[key] is None else f"{figures[key]:.3f}" for key in ("p50", "mean", "max")]
        row = (name, f"{asked['attempts']:,}", f"{asked['outcomes'].get('ok', 0):,}", failed or "0", *times)
        table.add_row(*map(Text, row))
    return table
