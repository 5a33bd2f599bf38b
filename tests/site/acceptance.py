"""How often what readouts say of simulated links is so: over as many links as are asked for.

    python -m tests.site.acceptance [links | machines | plans ...] [--seeds N] [--first N]

Prints how many links hold each figure. The tests ask for the same with a few seeds.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from random import Random
from statistics import median
from typing import Any

from bussim.api import run
from bussim.plc.profiles import AbsentStation, ErrorCount
from bussim.scenario.yaml.dump import dumped
from bussim.site.diagnosis.causes import Cause, Finding
from bussim.site.diagnosis.diagnose import diagnose
from bussim.site.file import load
from bussim.site.link import SiteLink, SteadyNoise
from bussim.site.noise.lenses import poisson_mean
from bussim.site.noise.picture import Fails, picture
from bussim.site.plan import EVENTS, plan
from bussim.site.readout import Readout
from bussim.site.writing import readout_data
from tests.site.machines import CAUSES, machine, noted
from tests.site.noisy_links import noisy

KINDS = ("wire", "receivers", "lost", "mixed", "bursts")
POLICIES = [
    {"absent_station": absent.value, "error_count": counted.value}
    for absent in AbsentStation
    for counted in ErrorCount
]
#: Longer than this no plan is simulated.
LONGEST_S = 20 * 3600


@dataclass
class Tally:
    """How often each figure was tried and right, and the figures whose median counts: widths, greatest by least."""

    tried: Counter[str] = field(default_factory=Counter)
    right: Counter[str] = field(default_factory=Counter)
    medians: dict[str, list[float]] = field(default_factory=dict)

    def add(self, found: Mapping[str, bool]) -> None:
        """Count what was tried at one link."""
        self.tried.update(found.keys())
        self.right.update(name for name, right in found.items() if right)

    def __str__(self) -> str:
        lines = [
            f"  {name:<22} {self.right[name]:>5} of {tried:>5}  {self.right[name] / tried:.1%}"
            for name, tried in self.tried.items()
        ]
        lines += [
            f"  {name:<22} median {median(each):.2f} of {len(each)}" for name, each in self.medians.items()
        ]
        return "\n".join(lines)


def read(data: dict[str, Any]) -> Readout:
    """What a readout says that lies in a file."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "readout.yaml"
        path.write_text(dumped(data), encoding="utf-8")
        paper = load(path)
    assert isinstance(paper, Readout)
    return paper


def links(seeds: range) -> Tally:
    """Intervals of the noise of links of each kind, all four policies of the master in turn.

    One station a link, as those on one wire are not independent. Beside the width of an interval of S stands the
    width that the number of events alone allows.
    """
    tally = Tally()
    for seed in seeds:
        for kind in KINDS:
            data, truth = noisy(500 + seed, kind, **POLICIES[seed % 4])
            paper = read(data)
            link = SiteLink.of(paper)
            found = picture(paper, link)
            tally.add({f"bursts {truth['bursts']}": found.bursts == "seen"})
            if truth["bursts"]:
                for k, fails in found.fails.items():
                    tally.add({"fails in bursts": fails.low <= truth["fails"][k] <= fails.high})
                continue
            k = Random(seed).randint(1, link.settings.slaves)
            least, _, most = found.measured.scans
            fails = found.fails[k]
            tests = {
                "N": least - 1 <= truth["scans"] <= most + 1,
                "fails": fails.low <= truth["fails"][k] <= fails.high,
            }
            true = {
                "M": truth["fails"][k],
                "S": truth["slaves"][k],
                "L": truth["receivers"][k],
                "E": truth["any"],
                "T": truth["silent"],
            }
            for name, value in true.items():
                lens = found.measured.of(name, k if name in "MSL" else None)
                if lens is None:
                    continue
                tests[name if lens.count else "bounds"] = lens.low <= value <= lens.high
                if not lens.count or lens.low <= 0:
                    continue
                named = {"S": "S", "E": "E", "M": "M at n = 1" if link.n == 1 else ""}.get(name)
                if named:
                    tally.medians.setdefault(f"width {named}", []).append(lens.high / lens.low)
                    low, high = poisson_mean(lens.count)
                    tally.medians.setdefault(f"width {named} by count", []).append(high / low)
            tally.add(tests)
    return tally


def machines(seeds: range) -> Tally:
    """Diagnoses of machines with each cause, of all stations with RUN state and lamps."""
    tally = Tally()
    for seed in seeds:
        for cause in CAUSES:
            paper = read(noted(*machine(cause, 1000 + seed)))
            causes = diagnose(paper, SiteLink.of(paper)).causes
            group = Finding(Cause(cause), None, 0, ()).group
            tests = {
                "among three": cause in [one.cause.value for one in causes[:3]],
                "first group": bool(causes) and causes[0].group == group,
            }
            if causes and (len(causes) == 1 or causes[0].score - causes[1].score >= 3):
                tests["first with a lead of 3"] = causes[0].cause.value == cause
            tally.add(tests)
    return tally


def plans(seeds: range) -> Tally:
    """Whether so many events come in the planned time that the interval's ends differ by a factor of 4 at most.

    The plan is made with the link's true probabilities, and the link is watched in a simulation of its own.
    """
    tally = Tally()
    for seed in seeds:
        data, truth = noisy(900 + seed, "wire", **POLICIES[seed % 4])
        link = SiteLink.of(read(data))
        true = {k: Fails(p, p, p, "true") for k, p in truth["fails"].items()}
        watches = {
            watch.reading.split(" at ")[0]: watch
            for watch in plan(replace(picture(read(data), link), fails=true))[:2]
        }
        for reading, watch in watches.items():
            if watch.seconds is None or watch.seconds > LONGEST_S:
                continue
            scenario = replace(
                link.scenario(SteadyNoise(truth["slaves"][1])),
                duration=round(watch.seconds * 72_000_000),
                seed=seed + 1,
            )
            result = run(scenario)
            assert result.totals is not None
            if reading == "the ladder":
                times, least = result.link_scans["duration_ms"].to_numpy(), link.thresholds()[0]
                count = int(((times[1:] >= least) & (times[:-1] < least)).sum())
            else:
                count = readout_data(scenario, result.totals)["stations"][1]["after"].get("D8203", 0)
            low, high = poisson_mean(count)
            tally.add({reading: low > 0 and high <= 4 * low})
            tally.medians.setdefault(f"{reading}: events, {EVENTS} planned", []).append(count)
    return tally


ROWS = {"links": (links, 80), "machines": (machines, 15), "plans": (plans, 200)}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rows", nargs="*", metavar="ROW", help=", ".join(ROWS))
    parser.add_argument("--seeds", type=int, metavar="N", help="seeds of each row")
    parser.add_argument("--first", type=int, default=0, metavar="N", help="the first seed (0)")
    given = parser.parse_args()
    for row in given.rows or ROWS:
        each, many = ROWS[row]
        seeds = range(given.first, given.first + (given.seeds or many))
        print(f"{row}: {len(seeds)} seeds\n{each(seeds)}", flush=True)  # noqa: T201 - it is a program
