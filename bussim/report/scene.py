"""A timeline as plain shapes, lanes, boxes and marks, for a picture or a web page.

Times are ticks of 1/72 MHz. A lane is a line of the picture: the link scans, the attempts of the
master, a node of the bus each, what else happened, and the devices that changed.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from bussim.line.characters import CharFormat
from bussim.line.wave import edge_of, paused
from bussim.report.trace_window import TraceWindow, in_words, ms, parts_of_scan, read_window, worst_window
from bussim.results.meters.timeline import Span
from bussim.results.run_record import RunRecord
from bussim.results.text.lines import fault_in_words
from bussim.trace.file import Trace
from bussim.trace.levels import timing_of_frame
from bussim.trace.records import AttemptRecord, FrameRecord, ScanRecord, TransactionRecord
from bussim.units import seconds
from bussim.words.language import say
from bussim.words.tables import recognised

#: Most lanes of devices that changed; the least busy ones are left out.
MOST_DEVICES = 8
#: Most shapes of the timelines that one page can carry.
MOST_SHAPES = 6_000

#: Kinds of boxes besides those of frames (:data:`bussim.results.plots.style.FRAMES`), and what they are.
SCAN, GOOD, WAIT, DAMAGE, HEARD_DAMAGE, LEVEL = "scan", "good", "wait", "damage", "heard damage", "level"
ACTING, FLAG, LOST, DRIVEN = "acting", "flag", "lost", "driven"
#: Kinds of marks.
END, EVENT, TROUBLE = "end", "event", "trouble"

_TROUBLE_KINDS = frozenset(
    {
        "station_error",
        "watchdog",
        "undetected",
        "refused",
        "no_parameters",
        "program_stopped",
        "program_error",
    }
)


@dataclass(frozen=True, slots=True)
class Box:
    """A box from ``start`` to ``end``: a short ``label`` to stand in it, and its whole ``text``."""

    lane: int
    start: int
    end: int
    kind: str
    label: str
    text: str


@dataclass(frozen=True, slots=True)
class Mark:
    """A mark at an instant."""

    lane: int
    tick: int
    kind: str
    text: str


@dataclass(frozen=True, slots=True)
class Scene:
    """A timeline. ``why`` are sentences on what made link scans longer than plain ones.

    ``left_out`` counts the devices that changed and have no lane.
    """

    bus: str
    begin: int
    end: int
    lanes: Sequence[str]
    boxes: Sequence[Box]
    marks: Sequence[Mark]
    why: Sequence[str]
    left_out: int = 0

    def kinds(self) -> list[str]:
        """Kinds of boxes and marks in it, for a legend, in order of appearance."""
        return list(dict.fromkeys([*(box.kind for box in self.boxes), *(mark.kind for mark in self.marks)]))


@dataclass(slots=True)
class _Painter:
    window: TraceWindow
    lanes: list[str] = field(default_factory=list)
    boxes: list[Box] = field(default_factory=list)
    marks: list[Mark] = field(default_factory=list)

    def lane(self, name: str) -> int:
        self.lanes.append(name)
        return len(self.lanes) - 1

    def box(self, lane: int, start: int, end: int, kind: str, label: str, text: str) -> None:
        if end > self.window.begin and start < self.window.end:
            self.boxes.append(Box(lane, start, end, kind, label, text))

    def mark(self, lane: int, tick: int, kind: str, text: str) -> None:
        if self.window.begin <= tick < self.window.end:
            self.marks.append(Mark(lane, tick, kind, text))

    def scans(self, scans: Sequence[ScanRecord]) -> None:
        if not scans:
            return
        lane = self.lane(say("scene_scans"))
        for scan in scans:
            took = ms(scan.duration)
            text = say("scene_scan", number=scan.number, took=took)
            if scan.cause:
                text = say("scene_scan_because", number=scan.number, took=took, cause=scan.cause)
            self.box(lane, scan.start, scan.start + scan.duration, SCAN, took, text)

    def attempts(self, attempts: Sequence[AttemptRecord]) -> None:
        if not attempts:
            return
        lane = self.lane(say("scene_attempts"))
        for a in attempts:
            took = ms(a.end - a.start)
            where = say("scene_attempt", number=a.number, station=self.window.station(a.station))
            if a.code:
                values = {"outcome": a.outcome, "code": f"{a.code:02X}"}
                label = say("scene_failed_label", number=a.number, **values)
                text = say("scene_failed", where=where, took=took, **values)
                self.box(lane, a.start, a.end, WAIT, label, text)
            else:
                text = say("scene_reply", where=where)
                if a.turnaround is not None:
                    text = say("scene_reply_after", where=where, time=ms(a.turnaround))
                self.box(lane, a.start, a.end, GOOD, say("scene_to", station=a.station), text)

    def transactions(self, transactions: Sequence[TransactionRecord]) -> None:
        masters = dict.fromkeys(t.master for t in transactions)
        for master in masters:
            several = len(masters) > 1
            lane = self.lane(say("scene_attempts_of", master=master) if several else say("scene_attempts"))
            for t in transactions:
                if t.master != master or t.sent is None:
                    continue
                what = say(
                    "scene_request",
                    poll=t.poll or say("scene_a_request"),
                    function=t.function,
                    station=t.station,
                    address=t.address,
                    quantity=t.quantity,
                    attempt=t.attempt,
                )
                if t.outcome == "ok":
                    self.box(lane, t.sent, t.end, GOOD, t.poll, say("scene_response", what=what))
                else:
                    label = say("scene_outcome_label", attempt=t.attempt, outcome=t.outcome)
                    text = say("scene_outcome", what=what, outcome=t.outcome)
                    self.box(lane, t.sent, t.end, WAIT, label, text)

    def nodes(self) -> None:
        window = self.window
        numbers = {name: number for number, name in window.stations.items()}
        senders = [f.sender for f in window.frames]
        lane_of: dict[str, int] = {}
        for name in dict.fromkeys([*window.nodes, *senders]):
            lane_of[name] = self.lane(f"{numbers[name]} {name}" if name in numbers else name)
        for frame in window.frames:
            self._frame(lane_of[frame.sender], frame)
            for receiver, bits in frame.damaged_at.items():
                if receiver in lane_of:
                    for start, end, text in _damage(frame, bits):
                        heard = say("scene_heard", receiver=receiver, text=text, sender=frame.sender)
                        self.box(lane_of[receiver], start, end, HEARD_DAMAGE, "", heard)
        for plc, ticks in window.ends.items():
            for name in (plc, *(n for n in lane_of if n.startswith(f"{plc}."))):
                if name in lane_of:
                    for tick in ticks:
                        self.mark(lane_of[name], tick, END, say("scene_end", plc=plc))

    def _frame(self, lane: int, frame: FrameRecord) -> None:
        what = say("scene_kind", kind=frame.kind)
        if frame.station is not None:
            what = say("scene_kind_station", frame=what, station=frame.station)
        if frame.counter is not None:
            what = say("scene_counter", frame=what, counter=frame.counter)
        marks = ("scene_collided", frame.collided), ("scene_cut_off", frame.cut)
        faults = [say(key) for key, on in marks if on]
        if frame.damaged_bits:
            faults.append(say("scene_bits", number=len(frame.damaged_bits)))
        faults += [say("scene_pause", time=ms(ticks), number=index + 1) for index, ticks in frame.pauses]
        size = {"characters": len(frame.chars), "time": ms(frame.end - frame.start)}
        text = say("scene_frame", sender=frame.sender, frame=what, **size)
        text = say("scene_frame_faults", frame=text, faults=faults) if faults else text
        label = say("scene_label", kind=frame.kind)
        if frame.station is not None and frame.kind != "parameters":
            label = say("scene_label_station", kind=frame.kind, station=frame.station)
        self.box(lane, frame.start, frame.end, frame.kind, label, text)
        idle = [(frame.end, frame.driven_until)]
        for index, ticks in frame.pauses:
            edge = edge_of(index + 1, timing_of_frame(frame), frame.start, frame.pauses)
            idle.append((edge - ticks, min(edge, frame.end)))
        for start, end in idle:
            if start < end:
                on = say("scene_driver", sender=frame.sender, time=ms(end - start))
                self.box(lane, start, end, DRIVEN, "", on)
        for start, end, what in _damage(frame, frame.damaged_bits):
            damaged = say("scene_damaged", what=what, sender=frame.sender, kind=frame.kind)
            self.box(lane, start, end, DAMAGE, "", damaged)
        if frame.collided or frame.cut:
            self.box(lane, frame.start, frame.end, LOST, "", text)

    def spans(self) -> None:
        window = self.window
        faults: dict[str, list[Span]] = {}
        for text, span in window.faults:
            faults.setdefault(fault_in_words(text), []).append(span)
        for text, spans in faults.items():
            self._spans(say("scene_fault"), spans, ACTING, text, text)
        for station, flags in window.flags.items():
            name = window.flag_names[station]
            text = say("scene_flag", name=name, station=window.station(station))
            self._spans(name, flags, FLAG, "ON", text)

    def _spans(self, name: str, spans: Sequence[Span], kind: str, label: str, text: str) -> None:
        begin, end = self.window.begin, self.window.end
        # What hits a number of frames has a beginning only, which is among the events.
        shown = [(s.start, end if s.end is None else s.end) for s in spans if s.end != s.start]
        shown = [(start, until) for start, until in shown if start < end and until > begin]
        if shown:
            lane = self.lane(name)
            for start, until in shown:
                self.box(lane, start, until, kind, label, text)

    def notes(self) -> None:
        shown = [n for n in self.window.notes if self.window.begin <= n.tick < self.window.end]
        if not shown:
            return
        lane = self.lane(say("scene_events"))
        # What several stations report of one event at one instant is one mark.
        reported: dict[tuple[int, str, str], list[str]] = {}
        for note in shown:
            fault = note.kind.startswith("fault")
            text = fault_in_words(note.text) if fault else recognised(note.text, "note_")
            text = say("scene_over", text=text) if note.kind == "fault_over" else text
            kind = TROUBLE if note.kind in _TROUBLE_KINDS else EVENT
            by = reported.setdefault((note.tick, kind, text), [])
            if note.where not in (self.window.bus, "") and not fault:
                by.append(note.where)
        for (tick, kind, text), by in reported.items():
            self.mark(lane, tick, kind, say("scene_by", by=by, text=text) if by else text)

    def values(self) -> int:
        window = self.window
        changes = _courses(window)
        inside = {
            key: sum(window.begin <= tick < window.end for tick, _ in past) for key, past in changes.items()
        }
        busiest = sorted((key for key in changes if inside[key]), key=lambda key: -inside[key])
        kept = set(busiest[:MOST_DEVICES])
        wires = {(record.plc, record.device) for record in window.inputs}
        for key, past in changes.items():
            if key not in kept:
                continue
            plc, device = key
            name = say("scene_wire", device=device) if key in wires else device
            lane = self.lane(say("scene_device", plc=plc, device=name))
            steps = sorted(past)
            for (tick, number), (until, _) in pairwise([*steps, (window.end, 0)]):
                self.box(
                    lane,
                    tick,
                    until,
                    LEVEL,
                    f"{number}",
                    say("scene_value", plc=plc, device=name, number=number),
                )
        return len(busiest) - len(kept)


def _courses(window: TraceWindow) -> dict[tuple[str, str], list[tuple[int, int]]]:
    """The changes of each device: of a driven input those of its wire, of others those at ENDs.

    Until the first change of its wire the level of an input is that of its image in memory.
    """
    wires: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for record in window.inputs:
        wires.setdefault((record.plc, record.device), []).append((record.tick, record.level))
    courses: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for value in window.values:
        key = (value.plc, value.device)
        if key not in wires or value.tick < wires[key][0][0]:
            courses.setdefault(key, []).append((value.tick, value.value))
    for key, past in wires.items():
        courses.setdefault(key, []).extend(past)
    return courses


def scene_of(window: TraceWindow) -> Scene:
    """The timeline of a window."""
    painter = _Painter(window)
    painter.scans(window.scans)
    painter.attempts(window.attempts)
    painter.transactions(window.transactions)
    painter.nodes()
    painter.spans()
    painter.notes()
    left_out = painter.values()
    return Scene(
        window.bus,
        window.begin,
        window.end,
        painter.lanes,
        painter.boxes,
        painter.marks,
        list(_why(window)),
        left_out,
    )


def worst_scenes(trace: Trace, record: RunRecord, buses: Iterable[str], most: int) -> dict[str, Scene]:
    """By bus the longest link scan of an N:N link, and the longest attempt on every other bus.

    What has more than ``most`` shapes is left to ``bussim timeline``.
    """
    scenes = {}
    for bus in buses:
        window = worst_window(trace, record, bus)
        if window is None:
            continue
        scene = scene_of(read_window(trace, record, bus, *window))
        if len(scene.boxes) + len(scene.marks) <= most:
            scenes[bus] = scene
    return scenes


def _damage(frame: FrameRecord, bits: Sequence[int]) -> Iterable[tuple[int, int, str]]:
    """The characters that hold damaged bits: from when, until when, and which of how many."""
    number = len(frame.chars)
    if not bits or not number:
        return
    per_char = CharFormat.parse(frame.format).bits
    length = frame.end - frame.start - paused(frame.pauses, number - 1)
    for char in sorted({min(bit // per_char, number - 1) for bit in bits}):
        begin = frame.start + paused(frame.pauses, char)
        start, end = (begin + length * edge // number for edge in (char, char + 1))
        yield start, end, say("scene_character", number=char + 1, among=number)


def _why(window: TraceWindow) -> Iterable[str]:
    """What the time of each link scan with failed attempts went to, one sentence a scan."""
    for scan in window.scans:
        whole = window.begin <= scan.start and scan.start + scan.duration <= window.end
        if not whole or not (scan.failed or scan.cause):
            continue
        parts = parts_of_scan(window, scan)
        # A late reply is no part of its own; the scan's cause names the station.
        values = {"number": scan.number, "start": seconds(scan.start), "said": in_words(parts)}
        if any(part.lost for part in parts):
            yield say("scene_why", **values)
        else:
            yield say("scene_why_because", **values, cause=scan.cause)
