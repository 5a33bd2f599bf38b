"""The longest that a signal takes from one device to another, in closed form. All times in ticks.

A change waits for at most two scans of its PLC (one that begins too early to see it, one that carries it
out), then for the next data frame of its station, at most one link scan away; the frame is on the wire;
the destination's END comes at most one scan later, and its output another one. Each program is taken to
pass the signal on in the scan that reads it: what it delays longer is to be added.

A lost reply, of whatever station, makes the master wait for its timeout and poll again. Where the
source itself spends all its attempts its data go out only in the next link scan. A frame that only the
target misses is repeated by nobody: each such one adds a link scan.

The age of a word is at most that of an image taken one scan before its frame began, when the next frame
is complete.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from bussim.exact.link import MASTER, LinkModel
from bussim.exact.outages import clean_scan
from bussim.exact.reading import from_scenario
from bussim.plc.board import D_STATION, setting_values
from bussim.scenario.model import Plc, Scenario
from bussim.scenario.ways import Way, ways
from bussim.units import milliseconds

#: Keys of the two cases beside those with lost replies.
NO_ERROR, EVERY_RETRY = "no error", "every retry spent"


@dataclass(frozen=True, slots=True)
class LatencyBound:
    """Of one entry: what its parts are at most. Nothing but ``reasons`` counts where it is not ``valid``.

    ``scan``, ``wire``, ``destination`` and ``output`` are those of :data:`bussim.results.latency.PARTS`;
    ``turn`` is without error. ``silent`` is what a lost reply costs, ``link_scan`` the longest link scan
    without error, ``answered`` what of it the source's own exchange takes (0 for the master),
    ``parameters`` a parameter frame, ``alive`` how many slaves answer. Both PLCs one and the same: no link.
    """

    name: str
    word: bool
    scan: int = 0
    turn: int = 0
    wire: int = 0
    destination: int = 0
    output: int = 0
    link_scan: int = 0
    silent: int = 0
    answered: int = 0
    parameters: int = 0
    alive: int = 0
    attempts: int = 1
    reasons: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def valid(self) -> bool:
        """Whether there is such a bound."""
        return not self.reasons

    @property
    def no_error(self) -> int:
        """Without any error."""
        return self.scan + self.turn + self.wire + self.destination + self.output

    def lost(self, replies: int) -> int:
        """With so many lost replies, of whatever stations, while it is under way."""
        if not replies or not self.link_scan:
            return self.no_error
        longer = replies * self.silent
        if replies < self.attempts:
            return self.no_error + longer
        # A station is in error, and then parameter frames go out; or it is the source itself.
        silences = replies // self.attempts if self.answered else 0
        flagged = max(1, replies // self.attempts) * self.parameters
        return self.no_error + longer + flagged + silences * (self.link_scan - self.answered)

    @property
    def every_retry(self) -> int:
        """With every retry of every station spent, and each answered by the last of them."""
        return self.no_error + self.alive * (self.attempts - 1) * self.silent

    def cases(self) -> dict[str, int]:
        """The bounds by case; empty where there are none."""
        if not self.valid:
            return {}
        found = {NO_ERROR: self.no_error}
        if self.link_scan:
            for replies in range(1, self.attempts + 1):
                found[f"{replies} lost {'reply' if replies == 1 else 'replies'}"] = self.lost(replies)
            found[EVERY_RETRY] = self.every_retry
        return found

    def to_json(self) -> dict[str, object]:
        """One entry of the JSON form, times in ms."""
        parts = ("scan", "turn", "wire", "destination", "output")
        return {
            "valid": self.valid,
            "reasons": list(self.reasons),
            "notes": list(self.notes),
            "kind": "age of a word" if self.word else "change of a bit",
            "no_error_ms": _ms(self.no_error) if self.valid else None,
            "lost_replies_ms": {str(number): _ms(self.lost(number)) for number in range(1, self.attempts + 1)}
            if self.valid and self.link_scan
            else {},
            "every_retry_ms": _ms(self.every_retry) if self.valid else None,
            "missed_frame_ms": _ms(self.link_scan) if self.valid and self.link_scan else None,
            "parts_ms": {part: _ms(getattr(self, part)) for part in parts} if self.valid else {},
        }


def _ms(ticks: int) -> float:
    return round(milliseconds(ticks), 6)


def bounds_of(scenario: Scenario) -> dict[str, LatencyBound]:
    """The bounds of all entries of ``latency`` by name, for the stretches without faults.

    Noise only decides how often replies are lost, which each case says for itself.
    """
    models = from_scenario(replace(scenario, noise=()), ignore_faults=True, bound_end=True)
    return {way.entry.name: _bound(way, models) for way in ways(scenario)}


def _bound(way: Way, models: dict[str, LinkModel]) -> LatencyBound:
    name, source, target = way.entry.name, way.source, way.target
    reasons = [
        f"the longest scan of {plc.name} cannot be told: its program has loops, subroutines or jumps back"
        for plc in ((source,) if source is target else (source, target))
        if plc.instruction_time is None
    ]
    from_input = way.entry.source.startswith("X")
    scan = 2 * source.longest_scan if from_input else 0
    if way.bus is None:
        output = 0 if from_input else source.longest_scan
        return LatencyBound(name, way.word, scan=scan, output=output, reasons=tuple(reasons))
    model = models[way.bus]
    reasons += _obstacles(way, model)
    if reasons:
        return LatencyBound(name, way.word, reasons=tuple(reasons), notes=model.notes)
    parameters = model.parameters_cost
    link_scan = clean_scan(model, slowest=True) + (parameters if model.dead else 0)
    number = _number(source)
    answered = 0
    if number != MASTER:
        station = model.station(number)
        answered = model.answered(station) - station.extra + station.slowest
    word = way.word
    return LatencyBound(
        name,
        word,
        scan=scan,
        turn=source.longest_scan if word else link_scan,
        wire=way.frame,
        destination=link_scan if word else target.longest_scan,
        output=0 if word or way.direct else target.longest_scan,
        link_scan=link_scan,
        silent=model.silent_cost,
        answered=answered,
        parameters=0 if model.dead else parameters,
        alive=len(model.alive),
        attempts=model.attempts,
        notes=model.notes,
    )


def _number(plc: Plc) -> int:
    return setting_values(plc.profile, plc.registers)[D_STATION]


def _obstacles(way: Way, model: LinkModel) -> list[str]:
    """Why the link carries nothing from one to the other, or not within known times."""
    found = [*model.obstacles, *(model.timeout_reasons() if not model.obstacles else ())]
    if found:
        return found
    for plc in (way.source, way.target):
        number = _number(plc)
        if number == MASTER:
            continue
        known = {station.number: station for station in (*model.stations, *model.listeners)}.get(number)
        polled = known in model.stations
        if plc is way.source and (known is None or not known.alive or not polled):
            found.append(f"{plc.name} is never heard on {way.bus}")
        elif known is None or not known.hears:
            found.append(f"{plc.name} hears nothing on {way.bus}")
    return found
