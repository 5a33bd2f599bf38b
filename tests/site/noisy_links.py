"""Random links with noise, simulated, read twice with the ladder between, and what was true of them."""

import math
from random import Random
from typing import Any

from bussim.api import run
from bussim.exact.from_scenario import from_scenario
from bussim.exact.scan.memoryless import probabilities_of
from bussim.scenario.loader import from_data
from bussim.site.forms import Settings
from bussim.site.link import SiteLink
from bussim.site.readout import SiteProfile
from bussim.site.writing import readout_data
from tests.site.machines import PLACES

BEFORE = 60


def noisy(seed: int, kind: str, **profile: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """A readout of a link with noise of a kind (wire, receivers, lost, mixed, bursts) and the truth."""
    random = Random(f"{kind} {seed}")
    slaves, mode, minutes = random.randint(2, 7), random.randint(0, 2), random.randint(5, 15)
    retries, timeout = random.choice((0, 1, 3)), random.choice((50, 80, 100))
    places = PLACES[: slaves + 1]

    def rate(low: float, high: float) -> float:
        return float(low * (high / low) ** random.random())

    noise: list[dict[str, Any]] = []
    if kind in ("wire", "mixed"):
        noise.append({"bus": "link", "ber": rate(2e-7, 5e-5)})
    if kind in ("receivers", "mixed"):
        noise += [
            {"bus": "link", "station": place, "direction": "rx", "ber": rate(2e-7, 5e-5)} for place in places
        ]
    if kind in ("lost", "mixed"):
        noise += [{"bus": "link", "station": place, "reply_loss": rate(1e-4, 5e-2)} for place in places[1:]]
    if kind == "bursts":
        burst = {
            "good": f"{random.randint(2, 20)} s",
            "bad": f"{random.randint(50, 400)} ms",
            "ber_good": 0,
            "ber_bad": rate(3e-3, 3e-2),
        }
        noise.append({"bus": "link", "burst": burst})
    form = {"base": "pw10", **profile}
    plcs = []
    for number, place in enumerate(places):
        link: dict[str, Any] = {"bus": "link", "port": "COM4", "station": number}
        if number == 0:
            link |= {"slaves": slaves, "mode": mode, "retries": retries, "timeout": f"{timeout} ms"}
        plcs.append({"name": place, "profile": form, "scan": "8 ms", "nn": link})
    data = {
        "schema": 1,
        "name": kind,
        "duration": f"{BEFORE} s",
        "seed": seed + 1,
        "plcs": plcs,
        "noise": noise,
    }
    data["buses"] = [{"name": "link", "nn": True, "contention": random.choice(("zero_wins", "undefined"))}]
    before = from_data(data)
    after = from_data({**data, "duration": f"{BEFORE + 60 * minutes} s"})
    first, last = run(before, rows=False).totals, run(after)
    assert first is not None
    assert last.totals is not None
    readout = readout_data(after, last.totals)
    for station, then in zip(readout["stations"], readout_data(before, first)["stations"], strict=True):
        station["before"] = then["after"]
    readout |= {"watched": f"{60 * minutes} s", "started": f"{BEFORE} s before the first reading"}
    settings = Settings.model_construct(slaves=slaves, mode=mode, retries=retries, timeout=timeout * 72_000)
    thresholds = [math.ceil(each) for each in SiteLink(SiteProfile(form), settings, places).thresholds()]
    scans = last.link_scans
    seen = scans["start_s"] + scans["duration_ms"] / 1000 > BEFORE
    times = (scans["duration_ms"][seen] + 0.5).astype(int).to_numpy()
    rises = [
        int(((times[1:] >= least) & (times[:-1] < least)).sum() + (times[0] >= least)) for least in thresholds
    ]
    readout["ladder"] = {"thresholds_ms": thresholds, "rises": rises, "max_ms": int(times.max())}
    truth: dict[str, Any] = {"scans": int(seen.sum()), "bursts": kind == "bursts"}
    if kind == "bursts":
        link = last.totals.links[0]
        failed = {k: sum(link.failed_attempts.get(k, {}).values()) for k in range(1, slaves + 1)}
        # Each exchange has one attempt that does not fail, unless it ends in a station error.
        tried = {k: link.polls / slaves + count - link.station_errors[k] for k, count in failed.items()}
        truth["fails"] = {k: failed[k] / tried[k] for k in failed}
    else:
        ends = probabilities_of(from_scenario(after)["link"])
        truth["fails"] = {k: end.failed for k, end in enumerate(ends, 1)}
        truth["any"] = 1 - math.prod(1 - end.failed for end in ends)
        truth["silent"] = sum(end.silent for end in ends) / sum(end.failed for end in ends)
    wire = sum(each["ber"] for each in noise if "ber" in each and "station" not in each)
    own = {each["station"]: each["ber"] for each in noise if each.get("direction") == "rx"}
    truth["receivers"] = {number: own.get(place, 0.0) for number, place in enumerate(places) if number}
    truth["slaves"] = {number: wire + ber for number, ber in truth["receivers"].items()}
    return readout, truth
