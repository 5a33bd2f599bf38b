"""The longest that a signal takes from one device to another, in closed form. All times in ticks.

A change waits for at most two scans of its PLC (one that begins too early to see it, one that carries it
out), then for the next data frame of its station, at most one link scan away; the frame is on the wire;
the destination's END comes at most one scan later, and its output another one. A rung that stands in front
of the one whose result it reads costs a scan more. The age of a word is at most that of an image taken one
scan before its frame began, when the next frame is complete. There is a bound only where the signal path is
plain (:mod:`bussim.scenario.signals.paths`); else one reason why there is none.

**What the cases mean.** The *window* of a change lasts from the change to its output (of a word: from the
END that left it to the one that reads it). An attempt counts as a lost reply if it fails and any part of it,
from the quiet time before its poll to its end, lies in the window. A station's *flag* is on from the end of
an exchange that has spent all its attempts to its next good one; a scan that begins while any is on has a
parameter frame in front. Stations that never reply belong to the link, not to its errors: no case holds for
a change before the link has formed, nor under ``absent_station: probe`` before the first link scan in which
the flags of all of them are on (until then each takes all its attempts once).

- *no error*: no lost reply, and at the change no station's flag is on. So from the link's first scan on
  until anything is lost (with absent stations: see above), and again once all stations have replied.
- *e lost replies*, of whatever stations: e lost replies; flags may be on from before. With e = 0 that is a
  parameter frame more than without error. Whenever the source itself has spent all its attempts (under
  ``absent_station: probe`` with its flag on: the one that it gets), its data wait for another link scan.
- *every retry spent*: any reply of any station may be lost, all attempts in every scan; only of the source
  is it assumed how often: its exchange spends all its attempts without a reply once, it is in error, and
  in the next scan it replies to the last attempt that it gets. (Under ``probe`` with its flag on it gets one
  attempt a scan: it spends as many scans as there are attempts.) A master has no exchange of its own: for
  one the case has no assumption. A source that is in error for longer sends nothing for as long.

No station repeats a frame that only the target misses: each such frame adds :attr:`LatencyBound.missed`.
"""

from dataclasses import dataclass, replace

from bussim.engines.nn.frames import MODES
from bussim.exact.from_scenario import from_scenario
from bussim.exact.link import MASTER, LinkModel
from bussim.exact.scan.outages import clean_scan
from bussim.exact.text import in_ms
from bussim.plc.link_registers import D_STATION, setting_values
from bussim.scenario.model import Edge, Plc, Scenario
from bussim.scenario.signals.paths import SignalPath, signal_paths
from bussim.words.language import say

#: Keys of the two cases beside those with lost replies.
NO_ERROR, EVERY_RETRY = "no error", "every retry spent"


@dataclass(frozen=True, slots=True)
class LatencyBound:
    """Of one entry: what its parts are at most. With a ``reason`` there is no bound, and nothing else counts.

    ``scan``, ``wire``, ``destination`` and ``output`` are those of ``bussim.results.meters.latency.PARTS``;
    ``turn`` is without error; ``program`` the scans that programs take beyond these, wherever they show.
    ``silent`` is what a lost reply costs, ``link_scan`` the longest link scan without error, ``replied``
    what of it the source's own exchange takes (0 for the master), ``others`` those of the other slaves that
    reply, ``parameters`` a parameter frame where not every scan has one anyway, ``probe`` whether a station
    whose flag is on gets one attempt only. ``gates`` are what must let the signal through. Both PLCs one and
    the same: no link, ``link_scan`` is 0.
    """

    name: str
    word: bool
    scan: int = 0
    turn: int = 0
    wire: int = 0
    destination: int = 0
    output: int = 0
    program: int = 0
    link_scan: int = 0
    silent: int = 0
    replied: int = 0
    others: tuple[int, ...] = ()
    parameters: int = 0
    attempts: int = 1
    probe: bool = False
    reason: str = ""
    gates: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def valid(self) -> bool:
        """Whether there is such a bound."""
        return not self.reason

    @property
    def caveats(self) -> tuple[str, ...]:
        """What the bound leaves out or takes for granted, in words."""
        gates = [say("bound_gates", gates=", ".join(self.gates))] if self.gates else []
        return (*gates, *self.notes)

    @property
    def no_error(self) -> int:
        """Without any error."""
        return self.scan + self.turn + self.wire + self.destination + self.output + self.program

    @property
    def missed(self) -> int:
        """What each frame that only the target misses adds, without further errors."""
        return self.link_scan + self.parameters

    def lost(self, replies: int) -> int:
        """With so many lost replies, of whatever stations, flags may be on from before."""
        if not self.link_scan:
            return self.no_error
        longer = self.no_error + self.parameters + replies * self.silent
        if not self.replied:
            # Of one scan: what is beyond the last retries leaves stations without a reply.
            missing = max(0, replies - len(self.others) * (self.attempts - 1))
            return min(longer - missing * min(self.others, default=0), self.every_retry)
        without = replies if self.probe else replies // self.attempts  # exchanges of the source
        return longer + without * (self.link_scan - self.replied + self.parameters)

    @property
    def every_retry(self) -> int:
        """With every retry of every station spent; the source once in vain, and then up to the last."""
        if not self.link_scan:
            return self.no_error
        spent = self.attempts * self.silent
        last = spent - self.silent  # up to a reply to the last attempt
        if not self.replied:
            scans, own = 1, 0
        elif self.probe:
            scans, own = self.attempts + 1, spent + self.replied
        else:
            scans, own = 2, spent + last + self.replied
        bare = self.link_scan - self.replied - sum(self.others) + self.parameters
        # A flag that is on costs one attempt under probe: replying to the last attempt each time costs more.
        each = [max(self.silent, last + other) if self.probe else spent for other in self.others]
        others = sum(spent + (scans - 1) * other for other in each)
        return self.no_error - self.link_scan + scans * bare + own + others

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
        parts = ("scan", "turn", "wire", "destination", "output", "program")
        return {
            "valid": self.valid,
            "reasons": [self.reason] if self.reason else [],
            "gates": list(self.gates),
            "notes": list(self.caveats),
            "kind": "age of a word" if self.word else "change of a bit",
            "no_error_ms": in_ms(self.no_error) if self.valid else None,
            "lost_replies_ms": {str(number): in_ms(self.lost(number)) for number in range(self.attempts + 1)}
            if self.valid and self.link_scan
            else {},
            "every_retry_ms": in_ms(self.every_retry) if self.valid else None,
            "missed_frame_ms": in_ms(self.missed) if self.valid and self.link_scan else None,
            "parts_ms": {part: in_ms(getattr(self, part)) for part in parts} if self.valid else {},
        }


