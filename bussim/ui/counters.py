"""What counters that were read on site say of a line's noise."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

from pydantic import Field

from bussim.exact.link import TIMEOUT_UNIT
from bussim.plc.link_registers import D_MODE, D_RETRIES, D_SLAVES, D_TIMEOUT, setting_values
from bussim.scenario.yaml.dump import dumped_inline
from bussim.ui.guard import Refusal
from bussim.ui.line import Line
from bussim.ui.questions import Asked
from bussim.units import TICKS_PER_MS, format_time

_Counts = Annotated[dict[str, Annotated[int, Field(ge=0, le=32767)]], Field(max_length=8, default={})]


class CountersAsked(Asked):
    """By how much counters rose within ``watched_h`` hours, by station; what was not read is missing.

    ``master`` are the master's D8204 to D8210, ``slaves`` each slave's own D8203.
    """

    watched_h: Annotated[float, Field(gt=0, le=100_000)]
    master: _Counts
    slaves: _Counts


#: The upper limit of lost replies that stands for none.
_UNLIMITED = 0.99


def noise_of(asked: CountersAsked, line: Line, site: Callable[[Path], Any]) -> dict[str, Any]:
    """The likeliest noise and its upper limits, as entries of a scenario's ``noise``, and what is not known.

    ``unlimited`` are the stations whose lost replies the counts do not limit: the master's were not read.

    ``site`` reads the file of a readout (:func:`bussim.site`). Raises Refusal without a count,
    ScenarioError for counts that contradict each other.
    """
    members = {number: plc for number, plc in line.members.items() if number in range(8)}
    if 0 not in members or not (asked.master or asked.slaves):
        raise Refusal(400, "no_counts", "enter the count of one station at least")
    settings = setting_values(members[0].profile, members[0].registers)
    slaves, mode, retries, timeout = (settings[at] for at in (D_SLAVES, D_MODE, D_RETRIES, D_TIMEOUT))
    counts = {
        number: {"D8203": many} for number in members if (many := asked.slaves.get(str(number))) is not None
    }
    counts[0] = {f"D{8203 + int(k)}": many for k, many in asked.master.items() if k in tuple("1234567")}
    stations = [
        {
            "place": plc.name,
            "number": number,
            "state": "run",
            "plc_scan": f"{plc.scan.mean / TICKS_PER_MS:.6g} ms",
            "before": dict.fromkeys(counts.get(number, ()), 0),
            "after": counts.get(number, {}),
        }
        for number, plc in sorted(members.items())
        if number <= slaves
    ]
    readout = {
        "schema": 1,
        "kind": "readout",
        "profile": members[0].profile.name,
        "settings": {
            "slaves": slaves,
            "mode": mode,
            "retries": retries,
            "timeout": format_time(timeout * TIMEOUT_UNIT),
        },
        "watched": f"{asked.watched_h:g} h",
        "stations": stations,
    }
    with TemporaryDirectory() as folder:
        file = Path(folder) / "counters.yaml"
        file.write_text(dumped_inline(readout), encoding="utf-8")
        said = site(file).to_dict()
    wanted = ("bursts", "noise", "noise_upper_limits", "not_known", "unexplained", "notes")
    open_ended = [
        each["station"] for each in said["noise_upper_limits"] if each.get("reply_loss", 0) >= _UNLIMITED
    ]
    return {"n": asked.n, **{key: said[key] for key in wanted}, "unlimited": open_ended}
