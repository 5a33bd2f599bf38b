"""``bussim.site``: what the registers of a link say, from Python."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bussim.errors import UsageError
from bussim.plc.profiles import Attempts
from bussim.site.calibration import Found, calibrate
from bussim.site.diagnosis.diagnose import Diagnosis, diagnose
from bussim.site.file import load
from bussim.site.link import SiteLink
from bussim.site.noise.picture import Picture, picture
from bussim.site.noise.sizing import sizes
from bussim.site.plan import plan
from bussim.site.readout import Calibration, Readout

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, slots=True, repr=False)
class SiteResult:
    """What ``bussim site`` says of one file; :meth:`to_dict` is its JSON form.

    ``noted`` is what the file has. Of a readout there are a ``diagnosis`` and ``pictures`` of the noise, by
    what D8179 means where a calibration left that open (else by None); of a calibration what it ``decides``.
    """

    noted: Readout | Calibration
    diagnosis: Diagnosis | None = None
    pictures: dict[Attempts | None, Picture] | None = None
    decides: Found | None = None

    def __repr__(self) -> str:
        causes = self.diagnosis.causes if self.diagnosis else ()
        kind = "calibration" if self.decides else ", ".join(str(one.cause) for one in causes) or "no cause"
        return f"<SiteResult: {kind}>"

    def to_dict(self, *, planned: bool = False) -> dict[str, Any]:
        """The JSON form, times in ms; ``planned``: with how long to watch, for a readout."""
        if self.decides is not None:
            return {"schema": 1, "kind": "calibration", **self.decides.to_json()}
        assert self.diagnosis and self.pictures and isinstance(self.noted, Readout)  # noqa: S101, PT018 - of a readout
        first = next(iter(self.pictures.values()))
        values: dict[str, Any] = {
            "schema": 1,
            "kind": "readout",
            **self.diagnosis.to_json(),
            **first.to_json(),
        }
        values["size"] = {name: chosen.to_json() for name, chosen in sizes(first).items()}
        values["plan"] = [watch.to_json() for watch in plan(first)] if planned else None
        if len(self.pictures) > 1:
            named = self.pictures.items()
            values["attempts_open"] = {str(name): one.to_json()["stations"] for name, one in named}
        return {**values, "notes": list(self.noted.notes)}

    def table(self) -> pd.DataFrame:
        """The probability that an attempt fails, with its interval: one row a station.

        Raises UsageError for a calibration.
        """
        import pandas as pd

        if not self.pictures:
            raise UsageError("a calibration has no table of failed attempts; to_dict() has what it decides")
        fails = next(iter(self.pictures.values())).fails
        return pd.DataFrame([{"station": k, **asdict(each)} for k, each in fails.items()]).set_index(
            "station"
        )


def site(file: str | PathLike[str]) -> SiteResult:
    """Read a readout of a link's registers, or a calibration, and work out what it says.

    Raises UsageError for a file that cannot be read, ScenarioError for one that is wrong.
    """
    noted = load(Path(file))
    if isinstance(noted, Calibration):
        return SiteResult(noted, decides=calibrate(noted))
    meanings = [*Attempts] if "attempts" in noted.profile.open else [None]
    pictures = {meaning: picture(noted, SiteLink.of(noted, meaning)) for meaning in meanings}
    found = diagnose(noted, SiteLink.of(noted), pictures[meanings[0]].bursts)
    return SiteResult(noted, diagnosis=found, pictures=pictures)
