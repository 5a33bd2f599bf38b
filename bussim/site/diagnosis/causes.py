"""The causes that a diagnosis tells apart, and how their evidence is added up."""

from collections import defaultdict
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any


class Cause(StrEnum):
    """What may be wrong."""

    STATION_OFF = "station_off"
    CABLE_CUT = "cable_cut"
    WRONG_FORMAT = "wrong_format"
    NUMBER_TWICE = "number_twice"
    TWO_MASTERS = "two_masters"
    SLOW_REPLY = "slow_reply"
    NOISE_RECEIVER = "noise_receiver"
    NOISE_RECEIVERS = "noise_receivers"
    NOISE_WIRE = "noise_wire"
    NOISE_BURSTS = "noise_bursts"
    NOISE_SENDER = "noise_sender"
    REPLIES_LOST = "replies_lost"
    WAS_AWAY = "was_away"
    MASTER_AWAY = "master_away"
    HEALTHY = "healthy"


#: Causes to mend before counts tell of noise.
BROKEN = [*Cause][: [*Cause].index(Cause.NOISE_RECEIVER)]
#: What each is, in words; ``{at}`` is the station.
MEANINGS = {
    Cause.STATION_OFF: "{at} is off or in STOP",
    Cause.CABLE_CUT: "the cable is interrupted before {at}",
    Cause.WRONG_FORMAT: "{at} has another character format or rate",
    Cause.NUMBER_TWICE: "the station number of {at} is there twice",
    Cause.TWO_MASTERS: "{at} is a second master",
    Cause.SLOW_REPLY: "{at} replies late: it waits for END, or the timeout is too short",
    Cause.NOISE_RECEIVER: "noise in the receiver of {at}",
    Cause.NOISE_RECEIVERS: "noise in each receiver by itself (terminators, bias, earth)",
    Cause.NOISE_WIRE: "noise on the wire, for all alike",
    Cause.NOISE_BURSTS: "noise on the wire that comes in bursts",
    Cause.NOISE_SENDER: "what {at} sends is damaged",
    Cause.REPLIES_LOST: "{at} leaves polls without a reply",
    Cause.WAS_AWAY: "{at} was away for a while",
    Cause.MASTER_AWAY: "the master is or was away",
    Cause.HEALTHY: "nothing but what every start leaves",
}
#: Causes that these readings hardly tell apart.
_GROUPS = {
    "wire or bursts": (Cause.NOISE_WIRE, Cause.NOISE_BURSTS),
    "sender or lost replies": (Cause.NOISE_SENDER, Cause.REPLIES_LOST),
}
_NUMBERS = "read D8176 in every cabinet, and D8173, which is in force"
#: What tells the causes of a pair from each other.
_SEPARATES = {
    (Cause.NOISE_WIRE, Cause.NOISE_BURSTS): (
        "count with the ladder: rises to its third threshold tell bursts from steady noise"
    ),
    (Cause.NOISE_SENDER, Cause.REPLIES_LOST): (
        "look at that station's code (D8211 + k) several times: 04 is damage, 01 no reply; or count with the "
        "ladder, whose second threshold only silence reaches"
    ),
    (Cause.WAS_AWAY, Cause.HEALTHY): (
        "read all stations again after 10 minutes: a late power-up adds no more counts"
    ),
    (Cause.MASTER_AWAY, Cause.HEALTHY): (
        "read D8203 of the slaves again later: it does not climb while the master stays in RUN"
    ),
    (Cause.SLOW_REPLY, Cause.NOISE_SENDER): (
        "look at D8201 several times: a late reply lengthens every scan, noise some of them"
    ),
    (Cause.CABLE_CUT, Cause.WRONG_FORMAT): (
        "look at the RD lamp of that station: dark beyond a cut, flickering with a wrong format"
    ),
    (Cause.STATION_OFF, Cause.CABLE_CUT): "look at the RUN and RD lamps of the stations that do not reply",
    (Cause.NOISE_WIRE, Cause.NOISE_SENDER): (
        "read D8204 to D8210 of the slaves at D8179 = 0, or swap the master's board: of what is on the wire "
        "replies suffer as well"
    ),
    (Cause.NOISE_WIRE, Cause.NOISE_RECEIVERS): (
        "compare D8203 of all slaves after some hours: equal counts are on the wire"
    ),
    (Cause.NUMBER_TWICE, Cause.SLOW_REPLY): _NUMBERS,
    (Cause.NUMBER_TWICE, Cause.TWO_MASTERS): _NUMBERS,
    # From any other cause.
    (Cause.STATION_OFF, None): "put that station into RUN and read all again: what is left has another cause",
    (Cause.HEALTHY, None): "let counts come: bussim site --plan says how long with which reading",
}
_NOISE = tuple(cause for cause in Cause if cause.value.startswith("noise"))
#: With which causes a symptom goes.
_SYMPTOMS = {
    "when_drive_runs": _NOISE,
    "after_power_cycle_gone": (Cause.STATION_OFF, Cause.WAS_AWAY, Cause.MASTER_AWAY),
    "since_start": (Cause.WRONG_FORMAT, Cause.NUMBER_TWICE, Cause.TWO_MASTERS, Cause.SLOW_REPLY),
    "every_few_days": (Cause.NOISE_BURSTS, Cause.WAS_AWAY, Cause.MASTER_AWAY),
}
#: Causes this close to each other are not told apart.
CLOSE = 2.0


