"""The causes that a diagnosis tells apart, and how their evidence is added up."""

from collections import defaultdict
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

from bussim.words.tables import read_table


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
_TABLE = read_table("bussim.site.diagnosis", "causes.yaml")
#: What each is, in words; ``{at}`` is the station.
MEANINGS = {cause: str(_TABLE["causes"][cause]) for cause in Cause}
#: What tells a cause from another one, or from any (``any``).
_SEPARATES = {(Cause(one), two): text for one, two, text in _TABLE["separates"]}
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
        shared = (name for name, causes in _TABLE["groups"].items() if self.cause in causes)
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
                if key[0] in _TABLE["symptoms"][symptom]:
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
    pairs = (first, second), (second, first), (first, "any"), (second, "any")
    again = "read all stations again after 10 minutes and give both readings (before, after)"
    return next((_SEPARATES[pair] for pair in pairs if pair in _SEPARATES), again)