def bounds_of(scenario: Scenario) -> dict[str, LatencyBound]:
    """The bounds of all entries of ``latency`` by name, for the parts of a run without faults.

    Noise only decides how often replies are lost, which each case says for itself.
    """
    models = from_scenario(replace(scenario, noise=()), ignore_faults=True, bound_end=True)
    return {path.entry.name: _bound(path, models) for path in signal_paths(scenario)}


def _bound(path: SignalPath, models: dict[str, LinkModel]) -> LatencyBound:
    name, source, target, word = path.entry.name, path.source, path.target, path.word
    model = models[path.bus] if path.bus is not None else None
    notes = model.notes if model is not None else ()
    ports = {plc.name: plc.ports for plc in (source, target)}
    notes += tuple(say("bound_ports", plc=plc) for plc in ports if ports[plc])
    reason = path.reason or _obstacle(path, model)
    if reason:
        return LatencyBound(name, word, reason=reason, notes=notes)
    counted = {Edge.RISING: (1,), Edge.FALLING: (0,), Edge.BOTH: (0, 1)}[path.entry.edge]
    bound = LatencyBound(
        name,
        word,
        scan=2 * source.longest_scan if path.entry.source.startswith("X") else 0,
        program=path.scans[0] * source.longest_scan + path.scans[1] * target.longest_scan,
        gates=tuple(dict.fromkeys(gate for level in counted for gate in path.gates[level])),
        notes=notes,
    )
    if model is None:
        return bound
    if model.dead and model.absent.probes:
        absent = ", ".join(str(station.number) for station in model.dead)
        notes = (*notes, say("bound_flags", stations=absent))
    link_scan = clean_scan(model, slowest=True)
    replied = {s.number: model.replied(s) - s.extra + s.slowest for s in model.alive}
    return replace(
        bound,
        turn=source.longest_scan if word else link_scan,
        wire=path.frame,
        destination=link_scan if word else target.longest_scan,
        output=0 if word or path.direct else target.longest_scan,
        link_scan=link_scan,
        silent=model.silent_cost,
        replied=replied.pop(_number(source), 0),
        others=tuple(replied.values()),
        parameters=0 if model.dead else model.parameters_cost,
        attempts=model.attempts,
        probe=model.absent.probes,
        notes=notes,
    )


def _number(plc: Plc) -> int:
    return setting_values(plc.profile, plc.registers)[D_STATION]


def _obstacle(path: SignalPath, model: LinkModel | None) -> str:
    """Why no time is known of the link between source and target; empty if it is."""
    if model is None:
        return ""
    if reasons := model.obstacles or tuple(model.timeout_reasons()):
        return reasons[0]
    if not (MODES[model.mode].words if path.word else MODES[model.mode].bits):
        return say("bound_no_words" if path.word else "bound_no_bits", mode=model.mode)
    polled = {station.number: station for station in model.stations}
    known = {**{station.number: station for station in model.listeners}, **polled}
    source, target = _number(path.source), _number(path.target)
    if source != MASTER and (source not in polled or not polled[source].alive):
        return say("bound_never_heard", name=path.source.name, bus=path.bus)
    if target != MASTER and (target not in known or not known[target].hears):
        return say("bound_hears_nothing", name=path.target.name, bus=path.bus)
    return ""