@dataclass(frozen=True, slots=True)
class Finding:
    """One cause at one station (None: the link as a whole), its points and its evidence."""

    cause: Cause
    station: int | None
    score: float
    evidence: tuple[str, ...]

    @property
    def group(self) -> str:
        """The causes that it is hardly told from, by a name."""
        shared = (name for name, causes in _GROUPS.items() if self.cause in causes)
        return next(shared, self.cause.value.replace("_", " "))

    def to_json(self) -> dict[str, Any]:
        """The finding as plain data."""
        return {
            "cause": self.cause.value,
            "station": self.station,
            "group": self.group,
            "score": round(self.score, 1),
            "evidence": list(self.evidence),
        }


@dataclass(slots=True)
class Tally:
    """Points for and against causes, each with the sentence that says why."""

    points: dict[tuple[Cause, int | None], list[tuple[float, str]]] = field(
        default_factory=lambda: defaultdict(list)
    )

    def add(self, cause: Cause, station: int | None, points: float, why: str) -> None:
        """Points for a cause, below 0 against it."""
        self.points[cause, station].append((points, why))

    def score(self, cause: Cause, station: int | None = None) -> float:
        """The points of a cause so far."""
        return sum(points for points, _ in self.points.get((cause, station), ()))

    def findings(self, symptoms: frozenset[str]) -> list[Finding]:
        """The best finding of each cause with any points, the first first."""
        for symptom in sorted(symptoms):
            for key in self.points:
                if key[0] in _SYMPTOMS[symptom]:
                    self.points[key].append((1.0, f"it goes with the symptom {symptom}"))
        found = [
            Finding(cause, station, sum(points for points, _ in given), tuple(why for _, why in given))
            for (cause, station), given in self.points.items()
        ]
        # Of two that are as likely "healthy" comes last: who reads registers has a reason.
        found.sort(key=lambda one: (-one.score, [*Cause].index(one.cause), one.station or 0))
        best: dict[Cause, Finding] = {}
        for one in found:
            first = best.setdefault(one.cause, one) if one.score > 0 else None
            if first is not None and first is not one and first.score - one.score <= CLOSE:
                also = f"the same at station {one.station}: {one.evidence[0]}"
                best[one.cause] = replace(best[one.cause], evidence=(*best[one.cause].evidence, also))
        return list(best.values())


def separating(one: Finding, two: Finding) -> str:
    """The reading that tells two findings apart."""
    first, second = one.cause, two.cause
    pairs = (first, second), (second, first), (first, None), (second, None)
    again = "read all stations again after 10 minutes and give both readings (before, after)"
    return next((_SEPARATES[pair] for pair in pairs if pair in _SEPARATES), again)
