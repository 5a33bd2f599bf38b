"""From a readout to its likely causes, and the reading that would tell them apart."""

from dataclasses import dataclass
from typing import Any

from bussim.site.diagnosis.causes import BROKEN, CLOSE, Finding, Tally, separating
from bussim.site.diagnosis.noise_rules import noise_rules
from bussim.site.diagnosis.station_rules import station_rules
from bussim.site.diagnosis.witness import Witness
from bussim.site.link import SiteLink
from bussim.site.readout import Readout


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """Causes, the likeliest first; ``next`` are the readings that would tell most."""

    causes: tuple[Finding, ...]
    next: tuple[str, ...]

    @property
    def close(self) -> tuple[Finding, ...]:
        """Those that these readings cannot tell from the first."""
        return tuple(one for one in self.causes[1:] if self.causes[0].score - one.score <= CLOSE)

    @property
    def broken(self) -> bool:
        """Whether the first cause is one to mend before noise can be told."""
        return bool(self.causes) and self.causes[0].cause in BROKEN

    def to_json(self) -> dict[str, Any]:
        """The diagnosis as plain data."""
        return {"causes": [one.to_json() for one in self.causes], "next": list(self.next)}


def diagnose(readout: Readout, link: SiteLink, bursts: str = "cannot tell") -> Diagnosis:
    """Weigh all causes by the readout; ``bursts`` is what its ladder says of them."""
    witness, tally = Witness(readout, link, bursts), Tally()
    station_rules(witness, tally)
    noise_rules(witness, tally)
    found = tally.findings(readout.symptoms)
    unread = [s.place for s in readout.slaves if not s.read and s.state != "off"]
    missing = [place for place in readout.order if place not in {s.place for s in readout.stations}]
    following = []
    if not witness.heard:
        following.append("read the slaves: their D8203 to D8210 tell what no reading of the master does")
    elif unread or missing:
        following.append(f"read {', '.join(dict.fromkeys([*unread, *missing]))} as well")
    if witness.master is None:
        following.append(
            "read the master: its codes D8212 and its flags M8184 and on say which slave it misses"
        )
    if len(found) > 1:
        following.append(separating(found[0], found[1]))
    return Diagnosis(tuple(found), tuple(following))
